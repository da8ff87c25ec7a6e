//! The review of orders that may move a motor: setpoint and RUN, and their interlocks.

use super::review::{CommandVerdict, DriveFacts, no_steps, refused};
use super::setting::InForce;
use super::state::DriveGuard;
use crate::domain::command::{
    CommandRequest, Direction, GoOrder, Order, OrderManner, Origin, Outcome, Owner, Reason, Report,
    RunIntent,
};
use crate::domain::control::{ControlAction, ControlSettings, Ownership};
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::steps::{self, CommandStep};
use crate::profile::model::{RegisterRole, RunForm};

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
        self.may_be_written(go.registers(), control, now)?;
        self.may_be_ordered(go, control)?;
        if let Some(frequency) = go.frequency() {
            is_within(frequency, control)?;
        }
        if let Some(direction) = go.run() {
            self.may_turn(direction, control)?;
        }
        self.sign_may_stand(go, control, facts)?;
        // A controller that only sets parameters may no longer be supervising the motor.
        let renews = command.origin.manner == OrderManner::Once
            || go.run().is_some()
            || go.frequency().is_some();
        let in_force = self.is_in_force(now);
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
                        self.armed.remove(owner);
                    }
                })?;
            self.knows_full_scale(now)?;
        }
        let go = self.signed(go, control, facts)?;
        let commit = self.commit_of(&go, control, facts, now)?;
        let mut steps = steps::of_go(&self.model, &go, control, self.setpoint(), &self.bases)
            .map_err(no_steps)?;
        self.commit_after(&mut steps, commit.as_ref(), now);
        if go
            .run()
            .is_some_and(|direction| self.turns_round(direction, control, facts))
        {
            steps.splice(0..0, self.standstill());
        }
        let moves = go.run().is_some() || (go.frequency().is_some() && !facts.at_standstill);
        if moves || (renews && self.counts_as_held_by(owner, control)) {
            self.take_lease(owner, now);
        }
        self.interlocks.approved(&self.model, go.registers(), now);
        let is_repeated = go
            .frequency()
            .is_some_and(|frequency| self.is_repeated(frequency));
        if let Some(frequency) = go.frequency() {
            self.accept_setpoint(owner, frequency);
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
        let holds = self.counts_as_held_by(origin.owner, control);
        let is_his = |by| by == origin.owner || control.ownership == Ownership::Any;
        let run = go.run().filter(|direction| {
            !(holds && self.run_acknowledged && self.intent() == RunIntent::Run(*direction))
        });
        let frequency = go.frequency().filter(|frequency| {
            run.is_some()
                || in_force == InForce::No
                || !self.accepted_setpoint().is_some_and(|last| {
                    last.acknowledged && last.value == *frequency && is_his(last.by)
                })
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
        if command.epoch.is_some_and(|epoch| epoch != self.epoch()) {
            return Err(refused(Reason::StaleEpoch));
        }
        if now >= command.start_before {
            return Err(Report::new(Outcome::Expired, Reason::TooLate));
        }
        if facts.line_is_bad && (go.run().is_some() || self.is_higher(go)) {
            return Err(refused(Reason::LineQuality));
        }
        if self.is_output_outside && (go.run().is_some() || self.is_higher(go)) {
            return Err(refused(Reason::OutputOutside));
        }
        if facts.is_local == Some(true) && !self.takes_priority() {
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
        self.may_start(command, control, now)?;
        if self.is_a_start(direction, facts)
            && self.interlocks.is_too_soon(control.min_start_interval, now)
        {
            return Err(refused(Reason::StartsTooOften));
        }
        if self.turns_round(direction, control, facts) && self.standstill().is_none() {
            return Err(refused(Reason::Reversal));
        }
        Ok(())
    }

    /// Whether RUN would turn a motor round that was last read at speed, or not at all.
    fn turns_round(
        &self,
        direction: Direction,
        control: &ControlSettings,
        facts: &DriveFacts,
    ) -> bool {
        let turned = facts.turns.or(self.turned);
        let is_other = turned.is_some_and(|turned| turned != direction);
        is_other
            && !facts.at_standstill
            && facts
                .output
                .is_none_or(|output| output > control.reverse_below)
    }

    /// The reading that decides whether a motor may be turned round behind its stop: the last one may be of its ramp. It has
    /// to be 0, which means the same whatever the scale and the sign of the register.
    fn standstill(&self) -> Option<CommandStep> {
        let output = self
            .model
            .register_for(RegisterRole::OutputFrequency)
            .filter(|it| it.form.pair.is_none())?;
        let is_stopped = self.intent() == RunIntent::Stop;
        is_stopped.then_some(CommandStep::Check {
            address: output.address,
            least: 0,
            most: 0,
            reason: Reason::Reversal,
        })
    }

    /// Whether RUN would start a motor that is neither known nor ordered to turn.
    fn is_a_start(&self, direction: Direction, facts: &DriveFacts) -> bool {
        let is_ordered = self.run_acknowledged && self.intent() == RunIntent::Run(direction);
        !is_ordered && facts.output.is_none_or(|output| output == Hertz::ZERO)
    }

    /// Whether every command overrides panel and terminals, so that it always takes effect.
    fn takes_priority(&self) -> bool {
        let form = self.model.run.as_ref().map(|run| &run.form);
        matches!(form, Some(RunForm::Bits { priority: 1.., .. }))
    }

    /// Whether the frequency of `go` is above the one in force, or may be.
    fn is_higher(&self, go: &GoOrder) -> bool {
        go.frequency()
            .is_some_and(|frequency| self.setpoint().is_none_or(|in_force| frequency > in_force))
    }

    /// The start inhibit. A cyclic client acknowledges it by a stop; a message must have been sent after the last
    /// inhibit, as shown by its epoch, its moment of issue, or, without either, by arriving a while later. The start
    /// of the process is no such inhibit: no earlier message reaches it.
    fn may_start(
        &self,
        command: &CommandRequest,
        control: &ControlSettings,
        now: MonoTime,
    ) -> Result<(), Report> {
        if command.origin.manner == OrderManner::Cyclic {
            return if self.armed.has(command.origin.owner) {
                Ok(())
            } else {
                Err(refused(Reason::StartInhibited))
            };
        }
        if command.epoch.is_some() {
            return Ok(());
        }
        if let Some(issued) = command.issued {
            return if issued > self.starts_after() {
                Ok(())
            } else {
                Err(refused(Reason::Stale))
            };
        }
        // Orders from the page are never retained by a broker.
        if control.strict && !matches!(command.origin.owner, Owner::Page(_)) {
            return Err(refused(Reason::EpochNeeded));
        }
        let too_soon = self
            .inhibited_at
            .is_some_and(|inhibited| now.since(inhibited) < control.restart_delay);
        if too_soon {
            Err(refused(Reason::RestartDelay))
        } else {
            Ok(())
        }
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
