//! Additions to `--help` of each command: background, examples that work, exit codes.

mod texts;

use clap::Command;
use std::fmt::Write;
use texts::HELP_TEXTS;

/// Additional help for a command.
struct HelpText {
    /// The command with its sub-command.
    command: &'static str,
    /// In sentences; empty if its options are enough.
    about: &'static str,
    /// Command lines, with their effects.
    examples: &'static [(&'static str, &'static str)],
    /// The meaning of its exit codes.
    exits: &'static str,
}

impl HelpText {
    fn text(&self) -> String {
        let mut text = String::new();
        if !self.about.is_empty() {
            let _ = writeln!(text, "{}\n", self.about);
        }
        let _ = writeln!(text, "Examples:");
        for (line, does) in self.examples {
            let _ = writeln!(text, "  {line}\n      {does}");
        }
        let _ = write!(text, "\nExit codes: {}", self.exits);
        text
    }
}

/// The command line `plain` with everything that `--help` and the manual show.
pub fn complete(plain: Command) -> Command {
    with_texts(plain, "")
}

/// `command`, which is invoked by `words`, with its help text and those of its sub-commands.
fn with_texts(command: Command, words: &str) -> Command {
    let names: Vec<_> = command
        .get_subcommands()
        .map(|it| it.get_name().to_owned())
        .collect();
    let command = names.into_iter().fold(command, |command, name| {
        let words = format!("{words} {name}");
        command.mut_subcommand(name, |sub| with_texts(sub, words.trim()))
    });
    match HELP_TEXTS.iter().find(|help| help.command == words) {
        Some(help) => command.after_long_help(help.text()),
        None => command,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::{Cli, command};
    use clap::FromArgMatches;
    use std::collections::BTreeSet;

    /// All visible commands, with their words.
    fn all(command: &Command, words: &str) -> Vec<(String, Command)> {
        let shown = command
            .get_subcommands()
            .filter(|sub| !sub.is_hide_set() && sub.get_name() != "help");
        let mut found = vec![(words.to_owned(), command.clone())];
        found.extend(shown.flat_map(|sub| all(sub, format!("{words} {}", sub.get_name()).trim())));
        found
    }

    #[test]
    fn every_command_says_what_it_does_with_examples_and_exit_codes() {
        for (words, command) in all(&command(), "") {
            assert!(command.get_about().is_some(), "{words} has no sentence");
            let after = command.get_after_long_help().or(command.get_after_help());
            let after = after.map(ToString::to_string).unwrap_or_default();
            assert!(
                after.contains("Examples:\n"),
                "`{words}` shows no example: give it a help text in cli/help/texts.rs"
            );
            assert!(
                after.contains("Exit codes: 0"),
                "`{words}` says nothing of its exit codes"
            );
            for arg in command.get_arguments() {
                assert!(
                    arg.get_help().is_some(),
                    "`{words}`: {} is not explained",
                    arg.get_id()
                );
            }
        }
    }

    /// An example is accepted by the program as written, up to a pipe or a file.
    #[test]
    fn every_example_is_taken() {
        let known: BTreeSet<_> = all(&command(), "")
            .into_iter()
            .map(|(words, _)| words)
            .collect();
        for help in HELP_TEXTS {
            assert!(
                known.contains(help.command),
                "there is no command {}",
                help.command
            );
            for (line, _) in help.examples {
                let (_, typed) = line.split_once("vfd-gateway ").unwrap();
                let typed = typed.split(['|', '>', ')']).next().unwrap_or_default();
                let args = std::iter::once("vfd-gateway").chain(typed.split_whitespace());
                let matches = command().try_get_matches_from(args);
                let matches = matches.unwrap_or_else(|error| panic!("{line}: {error}"));
                assert!(Cli::from_arg_matches(&matches).is_ok(), "{line}");
                assert!(
                    line.contains(help.command),
                    "{line} is no example of {}",
                    help.command
                );
            }
        }
    }

    #[test]
    fn a_command_has_one_lesson() {
        let commands: BTreeSet<_> = HELP_TEXTS.iter().map(|help| help.command).collect();
        assert_eq!(commands.len(), HELP_TEXTS.len());
    }
}
