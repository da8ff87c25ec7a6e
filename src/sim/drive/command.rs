//! What a word in the run command register means.

use crate::profile::model::{BitMeaning, RunCommand, RunForm};

/// What a run command orders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct RunOrder {
    /// 1 forward, -1 reverse, 0 not to run.
    pub(super) direction: i64,
    /// It runs at the jog frequency.
    pub(super) jog: bool,
    pub(super) coast: bool,
    pub(super) trip: bool,
    pub(super) reset: bool,
    /// Panel and terminals get control back.
    pub(super) release: bool,
    /// The drive obeys the bus whatever its sources say.
    pub(super) bus_run: bool,
    /// The same for the frequency.
    pub(super) bus_frequency: bool,
    /// What is not ordered goes on as it was: the word is one command and not a set of states.
    pub(super) is_one_command: bool,
}

/// What `word` orders; nothing if it means nothing.
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

/// Whether the model's words can take control whatever the drive's sources say.
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
