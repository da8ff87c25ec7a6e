//! Rules that hold for every file of the program and its crates. Each reports all offenders at once, with file and line,
//! and each is shown to fail on a snippet that breaks it.
//!
//! Code that only tests see (`#[cfg(test)]`) is exempt except from the rules about the opening sentence, `unsafe`
//! and machine paths. The documents about the source text are read here too: they name files that exist.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::too_many_lines,
    reason = "a test fails by panicking, its helpers too, and is one story"
)]

#[path = "house_rules/circles.rs"]
mod circles;
#[path = "house_rules/source.rs"]
mod source;

use circles::Uses;
use source::Source;
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::Path;
use std::sync::LazyLock;

/// The rooms; each uses only those before it. Between crates the compiler sees to that.
const ROOMS: [&str; 15] = [
    "domain",
    "wire",
    "toml_file",
    "profile",
    "vendors",
    "drive",
    "journal",
    "guard",
    "line",
    "gateway",
    "north",
    "config",
    "sim",
    "daemon",
    "cli",
];
/// The folders of the daemon, and its files that have none; each uses only those before it.
const DAEMON: [&str; 16] = [
    "host",
    "qualified_file",
    "port",
    "exchange",
    "journal",
    "trends",
    "line_thread",
    "local",
    "lines",
    "scan",
    "commissioning",
    "modbus_server",
    "modbus_rtu",
    "mqtt",
    "http",
    "service",
];
/// The folders of the command line, likewise.
const CLI: [&str; 3] = ["help", "tools", "commands"];
/// The one file with `unsafe`.
const UNSAFE_FILE: &str = "src/daemon/host/sys.rs";
/// A file that grows beyond this has two things in it.
const MAX_LINES: usize = 600;
/// Beginnings of paths of one machine, in two parts so that this file does not break its own rule.
const MACHINE_PATHS: [(&str, &str); 4] = [
    ("/ho", "me/"),
    ("/ro", "ot/"),
    ("/wo", "rk/"),
    ("/Us", "ers/"),
];

/// Beginnings of paths that only the program names. Its crates have no dependency that does IO.
const IO_PATHS: [&[&str]; 9] = [
    &["std", "env"],
    &["std", "fs"],
    &["std", "net", "TcpListener"],
    &["std", "net", "TcpStream"],
    &["std", "net", "UdpSocket"],
    &["std", "os"],
    &["std", "process"],
    &["std", "thread"],
    &["std", "time", "SystemTime"],
];
/// Names that read a clock, however they came into scope.
const CLOCKS: [&str; 3] = ["Instant", "SystemTime", "UNIX_EPOCH"];

type Rule = fn(&Source) -> Vec<String>;

/// What `path` names in `source`, from the crate's root; empty if it begins with neither `crate` nor `super`.
fn from_root<'p>(source: &'p Source, path: &'p [String]) -> Vec<&'p str> {
    let mut modules = source.modules();
    let supers = path.iter().take_while(|part| *part == "super").count();
    let rest = match path[0].as_str() {
        first if first == "crate" || first.starts_with("vfd_") => {
            modules.clear();
            &path[1..]
        }
        "super" if supers <= modules.len() => {
            modules.truncate(modules.len() - supers);
            &path[supers..]
        }
        _ => return Vec::new(),
    };
    modules.extend(rest.iter().map(String::as_str));
    modules
}

fn rooms_use_only_rooms_before_them(source: &Source) -> Vec<String> {
    let room = source.room();
    let mut wrong = Vec::new();
    for (line, path) in &source.paths {
        let used = from_root(source, path).first().copied();
        if let Some(used) = used.filter(|used| ROOMS.contains(used) && !may_use(room, used)) {
            wrong.push(source.at(*line, &format!("{room} must not use {used}")));
        }
    }
    wrong
}

/// The folders of `room` in the order in which they may use each other; `None` if they have none.
fn folders_of(room: &str) -> Option<&'static [&'static str]> {
    match room {
        "daemon" => Some(&DAEMON),
        "cli" => Some(&CLI),
        _ => None,
    }
}

