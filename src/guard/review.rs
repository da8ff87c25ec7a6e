//! The review: the rules in the order in which they are asked, each with its reason for a refusal.

use super::approved::{Approved, StopOrder};
use super::registers::is_parameter;
use super::state::DriveGuard;
use crate::domain::command::{CommandRequest, Direction, Go, Manner, Order, Origin, Owner, Reason, Report, RunIntent};
use crate::domain::control::{ControlAction, ControlSettings};
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::steps::{self, NoSteps};
use std::time::Duration;

/// A command that names no deadline is sent within this time or never (laws: every command has a deadline). Every lease
/// is longer.
pub const COMMAND_DEADLINE: Duration = Duration::from_secs(1);

/// What is known of the drive when a command is reviewed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Facts {
    /// Requests can be sent over the line.
    pub line_is_up: bool,
    /// Too many exchanges with the drive fail.
    pub line_is_bad: bool,
    /// The drive has stopped answering.
    pub is_offline: bool,
    /// A stop is not effective yet.
    pub stop_pending: bool,
    /// Whether the drive is tripped, if that is known.
    pub tripped: Option<bool>,
    /// The motor is known to stand still.
    pub at_standstill: bool,
    /// Output frequency, if it was read.
    pub output: Option<Hertz>,
    /// The direction in which the motor turns, if the drive shows it.
    pub turns: Option<Direction>,
    /// Whether the drive obeys its panel or terminals, if that is known.
    pub is_local: Option<bool>,
    /// The drive's own watchdog is known to be on, and to fit what was configured.
    pub is_watched: bool,
}

/// What becomes of a command.
#[derive(Debug)]
pub enum Verdict {
    /// It is in force already, or only renewed the lease: nothing goes to the line.
    Unchanged,
    /// It joins the stop that is on its way.
    JoinsStop,
    /// It goes to the line before everything else.
    Stop(StopOrder),
    /// It goes to the line in its turn.
    Go(Approved),
    /// Control has passed to the one who took it, from the one who held it, if anybody did.
    Taken(Option<Owner>),
}

impl DriveGuard {
    /// Reviews `command` at `now`.
    ///
    /// # Errors
    /// Why nothing may be put on the line.
    pub fn review(&mut self, command: &CommandRequest, facts: &Facts, now: MonoTime) -> Result<Verdict, Report> {
        let control = self.control.clone().ok_or(refused(Reason::ReadOnly))?;
        let origin = command.origin;
        may_come_from(&control, origin.owner, &command.order)?;
        if ends_a_reset(&command.order) {
            self.resetting.remove(origin.owner);
        }
        match &command.order {
            Order::Stop { setpoint } => self.review_stop(command, *setpoint, &control, facts, now),
            Order::Coast => self.review_coast(origin, &control, facts, now),
            Order::Take => self.review_take(origin, &control, facts, now),
            order => {
                self.may_command(origin, &control, facts)?;
                match order {
                    Order::Go(go) if self.sets_watchdog(origin, go) => self.review_watchdog(command, go, facts, now),
                    Order::Go(go) if is_parameter(origin, go) => self.review_parameter(command, go, facts, now),
                    Order::Go(go) => self.review_go(command, go, &control, facts, now),
                    Order::Reset => self.review_reset(command, &control, facts, now),
                    Order::Release => self.review_release(command, &control, facts, now),
                    Order::Setup(addresses) => self.review_setup(command, addresses, facts, now),
                    Order::Renew | Order::EndReset | Order::Take | Order::Stop { .. } | Order::Coast => {
                        self.renew(origin.owner, now);
                        Ok(Verdict::Unchanged)
                    }
                }
            }
        }
    }

    fn review_stop(
        &mut self,
        command: &CommandRequest,
        setpoint: Option<Hertz>,
        control: &ControlSettings,
        facts: &Facts,
        now: MonoTime,
    ) -> Result<Verdict, Report> {
        let origin = command.origin;
        may_stop(origin)?;
        let in_force = self.is_stop_in_force(origin, RunIntent::Stop);
        if let Some(setpoint) = setpoint.filter(|_| in_force && !facts.stop_pending) {
            // The stop changes nothing any more, so the setpoint is a command of its own.
            let go = Go::new(Vec::new(), Some(setpoint), None).ok_or(refused(Reason::NotUnderstood))?;
            self.may_command(origin, control, facts)?;
            return self.review_go(command, &go, control, facts, now);
        }
        // A setpoint beside a stop that acts is dropped: none follows a stop that is not effective. What the
        // commander reads back shows it.
        self.stop(origin, in_force, false, facts, now)
    }

