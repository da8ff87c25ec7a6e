//! The rules between the keys of `[run]`.

use super::{reset, run_word, stop_bits};
use crate::domain::problem::Problem;
use crate::profile::file::{FormWord, RunFile};
use crate::profile::model::RegisterRole;
use crate::profile::register::RegisterFile;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey};

pub(super) fn check(
    run: &RunFile,
    location: &KeyLocation,
    registers: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    forbidden_words_are_no_commands(run, problems);
    reset::check(run, location, problems);
    match run.form.as_ref().map(|form| form.value) {
        None => {}
        Some(FormWord::Values) => run_word::values_have_no_bits(run, problems),
        Some(FormWord::Bits) => run_word::bits_are_sound(run, location, problems),
    }
    stop_bits::check(run, problems);
    run_word::zero_is_known(run, location, problems);
    commands_are_taken(location, registers, problems);
}

/// No command uses a forbidden word.
fn forbidden_words_are_no_commands(run: &RunFile, problems: &mut Vec<Problem>) {
    for (
        register,
        LocatedValue {
            value: never,
            location,
        },
    ) in run.never()
    {
        let is_there = |kind| run.named(kind).map(|name| name.value.as_str()) == register;
        if let Some((_, word)) = run
            .words()
            .find(|(kind, word)| word.value == *never && is_there(*kind))
        {
            let what = format!(
                "the word {} is the command {}",
                run.shown(*never),
                word.location.key
            );
            problems.push(location.problem(what).right("a word that is not a command"));
        }
    }
}

