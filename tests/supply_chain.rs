//! What the program is built from, as far as files tell it: packages and their licences, versions that stand in several
//! places, parts that are no packages, and the tests that SECURITY.md names. `tests/run deny` looks further, with cargo-deny.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::too_many_lines,
    reason = "a test fails by panicking, its helpers too, and is one story"
)]

#[path = "supply_chain/installing.rs"]
mod installing;

use serde_json::Value as Json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use toml::{Table, Value};

/// Where packages come from.
const REGISTRY: &str = "registry+https://github.com/rust-lang/crates.io-index";
const LOCK_FILES: [&str; 2] = ["Cargo.lock", "fuzz/Cargo.lock"];
/// What each exception in `deny.toml` must say: when it is no exception any more.
const END: &str = "goes";

#[test]
fn every_package_comes_from_the_registry_with_a_checksum() {
    for file in LOCK_FILES {
        let wrong: Vec<_> = packages(&toml_of(file))
            .into_iter()
            .filter(|package| !is_registered(package))
            .collect();
        assert!(wrong.is_empty(), "{file}: {wrong:?}");
    }
    let locked = |text: &str| is_registered(&text.parse().unwrap());
    let checksum = "0".repeat(64);
    assert!(locked(&format!(
        "name = 'x'\nsource = '{REGISTRY}'\nchecksum = '{checksum}'"
    )));
    assert!(!locked(&format!("name = 'x'\nsource = '{REGISTRY}'")));
    assert!(!locked(&format!(
        "name = 'x'\nsource = 'git+https://github.com/a/b'\nchecksum = '{checksum}'"
    )));
    assert!(!locked("name = 'x'"));
}

/// Whether the package is one of this repository.
fn is_own(package: &str) -> bool {
    package.starts_with("vfd-")
}

fn is_registered(package: &Table) -> bool {
    let text = |key: &str| package.get(key).and_then(Value::as_str);
    let has_checksum = text("checksum")
        .is_some_and(|sum| sum.len() == 64 && sum.bytes().all(|it| it.is_ascii_hexdigit()));
    let is_here = text("name").is_some_and(is_own) && text("source").is_none();
    is_here || (text("source") == Some(REGISTRY) && has_checksum)
}

#[test]
fn every_licence_is_allowed() {
    let deny = toml_of("deny.toml");
    let licences = deny["licenses"].as_table().unwrap();
    let everywhere = texts(&licences["allow"]);
    let exceptions = licences["exceptions"].as_array().unwrap();
    let mut wrong = Vec::new();
    for package in metadata()["packages"].as_array().unwrap() {
        let name = package["name"].as_str().unwrap();
        let own = exceptions
            .iter()
            .filter(|it| it["crate"].as_str() == Some(name));
        let allowed: Vec<_> = everywhere
            .iter()
            .cloned()
            .chain(own.flat_map(|it| texts(&it["allow"])))
            .collect();
        let licence = package["license"].as_str().unwrap_or_default();
        if !is_satisfied(licence, &allowed) {
            wrong.push(format!("{name}: {licence}"));
        }
    }
    assert!(wrong.is_empty(), "not allowed in deny.toml: {wrong:#?}");
}

#[test]
fn licences_are_read_as_they_are_meant() {
    let allowed = ["MIT", "Apache-2.0", "ISC"].map(str::to_owned);
    for good in [
        "MIT",
        "MIT OR GPL-3.0-only",
        "GPL-3.0-only OR MIT",
        "MIT/Apache-2.0",
        "Apache-2.0 AND ISC",
        "(MIT OR GPL-3.0-only) AND ISC",
        "Apache-2.0 WITH LLVM-exception OR MIT",
    ] {
        assert!(is_satisfied(good, &allowed), "{good}");
    }
    for bad in [
        "",
        "GPL-3.0-only",
        "MIT AND GPL-3.0-only",
        "(MIT OR ISC) AND GPL-3.0-only",
        "GPL-2.0-only OR GPL-3.0-only",
        "Apache-2.0 WITH LLVM-exception",
    ] {
        assert!(!is_satisfied(bad, &allowed), "{bad}");
    }
}

/// Whether `allowed` satisfies the SPDX expression. Some write `/` for OR.
fn is_satisfied(expression: &str, allowed: &[String]) -> bool {
    let spaced = expression
        .replace('/', " OR ")
        .replace('(', " ( ")
        .replace(')', " ) ");
    let words: Vec<_> = spaced.split_whitespace().collect();
    let mut rest = words.as_slice();
    let is_satisfied = either(&mut rest, allowed);
    is_satisfied && rest.is_empty()
}

