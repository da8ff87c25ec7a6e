//! A client or a gateway that is lost, or a drive that leaves, and the declared action that falls due for that.

use super::approved::LossAction;
use super::state::DriveGuard;
use crate::domain::command::{Direction, Owner};
use crate::domain::control::{ControlSettings, FailSafe};
use crate::domain::fail_safe::{FailSafeCause, FailSafeRun};
use crate::domain::standby::OnGatewayLost;
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

    /// Ends the lease if it has expired at `now`, and returns the declared action; `None` if no action is needed, because
    /// the drive is ordered to stop and is `at_rest`.
    pub fn expire(&mut self, now: MonoTime, at_rest: bool) -> Option<LossAction> {
        let ControlSettings {
            on_commander_lost: action,
            lost_after,
            ..
        } = **self.control.as_ref()?;
        let Some(lost) = self.lease.end_expired(lost_after, now) else {
            return self.expire_adopted(action, now, at_rest);
        };
        let was_ordered = self.order.is_to_run();
        self.inhibit(now);
        if at_rest && !was_ordered {
            return None;
        }
        Some(self.falls_due(Some(lost.owner), action, lost.cause, now))
    }

    /// Ends the adoption if its time is over at `now`, and returns the declared action; `None` if none is needed, because
    /// the order is no longer in force and the drive is `at_rest`.
    fn expire_adopted(
        &mut self,
        action: FailSafe,
        now: MonoTime,
        at_rest: bool,
    ) -> Option<LossAction> {
        self.lease
            .adopted()
            .filter(|adopted| adopted.until() <= now)?;
        let is_over = at_rest && !self.is_adopted();
        self.inhibit(now);
        if is_over {
            return None;
        }
        Some(self.falls_due(None, action, FailSafeCause::GatewayLost, now))
    }

    /// The gateway shuts down: nothing is accepted any more. Returns the declared action for a drive under control.
    pub fn shut_down(&mut self, now: MonoTime) -> Option<LossAction> {
        self.closing.end();
        let action = self.control.as_ref()?.on_shutdown;
        let owner = self.lease.end();
        if owner.is_none() && !self.order.is_to_run() {
            return None;
        }
        Some(self.lost(owner, action, FailSafeCause::Shutdown, now))
    }

    /// Ends any control with a stop, before the drive leaves; `None` without a control section.
    pub fn stop_to_leave(&mut self, now: MonoTime) -> Option<LossAction> {
        self.control.as_ref()?;
        let owner = self.lease.end();
        Some(self.lost(owner, FailSafe::Stop, FailSafeCause::Removed, now))
    }

    /// This gateway takes the line over from another at `now`. The drive is ordered to run, in `direction` if that is
    /// known. Returns the declared action; `None` if the drive goes on, as it does where the line was handed over.
    pub fn gateway_left(
        &mut self,
        direction: Option<Direction>,
        was_handed_over: bool,
        now: MonoTime,
    ) -> Option<LossAction> {
        let control = self.control.clone()?;
        self.lease.end();
        self.inhibit(now);
        self.order.turns(direction);
        let declared = control.on_gateway_lost.unwrap_or(OnGatewayLost::Stop);
        let action = match if was_handed_over {
            OnGatewayLost::Adopt
        } else {
            declared
        } {
            OnGatewayLost::Stop => FailSafe::Stop,
            OnGatewayLost::Coast => FailSafe::Coast,
            OnGatewayLost::Hold => FailSafe::Hold,
            OnGatewayLost::Adopt => return self.adopt(direction, &control, now),
        };
        Some(self.falls_due(None, action, FailSafeCause::GatewayLost, now))
    }

    /// The order is left standing. Where its direction is not known, it cannot be: a client could not repeat it.
    fn adopt(
        &mut self,
        direction: Option<Direction>,
        control: &ControlSettings,
        now: MonoTime,
    ) -> Option<LossAction> {
        let Some(direction) = direction else {
            return Some(self.falls_due(
                None,
                control.on_commander_lost,
                FailSafeCause::GatewayLost,
                now,
            ));
        };
        self.order.runs_already(direction);
        self.lease.adopt(direction, now + control.lost_after);
        None
    }

    /// The other gateway is lost at `now` before its stop took effect: it is sent again.
    pub fn repeat_stop(&mut self, coast: bool, now: MonoTime) -> Option<LossAction> {
        self.control.as_ref()?;
        self.lease.end();
        let action = if coast {
            FailSafe::Coast
        } else {
            FailSafe::Stop
        };
        Some(self.lost(None, action, FailSafeCause::GatewayLost, now))
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
    fn falls_due(
        &mut self,
        owner: Option<Owner>,
        action: FailSafe,
        cause: FailSafeCause,
        now: MonoTime,
    ) -> LossAction {
        self.failsafe = Some(FailSafeRun::due(action, cause, now));
        self.lost(owner, action, cause, now)
    }

    fn lost(
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
