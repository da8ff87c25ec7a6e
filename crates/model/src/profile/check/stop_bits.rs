//! The rules for the bits of an order to run that a stop keeps or changes: with all of them it is still the stop.

use super::run_word::{bits_are_declared, declared, orders_one_thing};
use crate::domain::problem::Problem;
use crate::profile::file::{FormWord, RunFile};
use crate::profile::model::OrderKind;
use crate::toml_file::LocatedValue;

pub(super) fn check(run: &RunFile, problems: &mut Vec<Problem>) {
    let Some(LocatedValue { value: order, .. }) = &run.stop.value else {
        return;
    };
    let (keep, drop) = (order.keep.valid(), order.drop.valid());
    if run
        .form
        .as_ref()
        .is_some_and(|form| form.value == FormWord::Values)
    {
        for written in keep.into_iter().chain(drop) {
            let problem = written
                .location
                .problem("each word is one command, so single bits have no meaning");
            problems.push(problem.right("leave it out, or form = \"bits\""));
        }
        return;
    }
    keep.into_iter()
        .chain(drop)
        .for_each(|written| bits_are_declared(written, declared(run), problems));
    if let (Some(keep), Some(drop)) = (keep, drop)
        && keep.value & drop.value != 0
    {
        let what = format!(
            "0x{:04X} is in {} as well",
            keep.value & drop.value,
            keep.location.key
        );
        problems.push(
            drop.location
                .problem(what)
                .right("bits that the stop either keeps or changes"),
        );
    }
    let Some(keep) = keep else { return };
    if let Some(register) = run.named(OrderKind::Stop) {
        let what = format!(
            "the stop goes to {}, which holds no order to run",
            register.value
        );
        problems.push(keep.location.problem(what).right("leave it out"));
        return;
    }
    let Some(stop) = run.stop.word() else { return };
    let ordered = run
        .own_words()
        .filter(|(kind, _)| matches!(kind, OrderKind::Forward | OrderKind::Reverse));
    for (_, order) in ordered {
        let value = stop.value & !keep.value | order.value & keep.value;
        if value == order.value {
            let what = format!(
                "0x{value:04X} would be the stop after {}",
                order.location.key
            );
            problems.push(
                keep.location
                    .problem(what)
                    .right("bits that do not run the motor"),
            );
            continue;
        }
        let word = LocatedValue {
            value,
            location: keep.location.clone(),
        };
        orders_one_thing(OrderKind::Stop, &word, run, problems);
    }
}

#[cfg(test)]
mod tests {
    use crate::domain::command::Direction;
    use crate::profile::check::model;
    use crate::profile::model::OrderedWord;
    use crate::profile::testing::{EVERYTHING, told_with};

    const STOP: &str = "stop = { value = 0xC000, ";

    fn with(keys: &str) -> String {
        format!("stop = {{ value = 0xC000, {keys}, ")
    }

    #[test]
    fn a_stop_has_the_bits_that_it_keeps_as_the_last_order_had_them() {
        let run = model(&EVERYTHING.replace(STOP, &with("keep = 0x0200")))
            .unwrap()
            .run
            .unwrap();
        let words = [None, Some(Direction::Forward), Some(Direction::Reverse)]
            .map(|after| run.stop_word(after));
        assert_eq!(words, [0xC000, 0xC000, 0xC200]);
        assert_eq!(
            [0xC000, 0xC200, 0xC201].map(|word| run.order_in(word)),
            [Some(OrderedWord::Stop), Some(OrderedWord::Stop), None]
        );
        assert_eq!(run.changed_by_stop(Direction::Reverse), 0);
    }

    #[test]
    fn a_stop_that_changes_more_than_the_running_says_so() {
        let run = |text: &str| model(text).unwrap().run.unwrap();
        let changed = |text: &str| {
            [Direction::Forward, Direction::Reverse].map(|after| run(text).changed_by_stop(after))
        };
        assert_eq!(changed(EVERYTHING), [0, 0x0200]);
        let said = EVERYTHING.replace(STOP, &with("drop = 0x0200"));
        assert_eq!(changed(&said), [0, 0]);
        assert_eq!(run(&said).stop_word(Some(Direction::Reverse)), 0xC000);
    }

    #[test]
    fn what_a_stop_keeps_leaves_it_a_stop() {
        for (keys, expected) in [
            (
                "keep = 0x0002",
                "run.stop.keep: 0x0002 has an undeclared bit: 1",
            ),
            (
                "keep = 0x0600",
                "run.stop.keep: 0xC400 would be the stop after run.forward.value",
            ),
            (
                "keep = 0x0200, drop = 0x0200",
                "run.stop.drop: 0x0200 is in run.stop.keep as well",
            ),
            ("keep = 0", "run.stop.keep: 0 is out of range"),
        ] {
            let found = told_with(EVERYTHING, STOP, &with(keys));
            assert!(found.contains(expected), "{keys}: {found}");
        }
    }
}
