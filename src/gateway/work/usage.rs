//! What the drive has used: measured with its readings, and kept.

use super::{DriveWork, Out};
use crate::domain::command::Owner;
use crate::domain::time::MonoTime;
use crate::drive::plan::Pace;
use crate::drive::snapshot::DriveSnapshot;
use crate::drive::usage::{UsageMeter, UsageParts, UsageTotals, UsageView};
use crate::drive::view::{TripEvent, TripEventKind};
use crate::journal::{Entry, KeptUsage, RowNumber};
use crate::profile::model::Model;
use std::collections::VecDeque;
use std::time::Duration;

/// What has been used is returned to be kept this often: it is lost if the process is killed.
const KEEP_EVERY: Duration = Duration::from_secs(3);

/// Most sums that wait for their rows. Beyond that, only the newest of them is shown.
const UNKEPT_MAX: usize = 8;

/// What a drive has used: measured, and shown as far as its rows are durable, so that no sum falls after a kill.
#[derive(Debug)]
pub(super) struct Usage {
    meter: UsageMeter,
    shown: UsageView,
    /// Sums to show once these rows are durable.
    unkept: VecDeque<(RowNumber, UsageTotals)>,
}

impl Usage {
    /// Nothing used so far.
    pub fn new(model: &Model, pace: Pace) -> Self {
        let shown = UsageView { parts: UsageParts::of(model), totals: UsageTotals::default() };
        Self { meter: UsageMeter::new(model, pace), shown, unkept: VecDeque::new() }
    }

    /// Continues from what an earlier process has kept.
    pub fn remember(&mut self, kept: KeptUsage) {
        self.meter.remember(kept);
        self.shown.totals = kept.totals;
    }

    /// Shows `totals` once `row` is durable; without a journal, at once.
    fn show(&mut self, row: Option<RowNumber>, totals: UsageTotals) {
        let is_full = self.unkept.len() >= UNKEPT_MAX;
        match (row, self.unkept.back_mut()) {
            (None, _) => self.shown.totals = totals,
            (Some(row), Some(newest)) if is_full => *newest = (row, totals),
            (Some(row), _) => self.unkept.push_back((row, totals)),
        }
    }

    /// Everything up to `row` is durable. Returns whether that changes what is shown.
    pub fn kept(&mut self, row: RowNumber) -> bool {
        let before = self.unkept.len();
        while let Some((_, totals)) = self.unkept.pop_front_if(|(it, _)| *it <= row) {
            self.shown.totals = totals;
        }
        self.unkept.len() != before
    }
}

impl DriveWork {
    /// What it has used, as it is shown.
    #[must_use]
    pub const fn usage_view(&self) -> UsageView {
        self.usage.shown
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
        if self.is_moving() { Some(true) } else { is_at_rest.then_some(false) }
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
        out.keep(self.drive, Entry::UsageReset { owner });
        self.keep_usage(out);
    }

    /// Keeps what has been used since the last time.
    pub(super) fn keep_usage(&mut self, out: Out<'_>) {
        self.keep_usage_after(Duration::ZERO, out);
    }

    fn keep_usage_after(&mut self, after: Duration, out: Out<'_>) {
        if let Some(usage) = self.usage.meter.take_unkept(out.now(), after) {
            let row = out.keep(self.drive, Entry::Usage(usage));
            self.usage.show(row, usage.totals);
        }
    }
}
