//! Trials: one command of a person at the host that may use one unproven action, while the drive is being qualified.

use super::review::refused;
use crate::domain::command::{CommandRequest, Direction, Order, Owner, Reason, Report};
use crate::domain::control::{ControlAction, ControlSettings, FailSafe};
use std::sync::Arc;

/// The settings for the review of `command` alone: those of the drive, and the action that it tries. Nothing is
/// remembered of it, so the next command is reviewed as if there had been none.
pub(super) fn settings(
    command: &CommandRequest,
    control: Arc<ControlSettings>,
) -> Result<Arc<ControlSettings>, Report> {
    let Some(action) = command.trial else {
        return Ok(control);
    };
    // A motor that runs in a trial must stop when the person's command is killed.
    let may = control.qualify
        && command.origin.owner == Owner::Local
        && control.on_commander_lost != FailSafe::Hold;
    if !may {
        return Err(refused(Reason::NotAllowed));
    }
    if !is_of(action, &command.order) {
        return Err(refused(Reason::Conflict));
    }
    let mut tried = ControlSettings::clone(&control);
    tried.accept_unverified.push(action);
    if action == ControlAction::Reverse {
        // It rests on the same stop, setpoint and registers; the daemon accepts the mark only once these are sure.
        tried.accept_unverified.push(ControlAction::Basic);
    }
    Ok(Arc::new(tried))
}

/// Whether `order` is what a trial of `action` consists of.
fn is_of(action: ControlAction, order: &Order) -> bool {
    match (action, order) {
        (ControlAction::Basic, Order::Go(go)) => {
            go.registers().is_empty() && go.run() != Some(Direction::Reverse)
        }
        (ControlAction::Reverse, Order::Go(go)) => {
            go.registers().is_empty() && go.run() == Some(Direction::Reverse)
        }
        (ControlAction::Coast, Order::Coast)
        | (ControlAction::Reset, Order::Reset)
        | (ControlAction::Release, Order::Release) => true,
        _ => false,
    }
}
