//! The review: the rules in the order in which they are asked, each with its reason for a refusal.

use super::approved::{Approved, StopOrder};
use super::state::DriveGuard;
use crate::domain::command::{
    CommandRequest, Direction, Go, Manner, Order, Origin, Outcome, Owner, Reason, RegisterWrite, Report, RunIntent,
};
use crate::domain::control::{ControlAction, ControlSettings};
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::decode;
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
        match &command.order {
            Order::Stop { setpoint } => self.review_stop(command, *setpoint, &control, facts, now),
            Order::Coast => self.review_coast(origin, &control, facts, now),
            order => {
                self.may_command(origin, facts)?;
                match order {
                    Order::Go(go) => self.review_go(command, go, &control, facts, now),
                    Order::Reset => self.review_reset(command, &control, facts, now),
                    Order::Release => self.review_release(command, &control, facts, now),
                    Order::Setup(addresses) => self.review_setup(command, addresses, facts, now),
                    Order::Take => Err(refused(Reason::NoTake)),
                    Order::Renew | Order::Stop { .. } | Order::Coast => {
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
            self.may_command(origin, facts)?;
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
        origin.manner == Manner::Cyclic && self.intent() == intent && self.is_armed(origin.owner)
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

    /// What holds for every command but a stop.
    fn may_command(&self, origin: Origin, facts: &Facts) -> Result<(), Report> {
        let reason = if !origin.rights.write {
            Reason::NotAllowed
        } else if self.is_ending {
            Reason::ShuttingDown
        } else if self.is_leaving {
            Reason::Removed
        } else if !facts.line_is_up {
            Reason::LineDown
        } else if facts.is_offline {
            Reason::Offline
        } else if self.lease().is_some_and(|(owner, _)| owner != origin.owner) {
            Reason::OtherOwner
        } else {
            return Ok(());
        };
        Err(refused(reason))
    }

    fn review_go(
        &mut self,
        command: &CommandRequest,
        go: &Go,
        control: &ControlSettings,
        facts: &Facts,
        now: MonoTime,
    ) -> Result<Verdict, Report> {
        let owner = command.origin.owner;
        self.may_be_written(go.registers(), control)?;
        if let Some(frequency) = go.frequency() {
            is_within(frequency, control)?;
        }
        if let Some(direction) = go.run() {
            self.may_turn(direction, control)?;
        }
        let Some(go) = self.what_changes(command.origin, go) else {
            self.renew(owner, now);
            return Ok(Verdict::Unchanged);
        };
        if go.run().is_some() || go.frequency().is_some() {
            self.may_move(command, &go, control, facts, now)?;
        }
        let steps = steps::of_go(&self.model, &go, control, self.setpoint()).map_err(no_steps)?;
        let moves = go.run().is_some() || (go.frequency().is_some() && !facts.at_standstill);
        if moves || self.lease_of(owner).is_some() {
            self.take_lease(owner, now);
        }
        if let Some(frequency) = go.frequency() {
            self.accept_setpoint(owner, frequency);
        }
        if let Some(direction) = go.run() {
            self.accept_run(owner, direction);
        }
        Ok(Verdict::Go(self.approve(command, Order::Go(go), steps)))
    }

    /// A register is listed, and is no way around control whoever has listed it.
    fn may_be_written(&self, writes: &[RegisterWrite], control: &ControlSettings) -> Result<(), Report> {
        writes.iter().try_for_each(|write| {
            let is_listed = control.native_write.contains(&write.address);
            let allowed = if is_listed { decode::register(&self.model, *write) } else { Err(Reason::NotListed) };
            allowed.map_err(refused)
        })
    }

    /// The parts of a cyclic order that are not in force already; nothing if all are.
    fn what_changes(&self, origin: Origin, go: &Go) -> Option<Go> {
        if origin.manner == Manner::Once {
            return Some(go.clone());
        }
        let holds = self.lease_of(origin.owner).is_some();
        let run = go
            .run()
            .filter(|direction| !(holds && self.run_acknowledged && self.intent() == RunIntent::Run(*direction)));
        let frequency = go.frequency().filter(|frequency| {
            !self
                .accepted_setpoint()
                .is_some_and(|last| last.acknowledged && last.value == *frequency && last.by == origin.owner)
        });
        Go::new(go.registers().to_vec(), frequency, run)
    }

    /// Rules for orders that may move a motor.
    fn may_move(
        &self,
        command: &CommandRequest,
        go: &Go,
        control: &ControlSettings,
        facts: &Facts,
        now: MonoTime,
    ) -> Result<(), Report> {
        if facts.stop_pending {
            return Err(refused(Reason::StopPending));
        }
        if command.epoch.is_some_and(|epoch| epoch != self.epoch()) {
            return Err(refused(Reason::StaleEpoch));
        }
        if now >= command.start_before {
            return Err(Report::new(Outcome::Expired, Reason::TooLate));
        }
        if facts.line_is_bad && (go.run().is_some() || self.is_higher(go)) {
            return Err(refused(Reason::LineQuality));
        }
        let Some(direction) = go.run() else { return Ok(()) };
        if facts.tripped == Some(true) {
            return Err(refused(Reason::Tripped));
        }
        self.may_start(command, control, now)?;
        let turns_the_other_way = self.turned.is_some_and(|turned| turned != direction) && !facts.at_standstill;
        let too_fast = facts.output.is_none_or(|output| output > control.reverse_below);
        if turns_the_other_way && too_fast {
            return Err(refused(Reason::Reversal));
        }
        Ok(())
    }

    /// Whether the frequency of `go` is above the one in force, or may be.
    fn is_higher(&self, go: &Go) -> bool {
        go.frequency().is_some_and(|frequency| self.setpoint().is_none_or(|in_force| frequency > in_force))
    }

    /// The start inhibit. A cyclic commander shows by a stop that it knows; a message shows it by having been sent
    /// after the last stop, which is believed after a while or by its epoch or moment of issue.
    fn may_start(&self, command: &CommandRequest, control: &ControlSettings, now: MonoTime) -> Result<(), Report> {
        if command.origin.manner == Manner::Cyclic {
            return if self.is_armed(command.origin.owner) { Ok(()) } else { Err(refused(Reason::StartInhibited)) };
        }
        let issued_since = match (command.issued, self.stopped_at) {
            (Some(issued), Some(stopped)) => issued > stopped,
            (Some(_), None) => true,
            (None, _) => false,
        };
        if command.epoch.is_some() || issued_since {
            return Ok(());
        }
        if control.strict {
            return Err(refused(Reason::EpochNeeded));
        }
        let too_soon = self.stopped_at.is_some_and(|stopped| now.since(stopped) < control.restart_delay);
        if too_soon { Err(refused(Reason::RestartDelay)) } else { Ok(()) }
    }

    fn may_turn(&self, direction: Direction, control: &ControlSettings) -> Result<(), Report> {
        if !control.directions.contains(&direction) {
            return Err(refused(Reason::DirectionNotAllowed));
        }
        match direction {
            Direction::Forward => Ok(()),
            Direction::Reverse => self.may_do(ControlAction::Reverse, control),
        }
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

/// A stop from Modbus TCP is a matter of the listener's `stop` alone, whatever sides the drive is commanded from.
fn may_come_from(control: &ControlSettings, owner: Owner, order: &Order) -> Result<(), Report> {
    let stops = matches!(order, Order::Stop { .. } | Order::Coast);
    let allowed = match owner {
        Owner::ModbusTcp(_) => control.from_modbus_tcp || stops,
        Owner::Mqtt | Owner::MqttBy(_) => control.from_mqtt,
        Owner::Local => true,
    };
    if allowed { Ok(()) } else { Err(refused(Reason::NotFromHere)) }
}

fn may_stop(origin: Origin) -> Result<(), Report> {
    if origin.rights.stop { Ok(()) } else { Err(refused(Reason::NotAllowed)) }
}

fn is_within(frequency: Hertz, control: &ControlSettings) -> Result<(), Report> {
    let within = (control.least..=control.most).contains(&frequency);
    if within { Ok(()) } else { Err(refused(Reason::OutsideLimits)) }
}
