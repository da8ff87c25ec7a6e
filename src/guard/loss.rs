//! A client that is lost, and the declared action that falls due for that.

use super::approved::LossAction;
use super::state::DriveGuard;
use crate::domain::command::{Owner, RunIntent};
use crate::domain::control::{ControlSettings, FailSafe};
use crate::domain::fail_safe::{FailSafeCause, FailSafeRun};
use crate::domain::time::MonoTime;

impl DriveGuard {
    /// The last declared action since the last accepted RUN.
    #[must_use]
    pub const fn fail_safe(&self) -> Option<FailSafeRun> {
        self.failsafe
    }

    /// A stop frame was on the wire, which is what is declared, if that is due. Returns what has come further.
    pub fn stop_was_sent(&mut self) -> Option<FailSafeRun> {
        self.failsafe
            .as_mut()
            .and_then(|run| run.was_sent().then_some(*run))
    }

    /// A stop is over: it was effective, or is not sent any more. Returns what has come further.
    pub fn stop_is_over(&mut self, is_effective: bool) -> Option<FailSafeRun> {
        let run = self.failsafe.as_mut()?;
        let is_further = if is_effective {
            run.was_effective()
        } else {
            run.was_given_up()
        };
        is_further.then_some(*run)
    }

    /// The drive cannot be reached: what `owner` orders, or its open connection, renews nothing, but the client is there.
    pub fn was_out_of_reach(&mut self, owner: Owner, now: MonoTime) {
        if let Some(lease) = self.lease.as_mut().filter(|lease| lease.owner == owner) {
            lease.refused_at = Some(now);
        }
    }

    /// Ends the lease if it has expired at `now`, and returns the declared action; `None` if no action is needed, because
    /// the drive is ordered to stop and is `at_rest`.
    pub fn expire(&mut self, now: MonoTime, at_rest: bool) -> Option<LossAction> {
        let Some(lease) = self.lease.filter(|it| it.until <= now) else {
            return self.expire_adopted(now, at_rest);
        };
        self.lease = None;
        let ControlSettings {
            on_commander_lost: action,
            lost_after,
            ..
        } = **self.control.as_ref()?;
        let was_ordered = matches!(self.intent, RunIntent::Run(_));
        self.inhibit(now);
        if at_rest && !was_ordered {
            return None;
        }
        let is_there = lease.refused_at.is_some_and(|at| at + lost_after > now);
        let cause = match lease.orphan {
            Some(orphan) => orphan.cause(),
            None if is_there => FailSafeCause::OutOfReach,
            None => FailSafeCause::CommanderLost,
        };
        Some(self.falls_due(Some(lease.owner), action, cause, now))
    }

    /// The gateway shuts down: nothing is accepted any more. Returns the declared action for a drive under control.
    pub fn shut_down(&mut self, now: MonoTime) -> Option<LossAction> {
        self.is_ending = true;
        let action = self.control.as_ref()?.on_shutdown;
        let owner = self.lease.take().map(|lease| lease.owner);
        if owner.is_none() && !matches!(self.intent, RunIntent::Run(_)) {
            return None;
        }
        Some(self.lost(owner, action, FailSafeCause::Shutdown, now))
    }

    /// Ends the order in force by a declared `action`, and inhibits the start.
    pub fn ends(
        &mut self,
        owner: Option<Owner>,
        action: FailSafe,
        cause: FailSafeCause,
        now: MonoTime,
    ) -> LossAction {
        self.inhibit(now);
        self.falls_due(owner, action, cause, now)
    }

    /// The declared `action` falls due at `now`, because of a loss.
    pub(super) fn falls_due(
        &mut self,
        owner: Option<Owner>,
        action: FailSafe,
        cause: FailSafeCause,
        now: MonoTime,
    ) -> LossAction {
        self.failsafe = Some(FailSafeRun::due(action, cause, now));
        self.lost(owner, action, cause, now)
    }

    pub(super) fn lost(
        &mut self,
        owner: Option<Owner>,
        action: FailSafe,
        cause: FailSafeCause,
        now: MonoTime,
    ) -> LossAction {
        let order = match action {
            FailSafe::Hold => None,
            FailSafe::Stop | FailSafe::Coast => self.stop_order(action == FailSafe::Coast),
        };
        if let Some(order) = &order {
            self.accept_stop(None, order.is_coast(), now);
        }
        LossAction {
            owner,
            action,
            cause,
            order,
        }
    }
}
