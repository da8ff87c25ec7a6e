//! What the drive has used: measured with its readings, and kept.

use super::{DriveWork, Out};
use crate::domain::command::Owner;
use crate::domain::time::MonoTime;
use crate::drive::snapshot::DriveSnapshot;
use crate::drive::usage::UsageView;
use crate::drive::view::{TripEvent, TripEventKind};
use crate::journal::JournalEntry;
use std::time::Duration;

/// What has been used is returned to be kept this often: it is lost if the process is killed.
const KEEP_EVERY: Duration = Duration::from_secs(3);

impl DriveWork {
    /// What it has used, as it is shown.
    #[must_use]
    pub const fn usage_view(&self) -> UsageView {
        self.usage.view()
    }

    /// Words were read from the drive at `read_at`, and `snapshot` has them.
    pub fn take_usage(&mut self, snapshot: &DriveSnapshot, read_at: MonoTime, out: Out<'_>) {
        if self.status_at.max(self.output.at()) == Some(read_at) {
            self.usage.meter.take_running(self.runs(), read_at);
        }
        self.usage.meter.take_readings(snapshot);
        self.keep_usage_after(KEEP_EVERY, out);
    }

    /// Whether the motor turns or the drive is ordered to run; `None` if that is not known.
    fn runs(&self) -> Option<bool> {
        let is_at_rest = self.status.is_running() == Some(false) || self.output.raw() == Some(0);
        if self.is_moving() {
            Some(true)
        } else {
            is_at_rest.then_some(false)
        }
    }

    /// Counts the trips of `events`. The sums are kept before them, so that the journal knows the running time of a trip.
    pub(super) fn count_trips(&mut self, events: &[TripEvent], out: Out<'_>) {
        let trips = events.iter().map(|event| match &event.kind {
            TripEventKind::Tripped { trips, .. } => *trips,
            TripEventKind::Cleared => 0,
        });
        let trips = trips.fold(0, u16::saturating_add);
        if trips > 0 {
            self.usage.meter.tripped(trips);
            self.keep_usage(out);
        }
    }

    /// The drive has stopped answering.
    pub(super) fn usage_out_of_sight(&mut self, out: Out<'_>) {
        self.usage.meter.out_of_sight();
        self.keep_usage(out);
    }

    /// Sets all sums back to 0, because `owner` has requested it.
    pub fn reset_usage(&mut self, owner: Owner, out: Out<'_>) {
        self.keep_usage(out);
        self.usage.meter.reset();
        self.has_changed = true;
        out.keep(self.drive, JournalEntry::UsageReset { owner });
        self.keep_usage(out);
    }

    /// Keeps what has been used since the last time.
    pub(super) fn keep_usage(&mut self, out: Out<'_>) {
        self.keep_usage_after(Duration::ZERO, out);
    }

    fn keep_usage_after(&mut self, after: Duration, out: Out<'_>) {
        if let Some(usage) = self.usage.meter.take_unkept(out.now(), after) {
            let row = out.keep(self.drive, JournalEntry::Usage(usage));
            self.usage.totals.show(row, usage.totals);
        }
    }
}
