//! The README lists every command, option and reason, and exactly the keys that there are: one list, and it is true.

use super::rig::vfd_gateway;
use std::path::Path;
use vfd_gateway::config::keys::{KEYS, Key, Section};
use vfd_gateway::domain::command::Reason;

#[test]
fn the_readme_has_every_key_as_the_program_has_it() {
    let readme = readme();
    let tables = part(&readme, "## Configuration", "\n## ");
    for section in Section::ALL.into_iter().filter(|section| *section != Section::Root) {
        let header = section.header();
        let table = part(tables, &format!("### `{header}`"), "\n### ");
        let written: Vec<_> = table.lines().filter(|line| line.starts_with("| `")).collect();
        let keys = KEYS.iter().filter(|key| key.section == section);
        let expected: Vec<_> = keys.map(row).collect();
        assert_eq!(written, expected, "keys of {header}");
    }
}

/// Uniform word 261 and `result` give a reason by its number and its word: the README must say what each means.
#[test]
fn the_readme_has_every_reason() {
    let readme = readme();
    for reason in Reason::ALL {
        let row = format!("| {} | `{}` | {} |", reason.number(), reason.word(), reason.text());
        assert!(readme.contains(&row), "README.md has no row {row}");
    }
}

#[test]
fn the_readme_has_every_command_and_option() {
    let readme = readme();
    let table = part(&readme, "## Commands", "\n## ");
    for words in commands() {
        let mut args: Vec<_> = words.split(' ').collect();
        assert!(table.contains(&format!("| `{words}")), "no row for {words}");
        args.push("--help");
        let help = vfd_gateway(&args).stdout;
        let help = String::from_utf8(help).unwrap();
        for option in options(&help).filter(|option| *option != "--help") {
            assert!(table.contains(option), "no {option} of {words}");
        }
    }
}

/// The commands with their sub-commands.
fn commands() -> Vec<String> {
    let mut found = Vec::new();
    for command in listed(&[]) {
        match listed(&[&command]) {
            actions if actions.is_empty() => found.push(command),
            actions => found.extend(actions.iter().map(|action| format!("{command} {action}"))),
        }
    }
    assert!(found.len() >= 7, "{found:?}");
    found
}

/// The commands that the short help of `args` lists.
fn listed(args: &[&str]) -> Vec<String> {
    let output = vfd_gateway(&[args, &["-h"]].concat());
    let help = String::from_utf8(output.stdout).unwrap();
    let names = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    // A line that begins further right continues the text above it.
    let names = names.filter_map(|line| line.strip_prefix("  ").filter(|line| !line.starts_with(' ')));
    names.filter_map(|line| line.split(' ').next()).filter(|name| *name != "help").map(str::to_owned).collect()
}

fn options(help: &str) -> impl Iterator<Item = &str> {
    let lines = help.lines().map(str::trim_start).filter(|line| line.starts_with('-'));
    lines.flat_map(|line| line.split([' ', ','])).filter(|word| word.starts_with("--"))
}

/// How the README writes a key.
fn row(key: &Key) -> String {
    let default = key.default.unwrap_or("required");
    format!("| `{}` | {} | {} | {} |", key.name, marked(key.kind), marked(default), marked(key.about))
}

/// `text` with everything that is in quotes marked as code.
fn marked(text: &str) -> String {
    let parts = text.split('"').enumerate();
    parts.map(|(index, part)| if index % 2 == 1 { format!("`\"{part}\"`") } else { part.to_owned() }).collect()
}

/// From `begin` to the next `end`.
#[track_caller]
fn part<'a>(text: &'a str, begin: &str, end: &str) -> &'a str {
    let (_, rest) = text.split_once(begin).unwrap_or_else(|| panic!("the README has no {begin}"));
    rest.split_once(end).map_or(rest, |(part, _)| part)
}

fn readme() -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md")).unwrap()
}