    fn review_coast(
        &mut self,
        origin: Origin,
        control: &ControlSettings,
        facts: &Facts,
        now: MonoTime,
    ) -> Result<Verdict, Report> {
        may_stop(origin)?;
        self.may_do(ControlAction::Coast, control)?;
        let in_force = self.is_stop_in_force(origin, RunIntent::Coast);
        self.stop(origin, in_force, true, facts, now)
    }

    /// Whether this cyclic order to stop changes nothing: its sender has commanded it since the last inhibit.
    fn is_stop_in_force(&self, origin: Origin, intent: RunIntent) -> bool {
        origin.manner == Manner::Cyclic && self.intent() == intent && self.armed.has(origin.owner)
    }

    fn stop(
        &mut self,
        origin: Origin,
        in_force: bool,
        coast: bool,
        facts: &Facts,
        now: MonoTime,
    ) -> Result<Verdict, Report> {
        if in_force {
            self.renew(origin.owner, now);
            return Ok(if facts.stop_pending { Verdict::JoinsStop } else { Verdict::Unchanged });
        }
        let order = self.stop_order(coast).ok_or(refused(Reason::NotCapable))?;
        self.accept_stop(Some(origin.owner), coast, now);
        self.renew(origin.owner, now);
        Ok(Verdict::Stop(order))
    }

    /// A control action needs a fact of the model that is proven, or that the control section accepts as it is.
    pub(super) fn may_do(&self, action: ControlAction, control: &ControlSettings) -> Result<(), Report> {
        let run = self.model.run.as_ref().filter(|run| run.action(action).is_some());
        let run = run.ok_or(refused(Reason::NotCapable))?;
        if run.may(action, &control.accept_unverified) { Ok(()) } else { Err(refused(Reason::Unverified)) }
    }

    pub(super) fn approve(&self, command: &CommandRequest, order: Order, steps: Vec<steps::Step>) -> Approved {
        let (owner, start_before) = (command.origin.owner, command.start_before);
        Approved { order, owner, stops: self.stops(), start_before, steps }
    }
}

pub(super) fn refused(reason: Reason) -> Report {
    Report::refused(reason)
}

pub(super) fn no_steps(no: NoSteps) -> Report {
    refused(match no {
        NoSteps::NotCapable => Reason::NotCapable,
        NoSteps::BetweenSteps => Reason::BetweenSteps,
        NoSteps::SetpointUnknown => Reason::SetpointUnknown,
    })
}

/// Whether a commander that orders this holds an order to reset no longer.
fn ends_a_reset(order: &Order) -> bool {
    match order {
        Order::Go(go) => go.run().is_some(),
        Order::EndReset | Order::Stop { .. } | Order::Coast | Order::Release | Order::Take => true,
        Order::Reset | Order::Renew | Order::Setup(_) => false,
    }
}

/// A stop from Modbus TCP is a matter of the listener's `stop` alone, whatever sides the drive is commanded from.
fn may_come_from(control: &ControlSettings, owner: Owner, order: &Order) -> Result<(), Report> {
    let stops = order.is_stop();
    let allowed = match owner {
        Owner::ModbusTcp(_) | Owner::ModbusSecurity(_) => control.from_modbus_tcp || stops,
        Owner::Mqtt | Owner::MqttBy(_) => control.from_mqtt,
        Owner::Page(_) => control.from_page,
        Owner::Sparkplug => control.from_sparkplug,
        Owner::Local => true,
    };
    if allowed { Ok(()) } else { Err(refused(Reason::NotFromHere)) }
}

fn may_stop(origin: Origin) -> Result<(), Report> {
    if origin.rights.stop { Ok(()) } else { Err(refused(Reason::NotAllowed)) }
}
