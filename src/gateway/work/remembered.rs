//! State that a drive's work restores after a restart of the gateway.

use super::{DriveWork, Out};
use crate::domain::time::MonoTime;
use crate::gateway::event::Effect;
use crate::gateway::note::Note;
use crate::gateway::stop::StopLatch;
use crate::journal::{Entry, Remembered};

impl DriveWork {
    /// Restores the remembered state at `now`: the trip baseline, the owner of control, and a stop that was accepted but
    /// not seen to take effect. A run order is never restored.
    pub fn remember(&mut self, remembered: &Remembered, now: MonoTime, out: Out<'_>) {
        self.remember_records(remembered);
        self.remember_orders(remembered, now, out);
    }

    /// Restores what does not depend on who sends on the line: trips and sums.
    pub fn remember_records(&mut self, remembered: &Remembered) {
        self.trips = std::mem::take(&mut self.trips).remembering(remembered.trips.unwrap_or_default());
        self.kept.remember(remembered);
        self.usage.remember(remembered.usage);
    }

    /// Restores what was ordered.
    pub fn remember_orders(&mut self, remembered: &Remembered, now: MonoTime, out: Out<'_>) {
        self.remember_sight(remembered);
        self.remember_reset(remembered.reset);
        if let Some(lease) = remembered.lease {
            self.said_owner = Some((lease.owner, true));
            self.guard.remember_lease(lease);
        }
        let Some(stop) = remembered.stop else { return };
        match self.guard.remember_stop(stop.coast, now) {
            Some(order) => {
                self.is_stopping = true;
                self.latch = Some(StopLatch::remembered(order, now));
            }
            // Its control section is gone, or the drive was replaced.
            None => {
                out.push_back(Effect::Note(self.drive, Note::StopDropped));
                out.keep(self.drive, Entry::StopOver { is_effective: false });
            }
        }
    }
}