fn folders_use_only_folders_before_them(source: &Source) -> Vec<String> {
    let modules = source.modules();
    // The room's own file is above all of them, and none uses it.
    let [room, folder, ..] = modules[..] else {
        return Vec::new();
    };
    let Some(folders) = folders_of(room) else {
        return Vec::new();
    };
    let place = |folder: &str| folders.iter().position(|it| *it == folder);
    let mut wrong = Vec::new();
    for (line, path) in &source.paths {
        let used = from_root(source, path);
        let [other, used, ..] = used[..] else {
            continue;
        };
        let is_before =
            place(used).is_some_and(|used| place(folder).is_some_and(|own| used <= own));
        if other == room && !is_before {
            wrong.push(source.at(*line, &format!("{folder} must not use {used}")));
        }
    }
    wrong
}

fn no_command_uses_another_one(source: &Source) -> Vec<String> {
    let modules = source.modules();
    let ["cli", "commands", command, ..] = modules[..] else {
        return Vec::new();
    };
    let mut wrong = Vec::new();
    for (line, path) in &source.paths {
        let used = from_root(source, path);
        let ["cli", "commands", other, ..] = used[..] else {
            continue;
        };
        if other != command {
            wrong.push(source.at(
                *line,
                &format!("{command} must not use {other}: what both need is a tool"),
            ));
        }
    }
    wrong
}

fn may_use(room: &str, used: &str) -> bool {
    let place = |room| {
        ROOMS
            .iter()
            .position(|it| *it == room)
            .unwrap_or(ROOMS.len())
    };
    if room == used || room == "lib" {
        return true;
    }
    if used == "vendors" {
        ["config", "sim", "cli"].contains(&room)
    } else {
        place(used) < place(room)
    }
}

fn a_file_begins_with_a_sentence(source: &Source) -> Vec<String> {
    let paragraph: Vec<_> = source
        .text
        .lines()
        .map_while(|line| line.strip_prefix("//! "))
        .collect();
    let is_sentence = paragraph.concat().trim_end().ends_with(['.', ':']);
    if is_sentence {
        Vec::new()
    } else {
        vec![source.at(1, "does not begin with a `//!` sentence")]
    }
}

/// The makers and series that have model files. A series may be a bare number, which names no vendor.
static VENDOR_NAMES: LazyLock<BTreeSet<String>> = LazyLock::new(|| {
    let is_name = |name: &String| *name != "generic" && !name.bytes().all(|it| it.is_ascii_digit());
    vfd_gateway::vendors::texts()
        .iter()
        .flat_map(|(file, _)| file.trim_end_matches(".toml").split('/'))
        .flat_map(|name| {
            [
                name.to_owned(),
                name.replace('-', "_"),
                name.replace('-', ""),
            ]
        })
        .filter(is_name)
        .collect()
});

fn vendors_are_named_only_in_their_room(source: &Source) -> Vec<String> {
    if source.room() == "vendors" {
        return Vec::new();
    }
    let mut wrong = Vec::new();
    for (line, text) in numbered(&source.shipped) {
        let text = text.to_lowercase();
        let is_part = char::is_alphanumeric;
        for name in VENDOR_NAMES.iter() {
            let is_whole = |(at, _): (usize, &str)| {
                !text[..at].ends_with(is_part) && !text[at + name.len()..].starts_with(is_part)
            };
            if text.match_indices(name.as_str()).any(is_whole) {
                wrong.push(source.at(line, &format!("names {name}")));
            }
        }
    }
    wrong
}

fn unsafe_stands_in_one_file(source: &Source) -> Vec<String> {
    if source.path == UNSAFE_FILE {
        return Vec::new();
    }
    let is_unsafe = |(_, word): &&(usize, String)| word == "unsafe" || word == "unsafe_code";
    source
        .words
        .iter()
        .filter(is_unsafe)
        .map(|(line, _)| source.at(*line, "unsafe"))
        .collect()
}

fn io_and_clocks_stay_in_the_program(source: &Source) -> Vec<String> {
    // A build script is of the machine that builds.
    if source.path.starts_with("src/") || source.path.ends_with("/build.rs") {
        return Vec::new();
    }
    let is_io = |path: &[String]| {
        let begins_with = |io: &&[&str]| {
            path.len() >= io.len() && path.iter().zip(*io).all(|(one, other)| one == other)
        };
        IO_PATHS.iter().any(begins_with) || path.iter().any(|part| CLOCKS.contains(&part.as_str()))
    };
    let found = source.paths.iter().filter(|(_, path)| is_io(path));
    found
        .map(|(line, path)| source.at(*line, &format!("names {}", path.join("::"))))
        .collect()
}

