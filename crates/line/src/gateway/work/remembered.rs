//! State that a drive's work restores after a restart of the gateway.

use super::{DriveWork, Out};
use crate::domain::time::MonoTime;
use crate::gateway::event::LineEffect;
use crate::gateway::note::DriveNote;
use crate::gateway::stop::StopLatch;
use crate::journal::{JournalEntry, RememberedDrive};
use crate::line::standby::SIGNALS_WITHIN;

impl DriveWork {
    /// Restores the remembered state at `now`: the trip baseline, the owner of control, and a stop that was accepted but
    /// not seen to take effect. A run order is never restored.
    pub fn remember(&mut self, remembered: &RememberedDrive, now: MonoTime, out: Out<'_>) {
        self.remember_records(remembered);
        if let Some(lease) = remembered.lease {
            self.said_owner = Some((lease.owner, true));
            self.guard.remember_lease(lease);
        }
        self.remember_orders(remembered, now, out);
    }

    /// Restores, on a line that this gateway listens to, what does not depend on who sends there, and whose control it was.
    pub fn remember_listening(&mut self, remembered: &RememberedDrive, now: MonoTime) {
        self.remember_records(remembered);
        if let Some(lease) = remembered.lease {
            self.said_owner = Some((lease.owner, true));
            self.guard
                .remember_lease_listening(lease, now, SIGNALS_WITHIN);
        }
    }

    /// This gateway takes the line, and no other one was heard since the start: restores what was ordered. Returns whether
    /// control has an owner.
    pub fn remember_on_line(
        &mut self,
        remembered: &RememberedDrive,
        now: MonoTime,
        out: Out<'_>,
    ) -> bool {
        self.remember_orders(remembered, now, out);
        self.guard.awaited_since_start();
        self.guard.lease().is_some()
    }

    /// Restores what does not depend on who sends on the line: trips and sums.
    fn remember_records(&mut self, remembered: &RememberedDrive) {
        self.trips =
            std::mem::take(&mut self.trips).remembering(remembered.trips.unwrap_or_default());
        self.kept.remember(remembered);
        self.usage.remember(remembered.usage);
    }

    /// Restores what was ordered.
    fn remember_orders(&mut self, remembered: &RememberedDrive, now: MonoTime, out: Out<'_>) {
        self.remember_sight(remembered);
        self.remember_reset(remembered.reset);
        let Some(stop) = remembered.stop else { return };
        match self.guard.remember_stop(stop.coast, now) {
            Some(order) => {
                self.is_stopping = true;
                self.latch = Some(StopLatch::remembered(order, now));
            }
            // Its control section is gone, or the drive was replaced.
            None => {
                out.push_back(LineEffect::Note(self.drive, DriveNote::StopDropped));
                out.keep(
                    self.drive,
                    JournalEntry::StopOver {
                        is_effective: false,
                    },
                );
            }
        }
    }
}
