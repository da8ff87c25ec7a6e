//! What waits for the journal: orders that are sent, and trips that are shown, only once their rows are durable.

use super::queue::OrderQueue;
use super::reports::{DriveReports, Out};
use crate::domain::command::{Order, Owner};
use crate::domain::time::MonoTime;
use crate::drive::trips::{TripBaseline, TripWatch};
use crate::drive::view::{KeptTrips, TripEvent};
use crate::gateway::execution::CommandExecution;
use crate::gateway::note::DriveNote;
use crate::guard::DriveGuard;
use crate::journal::{JournalEntry, RememberedDrive, RowNumber};
use std::collections::VecDeque;
use std::time::Duration;

/// Maximum time for which a reset, or a run order that opens a lease, waits for its row. Control takes precedence over
/// the journal.
const WAIT_MAX: Duration = Duration::from_millis(20);
/// Maximum number of trip snapshots that wait for their rows. Beyond that, the newest two are merged.
const UNKEPT_MAX: usize = 16;

/// A picture as far as its rows are durable. At most `MAX` newer ones wait for theirs; beyond that, the newest two are
/// merged.
#[derive(Debug, Default)]
pub(super) struct DurablePicture<T, const MAX: usize> {
    shown: T,
    /// Pictures to show once these rows are durable.
    unkept: VecDeque<(RowNumber, T)>,
}

impl<T, const MAX: usize> DurablePicture<T, MAX> {
    /// Shows `shown`, with nothing newer.
    pub const fn new(shown: T) -> Self {
        Self {
            shown,
            unkept: VecDeque::new(),
        }
    }

    /// What is shown.
    pub const fn shown(&self) -> &T {
        &self.shown
    }

    /// The newest picture, shown or not.
    pub fn newest(&self) -> &T {
        self.unkept
            .back()
            .map_or(&self.shown, |(_, picture)| picture)
    }

    /// Adds a picture to show once `row` is durable; without a row, at once, unless others are pending.
    pub fn show(&mut self, row: Option<RowNumber>, picture: T) {
        let is_full = self.unkept.len() >= MAX;
        match (row, self.unkept.back_mut()) {
            (None, None) => self.shown = picture,
            (None, Some(newest)) => newest.1 = picture,
            (Some(row), Some(newest)) if is_full => *newest = (row, picture),
            (Some(row), _) => self.unkept.push_back((row, picture)),
        }
    }

    /// Everything up to `row` is durable. Returns whether that changes what is shown.
    pub fn kept(&mut self, row: RowNumber) -> bool {
        let before = self.unkept.len();
        while let Some((_, picture)) = self.unkept.pop_front_if(|(it, _)| *it <= row) {
            self.shown = picture;
        }
        self.unkept.len() != before
    }
}

/// Trips, as far as their rows are durable.
#[derive(Debug, Default)]
pub(super) struct DurableTrips {
    pictures: DurablePicture<KeptTrips, UNKEPT_MAX>,
    /// The baseline in the last row.
    said: TripBaseline,
    /// Trips of previous runs, and the number of the newest.
    total_before: u32,
    code_before: Option<u16>,
}

impl DurableTrips {
    /// Restores the trips of previous runs.
    pub fn remember(&mut self, remembered: &RememberedDrive) {
        self.said = remembered.trips.unwrap_or_default();
        self.total_before = remembered.trips_total;
        self.code_before = remembered.last_code;
        let total = self.total_before;
        let last_code = self.code_before;
        self.pictures = DurablePicture::new(KeptTrips {
            count: self.said.count,
            total,
            last: None,
            last_code,
        });
    }

    /// What is shown.
    pub const fn shown(&self) -> &KeptTrips {
        self.pictures.shown()
    }

    /// Everything up to `row` is durable. Returns whether that changes what is shown.
    pub fn kept(&mut self, row: RowNumber) -> bool {
        self.pictures.kept(row)
    }

    /// Records new `trips`: `events`, or only the new baseline.
    pub fn keep(
        &mut self,
        trips: &TripWatch,
        events: &[TripEvent],
        reports: &DriveReports,
        out: Out<'_>,
    ) {
        let baseline = trips.baseline();
        let is_other = std::mem::replace(&mut self.said, baseline) != baseline;
        let moved = (events.is_empty() && is_other).then_some(JournalEntry::Baseline(baseline));
        let entries = events
            .iter()
            .map(|event| JournalEntry::Trip(event.clone(), baseline))
            .chain(moved);
        let mut row = None;
        for entry in entries {
            row = reports.keep(entry, out);
        }
        if let Some(picture) = self.new_picture(trips, out.keeps()) {
            self.pictures.show(row, picture);
        }
    }

