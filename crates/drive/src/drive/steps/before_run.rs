//! What is sent before the run word: the words of a start, each once the drive shows the effect of the one before, and the
//! direction of a model that takes it in a register of its own.

use super::{
    AwaitStep, CommandStep, NoSteps, RegisterCondition, SHOWN_WITHIN, SkipSteps, StepPart,
    WriteStep, order,
};
use crate::domain::address::Address;
use crate::domain::command::{Direction, Reason};
use crate::profile::model::{IndicatedState, Model, OrderKind, StartCondition, StartStep};
use std::time::Duration;

/// `steps` of a run order, with what goes before the frame that carries the run word.
///
/// # Errors
/// [`NoSteps::NotCapable`]
pub(super) fn before_run(
    model: &Model,
    direction: Direction,
    steps: Vec<CommandStep>,
) -> Result<Vec<CommandStep>, NoSteps> {
    let has_run = |step: &CommandStep| matches!(step, CommandStep::Write(writes) if writes.iter().any(|it| matches!(it.part, StepPart::Run(_))));
    let at = steps.iter().position(has_run).unwrap_or(steps.len());
    let mut before = start(model)?;
    before.extend(turn(model, direction)?);
    let mut all = steps;
    all.splice(at..at, before);
    Ok(all)
}

/// The words of a start. A drive that shows that it runs needs none of them. One that is ready for the run word needs none of
/// those before the last, which might take it back to a state in which its output is off: it may still ramp down. Neither
/// does it need the last, unless that is the stop, which changes nothing in such a drive, and after which the run word is a
/// change of the word that it holds.
fn start(model: &Model) -> Result<Vec<CommandStep>, NoSteps> {
    let starts = model.start_steps();
    let Some(last) = starts.last() else {
        return Ok(Vec::new());
    };
    let (address, _) = order(model, OrderKind::Forward)?;
    let (_, stop) = order(model, OrderKind::Stop)?;
    let steps: Vec<CommandStep> = starts
        .iter()
        .flat_map(|step| written(address, step))
        .collect();
    let kept = if last.write.value == stop {
        written(address, last).len()
    } else {
        0
    };
    let count = steps.len() - kept;
    let is_ready = match met_after(last) {
        Some(condition) if count > 0 => Some(CommandStep::Skip(SkipSteps { condition, count })),
        _ => None,
    };
    let runs =
        RegisterCondition::flag(model, IndicatedState::Running, true).ok_or(NoSteps::NotCapable)?;
    let all = is_ready.into_iter().chain(steps).collect::<Vec<_>>();
    Ok([CommandStep::Skip(SkipSteps {
        condition: runs,
        count: all.len(),
    })]
    .into_iter()
    .chain(all)
    .collect())
}

fn written(address: Address, step: &StartStep) -> [CommandStep; 2] {
    let write = WriteStep {
        address,
        value: step.write.value,
        part: StepPart::Start,
        shown: Vec::new(),
    };
    let wait = match met_after(step) {
        Some(condition) => CommandStep::Await(AwaitStep {
            condition,
            at_least: step.at_least,
            reason: Reason::NotReady,
        }),
        None => CommandStep::Pause(step.at_least),
    };
    [CommandStep::Write(vec![write]), wait]
}

/// What the drive shows once it has followed `step`; `None` if only time must pass.
fn met_after(step: &StartStep) -> Option<RegisterCondition> {
    let until = step.until.as_ref()?;
    let StartCondition {
        address,
        mask,
        values,
        within,
    } = until.clone();
    Some(RegisterCondition {
        address,
        mask,
        values,
        second: None,
        instead: None,
        within,
    })
}

/// The direction. If its register can be read, the run word is sent only after it was read to hold the direction: an order
/// is never given by half.
fn turn(model: &Model, direction: Direction) -> Result<Vec<CommandStep>, NoSteps> {
    let words = model
        .run
        .as_ref()
        .and_then(|run| run.places.direction.as_ref());
    let Some(words) = words.map(|fact| &fact.value) else {
        return Ok(Vec::new());
    };
    let value = match direction {
        Direction::Forward => words.forward,
        Direction::Reverse => words.reverse.ok_or(NoSteps::NotCapable)?,
    };
    let write = WriteStep {
        address: words.address,
        value,
        part: StepPart::Direction(direction),
        shown: Vec::new(),
    };
    let is_readable = model
        .writable_at(words.address)
        .is_some_and(|register| register.access.can_read());
    let read = is_readable.then(|| {
        let condition = RegisterCondition::holds(words.address, vec![value], SHOWN_WITHIN);
        CommandStep::Await(AwaitStep {
            condition,
            at_least: Duration::ZERO,
            reason: Reason::KeptOldValue,
        })
    });
    Ok([CommandStep::Write(vec![write])]
        .into_iter()
        .chain(read)
        .collect())
}
