//! What follows for a stop from time alone: alarms, and that it is given up.

use super::{StopLatch, StopTurn, ZeroSpan};
use crate::domain::command::{Outcome, Reason, Report};
use crate::domain::control::ControlSettings;
use crate::domain::time::MonoTime;

impl StopLatch {
    /// Whether the alarm was raised that it has no effect.
    #[must_use]
    pub const fn is_late(&self) -> bool {
        self.is_late_reported && !self.is_unsent()
    }

    /// Whether any alarm was raised.
    #[must_use]
    pub const fn is_reported(&self) -> bool {
        self.is_late_reported || self.is_unsent_reported
    }

    /// Whether nothing was sent for it in this run of the gateway.
    #[must_use]
    pub const fn is_unsent(&self) -> bool {
        (self.is_first() || self.is_remembered) && !self.was_broadcast
    }

    /// Changes caused by time alone.
    pub fn pass(&mut self, now: MonoTime, is_offline: bool, control: &ControlSettings) -> StopTurn {
        self.offline_since = is_offline.then(|| self.offline_since.unwrap_or(now));
        if self.drop_at(control).is_some_and(|at| now >= at) {
            return StopTurn::Dropped;
        }
        if self.late_at(control).is_some_and(|at| now >= at) {
            self.is_late_reported = true;
            self.is_unsent_reported |= self.is_unsent();
            return if self.is_unsent() {
                StopTurn::NotSent
            } else {
                StopTurn::NotEffective
            };
        }
        StopTurn::None
    }

    /// When [`Self::pass`] is due; `None` while the drive answers and nothing expires.
    #[must_use]
    pub fn next_wake(&self, control: &ControlSettings) -> Option<MonoTime> {
        [self.drop_at(control), self.late_at(control)]
            .into_iter()
            .flatten()
            .min()
    }

    /// When the stop is dropped because the drive has been offline for too long since the last order to stop.
    fn drop_at(&self, control: &ControlSettings) -> Option<MonoTime> {
        self.offline_since
            .map(|since| since.max(self.accepted_at) + control.stop_pending_for)
    }

    /// When the alarm is due, unless it was raised. A drive that is back and reads as 0 is given the time to prove it.
    fn late_at(&self, control: &ControlSettings) -> Option<MonoTime> {
        let proves_until = self.zeros.map_or(MonoTime::ZERO, ZeroSpan::ends_at);
        let late_at = proves_until.max(self.awaited_since + control.stop_effect_timeout);
        (!self.is_late_reported).then_some(late_at)
    }

    /// The report for waiting clients when it is late: it depends on whether the drive ever answered.
    #[must_use]
    pub const fn late_report(&self) -> Report {
        let reason = if self.is_acknowledged {
            Reason::NotEffective
        } else {
            Reason::NoReply
        };
        Report::new(Outcome::Unknown, reason)
    }
}
