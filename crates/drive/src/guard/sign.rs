//! The sign of a setpoint on a drive that turns by it: it never turns a motor round by itself.

use super::review::{DriveFacts, refused};
use super::run_order::RunOrder;
use crate::domain::command::{Direction, GoOrder, Reason, Report, RunIntent};
use crate::domain::control::ControlSettings;

/// Whether a setpoint that a client wrote alone, with a sign, leaves the direction as it is.
pub(super) fn may_stand(
    go: &GoOrder,
    order: &RunOrder,
    control: &ControlSettings,
    facts: &DriveFacts,
) -> Result<(), Report> {
    if go.run().is_some() || go.toward().is_none() || go.toward() == in_force(order, control, facts)
    {
        return Ok(());
    }
    Err(refused(Reason::SignUnknown))
}

/// `go` for a drive that turns by the sign: its setpoint has the sign of the direction in force if it has no direction of its
/// own.
pub(super) fn signed(
    go: GoOrder,
    order: &RunOrder,
    control: &ControlSettings,
    facts: &DriveFacts,
) -> Result<GoOrder, Report> {
    if go.run().is_some() || go.frequency().is_none() {
        return Ok(go);
    }
    let sign = in_force(order, control, facts).ok_or(refused(Reason::SignUnknown))?;
    Ok(go.with_sign(Some(sign)))
}

/// The direction in force, which a setpoint alone must keep: the one that was ordered here and that the motor, as far
/// as the drive shows it, has. `None` while it is not known, as of a motor that was started elsewhere.
fn in_force(order: &RunOrder, control: &ControlSettings, facts: &DriveFacts) -> Option<Direction> {
    if !control.bus.has_run() {
        // Terminals give the direction.
        return Some(Direction::Forward);
    }
    let ordered = match order.intent() {
        RunIntent::Run(direction) => Some(direction),
        RunIntent::Stop | RunIntent::Coast => None,
    };
    if facts.at_standstill {
        return Some(ordered.unwrap_or(Direction::Forward));
    }
    ordered.filter(|ordered| match facts.turns {
        Some(turns) => turns == *ordered,
        None => order.is_acknowledged(),
    })
}
