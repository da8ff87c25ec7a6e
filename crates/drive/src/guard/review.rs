//! The review: the rules in order of evaluation, each with its reason for a refusal.

use super::approved::{Approved, StopOrder};
use super::registers::{is_parameter, sets_watchdog};
use super::state::DriveGuard;
use super::trial;
use crate::domain::command::{
    CommandRequest, Direction, Order, OrderManner, Origin, Owner, Reason, Report, RunIntent,
};
use crate::domain::control::{ControlAction, ControlSettings, Ownership};
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::required;
use crate::drive::steps::{CommandStep, NoSteps};
use crate::profile::model::Model;
use std::time::Duration;

/// Default deadline: a command without its own is sent within this time or never. Every lease is longer.
pub const COMMAND_DEADLINE: Duration = Duration::from_secs(1);

/// Facts about the drive when a command is reviewed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DriveFacts {
    /// Requests can be sent over the line.
    pub line_is_up: bool,
    /// Another gateway of the line sends, or may send: this one listens.
    pub listens: bool,
    /// Too many exchanges with the drive fail.
    pub line_is_bad: bool,
    /// The drive has stopped answering.
    pub is_offline: bool,
    /// The drive has not shown yet what every drive of its model shows.
    pub is_implausible: bool,
    /// A stop is not effective yet.
    pub stop_pending: bool,
    /// Whether the drive is tripped, if that is known.
    pub tripped: Option<bool>,
    /// The motor is known to be at standstill.
    pub at_standstill: bool,
    /// Fresh readings show that the motor is not running, or is ramping down because of a stop given here. Only then does
    /// another stop change nothing.
    pub rests: bool,
    /// The drive refused the last stop sent to it, and none has taken effect since.
    pub stop_refused: bool,
    /// Output frequency, if it was read.
    pub output: Option<Hertz>,
    /// The direction in which the motor turns, if the drive shows it.
    pub turns: Option<Direction>,
    /// Whether the drive obeys its panel or terminals, if that is known.
    pub is_local: Option<bool>,
    /// The drive's own watchdog is known to be on and suitable for the configuration.
    pub is_watched: bool,
}

/// The verdict on a command.
#[derive(Debug)]
pub enum CommandVerdict {
    /// The command is already in force, or only renewed the lease: nothing is sent.
    Unchanged,
    /// The command joins the stop in progress.
    JoinsStop,
    /// The command is sent before everything else.
    Stop(StopOrder),
    /// A stop that is already in force is sent again: the drive refused it, and may accept it now.
    StopAgain(StopOrder),
    /// The command is sent in its turn.
    Go(Approved),
    /// Control has passed to the client, from the previous owner, if any.
    Taken(Option<Owner>),
}

impl DriveGuard {
    /// Reviews `command` at `now`.
    ///
    /// # Errors
    /// The reason for the refusal.
    pub fn review(
        &mut self,
        command: &CommandRequest,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        let control = self.control.clone().ok_or(refused(Reason::ReadOnly))?;
        let control = trial::settings(command, control)?;
        let origin = command.origin;
        may_come_from(&control, origin.owner, &command.order)?;
        comes_over_the_bus(&control, &command.order)?;
        if ends_a_reset(&command.order) {
            self.resetting.remove(origin.owner);
        }
        match &command.order {
            // A setpoint beside a stop is never accepted: the client sees that when it reads back.
            Order::Stop { .. } => self.review_stop(origin, facts, now),
            Order::Coast => self.review_coast(origin, &control, facts, now),
            Order::Take if facts.listens => Err(refused(Reason::Standby)),
            Order::Take => self.review_take(origin, &control, facts, now),
            order => {
                self.may_command(origin, &control, facts)
                    .inspect_err(|refused| {
                        if let Reason::LineDown
                        | Reason::Offline
                        | Reason::Standby
                        | Reason::Implausible = refused.reason
                        {
                            self.lease.was_out_of_reach(origin.owner, now);
                        }
                    })?;
                self.take_up(origin, order, &control, now);
                match order {
                    Order::Go(go) if sets_watchdog(&self.model, origin, go) => {
                        self.review_watchdog(command, go, facts, now)
                    }
                    Order::Go(go) if is_parameter(origin, go) => {
                        self.review_parameter(command, go, facts, now)
                    }
                    Order::Go(go) => self.review_go(command, go, &control, facts, now),
                    Order::Reset => self.review_reset(command, &control, facts, now),
                    Order::Release => self.review_release(command, &control, facts, now),
                    Order::Setup(addresses) => self.review_setup(command, addresses, facts, now),
                    Order::Renew
                    | Order::EndReset
                    | Order::Take
                    | Order::Stop { .. }
                    | Order::Coast => {
                        self.renew(origin.owner, now);
                        Ok(CommandVerdict::Unchanged)
                    }
                }
            }
        }
    }

