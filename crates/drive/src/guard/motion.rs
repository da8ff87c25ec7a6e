//! The review of orders that may move a motor: setpoint and RUN, and their interlocks.

use super::review::{CommandVerdict, DriveFacts, may_do, no_steps, refused};
use super::run_order::RunOrder;
use super::setpoint::{InForce, SetpointOrder};
use super::state::DriveGuard;
use super::{commit, registers, sign};
use crate::domain::command::{
    CommandRequest, Direction, GoOrder, Order, OrderManner, Origin, Outcome, Owner, Reason, Report,
    RunIntent,
};
use crate::domain::control::{ControlAction, ControlSettings, Ownership};
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::steps::{self, CommandStep};
use crate::profile::model::{Model, RegisterRole, RunForm};

impl DriveGuard {
    pub(super) fn review_go(
        &mut self,
        command: &CommandRequest,
        go: &GoOrder,
        control: &ControlSettings,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        let owner = command.origin.owner;
        registers::may_be_written(&self.model, &self.interlocks, go.registers(), control, now)?;
        may_be_ordered(&self.model, go, control)?;
        if let Some(frequency) = go.frequency() {
            is_within(frequency, control)?;
        }
        if let Some(direction) = go.run() {
            may_turn(&self.model, direction, control)?;
        }
        sign::may_stand(go, &self.order, control, facts)?;
        // A controller that only sets parameters may no longer be supervising the motor.
        let renews = command.origin.manner == OrderManner::Once
            || go.run().is_some()
            || go.frequency().is_some();
        let in_force = self
            .setpoint
            .is_in_force(self.is_worn_by_setpoint(control, now));
        let given = go;
        let Some(go) = self.what_changes(command.origin, given, control, in_force) else {
            self.renew_unchanged(owner, control, now);
            return if given.frequency().is_some() {
                in_force.report()
            } else {
                Ok(())
            }
            .map(|()| CommandVerdict::Unchanged);
        };
        if given.frequency() != go.frequency() {
            in_force.report()?;
        }
        if go.run().is_some() || go.frequency().is_some() {
            self.may_move(command, &go, control, facts, now)
                .inspect_err(|report| {
                    if go.run().is_some()
                        && command.origin.manner == OrderManner::Cyclic
                        && is_ended_at_the_drive(report.reason)
                    {
                        self.start.disarm(owner);
                    }
                })?;
            self.setpoint.knows_full_scale(now)?;
        }
        let (go, steps) = self.steps_of(go, control, facts, now)?;
        let moves = go.run().is_some() || (go.frequency().is_some() && !facts.at_standstill);
        if moves || (renews && self.lease.counts_as_held_by(owner, control)) {
            self.lease.take(owner, control.lost_after, now);
        }
        self.interlocks.approved(&self.model, go.registers(), now);
        let is_repeated = go
            .frequency()
            .is_some_and(|frequency| self.setpoint.is_repeated(frequency));
        if let Some(frequency) = go.frequency() {
            self.setpoint.accept(owner, frequency);
        }
        if let Some(direction) = go.run() {
            self.accept_run(owner, direction);
        }
        let is_answered_late = is_repeated && command.origin.manner == OrderManner::Cyclic;
        Ok(CommandVerdict::Go(
            self.approve(command, Order::Go(go), steps)
                .answered_when_shown(is_answered_late),
        ))
    }

