//! Changes caused by time alone: leases end, stops are overdue or left to the drive's own watchdog, commands expire.

use super::{DriveWork, Out};
use crate::domain::address::Address;
use crate::domain::command::{Outcome, Reason, Report};
use crate::domain::time::MonoTime;
use crate::drive::watchdog::{WatchdogRange, WatchdogWatch};
use crate::gateway::event::LineEffect;
use crate::gateway::execution::CommandExecution;
use crate::gateway::note::DriveNote;
use crate::gateway::stop::StopTurn;
use crate::guard::VoidApproval;
use crate::journal::{FailSafeCause, JournalEntry};
use std::sync::Arc;
use std::time::Duration;

/// How much longer than its watchdog time nothing is sent to a drive: its clock differs from ours.
const MARGIN: Duration = Duration::from_secs(1);

impl DriveWork {
    /// Applies the changes caused by time alone.
    pub fn pass(&mut self, now: MonoTime, is_offline: bool, out: Out<'_>) {
        self.settle(now, out);
        // A stop that has taken effect is all that can be done, even while the ramp lasts.
        let is_stopped = self.stands() || self.is_stopping || self.sight.stood_last();
        let at_rest = self.latch.is_none() && is_stopped;
        let had_lease = self.guard.lease().is_some();
        if let Some(lost) = self.guard.expire(now, at_rest) {
            if let Some(owner) = lost.owner {
                let action = lost.action;
                let note = match lost.cause {
                    FailSafeCause::Orphaned | FailSafeCause::CrashLoop => {
                        DriveNote::Orphaned { owner, action }
                    }
                    FailSafeCause::OutOfReach => DriveNote::OutOfReach { owner, action },
                    _ => DriveNote::CommanderLost { owner, action },
                };
                out.push_back(LineEffect::Note(self.drive, note));
            }
            self.fail_safe(lost, now, out);
        }
        self.has_changed |= had_lease && self.guard.lease().is_none();
        self.pass_opening(now, out);
        self.pass_stop(now, is_offline, out);
        self.leave_to_watchdog(now, out);
        self.expire_lists(now, out);
        self.take_start_back(now, is_offline, out);
        self.take_reset_back(now, is_offline, out);
    }

    /// When [`Self::pass`] is due.
    #[must_use]
    pub fn next_wake(&self) -> Option<MonoTime> {
        let control = self.guard.control();
        let stop = self
            .latch
            .as_ref()
            .zip(control)
            .and_then(|(latch, control)| latch.next_wake(control));
        let current = self
            .current
            .as_ref()
            .filter(|execution| !execution.has_begun() && self.flight.is_none());
        let executions = current
            .into_iter()
            .chain(&self.waiting)
            .map(CommandExecution::start_before)
            .min();
        let opening = self.opening.map(|opening| opening.until);
        [
            self.guard.next_wake(),
            stop,
            self.left_at(),
            executions,
            opening,
            self.settles_at(),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    pub(super) fn pass_stop(&mut self, now: MonoTime, is_offline: bool, out: Out<'_>) {
        let (Some(latch), Some(control)) = (&mut self.latch, self.guard.control()) else {
            return;
        };
        let turn = latch.pass(now, is_offline, control);
        let note = match turn {
            StopTurn::None => return,
            StopTurn::NotEffective => DriveNote::NotEffective,
            StopTurn::NotSent => DriveNote::StopNotSent,
            StopTurn::Dropped => DriveNote::StopDropped,
        };
        self.has_changed = true;
        out.push_back(LineEffect::Note(self.drive, note));
        let report = latch.late_report();
        if turn == StopTurn::Dropped {
            self.guard.inhibit(now);
            return self.drop_stop(report, out);
        }
        for mut waiter in std::mem::take(latch.waiters()) {
            self.tell(&mut waiter, report, true, out);
        }
    }

    /// A stop that had no effect is not sent any more; those who wait for it get `report`. An equal one is a new one.
    pub(super) fn drop_stop(&mut self, report: Report, out: Out<'_>) {
        let Some(mut latch) = self.latch.take() else {
            return;
        };
        self.is_stopping = false;
        let over = self.guard.stop_is_over(false);
        self.fail_safe_came(over, out);
        out.keep(
            self.drive,
            JournalEntry::StopOver {
                is_effective: false,
            },
        );
        for mut waiter in std::mem::take(latch.waiters()) {
            self.tell(&mut waiter, report, true, out);
        }
    }

    pub(super) fn expire_lists(&mut self, now: MonoTime, out: Out<'_>) {
        if self.flight.is_none()
            && self
                .current
                .as_ref()
                .is_some_and(|execution| !execution.has_begun() && now >= execution.start_before())
        {
            self.void(VoidApproval::TooLate, out);
        }
        while let Some(at) = self
            .waiting
            .iter()
            .position(|execution| now >= execution.start_before())
        {
            if let Some(mut execution) = self.waiting.remove(at) {
                self.finish(
                    &mut execution,
                    Report::new(Outcome::Expired, Reason::TooLate),
                    out,
                );
            }
        }
    }

    pub(super) fn void(&mut self, void: VoidApproval, out: Out<'_>) {
        let Some(mut execution) = self.current.take() else {
            return;
        };
        let report = match void {
            VoidApproval::Stopped => Report::new(Outcome::Superseded, Reason::Stopped),
            VoidApproval::TooLate => Report::new(Outcome::Expired, Reason::TooLate),
        };
        self.finish(&mut execution, report, out);
    }

    /// Sets the suitable range of watchdog times.
    #[must_use]
    pub fn watched(mut self, range: WatchdogRange) -> Self {
        self.watchdog = WatchdogWatch::new(Arc::clone(&self.model), range);
        self
    }

    /// The state of the drive's own watchdog.
    #[must_use]
    pub const fn watchdog(&self) -> &WatchdogWatch {
        &self.watchdog
    }

    pub(super) fn take_watchdog(&mut self, address: Address, words: &[u16], out: Out<'_>) {
        let is_commanded = self.guard.control().is_some();
        if let Some(state) = self.watchdog.take(address, words)
            && is_commanded
        {
            out.push_back(LineEffect::Note(self.drive, DriveNote::Watchdog(state)));
        }
    }

    /// When a declared stop without effect is left to the drive's own watchdog; `None` if no watchdog can be relied on.
    pub(super) fn left_at(&self) -> Option<MonoTime> {
        let declared = self.latch.as_ref()?.declared_at()?;
        self.watchdog.stops_after()?;
        Some(declared + self.guard.control()?.failsafe_confirm_timeout)
    }

    /// A declared stop has no effect, and any frame keeps the drive's watchdog from acting: nothing is sent to the drive
    /// until the watchdog must have acted.
    pub(super) fn leave_to_watchdog(&mut self, now: MonoTime, out: Out<'_>) {
        let (Some(after), Some(left_at)) = (self.watchdog.stops_after(), self.left_at()) else {
            return;
        };
        if left_at > now {
            return;
        }
        let until = now + after + MARGIN;
        if let Some(latch) = &mut self.latch {
            latch.leave_until(until);
        }
        self.rest_until = Some(until);
        self.has_changed = true;
        out.push_back(LineEffect::Note(self.drive, DriveNote::LeftToWatchdog));
    }
}