fn files_are_short(source: &Source) -> Vec<String> {
    let lines = source.text.lines().zip(source.shipped.lines());
    let count = lines
        .filter(|(text, shipped)| text.is_empty() || !shipped.trim().is_empty())
        .count();
    if count <= MAX_LINES {
        return Vec::new();
    }
    vec![source.at(
        1,
        &format!("{count} lines without tests, more than {MAX_LINES}"),
    )]
}

fn no_path_of_one_machine(source: &Source) -> Vec<String> {
    let names_one = |text: &str| {
        MACHINE_PATHS
            .iter()
            .any(|(one, other)| text.contains(&format!("{one}{other}")))
    };
    let lines = numbered(&source.text).filter(|(_, text)| names_one(text));
    lines
        .map(|(line, _)| source.at(line, "names a path of one machine"))
        .collect()
}

#[track_caller]
fn assert_holds(rule: Rule) {
    let mut wrong = String::new();
    for offence in sources().iter().flat_map(rule) {
        let _ = writeln!(wrong, "{offence}");
    }
    assert!(wrong.is_empty(), "\n{wrong}");
}

/// `bad` in the file `path` is found at `line`, and `good` is not.
#[track_caller]
fn assert_bites(rule: Rule, path: &str, bad: &str, line: usize, good: &str) {
    let found = rule(&Source::new(path, bad));
    assert!(
        found
            .iter()
            .any(|offence| offence.starts_with(&format!("{path}:{line}: "))),
        "{found:?} in\n{bad}"
    );
    assert_eq!(rule(&Source::new(path, good)), [""; 0], "in\n{good}");
}

#[test]
fn rooms_use_only_rooms_before_them_everywhere() {
    let rule = rooms_use_only_rooms_before_them;
    assert_bites(
        rule,
        "crates/line/src/line/timing.rs",
        "\nuse crate::gateway::LineCore;",
        2,
        "use crate::domain::time;",
    );
    assert_bites(
        rule,
        "crates/line/src/line/timing.rs",
        "use super::super::north;",
        1,
        "use super::station;",
    );
    assert_bites(
        rule,
        "crates/line/src/line/mod.rs",
        "use super::north::modbus;",
        1,
        "pub mod north;",
    );
    assert_bites(
        rule,
        "crates/model/src/wire/pdu.rs",
        "use crate::{\n domain::time,\n line::{fault, timing},\n};",
        3,
        "",
    );
    assert_bites(
        rule,
        "crates/drive/src/drive/plan.rs",
        "use vfd_model::vendors;",
        1,
        "#[cfg(test)]\nuse crate::guard::review;",
    );
    assert_bites(
        rule,
        "src/daemon/service/run.rs",
        "use crate::vendors;",
        1,
        "use crate::sim;",
    );
    assert_bites(
        rule,
        "crates/model/src/domain/ids.rs",
        "use vfd_gateway::cli;",
        1,
        "",
    );
    assert_holds(rule);
}

#[test]
fn folders_use_only_folders_before_them_everywhere() {
    let rule = folders_use_only_folders_before_them;
    let good = "use crate::daemon::host::timer;\nuse super::clock;\nuse crate::config;";
    assert_bites(
        rule,
        "src/daemon/host/sys.rs",
        "\nuse crate::daemon::port::Port;",
        2,
        good,
    );
    assert_bites(
        rule,
        "src/daemon/port/mod.rs",
        "use super::journal;",
        1,
        "use super::host::sys;\nuse tcp::Lookup;",
    );
    assert_bites(
        rule,
        "src/daemon/local.rs",
        "use crate::daemon::{\n host,\n lines::build,\n};",
        3,
        "",
    );
    assert_bites(
        rule,
        "src/daemon/http/live/mod.rs",
        "let x = super::super::service::run();",
        1,
        "use super::routes;",
    );
    assert_bites(
        rule,
        "src/daemon/new.rs",
        "use super::host;",
        1,
        "#[cfg(test)]\nuse super::host;",
    );
    assert_bites(
        rule,
        "src/cli/tools/log.rs",
        "use crate::cli::commands::run;",
        1,
        "use super::failure;",
    );
    assert_bites(
        rule,
        "src/cli/commands/run.rs",
        "use crate::cli::Cli;",
        1,
        "use crate::cli::tools::print;",
    );
    assert_eq!(
        rule(&Source::new(
            "src/cli/mod.rs",
            "use commands::run;\nuse crate::cli::tools;"
        )),
        [""; 0]
    );
    assert_holds(rule);
    let sources = sources();
    for (room, folders) in [("daemon", &DAEMON[..]), ("cli", &CLI[..])] {
        let ships = sources
            .iter()
            .filter(|source| !source.shipped.trim().is_empty());
        let found: BTreeSet<_> = ships
            .map(Source::modules)
            .filter(|it| it.len() > 1 && it[0] == room)
            .collect();
        let found: BTreeSet<_> = found.iter().map(|modules| modules[1]).collect();
        let known: BTreeSet<_> = folders.iter().copied().collect();
        assert_eq!(found, known, "the folders of {room}");
    }
}

