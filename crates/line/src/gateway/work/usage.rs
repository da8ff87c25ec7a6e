//! What a drive has used: measured with its readings, kept, and shown as far as its rows are durable, so that no sum falls
//! after a kill.

use super::durable::DurablePicture;
use crate::domain::command::Owner;
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::drive::plan::PollPace;
use crate::drive::snapshot::DriveSnapshot;
use crate::drive::usage::{KeptUsage, UsageMeter, UsageParts, UsageTotals, UsageView};
use crate::drive::view::{TripEvent, TripEventKind};
use crate::gateway::outbox::EffectOutbox;
use crate::journal::{JournalEntry, RowNumber};
use crate::profile::model::Model;
use std::time::Duration;

/// What has been used is returned to be kept this often: it is lost if the process is killed.
const KEEP_EVERY: Duration = Duration::from_secs(3);
/// Most sums that wait for their rows.
const UNKEPT_MAX: usize = 8;

/// The sums of one drive.
#[derive(Debug)]
pub(super) struct UsageSums {
    drive: DriveIndex,
    meter: UsageMeter,
    parts: UsageParts,
    totals: DurablePicture<UsageTotals, UNKEPT_MAX>,
}

impl UsageSums {
    /// Nothing used so far.
    pub fn new(drive: DriveIndex, model: &Model, pace: PollPace) -> Self {
        let totals = DurablePicture::new(UsageTotals::default());
        Self {
            drive,
            meter: UsageMeter::new(model, pace),
            parts: UsageParts::of(model),
            totals,
        }
    }

    /// Continues from what an earlier process has kept.
    pub fn remember(&mut self, kept: KeptUsage) {
        self.meter.remember(kept);
        self.totals = DurablePicture::new(kept.totals);
    }

    /// What is shown.
    pub const fn view(&self) -> UsageView {
        UsageView {
            parts: self.parts,
            totals: *self.totals.shown(),
        }
    }

    /// A reading of `read_at` shows whether the motor runs; `None` if that is not known.
    pub fn take_running(&mut self, runs: Option<bool>, read_at: MonoTime) {
        self.meter.take_running(runs, read_at);
    }

    /// `snapshot` has new words.
    pub fn take_readings(&mut self, snapshot: &DriveSnapshot, out: &mut EffectOutbox) {
        self.meter.take_readings(snapshot);
        self.keep_after(KEEP_EVERY, out);
    }

    /// Counts the trips of `events`. The sums are kept before them, so that the journal knows the running time of a trip.
    pub fn count_trips(&mut self, events: &[TripEvent], out: &mut EffectOutbox) {
        let trips = events.iter().map(|event| match &event.kind {
            TripEventKind::Tripped { trips, .. } => *trips,
            TripEventKind::Cleared => 0,
        });
        let trips = trips.fold(0, u16::saturating_add);
        if trips > 0 {
            self.meter.tripped(trips);
            self.keep(out);
        }
    }

    /// The drive has stopped answering.
    pub fn out_of_sight(&mut self, out: &mut EffectOutbox) {
        self.meter.out_of_sight();
        self.keep(out);
    }

    /// Sets all sums back to 0, because `owner` has requested it.
    pub fn reset(&mut self, owner: Owner, out: &mut EffectOutbox) {
        self.keep(out);
        self.meter.reset();
        out.keep(self.drive, JournalEntry::UsageReset { owner });
        self.keep(out);
    }

    /// Keeps what has been used since the last time.
    pub fn keep(&mut self, out: &mut EffectOutbox) {
        self.keep_after(Duration::ZERO, out);
    }

    fn keep_after(&mut self, after: Duration, out: &mut EffectOutbox) {
        if let Some(usage) = self.meter.take_unkept(out.now(), after) {
            let row = out.keep(self.drive, JournalEntry::Usage(usage));
            self.totals.show(row, usage.totals);
        }
    }

    /// Everything up to `row` is durable. Returns whether that changes what is shown.
    pub fn kept(&mut self, row: RowNumber) -> bool {
        self.totals.kept(row)
    }
}