fn either(rest: &mut &[&str], allowed: &[String]) -> bool {
    let mut is_one = both(rest, allowed);
    while take(rest, "OR") {
        is_one |= both(rest, allowed);
    }
    is_one
}

fn both(rest: &mut &[&str], allowed: &[String]) -> bool {
    let mut are_all = one(rest, allowed);
    while take(rest, "AND") {
        are_all &= one(rest, allowed);
    }
    are_all
}

fn one(rest: &mut &[&str], allowed: &[String]) -> bool {
    if take(rest, "(") {
        let is_inner = either(rest, allowed);
        return take(rest, ")") && is_inner;
    }
    let Some((name, after)) = rest.split_first() else {
        return false;
    };
    *rest = after;
    match rest {
        ["WITH", exception, ..] => {
            let whole = format!("{name} WITH {exception}");
            *rest = &rest[2..];
            allowed.contains(&whole)
        }
        _ => allowed.iter().any(|it| it == name),
    }
}

fn take(rest: &mut &[&str], word: &str) -> bool {
    let is_next = rest.first() == Some(&word);
    *rest = &rest[usize::from(is_next)..];
    is_next
}

/// An exception that nobody ends becomes the rule.
#[test]
fn every_exception_says_why_and_when_it_ends() {
    let deny = toml_of("deny.toml");
    let tables = [
        ("advisories", "ignore"),
        ("bans", "skip"),
        ("bans", "skip-tree"),
    ];
    for (section, list) in tables {
        for entry in deny[section][list].as_array().unwrap() {
            let reason = entry
                .get("reason")
                .and_then(Value::as_str)
                .unwrap_or_default();
            assert!(
                reason.contains(END),
                "[{section}] {list}: {entry} does not say when it goes"
            );
        }
    }
    // Exceptions of licences have no key for a reason: it stands above them.
    let text = read("deny.toml");
    let (_, exceptions) = text.split_once("exceptions = [\n").unwrap();
    let (exceptions, _) = exceptions.split_once("\n]").unwrap();
    let mut above = String::new();
    for line in exceptions.lines() {
        match line.trim().strip_prefix('#') {
            Some(comment) => above += comment,
            None => assert!(
                std::mem::take(&mut above).contains(END),
                "{line} does not say when it goes"
            ),
        }
    }
}

/// What stands in several places is the same in all of them.
#[test]
fn versions_agree() {
    let manifest = toml_of("Cargo.toml");
    let package = &manifest["workspace"]["package"];
    let (version, rust) = (
        package["version"].as_str().unwrap(),
        package["rust-version"].as_str().unwrap(),
    );
    let locked = packages(&toml_of("Cargo.lock"));
    let own = locked
        .iter()
        .find(|it| it["name"].as_str() == Some("vfd-gateway"))
        .unwrap();
    assert_eq!(own["version"].as_str(), Some(version), "Cargo.lock");

    let changes = read("CHANGELOG.md");
    let newest = changes.lines().find_map(|line| line.strip_prefix("## "));
    let expected = version.strip_suffix("-dev").map_or_else(
        || version.to_owned(),
        |coming| format!("{coming} (not released yet)"),
    );
    assert_eq!(
        newest,
        Some(&*expected),
        "the newest version in CHANGELOG.md is not that of Cargo.toml"
    );

    let tag = format!("newTag: {version}\n");
    assert!(
        read("deploy/kubernetes/kustomization.yaml").contains(&tag),
        "deploy/kubernetes takes another image"
    );

    let statement = format!("Rust {rust} or newer");
    assert!(
        read("README.md").contains(&statement),
        "README.md does not say {statement}"
    );
    assert_eq!(
        toml_of("fuzz/Cargo.toml")["package"]["edition"],
        package["edition"],
        "edition of fuzz"
    );
}

/// The compiler's image is of the Debian that the program runs on there, and new enough.
#[test]
fn the_images_of_the_dockerfile_fit_each_other() {
    let rust = toml_of("Cargo.toml")["workspace"]["package"]["rust-version"]
        .as_str()
        .unwrap()
        .to_owned();
    let images = images(&read("Dockerfile"));
    assert_eq!(unfit(&images, &rust), [""; 0]);
    let with = |lines: &str| unfit(&self::images(lines), "1.94");
    let fit =
        "FROM rust:1.95-slim-bookworm AS build\nFROM --platform=linux/arm64 debian:bookworm-slim\n";
    assert_eq!(with(fit), [""; 0]);
    assert_eq!(
        with(&fit.replace("rust:1.95", "rust:1.93")).len(),
        1,
        "too old"
    );
    assert_eq!(
        with(&fit.replace("debian:bookworm", "debian:trixie")).len(),
        1,
        "two releases"
    );
    let by_argument = "ARG DEBIAN=bookworm\nFROM rust:1-slim-${DEBIAN} AS build\nFROM debian:${DEBIAN}-slim\nFROM scratch\n";
    assert_eq!(with(by_argument), [""; 0]);
}

