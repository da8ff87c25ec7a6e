//! A drive leaves the configuration, or its line is restarted: it accepts no commands any more, and a motor that runs by
//! our order is stopped first.

use super::approved::LossAction;
use super::state::DriveGuard;
use crate::domain::command::RunIntent;
use crate::domain::control::FailSafe;
use crate::domain::time::MonoTime;
use crate::journal::FailSafeCause;

impl DriveGuard {
    /// From now on only stops are accepted, until [`Self::stay`].
    pub const fn leave(&mut self) {
        self.is_leaving = true;
    }

    /// The drive stays after all.
    pub const fn stay(&mut self) {
        self.is_leaving = false;
    }

    /// Whether control is held, or the drive is ordered to run.
    #[must_use]
    pub const fn is_held(&self) -> bool {
        self.lease.is_some() || matches!(self.intent(), RunIntent::Run(_))
    }

    /// Control was returned to panel or terminals: it has no owner here, and a client must stop before it starts.
    pub(super) fn released(&mut self, now: MonoTime) {
        self.lease = None;
        self.is_released = true;
        self.inhibit(now);
    }

    /// Ends any control with a stop; `None` without a control section.
    pub fn stop_to_leave(&mut self, now: MonoTime) -> Option<LossAction> {
        self.control.as_ref()?;
        let owner = self.lease.take().map(|lease| lease.owner);
        Some(self.lost(owner, FailSafe::Stop, FailSafeCause::Removed, now))
    }
}
