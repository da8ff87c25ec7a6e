//! The rules for the states of a drive: one polled register shows them, and no word is two of them.

use super::keys::readable;
use crate::domain::problem::Problem;
use crate::profile::file::ModelFile;
use crate::toml_file::{LocatedValue, OptionalKey};

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    let states = file.run.valid().map_or(&[][..], |run| &run.value.states);
    let mut first: Option<&LocatedValue<String>> = None;
    let mut seen: Vec<(u16, &LocatedValue<u16>)> = Vec::new();
    for state in states {
        match (&state.register, first) {
            (Some(name), Some(first)) if name.value != first.value => {
                let problem = name
                    .location
                    .problem(format!("{} names another register", first.location.key));
                problems.push(
                    problem.right(format!("`{}`: one register shows the state", first.value)),
                );
            }
            (Some(name), None) => {
                first = Some(name);
                let register = readable(name, &file.registers, problems);
                if register.is_some_and(|register| matches!(register.poll, OptionalKey::Absent)) {
                    let problem = name
                        .location
                        .problem(format!("`{}` is not polled", name.value));
                    problems.push(problem.right("a register with `poll`"));
                }
            }
            (Some(_) | None, _) => {}
        }
        let (Some(value), Some(mask)) = (&state.value, state.mask()) else {
            continue;
        };
        let word = value.value;
        if word & !mask != 0 {
            let problem = value.location.problem(format!(
                "0x{word:04X} has bits outside the mask 0x{mask:04X}"
            ));
            problems.push(problem.right(format!("0x{:04X}, or a wider mask", word & mask)));
        } else if let Some((_, other)) = seen
            .iter()
            .find(|(of, it)| (it.value ^ word) & of & mask == 0)
        {
            let what = format!(
                "a word may be this state and that of {}",
                other.location.key
            );
            problems.push(
                value
                    .location
                    .problem(what)
                    .right("masks and values that no word meets twice"),
            );
        }
        seen.push((mask, value));
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::check;
    use crate::profile::testing::told_with;

    const START: &str = include_str!("../../../../../tests/golden/models/start.toml");
    const READY: &str = "register = \"status\"\nmask = 0x006F\nvalue = 0x0021";

    #[test]
    fn one_polled_register_shows_each_state_once() {
        let model = check::model(START).unwrap();
        let state_of = |word| model.drive_state(word);
        assert_eq!(state_of(0x0221).as_deref(), Some("ready to switch on"));
        assert_eq!(state_of(0x0208).as_deref(), Some("fault (inferred)"));
        assert_eq!(state_of(0x0060), None, "an unknown word has no text");
        for (to, expected) in [
            (
                "register = \"statis\"\nmask = 0x006F\nvalue = 0x0021",
                "no register called `statis` -> `status`",
            ),
            (
                "register = \"run\"\nmask = 0x006F\nvalue = 0x0021",
                "run.state[0].register: `run` is not polled -> a register with `poll`",
            ),
            (
                "register = \"status\"\nmask = 0x006F\nvalue = 0x0121",
                "run.state[0].value: 0x0121 has bits outside the mask 0x006F -> 0x0021, or a wider mask",
            ),
            (
                "register = \"status\"\nmask = 0x0023\nvalue = 0x0023",
                "run.state[1].value: a word may be this state and that of run.state[0].value -> masks and values",
            ),
            (
                "register = \"trip_code\"\nmask = 0x006F\nvalue = 0x0021",
                "run.state[1].register: run.state[0].register names another register -> `trip_code`: one register",
            ),
            (
                "register = \"status\"\nmask = 0x006F",
                "run.state[0].value: `value` is missing",
            ),
        ] {
            let found = told_with(START, READY, to).replace("\n    right: ", " -> ");
            assert!(found.contains(expected), "{to}: {found}");
        }
    }
}