    fn review_stop(
        &mut self,
        origin: Origin,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        may_stop(origin)?;
        self.stop(origin, false, facts, now)
    }

    fn review_coast(
        &mut self,
        origin: Origin,
        control: &ControlSettings,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        may_stop(origin)?;
        may_do(&self.model, ControlAction::Coast, control)?;
        self.stop(origin, true, facts, now)
    }

    /// Whether this cyclic order to stop is the one in force: its sender has commanded it since the last inhibit. If the
    /// drive has shown the effect of a stop since then, that holds for any other client's stop as well.
    fn is_stop_in_force(&mut self, origin: Origin, intent: RunIntent, facts: &DriveFacts) -> bool {
        if origin.manner != OrderManner::Cyclic || self.order.intent() != intent {
            return false;
        }
        if self.order.stop_took_effect() && facts.rests {
            self.start.arm(origin.owner);
        }
        self.start.is_armed(origin.owner)
    }

    fn stop(
        &mut self,
        origin: Origin,
        coast: bool,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        let in_force = self.is_stop_in_force(
            origin,
            if coast {
                RunIntent::Coast
            } else {
                RunIntent::Stop
            },
            facts,
        );
        if in_force && (facts.stop_pending || facts.rests) {
            self.renew(origin.owner, now);
            return Ok(if facts.stop_pending {
                CommandVerdict::JoinsStop
            } else {
                CommandVerdict::Unchanged
            });
        }
        let order = self
            .stop_of(origin.owner, coast, now)
            .ok_or(refused(Reason::NotCapable))?;
        Ok(if in_force && facts.stop_refused {
            CommandVerdict::StopAgain(order)
        } else {
            CommandVerdict::Stop(order)
        })
    }

    /// Accepts a stop of `owner`, which is sent. `None` if the model has no stop of this kind.
    fn stop_of(&mut self, owner: Owner, coast: bool, now: MonoTime) -> Option<StopOrder> {
        let order = self.stop_order(coast)?;
        self.accept_stop(Some(owner), coast, now);
        self.renew(owner, now);
        Some(order)
    }

    /// A stop of `owner` was answered from memory because the drive was not running; now it is seen running, and the stop
    /// is sent after all.
    pub fn stop_after_all(
        &mut self,
        owner: Owner,
        coast: bool,
        now: MonoTime,
    ) -> Option<StopOrder> {
        self.control.as_ref()?;
        self.stop_of(owner, coast, now)
    }

    /// Rules for every command but a stop.
    fn may_command(
        &self,
        origin: Origin,
        control: &ControlSettings,
        facts: &DriveFacts,
    ) -> Result<(), Report> {
        self.may_be_heard(origin)?;
        is_in_reach(facts)?;
        match self.lease.owner() {
            Some(other) if other != origin.owner && control.ownership == Ownership::One => {
                Err(Report::held_by(other))
            }
            _ => Ok(()),
        }
    }

    fn may_be_heard(&self, origin: Origin) -> Result<(), Report> {
        if !origin.rights.write {
            return Err(refused(Reason::NotAllowed));
        }
        self.closing.may_command()
    }

