//! The drive's own watchdog: messages about it, and the stop that is left to it.

use super::{DriveWork, Out};
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::drive::watchdog::{WatchdogRange, WatchdogWatch};
use crate::gateway::event::LineEffect;
use crate::gateway::note::DriveNote;
use std::sync::Arc;
use std::time::Duration;

/// How much longer than its watchdog time nothing is sent to a drive: its clock differs from ours.
const MARGIN: Duration = Duration::from_secs(1);

impl DriveWork {
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
