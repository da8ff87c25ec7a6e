//! The rules for the words of a reset: nothing in it runs the motor, and what must be cleared is cleared.

use crate::domain::problem::Problem;
use crate::profile::file::{FormWord, ResetStepFile, RunFile};
use crate::profile::model::OrderKind;
use crate::toml_file::values::duration_text;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey};
use std::time::Duration;

/// Maximum length of a reset sequence, in words.
const WORDS_MAX: usize = 8;

/// The longest time that the pauses of a reset may last together.
const WAITS_MAX: Duration = Duration::from_secs(20);

/// What a word of a reset is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ResetPart {
    Stop,
    Reset,
    Clear,
}

pub(super) fn check(run: &RunFile, location: &KeyLocation, problems: &mut Vec<Problem>) {
    if run.named(OrderKind::Reset).is_none() {
        reset_is_framed(run, location, problems);
    } else {
        reset_apart_is_framed(run, problems);
    }
    reset_is_cleared(run, problems);
    if let OptionalKey::Valid(sequence) = &run.reset_sequence {
        pauses_are_bounded(sequence, problems);
    }
}

/// A reset starts with a stop and never contains an order to run; with bits it also ends with a stop, which clears the
/// reset bit.
fn reset_is_framed(run: &RunFile, location: &KeyLocation, problems: &mut Vec<Problem>) {
    let Some(reset) = run.reset.as_ref() else {
        if let OptionalKey::Valid(sequence) = &run.reset_sequence {
            problems.push(
                sequence
                    .location
                    .problem("`reset` is missing")
                    .right("the word for `reset`, if the documents state one, or leave it out"),
            );
        }
        return;
    };
    let (Some(reset), Some(stop)) = (reset.word(), run.stop.word()) else {
        return;
    };
    let ends_with_stop = run
        .form
        .as_ref()
        .is_some_and(|form| form.value == FormWord::Bits);
    let mut example = vec![run.shown(stop.value), run.shown(reset.value)];
    example.extend(ends_with_stop.then(|| run.shown(stop.value)));
    let right = format!(
        "[{}], or up to {WORDS_MAX} words of these only",
        example.join(", ")
    );
    match &run.reset_sequence {
        OptionalKey::Absent => {
            let what = "`reset_sequence` is left out, and `reset` is given";
            problems.push(
                location
                    .missing("reset_sequence")
                    .problem(what)
                    .right(right),
            );
        }
        OptionalKey::Invalid => {}
        OptionalKey::Valid(sequence) => {
            let Some(parts) = parts(&sequence.value, run) else {
                return;
            };
            let framed = parts.first() == Some(&Some(ResetPart::Stop))
                && (!ends_with_stop || parts.last() == Some(&Some(ResetPart::Stop)));
            let only = parts.iter().all(Option::is_some) && parts.contains(&Some(ResetPart::Reset));
            if !(framed && only && parts.len() <= WORDS_MAX) {
                let end = if ends_with_stop {
                    " and ends with one"
                } else {
                    ""
                };
                let what =
                    format!("a reset starts with a stop{end}, and contains only stop and reset");
                problems.push(sequence.location.problem(what).right(right));
            }
        }
    }
}

/// A reset in a register of its own starts with a stop, and the word that it leaves there is `clear`, if that is given.
fn reset_apart_is_framed(run: &RunFile, problems: &mut Vec<Problem>) {
    let OptionalKey::Valid(sequence) = &run.reset_sequence else {
        return;
    };
    let Some(parts) = parts(&sequence.value, run) else {
        return;
    };
    let end = if run.clear().is_some() {
        ResetPart::Clear
    } else {
        ResetPart::Reset
    };
    let framed = parts.first() == Some(&Some(ResetPart::Stop)) && parts.last() == Some(&Some(end));
    let only = parts.iter().all(Option::is_some) && parts.contains(&Some(ResetPart::Reset));
    if framed && only && parts.len() <= WORDS_MAX {
        return;
    }
    let name = run.named(OrderKind::Reset).map_or("", |name| &name.value);
    let words = run.word(OrderKind::Reset).into_iter().chain(run.clear());
    let table =
        |word: &LocatedValue<u16>| format!("{{ register = \"{name}\", value = {} }}", word.value);
    let stop = run.stop.word().map(|word| run.shown(word.value));
    let example: Vec<_> = stop.into_iter().chain(words.map(table)).collect();
    let problem = sequence
        .location
        .problem("a reset in a register of its own is a stop, the reset and `clear`");
    let right = format!(
        "leave it out, or [{}], or up to {WORDS_MAX} of these only",
        example.join(", ")
    );
    problems.push(problem.right(right));
}

/// What each word of `steps` is, `None` for one that has no place in a reset; nothing if one of them is unusable.
fn parts(steps: &[ResetStepFile], run: &RunFile) -> Option<Vec<Option<ResetPart>>> {
    let stop = run.stop.word()?.value;
    let reset = run.word(OrderKind::Reset)?.value;
    let apart = run.named(OrderKind::Reset).map(|name| &name.value);
    let clear = run.clear().map(|clear| clear.value);
    let part = |step: &ResetStepFile| {
        let word = step.value.as_ref()?.value;
        let name = match &step.register {
            OptionalKey::Invalid => return None,
            OptionalKey::Absent => None,
            OptionalKey::Valid(name) => Some(&name.value),
        };
        Some(match name {
            None if apart.is_none() && word == reset => Some(ResetPart::Reset),
            None if word == stop => Some(ResetPart::Stop),
            Some(_) if name == apart && word == reset => Some(ResetPart::Reset),
            Some(_) if name == apart && Some(word) == clear => Some(ResetPart::Clear),
            None | Some(_) => None,
        })
    };
    steps.iter().map(part).collect()
}