#[test]
fn no_command_uses_another_command() {
    let rule = no_command_uses_another_one;
    let good =
        "use super::Args;\nuse crate::cli::commands::watch::view;\nuse crate::cli::tools::reading;";
    assert_bites(
        rule,
        "src/cli/commands/watch/view.rs",
        "\nuse crate::cli::commands::read::Shown;",
        2,
        good,
    );
    assert_bites(
        rule,
        "src/cli/commands/run.rs",
        "use super::init;",
        1,
        "use super::super::tools;",
    );
    assert_eq!(
        rule(&Source::new(
            "src/cli/commands/mod.rs",
            "use super::commands::init;"
        )),
        [""; 0]
    );
    assert_holds(rule);
}

#[test]
fn every_file_begins_with_a_sentence() {
    let rule = a_file_begins_with_a_sentence;
    assert_bites(
        rule,
        "crates/line/src/line/timing.rs",
        "use std::time;\n",
        1,
        "//! What silences\n//! cost.\n//!\n//! | a |\n",
    );
    assert_bites(
        rule,
        "crates/line/src/line/timing.rs",
        "//! TODO\n",
        1,
        "//! What silences cost.\n",
    );
    assert_holds(rule);
}

#[test]
fn no_vendor_is_named_outside_its_room() {
    let rule = vendors_are_named_only_in_their_room;
    assert_bites(
        rule,
        "crates/line/src/line/timing.rs",
        "\n// as the N700 wants it",
        2,
        "// a plan700, protecol",
    );
    assert_bites(
        rule,
        "src/cli/commands/demo.rs",
        "let id = \"hyundai-n700\";",
        1,
        "#[cfg(test)]\nmod tests { /* N700 */ }",
    );
    assert_bites(
        rule,
        "src/cli/commands/demo.rs",
        "#[cfg(test)]\nmod tests {}\nconst TECO: u8 = 1;",
        3,
        "",
    );
    assert_eq!(
        rule(&Source::new(
            "crates/model/src/vendors/mod.rs",
            "// Toshiba"
        )),
        [""; 0]
    );
    assert_holds(rule);
}

#[test]
fn unsafe_is_in_one_file() {
    let rule = unsafe_stands_in_one_file;
    assert_bites(
        rule,
        "src/daemon/port.rs",
        "\nunsafe { x() }",
        2,
        "// unsafe\nlet unsafely = \"unsafe\";",
    );
    assert_bites(
        rule,
        "src/daemon/port.rs",
        "#[cfg(test)]\nmod tests {\n #![allow(unsafe_code)]\n}",
        3,
        "",
    );
    assert_eq!(rule(&Source::new(UNSAFE_FILE, "unsafe { x() }")), [""; 0]);
    assert_holds(rule);
    let others: Vec<_> = ["tests", "benches", "fleet", "fuzz/src", "fuzz/fuzz_targets"]
        .iter()
        .flat_map(|it| read(it))
        .collect();
    assert!(
        others.len() > 100,
        "{} files beside the program",
        others.len()
    );
    let wrong: Vec<_> = others.iter().flat_map(rule).collect();
    assert_eq!(wrong, [""; 0]);
}

