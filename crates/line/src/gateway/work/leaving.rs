//! A drive leaves the configuration, or its line is restarted.

use super::{DriveWork, Out};
use crate::domain::command::Reason;
use crate::domain::time::MonoTime;
use crate::gateway::event::LineEffect;
use crate::gateway::note::DriveNote;

impl DriveWork {
    /// The drive is to leave: only stops are accepted any more. With `stops`, a drive in use is stopped.
    pub fn leave(&mut self, now: MonoTime, stops: bool, out: Out<'_>) {
        let is_in_use = self.is_in_use();
        self.guard.leave();
        if !stops || !is_in_use {
            return;
        }
        // A stop in progress is the same stop.
        if self.latch.is_some() && !self.guard.is_held() {
            return;
        }
        self.cut_motion(Reason::Removed, out);
        if let Some(lost) = self.guard.stop_to_leave(now) {
            out.push_back(LineEffect::Note(self.drive, DriveNote::Leaving));
            self.fail_safe(lost, now, out);
        }
    }

    /// The drive stays after all.
    pub fn stay(&mut self) {
        self.guard.stay();
        self.has_changed = true;
    }

    /// Whether it may be commanded and runs, is under control, or still has to be stopped.
    #[must_use]
    pub fn is_in_use(&self) -> bool {
        self.guard.control().is_some() && (self.is_bound() || self.is_moving())
    }

    /// Whether it still needs this line: a stop in progress, a reset that has begun, control.
    #[must_use]
    pub fn is_bound(&self) -> bool {
        self.must_go_on() || self.guard.is_held()
    }
}
