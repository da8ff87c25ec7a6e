//! The review of orders that require standstill: reset, release, set-up.

use super::approved::Approved;
use super::review::{CommandVerdict, DriveFacts, no_steps, refused};
use super::state::DriveGuard;
use crate::domain::address::Address;
use crate::domain::command::{
    CommandRequest, Order, OrderManner, Outcome, Owner, Reason, Report, RunIntent,
};
use crate::domain::control::{ControlAction, ControlSettings};
use crate::domain::time::MonoTime;
use crate::drive::steps;

impl DriveGuard {
    pub(super) fn review_reset(
        &mut self,
        command: &CommandRequest,
        control: &ControlSettings,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        self.may_do(ControlAction::Reset, control)?;
        let owner = command.origin.owner;
        let is_cyclic = command.origin.manner == OrderManner::Cyclic;
        let held_until = now + control.lost_after;
        if is_cyclic && self.holds_reset(owner, held_until, now) {
            self.renew(owner, now);
            return Ok(CommandVerdict::Unchanged);
        }
        let stands_still = facts.at_standstill && self.intent() == RunIntent::Stop;
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

    /// Whether a reset of this model needs a final word, which may be missing.
    #[must_use]
    pub fn leaves_a_reset_standing(&self) -> bool {
        self.control.is_some() && steps::of_take_back(&self.model).is_ok()
    }

    /// Clears the word of an interrupted reset: that completes the old order and is not a new one. `None` if the drive may
    /// no longer be commanded.
    pub fn take_reset_back(&self) -> Option<Approved> {
        if self.control.is_none() || self.is_ending || self.is_leaving {
            return None;
        }
        let steps = steps::of_take_back(&self.model).ok()?;
        Some(Approved {
            order: Order::Reset,
            owner: Owner::Local,
            stops: self.stops(),
            start_before: MonoTime::NEVER,
            steps,
            functions: steps::WriteFunctions::of(&self.model),
            silent: self.model.silent_writes().collect(),
            is_answered_late: false,
        })
    }

    /// Takes back a start that the drive did not follow, and inhibits the next one until a client orders it again. `None` if
    /// the drive may no longer be commanded.
    pub fn take_start_back(&mut self, now: MonoTime) -> Option<Approved> {
        if self.control.is_none() || self.is_ending || self.is_leaving {
            return None;
        }
        let steps = steps::of_start_taken_back(&self.model).ok()?;
        self.inhibit(now);
        Some(Approved {
            order: Order::Stop { setpoint: None },
            owner: Owner::Local,
            stops: self.stops(),
            start_before: MonoTime::NEVER,
            steps,
            functions: steps::WriteFunctions::of(&self.model),
            silent: self.model.silent_writes().collect(),
            is_answered_late: false,
        })
    }

    /// Whether a reset was accepted from `owner`, who has repeated the order ever since; if so, the hold is renewed.
    fn holds_reset(&mut self, owner: Owner, until: MonoTime, now: MonoTime) -> bool {
        self.resetting.forget_past(now);
        let holds = self.resetting.has(owner);
        if holds {
            self.resetting.add(owner, until);
        }
        holds
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
        self.may_do(ControlAction::Release, control)?;
        // A controller that holds the release value means only the change to it.
        if self.is_released && command.origin.manner == OrderManner::Cyclic {
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
        let commit = self.last_commit(&control, now)?;
        let mut steps = steps::of_setup(&self.model, addresses).map_err(no_steps)?;
        self.commit_after(&mut steps, commit.as_ref(), now);
        Ok(CommandVerdict::Go(self.approve(
            command,
            Order::Setup(addresses.to_vec()),
            steps,
        )))
    }

    /// The source of commands is changed only at standstill and with nothing ordered.
    pub(super) fn may_change_at_rest(
        &self,
        command: &CommandRequest,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<(), Report> {
        if facts.stop_pending {
            return Err(refused(Reason::StopPending));
        }
        if !facts.at_standstill || matches!(self.intent(), RunIntent::Run(_)) {
            return Err(refused(Reason::Moving));
        }
        if now >= command.start_before {
            return Err(Report::new(Outcome::Expired, Reason::TooLate));
        }
        Ok(())
    }
}
