//! The reference lists every command, option and reason.
//! The links of all documents lead somewhere.

use super::rig::{text_of, vfd_gateway};
use std::path::{Path, PathBuf};
use vfd_gateway::domain::command::{Owner, Reason};
use vfd_gateway::domain::ids::CommanderName;

/// Uniform word 261 and `result` give a reason by its number and its word: the reference must say what each means.
#[test]
fn the_reference_has_every_reason() {
    let table = text_of("docs/outcomes.md");
    for reason in Reason::ALL {
        let row = format!(
            "| {} | `{}` | {} |",
            reason.number(),
            reason.keyword(),
            reason.text()
        );
        assert!(table.contains(&row), "docs/outcomes.md has no row {row}");
    }
}

#[test]
fn the_reference_has_every_command_and_option() {
    let table = text_of("docs/commands.md");
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

/// A row for what does not exist is as wrong as none.
#[test]
fn the_reference_has_no_command_that_there_is_not() {
    let table = text_of("docs/commands.md");
    let rows = table.lines().filter_map(|line| line.strip_prefix("| `"));
    let known = commands();
    for row in rows {
        let words = row.split('`').next().unwrap();
        let is_of = |known: &&String| {
            words
                .strip_prefix(known.as_str())
                .is_some_and(|it| it.is_empty() || it.starts_with(' '))
        };
        assert!(
            known.iter().any(|it| is_of(&it)),
            "there is no command {words}"
        );
    }
}

/// Whoever compares `control/owner` with a word finds every word in the reference.
#[test]
fn the_reference_has_every_owner() {
    let table = text_of("docs/mqtt-topics.md");
    let row = part(&table, "| `drive/DRIVE/control/owner` |", "\n");
    let written: Vec<_> = part(row, "who holds control: ", ";").split(", ").collect();
    let owners = owners().map(|owner| format!("`{owner}`").replace("192.0.2.7", "ADDRESS"));
    assert_eq!(written, owners);
}

/// One owner of each kind that can hold control.
fn owners() -> [Owner; 7] {
    let name = CommanderName::new("NAME").unwrap();
    let address = [192, 0, 2, 7].into();
    let owners = [
        Owner::Mqtt,
        Owner::MqttBy(name),
        Owner::ModbusTcp(address),
        Owner::ModbusSecurity(name),
        Owner::ModbusRtu(name),
        Owner::Page(name),
        Owner::Sparkplug,
    ];
    // So that nobody adds a kind and forgets it here. What is ordered over the gateway's socket begins no lease.
    for owner in owners {
        match owner {
            Owner::Mqtt
            | Owner::MqttBy(_)
            | Owner::ModbusTcp(_)
            | Owner::ModbusSecurity(_)
            | Owner::Page(_)
            | Owner::Sparkplug
            | Owner::ModbusRtu(_)
            | Owner::Local => {}
        }
    }
    owners
}

/// Documents refer to each other by file and heading.
#[test]
fn every_link_leads_somewhere() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let documents = documents(root);
    let mut links = 0;
    for (file, text) in &documents {
        for target in targets(text).filter(|target| !target.contains("://")) {
            let (path, anchor) = target
                .split_once('#')
                .map_or((target, None), |(path, anchor)| (path, Some(anchor)));
            let path = if path.is_empty() {
                file.clone()
            } else {
                file.parent().unwrap().join(path)
            };
            let found = path.canonicalize();
            let found =
                found.unwrap_or_else(|_| panic!("{}: there is no {target}", file.display()));
            if let Some(anchor) = anchor {
                let text = std::fs::read_to_string(&found).unwrap();
                assert!(
                    anchors(&text).any(|it| it == anchor),
                    "{}: no heading {target}",
                    file.display()
                );
            }
            links += 1;
        }
    }
    assert!(links > 50, "{links} links");
}

/// What is written for people, by its path.
fn documents(root: &Path) -> Vec<(PathBuf, String)> {
    let folders = [
        "",
        "docs",
        "docs/first-steps",
        "docs/design",
        "deploy",
        "fuzz",
    ]
    .map(|folder| root.join(folder));
    let files = folders
        .iter()
        .flat_map(|folder| std::fs::read_dir(folder).unwrap())
        .map(|entry| entry.unwrap().path());
    let written = files.filter(|path| path.extension().is_some_and(|it| it == "md"));
    written
        .map(|path| (path.clone(), std::fs::read_to_string(path).unwrap()))
        .collect()
}

/// Where the links and pictures of `text` lead.
fn targets(text: &str) -> impl Iterator<Item = &str> {
    let prose = text.split("```").step_by(2);
    prose
        .flat_map(|prose| prose.split("](").skip(1))
        .filter_map(|rest| rest.split(')').next())
}

/// The names by which headings of `text` are linked to.
fn anchors(text: &str) -> impl Iterator<Item = String> {
    let headings = text
        .split("```")
        .step_by(2)
        .flat_map(str::lines)
        .filter(|line| line.starts_with('#'));
    headings.map(|line| {
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let kept = title
            .chars()
            .filter(|it| it.is_alphanumeric() || matches!(it, ' ' | '-' | '_'));
        kept.collect::<String>().replace(' ', "-")
    })
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
    let names = help
        .lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| !line.is_empty());
    // A line that begins further right continues the text above it.
    let names = names.filter_map(|line| {
        line.strip_prefix("  ")
            .filter(|line| !line.starts_with(' '))
    });
    names
        .filter_map(|line| line.split(' ').next())
        .filter(|name| *name != "help")
        .map(str::to_owned)
        .collect()
}

fn options(help: &str) -> impl Iterator<Item = &str> {
    let lines = help
        .lines()
        .map(str::trim_start)
        .filter(|line| line.starts_with('-'));
    lines
        .flat_map(|line| line.split([' ', ',']))
        .filter(|word| word.starts_with("--"))
}

/// From `begin` to the next `end`.
#[track_caller]
fn part<'a>(text: &'a str, begin: &str, end: &str) -> &'a str {
    let (_, rest) = text
        .split_once(begin)
        .unwrap_or_else(|| panic!("there is no {begin}"));
    rest.split_once(end).map_or(rest, |(part, _)| part)
}