/// What `FROM` names, other stages left out; arguments as they are where nobody gives others.
fn images(dockerfile: &str) -> Vec<String> {
    let args = dockerfile
        .lines()
        .filter_map(|line| line.strip_prefix("ARG ")?.split_once('='));
    let args: Vec<_> = args.collect();
    let filled = |line: &str| {
        let fill = |line: String, (name, value): &(&str, &str)| {
            line.replace(&format!("${{{name}}}"), value)
        };
        args.iter().fold(line.to_owned(), fill)
    };
    let froms = dockerfile
        .lines()
        .filter_map(|line| line.strip_prefix("FROM "))
        .map(filled);
    let named = froms.filter_map(|rest| {
        rest.split(' ')
            .find(|word| !word.starts_with("--"))
            .map(str::to_owned)
    });
    named.filter(|image| image.contains(':')).collect()
}

fn unfit(images: &[String], rust: &str) -> Vec<String> {
    const RELEASES: [(&str, &str); 3] = [
        ("bookworm", "debian12"),
        ("trixie", "debian13"),
        ("forky", "debian14"),
    ];
    let is_of =
        |image: &str, names: &(&str, &str)| image.contains(names.0) || image.contains(names.1);
    let releases: BTreeSet<_> = RELEASES
        .iter()
        .filter(|names| images.iter().any(|image| is_of(image, names)))
        .collect();
    let mut wrong = Vec::new();
    if releases.len() != 1 {
        wrong.push(format!("one release of Debian is wanted, not {releases:?}"));
    }
    for tag in images
        .iter()
        .filter_map(|image| image.split_once("rust:").map(|(_, tag)| tag))
    {
        let numbers = |text: &str| {
            text.split(['.', '-'])
                .map_while(|part| part.parse().ok())
                .collect::<Vec<u32>>()
        };
        let (is, wanted) = (numbers(tag), numbers(rust));
        if is.len() > 1 && is < wanted {
            wrong.push(format!("rust:{tag} is older than rust-version {rust}"));
        }
    }
    wrong
}

/// A new release of somebody else's cannot change what a test means.
#[test]
fn every_python_package_has_one_version() {
    let folders =
        ["tests/process", "release"].map(|folder| root().join(folder).read_dir().unwrap());
    let files = folders
        .into_iter()
        .flatten()
        .map(|entry| entry.unwrap().path());
    let lists: Vec<_> = files
        .filter(|path| path.extension().is_some_and(|it| it == "txt"))
        .collect();
    assert!(lists.len() >= 4, "{lists:?}");
    for list in lists {
        let text = std::fs::read_to_string(&list).unwrap();
        let requirements = text
            .lines()
            .filter(|line| !line.is_empty() && !line.trim_start().starts_with(['#', '-']));
        let loose: Vec<_> = requirements.filter(|line| !line.contains("==")).collect();
        assert!(loose.is_empty(), "{}: {loose:?}", list.display());
    }
}

/// The program holds what is no package of Cargo. `release/parts.json` has it for notices and SBOM.
#[test]
fn parts_that_are_no_packages_are_listed_as_they_are() {
    let parts: Json = serde_json::from_str(&read("release/parts.json")).unwrap();
    let version = |name: &str| {
        let part = parts
            .as_array()
            .unwrap()
            .iter()
            .find(|part| part["component"]["name"] == name);
        let part = part.unwrap_or_else(|| panic!("no {name} in release/parts.json"));
        part["component"]["version"].as_str().unwrap().to_owned()
    };
    let chart = read("src/daemon/http/page/files/uplot.min.js");
    assert!(chart.starts_with(&format!(
        "/*! https://github.com/leeoniya/uPlot (v{}) */",
        version("uPlot")
    )));
    let header = folder_of("libsqlite3-sys").join("sqlite3/sqlite3.h");
    let header = std::fs::read_to_string(header).unwrap();
    let line = header
        .lines()
        .find(|line| line.starts_with("#define SQLITE_VERSION "))
        .unwrap();
    assert!(
        line.contains(&format!("\"{}\"", version("SQLite"))),
        "release/parts.json has not what is built: {line}"
    );
}