#[test]
fn no_crate_knows_clocks_files_sockets_or_threads() {
    let rule = io_and_clocks_stay_in_the_program;
    let good = "use std::net::{IpAddr, SocketAddr};\nuse std::path::PathBuf;\n// std::fs\nlet x = \"std::fs\";";
    assert_bites(
        rule,
        "crates/line/src/line/timing.rs",
        "use std::{fmt, fs};",
        1,
        good,
    );
    assert_bites(
        rule,
        "crates/line/src/line/timing.rs",
        "\nuse std::net::{IpAddr, TcpStream};",
        2,
        good,
    );
    assert_bites(
        rule,
        "crates/line/src/line/timing.rs",
        "let now = Instant::now();",
        1,
        "let now = MonoTime::ZERO;",
    );
    assert_bites(
        rule,
        "crates/config/src/config/read.rs",
        "std::process::exit(x)",
        1,
        "let process = 1;",
    );
    assert_bites(
        rule,
        "crates/config/src/config/read.rs",
        "std::thread::sleep(x)",
        1,
        "#[cfg(test)]\nfn f() { std::thread::x() }",
    );
    assert_eq!(
        rule(&Source::new("src/daemon/service/run.rs", "use std::fs;")),
        [""; 0]
    );
    assert_holds(rule);
}

#[test]
fn no_file_is_long() {
    let rule = files_are_short;
    let lines = |count: usize| "let x = 1;\n".repeat(count);
    let tests = format!(
        "{}#[cfg(test)]\nmod tests {{\n{}}}\n",
        lines(MAX_LINES),
        lines(MAX_LINES)
    );
    assert_bites(
        rule,
        "crates/line/src/line/timing.rs",
        &lines(MAX_LINES + 1),
        1,
        &tests,
    );
    assert_holds(rule);
}

#[test]
fn no_file_names_a_path_of_one_machine() {
    let rule = no_path_of_one_machine;
    for (one, other) in MACHINE_PATHS {
        assert_bites(
            rule,
            "src/cli/commands/run.rs",
            &format!("// see {one}{other}x"),
            1,
            "// see /etc/x",
        );
    }
    assert_holds(rule);
}

#[test]
fn the_design_documents_name_files_that_exist() {
    let known = BTreeSet::from([
        "crates/drive/src/guard/state.rs".to_owned(),
        "src/guard".to_owned(),
    ]);
    let text = "`guard/state.rs`, `state.rs`, `guard/`, `ard/state.rs`, `/api/`, `tcp://`, `x.rs`\n```\n`y.rs`\n```\n`z.rs`";
    assert_eq!(
        unknown_files(text, &known),
        ["ard/state.rs", "x.rs", "z.rs"]
    );
    let known = everything_below(Path::new(env!("CARGO_MANIFEST_DIR")));
    for (file, text) in design_documents() {
        assert_eq!(unknown_files(&text, &known), [""; 0], "in {file}");
    }
}

#[test]
fn the_map_finds_what_it_says() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let map = std::fs::read_to_string(root.join("ARCHITECTURE.md")).unwrap();
    let (_, rest) = map.split_once("\n## Where to find\n").unwrap();
    let (table, _) = rest.split_once("\n## ").unwrap();
    let answers: Vec<_> = table.lines().flat_map(answers).collect();
    assert!(answers.len() > 20, "{answers:?}");
    for (file, names) in answers {
        let path = place_of(file).expect(file);
        let text = if path.is_dir() {
            String::new()
        } else {
            std::fs::read_to_string(&path).expect(file)
        };
        for name in names {
            let last = name.rsplit("::").next().unwrap_or(name);
            assert!(
                words(&text).any(|word| word == last),
                "{file} has no {name}"
            );
        }
    }
}

#[test]
fn no_more_than_three_files_use_each_other_in_a_circle() {
    let sources = sources();
    let circles = Uses::of(&sources).circles(3);
    assert!(circles.is_empty(), "\n{}", circles.join("\n"));
}

#[test]
fn files_below_a_test_are_found() {
    let tests = BTreeSet::from(["src/a/tests".to_owned()]);
    for (path, is_below_tests) in [
        ("src/a/tests.rs", true),
        ("src/a/tests/mod.rs", true),
        ("src/a/tests/b/c.rs", true),
        ("src/a/tests_of_drives.rs", false),
        ("src/a/b.rs", false),
    ] {
        assert_eq!(is_below(path, &tests), is_below_tests, "{path}");
    }
    assert!(sources().len() > 50, "the sources are found");
}

/// The map for those who change the program, its details, and how a change is made.
fn design_documents() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let details = std::fs::read_dir(root.join("docs/design"))
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let beside = ["ARCHITECTURE.md", "CONTRIBUTING.md"].map(|file| root.join(file));
    let files: Vec<_> = details.chain(beside).collect();
    assert!(files.len() > 10, "{files:?}");
    files
        .iter()
        .map(|file| {
            (
                file.display().to_string(),
                std::fs::read_to_string(file).unwrap(),
            )
        })
        .collect()
}