/// There is a register for run commands.
fn commands_are_taken(run: &KeyLocation, registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    let may_be = |register: &RegisterFile| match &register.role {
        OptionalKey::Absent => false,
        OptionalKey::Invalid => true,
        OptionalKey::Valid(role) => role.value == RegisterRole::RunCommand,
    };
    if !registers.iter().any(may_be) {
        let problem = run.problem("there is no register for run commands");
        problems.push(problem.right("a register with `role = \"run-command\"`"));
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::testing::{EVERYTHING, MODEL, each_is_told, told_with};

    const SEQUENCE: &str = "reset_sequence = [0xC000, 0xE000, 0xC000]";

    fn fact(word: u16) -> String {
        format!("{{ value = {word}, confidence = \"manual\", source = \"IM 5\" }}")
    }

    /// [`MODEL`] with run commands that are values: stop 0, forward 1, reset 4.
    fn told_of_values(more: &str) -> String {
        let stop = fact(0);
        let forward = fact(1);
        let reset = fact(4);
        let run = format!(
            "[run]\nform = \"values\"\nstop = {stop}\nforward = {forward}\nreset = {reset}\n{more}\n"
        );
        let register = "[[register]]\nname = \"run\"\ntitle = \"Run\"\naddress = 2\nscale = 1\nunit = \"-\"\n\
                        access = \"write\"\nrole = \"run-command\"\nconfidence = \"manual\"\nsource = \"IM 1\"\n\n";
        told_with(
            MODEL,
            "[[register]]",
            &format!("{run}\n{register}[[register]]\nnonsense = 1"),
        )
    }

    #[test]
    fn a_reset_starts_with_a_stop_and_holds_no_order_to_run() {
        let nine = "reset_sequence = [0, 4, 4, 4, 4, 4, 4, 4, 4]";
        let wrong = [
            "",
            "reset_sequence = [4]",
            "reset_sequence = [0, 4, 1]",
            "reset_sequence = [0, 0, 0]",
            nine,
        ];
        for wrong in wrong {
            let found = told_of_values(wrong);
            assert!(
                found.contains("right: [0, 4], or up to 8 words"),
                "{wrong}: {found}"
            );
        }
        for right in [
            "reset_sequence = [0, 4]",
            "reset_sequence = [0, 4, 0]",
            "reset_sequence = [0, 0, 4, 4, 0, 4]",
        ] {
            let found = told_of_values(right);
            assert!(!found.contains("run"), "{right}: {found}");
        }
    }

    #[test]
    fn with_bits_a_reset_ends_with_a_stop() {
        let expected = "run.reset_sequence: a reset starts with a stop and ends with one, and contains only stop and \
                        reset -> [0xC000, 0xE000, 0xC000], or up to 8 words of these only";
        for wrong in [
            "[0xC000, 0xE000]",
            "[0xE000, 0xC000]",
            "[0xC000, 0xE000, 0x0000, 0xC000]",
        ] {
            each_is_told(&[(SEQUENCE, &format!("reset_sequence = {wrong}"), expected)]);
        }
        let found = told_with(
            EVERYTHING,
            "reset = { value = 0xE000, confidence = \"inferred\", source = \"IM 5\" }",
            "",
        );
        assert!(
            found.contains("run.reset_sequence: `reset` is missing"),
            "{found}"
        );
    }

    #[test]
    fn words_that_are_values_have_no_bits() {
        let more = "reset_sequence = [0, 4]\npriority = 1\n[[run.bit]]\nbit = 0\nmeaning = \"run\"\n\
                    confidence = \"manual\"\nsource = \"IM 5\"\n";
        let found = told_of_values(more);
        for key in ["run.priority", "run.bit[0]"] {
            let what = format!("{key}: each word is one command, so single bits have no meaning");
            assert!(found.contains(&what), "{found}");
        }
    }

    #[test]
    fn command_words_consist_of_declared_bits() {
        let reverse = "reverse = { value = 0xC600";
        each_is_told(&[
            (
                reverse,
                "reverse = { value = 0xD600",
                "run.reverse.value: 0xD600 has an undeclared bit: 12 -> \
                 a `[[run.bit]]` with what the documents say of it, or a word without it",
            ),
            (
                reverse,
                "reverse = { value = 0x8600",
                "run.reverse.value: 0x8600 lacks bits of `priority` -> \
                 0xC600, if the documents show that word, or another `priority`",
            ),
            (
                "bit = 0\n",
                "bit = 9\n",
                "run.bit[6].bit: bit 9 is taken by run.bit[5].bit -> a bit that is declared only once",
            ),
        ]);
        let found = told_with(EVERYTHING, "priority = 0xC000", "priority = 0xC002");
        assert!(
            found.contains("run.priority: 0xC002 has an undeclared bit: 1\n"),
            "{found}"
        );
    }

    #[test]
    fn bits_are_declared_where_words_are_built_of_them() {
        let start = EVERYTHING.find("[[run.bit]]").unwrap();
        let end = EVERYTHING.find("[[status]]").unwrap();
        let found = told_with(EVERYTHING, &EVERYTHING[start..end], "");
        assert!(
            found.contains("run.bit: no bit is declared, and form is \"bits\"\n"),
            "{found}"
        );
        assert_eq!(found.lines().count(), 2, "{found}");
    }

    #[test]
    fn only_forward_and_reverse_turn_the_motor() {
        each_is_told(&[
            (
                "coast = { value = 0xC800",
                "coast = { value = 0xCC01",
                "run.coast.value: 0xCC01 has the bit `run` -> a word without it",
            ),
            (
                "release = { value = 0x0000",
                "release = { value = 0x0400",
                "run.release.value: 0x0400 has the bit `run` -> a word without it",
            ),
        ]);
        for (meaning, word) in [
            ("run", "run"),
            ("jog", "jog"),
            ("trip", "trip"),
            ("reset", "reset"),
        ] {
            let text = EVERYTHING.replacen(
                "meaning = \"other\"",
                &format!("meaning = \"{meaning}\""),
                1,
            );
            let found = told_with(&text, "stop = { value = 0xC000", "stop = { value = 0xC001");
            assert!(
                found.contains(&format!("run.stop.value: 0xC001 has the bit `{word}`\n")),
                "{found}"
            );
        }
    }

    #[test]
    fn no_command_runs_both_ways() {
        let text = EVERYTHING.replacen("meaning = \"run\"", "meaning = \"run-forward\"", 1);
        let text = text.replacen("meaning = \"reverse\"", "meaning = \"run-reverse\"", 1);
        let found = told_with(&text, "bit = 0\n", "bit = 0\n");
        let expected = "run.reverse.value: 0xC600 orders forward and reverse at once\n    right: a single direction\n";
        assert!(found.ends_with(expected), "{found}");
    }

    #[test]
    fn words_differ_and_are_not_forbidden() {
        each_is_told(&[
            (
                "reverse = { value = 0xC600",
                "reverse = { value = 0xC400",
                "run.reverse.value: the word 0xC400 is taken by run.forward.value -> \
                 a word that no other run command uses",
            ),
            (
                "never = [{ value = 0xCC00",
                "never = [{ value = 0x0000",
                "run.never[0].value: the word 0x0000 is the command run.release.value -> a word that is not a command",
            ),
        ]);
    }

    #[test]
    fn a_run_table_needs_its_register() {
        each_is_told(&[(
            "role = \"run-command\"\n",
            "",
            "run: there is no register for run commands -> a register with `role = \"run-command\"`",
        )]);
    }
}
