//! The review of orders that require standstill: reset, release, set-up, parameters, and the drive's own watchdog.

use super::review::{CommandVerdict, DriveFacts, may_do, no_steps, refused};
use super::state::DriveGuard;
use super::{commit, registers};
use crate::domain::address::Address;
use crate::domain::command::{
    CommandRequest, GoOrder, Order, OrderManner, Outcome, Owner, Reason, Report, RunIntent,
};
use crate::domain::control::{ControlAction, ControlSettings};
use crate::domain::time::MonoTime;
use crate::drive::decode;
use crate::drive::steps::{self, CommandStep};
use crate::profile::model::{CommitEffect, CommitWord};

impl DriveGuard {
    pub(super) fn review_reset(
        &mut self,
        command: &CommandRequest,
        control: &ControlSettings,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        may_do(&self.model, ControlAction::Reset, control)?;
        let owner = command.origin.owner;
        let is_cyclic = command.origin.manner == OrderManner::Cyclic;
        let held_until = now + control.lost_after;
        if is_cyclic && self.resetting.renew(owner, held_until, now) {
            self.renew(owner, now);
            return Ok(CommandVerdict::Unchanged);
        }
        let stands_still = facts.at_standstill && self.order.intent() == RunIntent::Stop;
        match facts.tripped {
            Some(true) => {}
            None if stands_still => {}
            // A controller that holds the reset value means only the change to it, and there is nothing to reset.
            Some(false) if is_cyclic => {
                self.resetting.add(owner, held_until);
                return Ok(CommandVerdict::Unchanged);
            }
            Some(false) | None => return Err(refused(Reason::NotTripped)),
        }
        if facts.stop_pending {
            return Err(refused(Reason::StopPending));
        }
        if now >= command.start_before {
            return Err(Report::new(Outcome::Expired, Reason::TooLate));
        }
        let steps = steps::of_reset(&self.model).map_err(no_steps)?;
        self.renew(owner, now);
        if is_cyclic {
            self.resetting.add(owner, held_until);
        }
        Ok(CommandVerdict::Go(self.approve(
            command,
            Order::Reset,
            steps,
        )))
    }

    /// Returns control to panel or terminals: only at standstill, because a closed terminal may start the motor, and
    /// only if the control section allows it.
    pub(super) fn review_release(
        &mut self,
        command: &CommandRequest,
        control: &ControlSettings,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        if !control.allow_release {
            return Err(refused(Reason::NoRelease));
        }
        may_do(&self.model, ControlAction::Release, control)?;
        // A controller that holds the release value means only the change to it.
        if self.order.is_released() && command.origin.manner == OrderManner::Cyclic {
            return Ok(CommandVerdict::Unchanged);
        }
        self.may_change_at_rest(command, facts, now)?;
        let steps = steps::of_release(&self.model).map_err(no_steps)?;
        let approved = self.approve(command, Order::Release, steps);
        self.released(now);
        Ok(CommandVerdict::Go(approved))
    }

    pub(super) fn review_setup(
        &mut self,
        command: &CommandRequest,
        addresses: &[Address],
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        if command.origin.owner != Owner::Local {
            return Err(refused(Reason::NotFromHere));
        }
        if addresses.is_empty() {
            return Err(refused(Reason::NotUnderstood));
        }
        self.may_change_at_rest(command, facts, now)?;
        let control = self.control.clone().ok_or(refused(Reason::ReadOnly))?;
        let commit = commit::after_setup(&self.model, &self.interlocks, &control, now)?;
        let steps = steps::of_setup(&self.model, addresses).map_err(no_steps)?;
        Ok(self.approve_change(command, steps, commit.as_ref(), now))
    }

    /// A person at the host restores parameters of the drive, one at a time: at standstill and with nothing ordered, like
    /// everything that decides how a motor turns.
    pub(super) fn review_parameter(
        &mut self,
        command: &CommandRequest,
        go: &GoOrder,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        if let Some(word) = commit::written_by(go, &self.model) {
            return self.review_commit(command, &word, facts, now);
        }
        let control = self.control.clone().ok_or(refused(Reason::ReadOnly))?;
        registers::may_be_restored(&self.model, &self.interlocks, go.registers(), &control, now)?;
        self.may_change_at_rest(command, facts, now)?;
        let steps = steps::of_go(&self.model, go, &control, None, self.setpoint.bases())
            .map_err(no_steps)?;
        // What stores them is sent once, after the last one.
        let applies = self.model.commit(CommitEffect::Apply).cloned();
        let verdict = self.approve_change(command, steps, applies.as_ref(), now);
        self.interlocks.approved(&self.model, go.registers(), now);
        Ok(verdict)
    }

    /// A person at the host has restored parameters: they are taken over or stored, once for all of them.
    fn review_commit(
        &mut self,
        command: &CommandRequest,
        word: &CommitWord,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        let control = self.control.clone().ok_or(refused(Reason::ReadOnly))?;
        commit::may_wear(&self.interlocks, word, &control, now)?;
        self.may_change_at_rest(command, facts, now)?;
        Ok(self.approve_change(command, Vec::new(), Some(word), now))
    }

    /// The drive's own watchdog is set like everything that decides when a motor stops: at standstill, with nothing
    /// ordered, and with read-back.
    pub(super) fn review_watchdog(
        &mut self,
        command: &CommandRequest,
        go: &GoOrder,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        for write in go.registers() {
            decode::register(&self.model, *write).map_err(refused)?;
        }
        self.may_change_at_rest(command, facts, now)?;
        let control = self.control.clone().ok_or(refused(Reason::ReadOnly))?;
        let commit = commit::after_setup(&self.model, &self.interlocks, &control, now)?;
        let steps = steps::of_go(&self.model, go, &control, None, self.setpoint.bases())
            .map_err(no_steps)?;
        Ok(self.approve_change(command, steps, commit.as_ref(), now))
    }

    /// Approves `steps`, and then what takes over or stores what they write.
    fn approve_change(
        &mut self,
        command: &CommandRequest,
        mut steps: Vec<CommandStep>,
        commit: Option<&CommitWord>,
        now: MonoTime,
    ) -> CommandVerdict {
        commit::append(&mut steps, commit, &mut self.interlocks, now);
        CommandVerdict::Go(self.approve(command, command.order.clone(), steps))
    }

    /// The source of commands is changed only at standstill and with nothing ordered.
    fn may_change_at_rest(
        &self,
        command: &CommandRequest,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<(), Report> {
        if facts.stop_pending {
            return Err(refused(Reason::StopPending));
        }
        if !facts.at_standstill || self.order.is_to_run() {
            return Err(refused(Reason::Moving));
        }
        if now >= command.start_before {
            return Err(Report::new(Outcome::Expired, Reason::TooLate));
        }
        Ok(())
    }
}