/// The files and folders that `text` marks as code and that are not the end of any path in `known`.
fn unknown_files<'t>(text: &'t str, known: &BTreeSet<String>) -> Vec<&'t str> {
    let is_file = |code: &&str| {
        let ends_like_one = code.ends_with('/')
            || [".rs", ".toml", ".js"]
                .iter()
                .any(|end| code.ends_with(end));
        ends_like_one
            && !code.starts_with('/')
            && !code.contains("://")
            && !code.contains(char::is_whitespace)
    };
    let is_known = |file: &&str| {
        let end = format!("/{}", file.trim_end_matches('/'));
        known
            .iter()
            .any(|path| *path == end[1..] || path.ends_with(&end))
    };
    text.split("```")
        .step_by(2)
        .flat_map(codes)
        .filter(is_file)
        .filter(|file| !is_known(file))
        .collect()
}

/// Each file that a row of the map names, with the names in it that follow.
fn answers(row: &str) -> Vec<(&str, Vec<&str>)> {
    let mut found: Vec<(&str, Vec<&str>)> = Vec::new();
    for code in codes(row) {
        match found.last_mut() {
            _ if code.contains('/') => found.push((code, Vec::new())),
            Some((_, names)) => names.push(code),
            None => {}
        }
    }
    found
}

/// What `prose` marks as code.
fn codes(prose: &str) -> impl Iterator<Item = &str> {
    prose.split('`').skip(1).step_by(2)
}

/// The paths of all files and folders that belong to the repository, from its root.
fn everything_below(root: &Path) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            // What tools put there is of others.
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if name.starts_with('.') || name == "target" || name == "node_modules" {
                continue;
            }
            found.insert(
                path.strip_prefix(root)
                    .unwrap()
                    .to_string_lossy()
                    .into_owned(),
            );
            if path.is_dir() {
                folders.push(path);
            }
        }
    }
    found
}

/// The file or folder that documents call `file`, which begins with its room or, for the program's own, with a file of it.
fn place_of(file: &str) -> Option<std::path::PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let crates = std::fs::read_dir(root.join("crates")).unwrap();
    let folders = crates.map(|entry| entry.unwrap().path().join("src"));
    let mut places = folders.chain([root.join("src")]).map(|it| it.join(file));
    places.find(|place| place.exists())
}

/// All files of the program and of its crates.
fn sources() -> Vec<Source> {
    let mut sources = read("src");
    sources.extend(read("crates"));
    let mut for_tests = BTreeSet::new();
    for source in &sources {
        for name in &source.test_modules {
            for_tests.insert(format!("{}/{name}", source.folder()));
        }
    }
    let is_for_tests = |source: &&mut Source| is_below(&source.path, &for_tests);
    sources
        .iter_mut()
        .filter(is_for_tests)
        .for_each(Source::only_for_tests);
    sources
}

/// All files in `folder`, in order.
fn read(folder: &str) -> Vec<Source> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    collect(&root.join(folder), &mut files);
    files.sort();
    let name = |file: &Path| {
        file.strip_prefix(root)
            .unwrap()
            .to_string_lossy()
            .into_owned()
    };
    files
        .iter()
        .map(|file| Source::new(&name(file), &std::fs::read_to_string(file).unwrap()))
        .collect()
}

/// Whether the file at `path` is one of `modules`, or belongs to one: what a module for tests declares is for tests.
fn is_below(path: &str, modules: &BTreeSet<String>) -> bool {
    let name = path.trim_end_matches(".rs");
    let mut ends = name
        .match_indices('/')
        .map(|(at, _)| at)
        .chain([name.len()]);
    ends.any(|end| modules.contains(&name[..end]))
}

fn collect(folder: &Path, files: &mut Vec<std::path::PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        // What tools put into `tests/` is of others.
        let is_own = path
            .file_name()
            .is_some_and(|name| !name.to_string_lossy().starts_with('.') && name != "node_modules");
        if path.is_dir() && is_own {
            collect(&path, files);
        } else if path.extension().is_some_and(|it| it == "rs") {
            files.push(path);
        }
    }
}

fn is_word_part(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c| !is_word_part(c))
}

fn numbered(text: &str) -> impl Iterator<Item = (usize, &str)> {
    (1..).zip(text.lines())
}