/// Whoever ships the program ships what others ask for in return.
#[test]
fn the_notices_name_every_part_of_the_program() {
    let place = Path::new(env!("CARGO_TARGET_TMPDIR")).join("notices");
    let output = Command::new("python3")
        .arg(root().join("release/notices"))
        .arg(&place)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let notices = std::fs::read_to_string(place.join("THIRD-PARTY-NOTICES.txt")).unwrap();
    for part in ["uPlot", "SQLite", "Rust standard library", "serialport"] {
        assert!(
            notices
                .lines()
                .any(|line| line.starts_with(&format!("{part} "))),
            "no {part}"
        );
    }
    let source = notices
        .lines()
        .find(|line| line.starts_with("serialport "))
        .unwrap();
    assert!(
        source.contains("https://crates.io/crates/serialport/"),
        "where its source is: {source}"
    );
    for text in [
        "Mozilla Public License",
        "Leon Sorokin",
        "Apache License",
        "BoringSSL",
    ] {
        assert!(notices.contains(text), "no text with {text}");
    }
    let tree = cargo(&[
        "tree",
        "--locked",
        "--offline",
        "-e",
        "normal,no-proc-macro",
        "--prefix",
        "none",
    ]);
    let crates: BTreeSet<_> = tree
        .lines()
        .filter_map(|line| line.split_once(" v"))
        .collect();
    assert!(crates.len() > 100, "{} crates", crates.len());
    for (name, rest) in crates.into_iter().filter(|(name, _)| !is_own(name)) {
        let version = rest.split(' ').next().unwrap();
        assert!(
            notices.contains(&format!("\n{name} {version}, ")),
            "no {name} {version}"
        );
    }
}

/// What is to be typed for a release is there.
#[test]
fn every_command_of_a_release_is_there() {
    let text = read("RELEASING.md");
    let scripts = [
        "tests/run",
        "fuzz/run",
        "release/build",
        "release/reproduce",
        "release/notices",
        "release/sign",
        "release/apt",
    ];
    for script in scripts {
        assert!(text.contains(script), "RELEASING.md does not name {script}");
        let mode = std::os::unix::fs::PermissionsExt::mode(
            &root().join(script).metadata().unwrap().permissions(),
        );
        assert_ne!(mode & 0o111, 0, "{script} cannot be run");
    }
    let parts = text
        .split("tests/run ")
        .skip(1)
        .filter_map(|rest| rest.split([' ', '\n', '`']).next());
    let known = read("tests/run");
    let unknown: Vec<_> = parts
        .filter(|part| !part.is_empty() && !known.contains(&format!("tests/run {part} ")))
        .collect();
    assert!(unknown.is_empty(), "tests/run has no part {unknown:?}");
}

/// What is made after the signature would go out unsigned, and an image without its commit could be of any.
#[test]
fn all_that_is_released_is_made_before_it_is_signed() {
    let text = read("RELEASING.md");
    let (_, made) = text.split_once("## What is made").unwrap();
    let commands: Vec<_> = made.split("```").nth(1).unwrap().lines().collect();
    let at = |begin: &str| {
        let at = commands.iter().position(|line| line.starts_with(begin));
        at.unwrap_or_else(|| panic!("there is no {begin}"))
    };
    let signed = at("release/sign \"$out\"");
    assert!(at("docker save -o \"$out/") < signed);
    assert!(
        commands[at("docker build")].contains("--build-arg REVISION=\"$(git rev-parse HEAD)\"")
    );
    let after: Vec<_> = commands[signed + 1..]
        .iter()
        .filter(|line| !line.starts_with("release/sign --check"))
        .collect();
    assert!(after.iter().all(|line| !line.contains("$out")), "{after:?}");
}

