//! The rules for a start in several words.

use super::keys::{readable, with_role};
use super::run_word;
use crate::domain::problem::Problem;
use crate::profile::file::{FormWord, ModelFile, RunFile, StartStepFile};
use crate::profile::model::{IndicatedState, OrderKind, RegisterRole};
use crate::toml_file::{LocatedValue, OptionalKey};

/// Maximum number of words before the run word.
const STEPS_MAX: usize = 8;

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    let Some(run) = file.run.valid().map(|run| &run.value) else {
        return;
    };
    if let (Some(fact), true) = (&run.take_back, run.start.is_empty())
        && let Some(word) = &fact.value
    {
        let problem = word.location.problem("there is no start to take back");
        problems.push(problem.right("`[[run.start]]`, or leave it out"));
    }
    let Some(first) = run.start.first() else {
        return;
    };
    if run.start.len() > STEPS_MAX {
        let problem = first
            .location
            .problem(format!("a start of {} words", run.start.len()));
        problems.push(problem.right(format!("at most {STEPS_MAX}")));
    }
    let shows_running = file.status.iter().any(|it| {
        it.flag
            .as_ref()
            .is_none_or(|flag| flag.value == IndicatedState::Running)
    });
    if !shows_running {
        let problem = first
            .location
            .problem("nothing shows whether the drive has followed the start");
        problems.push(problem.right("a `[[status]]` with the flag `running`"));
    }
    for kind in [OrderKind::Stop, OrderKind::Forward, OrderKind::Reverse] {
        if let Some(name) = run.named(kind) {
            let problem = name
                .location
                .problem("a start in several words goes to the register for run commands");
            problems.push(problem.right("leave it out, or `[[run.start]]`"));
        }
    }
    for step in &run.start {
        step_can_be_seen(step, file, problems);
    }
    for word in run.start_words() {
        moves_nothing(word, run, problems);
    }
    turns_nothing_off(run, problems);
    if with_role(&[RegisterRole::OutputFrequency], &file.registers).is_none() && shows_running {
        let problem = first
            .location
            .problem("nothing shows whether the motor turns");
        problems.push(problem.right("a register with `role = \"output-frequency\"`"));
    }
}

/// The register of the condition is readable, its words fit the mask, and the times leave room for it.
fn step_can_be_seen(step: &StartStepFile, file: &ModelFile, problems: &mut Vec<Problem>) {
    let until = match &step.until {
        OptionalKey::Absent => return waits_by_time(step, problems),
        OptionalKey::Invalid => return,
        OptionalKey::Valid(until) => &until.value,
    };
    if matches!(step.within, OptionalKey::Absent) {
        let problem = step
            .location
            .missing("within")
            .problem("`within` is missing");
        problems.push(problem.right("how long the drive may take to show what `until` says"));
    }
    if let (Some(least), Some(within)) = (step.at_least.valid(), step.within.valid())
        && least.value > within.value
    {
        let problem = least.location.problem("is longer than `within`");
        problems.push(problem.right("a shorter time, or a longer `within`"));
    }
    if let Some(name) = &until.register {
        readable(name, &file.registers, problems);
    }
    let (Some(mask), Some(values)) = (until.mask(), &until.values) else {
        return;
    };
    for LocatedValue { value, location } in
        values.value.iter().filter(|word| word.value & !mask != 0)
    {
        let problem = location.problem(format!(
            "0x{value:04X} has bits outside the mask 0x{mask:04X}"
        ));
        problems.push(problem.right(format!("0x{:04X}, or a wider mask", value & mask)));
    }
}

/// A word after which nothing is read: its time is all that is known of it.
fn waits_by_time(step: &StartStepFile, problems: &mut Vec<Problem>) {
    if let Some(within) = step.within.valid() {
        let problem = within.location.problem("nothing is waited for");
        problems.push(problem.right("`until` beside it, or `at_least` in its place"));
    }
    let right = "`until`, or how long the drive takes to follow the word";
    match &step.at_least {
        OptionalKey::Absent if step.within.valid().is_none() => {
            let problem = step
                .location
                .missing("at_least")
                .problem("nothing comes between this word and the next");
            problems.push(problem.right(right));
        }
        OptionalKey::Valid(least) if least.value.is_zero() => {
            problems.push(
                least
                    .location
                    .problem("is no time for the drive to follow the word")
                    .right(right),
            );
        }
        OptionalKey::Absent | OptionalKey::Invalid | OptionalKey::Valid(_) => {}
    }
}

/// Where nothing shows that the drive is ready for the run word, all words go out whatever it does, as while its motor still
/// ramps down. Only the stop is sure to change nothing then.
fn turns_nothing_off(run: &RunFile, problems: &mut Vec<Problem>) {
    let is_shown = run
        .start
        .last()
        .is_some_and(|last| !matches!(last.until, OptionalKey::Absent));
    if is_shown {
        return;
    }
    let Some(stop) = run.stop.word() else {
        return;
    };
    let words = run.start.iter().filter_map(|step| step.write.as_ref());
    for word in words.filter(|word| word.value != stop.value) {
        let what = format!(
            "the word {} may cut off a motor that still ramps down",
            run.shown(word.value)
        );
        let right = format!(
            "`until` in the last `[[run.start]]`, or the stop {}",
            run.shown(stop.value)
        );
        problems.push(word.location.problem(what).right(right));
    }
}

