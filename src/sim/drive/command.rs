//! Meaning of a word in the run command register.

use crate::profile::model::{BitMeaning, RunCommand, RunForm};

/// The orders in a run command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct RunOrder {
    /// 1 forward, -1 reverse, 0 stop.
    pub(super) direction: i64,
    /// It runs at the jog frequency.
    pub(super) jog: bool,
    pub(super) coast: bool,
    pub(super) trip: bool,
    pub(super) reset: bool,
    /// Returns control to panel and terminals.
    pub(super) release: bool,
    /// Makes the drive obey the bus whatever its source registers say.
    pub(super) bus_run: bool,
    /// The same for the frequency.
    pub(super) bus_frequency: bool,
    /// Everything else stays unchanged: the word is one command, not a set of states.
    pub(super) is_one_command: bool,
}

/// The orders in `word`; `None` if it has no meaning.
pub(super) fn wish(run: &RunCommand, word: u16) -> Option<RunOrder> {
    match &run.form {
        RunForm::Values => one_command(run, word),
        RunForm::Bits { bits, .. } => {
            let meanings: Vec<_> = (0..16)
                .filter(|bit| word & (1 << bit) != 0)
                .map(|bit| bits.iter().find(|it| u16::from(it.bit.value) == bit).map(|it| it.meaning))
                .collect::<Option<_>>()?;
            states(&meanings)
        }
    }
}

/// Whether the model's words can take control whatever the drive's source registers say.
pub(super) fn has_priority(run: &RunCommand) -> bool {
    let takes = |meaning| matches!(meaning, BitMeaning::BusRun | BitMeaning::BusFrequency);
    matches!(&run.form, RunForm::Bits { bits, .. } if bits.iter().any(|it| takes(it.meaning)))
}

fn one_command(run: &RunCommand, word: u16) -> Option<RunOrder> {
    let none = RunOrder { is_one_command: true, ..RunOrder::default() };
    let wishes = [
        (Some(&run.stop), none),
        (Some(&run.forward), RunOrder { direction: 1, ..none }),
        (run.reverse.as_ref(), RunOrder { direction: -1, ..none }),
        (run.coast.as_ref(), RunOrder { coast: true, ..none }),
        (run.reset.as_ref(), RunOrder { reset: true, ..none }),
        (run.release.as_ref(), RunOrder { release: true, ..none }),
    ];
    wishes.into_iter().find(|(fact, _)| fact.is_some_and(|fact| fact.value == word)).map(|(_, wish)| wish)
}

fn states(meanings: &[BitMeaning]) -> Option<RunOrder> {
    use BitMeaning::{BusFrequency, BusRun, Coast, Jog, Reset, Reverse, Run, RunForward, RunReverse, Trip};
    let has = |meaning| meanings.contains(&meaning);
    let direction = match (has(RunForward), has(RunReverse)) {
        (true, true) => return None,
        (true, false) => 1,
        (false, true) => -1,
        (false, false) if !has(Run) && !has(Jog) => 0,
        (false, false) if has(Reverse) => -1,
        (false, false) => 1,
    };
    Some(RunOrder {
        direction,
        jog: has(Jog),
        coast: has(Coast),
        trip: has(Trip),
        reset: has(Reset),
        release: false,
        bus_run: has(BusRun),
        bus_frequency: has(BusFrequency),
        is_one_command: false,
    })
}