/// Sums and signature say of each file whether it is the one that was released.
#[test]
fn a_release_that_was_changed_is_not_taken() {
    let place =
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("signed-{}", std::process::id()));
    let (out, key) = (place.join("out"), place.join("key"));
    std::fs::create_dir_all(&out).unwrap();
    let made = Command::new("ssh-keygen")
        .args(["-q", "-t", "ed25519", "-N", "", "-f"])
        .arg(&key)
        .status()
        .unwrap();
    assert!(made.success());
    let public = std::fs::read_to_string(place.join("key.pub")).unwrap();
    let signers = place.join("signers");
    std::fs::write(&signers, format!("release@vfd-gateway {public}")).unwrap();
    let sign = |args: &[&std::ffi::OsStr]| {
        Command::new(root().join("release/sign"))
            .args(args)
            .output()
            .unwrap()
    };
    let check = || sign(&["--check".as_ref(), out.as_ref(), signers.as_ref()]);
    let is_taken = || check().status.success();
    std::fs::write(out.join("vfd-gateway"), "one").unwrap();
    assert!(sign(&[out.as_ref(), key.as_ref()]).status.success());
    assert!(is_taken());
    std::fs::create_dir(out.join("docs")).unwrap();
    for name in [
        "other",
        "SHA256SUMS.txt",
        "docs/SHA256SUMS",
        "docs/SHA256SUMS.sig",
        "link",
    ] {
        let file = out.join(name);
        match name {
            "link" => std::os::unix::fs::symlink("vfd-gateway", &file).unwrap(),
            _ => std::fs::write(&file, "one").unwrap(),
        }
        let output = check();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(
            !output.status.success() && said.contains(name),
            "{name} is passed over: {said}"
        );
        std::fs::remove_file(file).unwrap();
    }
    assert!(is_taken());
    std::fs::write(out.join("vfd-gateway"), "two").unwrap();
    assert!(!is_taken(), "another file");
    let sums = std::fs::read_to_string(out.join("SHA256SUMS")).unwrap();
    std::fs::write(out.join("SHA256SUMS"), sums.replace('a', "b")).unwrap();
    assert!(!is_taken(), "other sums");
    std::fs::remove_dir_all(&place).unwrap();
}

/// A claim about safety is as good as what holds it.
#[test]
fn security_names_tests_that_there_are() {
    let text = read("SECURITY.md");
    let named: Vec<_> = text
        .split('`')
        .skip(1)
        .step_by(2)
        .filter_map(|code| code.split_once(".rs: "))
        .collect();
    assert!(named.len() > 40, "{} tests are named", named.len());
    let missing: Vec<_> = named
        .into_iter()
        .filter(|(file, test)| !has_test(&format!("{file}.rs"), test))
        .collect();
    assert!(
        missing.is_empty(),
        "SECURITY.md names tests that there are not: {missing:#?}"
    );
    assert!(has_test(
        "tests/supply_chain.rs",
        "security_names_tests_that_there_are"
    ));
    assert!(
        !has_test("tests/supply_chain.rs", "has_test") && !has_test("tests/nowhere.rs", "has_test")
    );
}

fn has_test(file: &str, name: &str) -> bool {
    let Ok(text) = std::fs::read_to_string(root().join(file)) else {
        return false;
    };
    let lines: Vec<_> = text.lines().map(str::trim).collect();
    let head = format!("fn {name}(");
    let is_attribute = |line: &&&str| line.starts_with("#[") || line.starts_with("//");
    lines
        .iter()
        .position(|line| line.contains(&head))
        .is_some_and(|at| {
            let above = lines[..at].iter().rev().take_while(is_attribute);
            above
                .into_iter()
                .any(|line| *line == "#[test]" || line.starts_with("#[tokio::test"))
        })
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

#[track_caller]
fn read(file: &str) -> String {
    std::fs::read_to_string(root().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

#[track_caller]
fn toml_of(file: &str) -> Table {
    read(file).parse().unwrap()
}

fn packages(lock: &Table) -> Vec<Table> {
    lock["package"]
        .as_array()
        .unwrap()
        .iter()
        .map(|package| package.as_table().unwrap().clone())
        .collect()
}

fn texts(list: &Value) -> Vec<String> {
    list.as_array()
        .unwrap()
        .iter()
        .map(|it| it.as_str().unwrap().to_owned())
        .collect()
}

/// Everything that this machine's build may need, without asking anybody for it.
fn metadata() -> Json {
    let about = cargo(&["--version", "--verbose"]);
    let host = about
        .lines()
        .find_map(|line| line.strip_prefix("host: "))
        .unwrap();
    let args = [
        "metadata",
        "--format-version",
        "1",
        "--locked",
        "--offline",
        "--filter-platform",
        host,
    ];
    serde_json::from_str(&cargo(&args)).unwrap()
}

fn folder_of(package: &str) -> PathBuf {
    let metadata = metadata();
    let packages = metadata["packages"].as_array().unwrap();
    let manifest = packages.iter().find(|it| it["name"] == package).unwrap()["manifest_path"]
        .as_str()
        .unwrap();
    Path::new(manifest).parent().unwrap().to_owned()
}

#[track_caller]
fn cargo(args: &[&str]) -> String {
    let output = Command::new(env!("CARGO"))
        .args(args)
        .current_dir(root())
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "cargo {args:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).unwrap()
}