    /// Passes control to the client that takes it; the drive continues unchanged. Without an owner, control can be taken
    /// only of a motor that is not known to be at standstill.
    fn review_take(
        &mut self,
        origin: Origin,
        control: &ControlSettings,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        self.may_be_heard(origin)?;
        if !control.allow_take {
            return Err(refused(Reason::NoTake));
        }
        let holder = self.lease.owner();
        if holder == Some(origin.owner) {
            self.renew(origin.owner, now);
            return Ok(CommandVerdict::Unchanged);
        }
        let rests = facts.at_standstill && !self.order.is_to_run();
        if holder.is_none() && rests {
            return Ok(CommandVerdict::Unchanged);
        }
        self.lease.take(origin.owner, control.lost_after, now);
        Ok(CommandVerdict::Taken(holder))
    }

    pub(super) fn approve(
        &self,
        command: &CommandRequest,
        order: Order,
        steps: Vec<CommandStep>,
    ) -> Approved {
        let qualified = self
            .control
            .as_ref()
            .and_then(|control| control.qualified_drive());
        let mut all = required::before(&self.model, &order, self.is_identified, qualified);
        all.extend(steps);
        Approved::new(
            &self.model,
            command.origin.owner,
            order,
            all,
            command.start_before,
            self.order.stops(),
        )
    }
}

/// A control action requires a proven fact of the model, or acceptance in the control section.
pub(super) fn may_do(
    model: &Model,
    action: ControlAction,
    control: &ControlSettings,
) -> Result<(), Report> {
    let run = model
        .run
        .as_ref()
        .filter(|run| run.action(action).is_some());
    let run = run.ok_or(refused(Reason::NotCapable))?;
    if run.may(action, &control.accept_unverified) {
        Ok(())
    } else {
        Err(refused(Reason::Unverified))
    }
}

/// Whether orders other than stops can be sent to the drive.
fn is_in_reach(facts: &DriveFacts) -> Result<(), Report> {
    let reason = if facts.listens {
        Reason::Standby
    } else if !facts.line_is_up {
        Reason::LineDown
    } else if facts.is_offline {
        Reason::Offline
    } else if facts.is_implausible {
        Reason::Implausible
    } else {
        return Ok(());
    };
    Err(refused(reason))
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

/// Whether this order ends a client's hold on a reset.
fn ends_a_reset(order: &Order) -> bool {
    match order {
        Order::Go(go) => go.run().is_some(),
        Order::EndReset | Order::Stop { .. } | Order::Coast | Order::Release | Order::Take => true,
        Order::Reset | Order::Renew | Order::Setup(_) => false,
    }
}

/// A stop through Modbus depends on the listener's right to stop alone, whichever interfaces may command the drive.
fn may_come_from(control: &ControlSettings, owner: Owner, order: &Order) -> Result<(), Report> {
    let stops = order.is_stop();
    let allowed = match owner {
        Owner::ModbusTcp(_) | Owner::ModbusSecurity(_) | Owner::ModbusRtu(_) => {
            control.from_modbus_tcp || stops
        }
        Owner::Mqtt | Owner::MqttBy(_) => control.from_mqtt,
        Owner::Page(_) => control.from_page,
        Owner::Sparkplug => control.from_sparkplug,
        Owner::Local => true,
    };
    if allowed {
        Ok(())
    } else {
        Err(refused(Reason::NotFromHere))
    }
}

/// What is wired is not ordered over the bus. A stop is sent all the same: on some drives it acts whatever they obey, and
/// its outcome tells whether it did.
fn comes_over_the_bus(control: &ControlSettings, order: &Order) -> Result<(), Report> {
    let bus = control.bus;
    let may = match order {
        Order::Go(go) => {
            (go.run().is_none() || bus.has_run())
                && (go.frequency().is_none() || bus.has_frequency())
        }
        Order::Coast | Order::Reset | Order::Release => bus.has_run(),
        Order::Stop { .. } | Order::Setup(_) | Order::Take | Order::Renew | Order::EndReset => true,
    };
    if may {
        Ok(())
    } else {
        Err(refused(Reason::NotOverBus))
    }
}

/// A stop is carried out by a gateway that listens, too.
fn may_stop(origin: Origin) -> Result<(), Report> {
    if origin.rights.stop {
        Ok(())
    } else {
        Err(refused(Reason::NotAllowed))
    }
}
