//! The steps of a reset, and those that clear the word of one that was interrupted.

use super::{CommandStep, NoSteps, RegisterCondition, StepPart, WriteStep};
use crate::domain::command::Reason;
use crate::profile::model::{IndicatedState, Model, OrderKind, RegisterRole, ResetWrite};
use std::time::Duration;

/// The steps of a reset: the model's sequence, after which nothing turns.
///
/// # Errors
/// [`NoSteps::NotCapable`]
pub fn of_reset(model: &Model) -> Result<Vec<CommandStep>, NoSteps> {
    let writes = model.reset_writes();
    let last = writes.len().checked_sub(1).ok_or(NoSteps::NotCapable)?;
    let is_seen = model.status_flag(IndicatedState::Tripped).is_some();
    let step = |(index, write): (usize, &ResetWrite)| {
        let ends = index == last;
        let part = StepPart::Reset {
            resets: write.resets,
            ends,
            is_seen,
        };
        let shown = if ends { reset_shown(model) } else { Vec::new() };
        let pause = (!write.wait.is_zero()).then_some(CommandStep::Pause(write.wait));
        let write = WriteStep {
            address: write.address,
            value: write.value,
            part,
            shown,
        };
        [CommandStep::Write(vec![write])].into_iter().chain(pause)
    };
    let rest = model
        .quirks
        .deaf_after_reset
        .as_ref()
        .map(|deaf| CommandStep::Rest(deaf.value));
    Ok(writes
        .iter()
        .enumerate()
        .flat_map(step)
        .chain(rest)
        .collect())
}

/// The steps that clear the word of an interrupted reset: by a stop, or by the word that clears a register of its own. If
/// the register can be read, only if it still holds the reset word.
///
/// # Errors
/// [`NoSteps::NotCapable`] if a reset leaves no word in the register.
pub fn of_take_back(model: &Model) -> Result<Vec<CommandStep>, NoSteps> {
    let clears = model.reset_clears().ok_or(NoSteps::NotCapable)?;
    let (address, reset) = model.order(OrderKind::Reset).ok_or(NoSteps::NotCapable)?;
    let is_readable = model
        .writable_at(address)
        .is_some_and(|register| register.access.can_read());
    let check = CommandStep::Check {
        address,
        least: reset.value,
        most: reset.value,
        reason: Reason::SetpointUnknown,
    };
    let check = is_readable.then_some(check);
    let write = WriteStep {
        address,
        value: clears.value,
        part: StepPart::TakesBack,
        shown: Vec::new(),
    };
    Ok(check
        .into_iter()
        .chain([CommandStep::Write(vec![write])])
        .collect())
}

/// After a reset no trip holds and nothing turns, as far as the model shows it.
fn reset_shown(model: &Model) -> Vec<RegisterCondition> {
    let flags = [IndicatedState::Tripped, IndicatedState::Running]
        .into_iter()
        .filter_map(|flag| RegisterCondition::flag(model, flag, false));
    let mut shown: Vec<_> = flags.collect();
    if shown.is_empty() {
        // One word of a pair may be 0 although the motor turns.
        let output = model
            .register_for(RegisterRole::OutputFrequency)
            .filter(|output| output.form.is_one_word());
        shown.extend(
            output.map(|output| RegisterCondition::holds(output.address, vec![0], Duration::ZERO)),
        );
    }
    shown
}