/// The word neither runs nor resets, and is not forbidden.
fn moves_nothing(word: &LocatedValue<u16>, run: &RunFile, problems: &mut Vec<Problem>) {
    let is_order = |kind: OrderKind| {
        matches!(
            kind,
            OrderKind::Forward | OrderKind::Reverse | OrderKind::Reset
        )
    };
    if let Some((_, order)) = run
        .own_words()
        .find(|(kind, it)| is_order(*kind) && it.value == word.value)
    {
        let what = format!(
            "the word {} is the command {}",
            run.shown(word.value),
            order.location.key
        );
        problems.push(
            word.location
                .problem(what)
                .right("a word that does not move the motor"),
        );
    }
    if run
        .never()
        .any(|(register, never)| register.is_none() && never.value == word.value)
    {
        let what = format!("the word {} is one of `never`", run.shown(word.value));
        problems.push(word.location.problem(what).right("another word"));
    }
    if run
        .form
        .as_ref()
        .is_some_and(|form| form.value == FormWord::Bits)
    {
        run_word::bits_order_nothing(word, run, problems);
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::check;
    use crate::profile::testing::told_with;

    const START: &str = include_str!("../../../../../tests/golden/models/start.toml");
    const BY_TIME: &str = include_str!("../../../../../tests/golden/models/by-time.toml");
    const FIRST: &str = "values = [0x0021] }\nwithin = \"2s\"";

    fn each_is_told(changes: &[(&str, &str, &str)]) {
        check::model(START).unwrap();
        for (from, to, expected) in changes {
            let found = told_with(START, from, to).replace("\n    right: ", " -> ");
            assert!(found.contains(expected), "{from} -> {to}: {found}");
        }
    }

    #[test]
    fn each_step_of_a_start_can_be_seen_in_time() {
        each_is_told(&[
            (
                FIRST,
                &FIRST.replace("0x0021", "0x0121"),
                "run.start[0].until.values[0]: 0x0121 has bits outside the mask 0x006F -> 0x0021, or a wider mask",
            ),
            (
                FIRST,
                &FIRST.replace("[0x0021]", "[]"),
                "run.start[0].until.values: is empty",
            ),
            (FIRST, &FIRST.replace("2s", "20s"), "run.start[0].within: "),
            (
                FIRST,
                "values = [0x0021] }",
                "run.start[0].within: `within` is missing",
            ),
            (
                "at_least = \"100ms\"",
                "at_least = \"3s\"",
                "run.start[1].at_least: is longer than `within` -> a shorter time, or a longer `within`",
            ),
            (
                "until = { register = \"status\"",
                "until = { register = \"statis\"",
                "run.start[0].until.register: there is no register called `statis` -> `status`",
            ),
            (
                "flag = \"running\"",
                "flag = \"ready\"",
                "run.start[0]: nothing shows whether the drive has followed the start -> a `[[status]]` with the flag",
            ),
            (
                "role = \"output-frequency\"\n",
                "",
                "run.start[0]: nothing shows whether the motor turns -> a register with `role = \"output-frequency\"`",
            ),
            (
                "until = { register = \"status\", mask = 0x006F, values = [0x0023] }\n",
                "",
                "run.start[1].within: nothing is waited for -> `until` beside it, or `at_least` in its place",
            ),
        ]);
    }

    #[test]
    fn a_step_by_time_has_a_time_and_cuts_nothing_off() {
        const LEAST: &str = "at_least = \"100ms\"\n";
        let problems =
            |from: &str, to: &str| told_with(BY_TIME, from, to).replace("\n    right: ", " -> ");
        check::model(BY_TIME).unwrap();
        let found = problems(LEAST, "");
        assert!(
            found.contains(
                "run.start[0].at_least: nothing comes between this word and the next -> `until`"
            ),
            "{found}"
        );
        let found = problems(LEAST, "at_least = \"0s\"\n");
        assert!(
            found.contains("run.start[0].at_least: is no time for the drive to follow the word"),
            "{found}"
        );
        let found = problems("write = 0x047E", "write = 0x047C");
        let expected = "run.start[0].write: the word 1148 may cut off a motor that still ramps down -> \
                        `until` in the last `[[run.start]]`, or the stop 1150";
        assert!(found.contains(expected), "{found}");
        // A word before one with `until` may be left out.
        let first =
            "until = { register = \"status\", mask = 0x006F, values = [0x0021] }\nwithin = \"2s\"";
        check::model(&START.replace(first, "at_least = \"2s\"")).unwrap();
    }

    #[test]
    fn no_step_of_a_start_moves_the_motor() {
        each_is_told(&[
            (
                "write = 0x0006",
                "write = 0x000F",
                "run.start[0].write: the word 15 is the command run.forward.value -> a word that does not move the motor",
            ),
            (
                "take_back = { value = 0x0006",
                "take_back = { value = 0x0080",
                "run.take_back.value: the word 128 is the command run.reset.value -> a word that does not move the motor",
            ),
            (
                "take_back = {",
                "never = [{ value = 0x0006, confidence = \"manual\", source = \"IM 5\" }]\ntake_back = {",
                "run.start[0].write: the word 6 is one of `never` -> another word",
            ),
            (
                "form = \"values\"",
                "form = \"bits\"\nbit = [{ bit = 1, meaning = \"run\", confidence = \"manual\", source = \"IM 5\" }]",
                "run.start[0].write: 0x0006 has the bit `run` -> a word without it",
            ),
        ]);
        let start = START.find("[[run.start]]").unwrap();
        let end = START.find("[[status]]").unwrap();
        let found = told_with(START, &START[start..end], "");
        assert!(
            found.contains("run.take_back.value: there is no start to take back"),
            "{found}"
        );
    }

    #[test]
    fn a_start_goes_to_the_register_for_run_commands() {
        let found = told_with(
            START,
            "stop = { value",
            "stop = { register = \"frequency_command\", value",
        );
        assert!(
            found.contains(
                "run.stop.register: a start in several words goes to the register for run"
            ),
            "{found}"
        );
    }
}