    /// `go` as it is sent, with its steps.
    fn steps_of(
        &mut self,
        go: GoOrder,
        control: &ControlSettings,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<(GoOrder, Vec<CommandStep>), Report> {
        let go = if self.model.turns_by_sign() {
            sign::signed(go, &self.order, control, facts)?
        } else {
            go
        };
        let may_turn = !facts.at_standstill || self.order.is_to_run();
        let commit =
            commit::after_write(&self.model, &self.interlocks, &go, control, may_turn, now)?;
        let (setpoint, bases) = (self.setpoint.value(), self.setpoint.bases());
        let mut steps =
            steps::of_go(&self.model, &go, control, setpoint, bases).map_err(no_steps)?;
        commit::append(&mut steps, commit.as_ref(), &mut self.interlocks, now);
        if go
            .run()
            .is_some_and(|direction| turns_round(&self.order, direction, control, facts))
        {
            steps.splice(0..0, standstill(&self.model, &self.order));
        }
        Ok((go, steps))
    }

    /// The parts of a cyclic order that are not in force yet; `None` if all are. A setpoint beside RUN is always sent with
    /// it: during standstill, another one may have been set at the drive.
    fn what_changes(
        &self,
        origin: Origin,
        go: &GoOrder,
        control: &ControlSettings,
        in_force: InForce,
    ) -> Option<GoOrder> {
        if origin.manner == OrderManner::Once {
            return Some(go.clone());
        }
        let holds = self.lease.counts_as_held_by(origin.owner, control);
        let is_his = |by| by == origin.owner || control.ownership == Ownership::Any;
        let run = go
            .run()
            .filter(|direction| !(holds && self.order.runs_in(*direction)));
        let frequency = go.frequency().filter(|frequency| {
            run.is_some()
                || in_force == InForce::No
                || !self.setpoint.has_acknowledged(*frequency, is_his)
        });
        GoOrder::new(go.registers().to_vec(), frequency, run)
    }

    /// Rules for orders that may move a motor.
    fn may_move(
        &self,
        command: &CommandRequest,
        go: &GoOrder,
        control: &ControlSettings,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<(), Report> {
        if facts.stop_pending {
            return Err(refused(Reason::StopPending));
        }
        if facts.stop_refused && go.run().is_some() {
            return Err(refused(Reason::StopRefused));
        }
        if command
            .epoch
            .is_some_and(|epoch| epoch != self.start.epoch())
        {
            return Err(refused(Reason::StaleEpoch));
        }
        if now >= command.start_before {
            return Err(Report::new(Outcome::Expired, Reason::TooLate));
        }
        if facts.line_is_bad && (go.run().is_some() || is_higher(&self.setpoint, go)) {
            return Err(refused(Reason::LineQuality));
        }
        if self.interlocks.is_output_outside()
            && (go.run().is_some() || is_higher(&self.setpoint, go))
        {
            return Err(refused(Reason::OutputOutside));
        }
        if facts.is_local == Some(true) && !takes_priority(&self.model) {
            return Err(refused(Reason::LocalControl));
        }
        let Some(direction) = go.run() else {
            return Ok(());
        };
        if facts.tripped == Some(true) {
            return Err(refused(Reason::Tripped));
        }
        if control.require_watchdog && !facts.is_watched {
            return Err(refused(Reason::Watchdog));
        }
        self.start.may_start(command, control, now)?;
        if is_a_start(&self.order, direction, facts)
            && self.interlocks.is_too_soon(control.min_start_interval, now)
        {
            return Err(refused(Reason::StartsTooOften));
        }
        if turns_round(&self.order, direction, control, facts)
            && standstill(&self.model, &self.order).is_none()
        {
            return Err(refused(Reason::Reversal));
        }
        Ok(())
    }

    /// Whether the setpoint goes to a stored register that was written too short a time ago.
    fn is_worn_by_setpoint(&self, control: &ControlSettings, now: MonoTime) -> bool {
        let Some(address) = self.setpoint.address() else {
            return false;
        };
        self.model.is_stored(address)
            && self
                .interlocks
                .was_written_within(control.stored_write_interval, address, now)
    }

    /// An order that changes nothing renews the lease. With shared ownership it renews the current owner's lease: two
    /// controllers that repeat the same orders do not take control from each other.
    fn renew_unchanged(&mut self, owner: Owner, control: &ControlSettings, now: MonoTime) {
        let renewed = match self.lease.owner() {
            Some(holder) if self.lease.counts_as_held_by(owner, control) => holder,
            _ => owner,
        };
        self.renew(renewed, now);
    }
}

/// Whether RUN would turn a motor round that was last read at speed, or not at all.
fn turns_round(
    order: &RunOrder,
    direction: Direction,
    control: &ControlSettings,
    facts: &DriveFacts,
) -> bool {
    let turned = facts.turns.or(order.last_direction());
    let is_other = turned.is_some_and(|turned| turned != direction);
    is_other
        && !facts.at_standstill
        && facts
            .output
            .is_none_or(|output| output > control.reverse_below)
}

/// The reading that decides whether a motor may be turned round behind its stop: the last one may be of its ramp. It has
/// to be 0, which means the same whatever the scale and the sign of the register.
fn standstill(model: &Model, order: &RunOrder) -> Option<CommandStep> {
    let output = model
        .register_for(RegisterRole::OutputFrequency)
        .filter(|it| it.form.pair.is_none())?;
    let is_stopped = order.intent() == RunIntent::Stop;
    is_stopped.then_some(CommandStep::Check {
        address: output.address,
        least: 0,
        most: 0,
        reason: Reason::Reversal,
    })
}

/// Whether RUN would start a motor that is neither known nor ordered to turn.
fn is_a_start(order: &RunOrder, direction: Direction, facts: &DriveFacts) -> bool {
    !order.runs_in(direction) && facts.output.is_none_or(|output| output == Hertz::ZERO)
}

/// Whether every command overrides panel and terminals, so that it always takes effect.
fn takes_priority(model: &Model) -> bool {
    let form = model.run.as_ref().map(|run| &run.form);
    matches!(form, Some(RunForm::Bits { priority: 1.., .. }))
}

/// Whether the frequency of `go` is above the one in force, or may be.
fn is_higher(setpoint: &SetpointOrder, go: &GoOrder) -> bool {
    go.frequency()
        .is_some_and(|frequency| setpoint.value().is_none_or(|in_force| frequency > in_force))
}

fn may_turn(model: &Model, direction: Direction, control: &ControlSettings) -> Result<(), Report> {
    if !control.directions.contains(&direction) {
        return Err(refused(Reason::DirectionNotAllowed));
    }
    match direction {
        Direction::Forward => Ok(()),
        Direction::Reverse => may_do(model, ControlAction::Reverse, control),
    }
}

/// A motor is moved only if stop, forward and the setpoint are proven or accepted: a motor that cannot be stopped is not
/// started. A stop itself is never refused for that.
fn may_be_ordered(model: &Model, go: &GoOrder, control: &ControlSettings) -> Result<(), Report> {
    let moves = go.run().is_some() || go.frequency().is_some();
    let may = !moves || model.may_be_ordered(&control.accept_unverified);
    if may {
        Ok(())
    } else {
        Err(refused(Reason::Unverified))
    }
}

fn is_within(frequency: Hertz, control: &ControlSettings) -> Result<(), Report> {
    let within = (control.least..=control.most).contains(&frequency);
    if within {
        Ok(())
    } else {
        Err(refused(Reason::OutsideLimits))
    }
}

/// Whether an action at the drive or by another client can clear the obstacle to RUN. A held RUN must not start the motor
/// at that moment: it must be ordered again.
const fn is_ended_at_the_drive(reason: Reason) -> bool {
    matches!(
        reason,
        Reason::Tripped | Reason::LocalControl | Reason::Watchdog
    )
}