    /// The snapshot of `trips` to show, if it is new. Without a journal it is the current state.
    fn new_picture(&self, trips: &TripWatch, keeps: bool) -> Option<KeptTrips> {
        let view = trips.view();
        let newest = self.pictures.newest();
        let count = if keeps { self.said.count } else { view.count };
        let total = self.total_before.saturating_add(view.seen);
        let is_shown = newest.count == count && newest.total == total && newest.last == view.last;
        let last_code = || {
            view.last
                .as_ref()
                .map_or(self.code_before, |last| last.code)
        };
        (!is_shown).then(|| KeptTrips {
            count,
            total,
            last: view.last.clone(),
            last_code: last_code(),
        })
    }
}

/// A run order or reset that waits for its row.
#[derive(Clone, Copy, Debug)]
struct OpeningOrder {
    row: RowNumber,
    /// The order is sent at this moment even if its row is not durable.
    until: MonoTime,
}

/// The rows about who has control, and the order that waits for one.
#[derive(Debug, Default)]
pub(super) struct OpeningRows {
    /// A run order or reset that waits for its row.
    opening: Option<OpeningOrder>,
    /// The last recorded owner of the lease, and whether it is awaited since before a restart.
    said_owner: Option<(Owner, bool)>,
}

impl OpeningRows {
    /// Restores the `owner` of control, who is awaited since before the restart.
    pub const fn remember(&mut self, owner: Owner) {
        self.said_owner = Some((owner, true));
    }

    /// Everything up to `row` is durable.
    pub fn kept(&mut self, row: RowNumber) {
        self.opening.take_if(|opening| opening.row <= row);
    }

    /// Records a change of control. Returns its row, if any.
    pub fn keep_lease(
        &mut self,
        guard: &DriveGuard,
        reports: &DriveReports,
        out: Out<'_>,
    ) -> Option<RowNumber> {
        let owner = guard.lease().map(|(owner, _)| (owner, guard.is_orphaned()));
        if owner == self.said_owner {
            return None;
        }
        self.said_owner = owner;
        reports.keep(JournalEntry::Lease(owner.map(|(owner, _)| owner)), out)
    }

    /// An order was accepted. One that `runs` waits for the row of its lease, if it has opened one.
    pub fn open_lease(
        &mut self,
        runs: bool,
        guard: &DriveGuard,
        reports: &DriveReports,
        now: MonoTime,
        out: Out<'_>,
    ) {
        let held_before = self.said_owner.map(|(owner, _)| owner);
        let row = self.keep_lease(guard, reports, out);
        let is_opened = guard.lease().map(|(owner, _)| owner) != held_before;
        if let Some(row) = row
            && runs
            && is_opened
        {
            self.opens_behind(row, now);
        }
    }

    /// Delays the accepted order until `row` is durable.
    pub fn opens_behind(&mut self, row: RowNumber, now: MonoTime) {
        self.opening = Some(OpeningOrder {
            row,
            until: now + WAIT_MAX,
        });
    }

    /// When `execution` may begin, as far as the journal is concerned.
    pub fn opens_at(&self, execution: &CommandExecution) -> MonoTime {
        match self.opening {
            Some(opening) if waits_for_row(execution) => opening.until,
            _ => MonoTime::ZERO,
        }
    }

    /// When [`Self::pass`] is due.
    pub fn next_wake(&self) -> Option<MonoTime> {
        self.opening.map(|opening| opening.until)
    }

    /// Ends the wait for the journal once it has lasted too long.
    pub fn pass(
        &mut self,
        queue: &OrderQueue,
        reports: &DriveReports,
        now: MonoTime,
        out: Out<'_>,
    ) {
        let is_over = self
            .opening
            .take_if(|opening| now >= opening.until)
            .is_some();
        if is_over && queue.iter().any(waits_for_row) {
            reports.note(DriveNote::JournalSlow, out);
        }
    }
}

/// Whether `execution` is an order to run, or a reset, that has not begun.
fn waits_for_row(execution: &CommandExecution) -> bool {
    let waits = match execution.order() {
        Order::Go(go) => go.run().is_some(),
        order => *order == Order::Reset,
    };
    execution.is_new() && !execution.has_begun() && waits
}