/// Only a reset in a register of its own is cleared there; elsewhere the stop clears it.
fn reset_is_cleared(run: &RunFile, problems: &mut Vec<Problem>) {
    let Some(clear) = run.clear() else {
        return;
    };
    let Some(register) = run.named(OrderKind::Reset) else {
        let problem = clear
            .location
            .problem("only a register of the reset alone is cleared");
        return problems.push(problem.right("`register` beside it, or `reset_sequence`"));
    };
    let is_same = |kind| run.named(kind).map(|name| &name.value) == Some(&register.value);
    if run
        .words()
        .any(|(kind, word)| is_same(kind) && word.value == clear.value)
    {
        let problem = clear.location.problem(format!(
            "the word {} is an order in this register",
            clear.value
        ));
        problems.push(problem.right("a word that orders nothing"));
    }
}

fn pauses_are_bounded(sequence: &LocatedValue<Vec<ResetStepFile>>, problems: &mut Vec<Problem>) {
    let waits = sequence
        .value
        .iter()
        .filter_map(|step| Some(step.wait.valid()?.value));
    let all: Duration = waits.sum();
    if all > WAITS_MAX {
        let problem = sequence
            .location
            .problem(format!("a reset with pauses of {}", duration_text(all)));
        problems.push(problem.right(format!("at most {} together", duration_text(WAITS_MAX))));
    }
    if let Some(wait) = sequence.value.last().and_then(|step| step.wait.valid()) {
        let problem = wait.location.problem("nothing follows the last word");
        problems.push(problem.right("leave it out, or the quirk `deaf_after_reset`"));
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::check;
    use crate::profile::testing::told_with;

    const ORDERS: &str = include_str!("../../../../../tests/golden/models/orders.toml");
    const BY_TIME: &str = include_str!("../../../../../tests/golden/models/by-time.toml");
    const RESET: &str = "reset = { register = \"fault_reset\", value = 1, clear = 0,";
    const STEP: &str = "{ value = 0x04FE, wait = \"200ms\" }";

    fn apart(sequence: &str) -> String {
        ORDERS.replace(RESET, &format!("reset_sequence = {sequence}\n{RESET}"))
    }

    #[test]
    fn a_reset_apart_is_cleared_after_its_pause() {
        let set = "{ register = \"fault_reset\", value = 1, wait = \"1s\" }";
        let clear = "{ register = \"fault_reset\", value = 0 }";
        check::model(&apart(&format!("[0, {set}, {clear}]"))).unwrap();
        check::model(&apart(&format!("[0, {set}, {clear}, {set}, {clear}]"))).unwrap();
        let expected = "run.reset_sequence: a reset in a register of its own is a stop, the reset and `clear`\n    \
                        right: leave it out, or [0, { register = \"fault_reset\", value = 1 }, \
                        { register = \"fault_reset\", value = 0 }], or up to 8 of these only";
        let run = "{ register = \"run\", value = 1 }";
        for wrong in [
            format!("[0, {set}]"),
            format!("[{set}, {clear}]"),
            format!("[0, {run}, {clear}]"),
        ] {
            let found = told_with(&apart(&wrong), "id =", "id =");
            assert!(found.contains(expected), "{wrong}: {found}");
        }
    }

    #[test]
    fn a_pause_stands_between_two_words_and_is_bounded() {
        let problems = |step: &str| told_with(BY_TIME, STEP, step).replace("\n    right: ", " -> ");
        for (step, expected) in [
            (
                "{ value = 0x04FE, wait = \"30s\" }",
                "run.reset_sequence[1].wait: ",
            ),
            (
                "{ wait = \"1s\" }",
                "run.reset_sequence[1].value: `value` is missing",
            ),
            (
                "{ value = 0x04FE, waits = \"1s\" }",
                "unknown key `waits` -> `wait`",
            ),
            (
                "\"0x04FE\"",
                "run.reset_sequence[1]: must be a whole number, not text -> a whole number",
            ),
            (
                "{ value = 0x047F }, 0x04FE",
                "run.reset_sequence: a reset starts with a stop, and contains only stop and reset",
            ),
            (
                "{ register = \"status\", value = 0x04FE }",
                "run.reset_sequence: a reset starts with a stop",
            ),
            (
                "{ value = 0x04FE, wait = \"9s\" }, { value = 0x04FE, wait = \"9s\" }, { value = 0x04FE, wait = \"9s\" }",
                "run.reset_sequence: a reset with pauses of 27s -> at most 20s together",
            ),
            (
                "0x04FE, { value = 0x047E, wait = \"1s\" }] #",
                "run.reset_sequence[2].wait: nothing follows the last word -> leave it out, or the quirk",
            ),
        ] {
            let found = problems(step);
            assert!(found.contains(expected), "{step}: {found}");
        }
    }
}
