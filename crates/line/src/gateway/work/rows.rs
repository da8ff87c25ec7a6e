//! Journal rows of a drive, and the work that waits for them.

use super::durable::DurablePicture;
use super::{DriveWork, Out};
use crate::domain::command::{Order, Outcome, Reason, Report};
use crate::domain::time::MonoTime;
use crate::drive::trips::{TripBaseline, TripWatch};
use crate::drive::view::{KeptTrips, TripEvent};
use crate::gateway::event::LineEffect;
use crate::gateway::execution::CommandExecution;
use crate::gateway::note::DriveNote;
use crate::journal::{JournalEntry, RememberedDrive, RowNumber};
use std::time::Duration;

/// Maximum time for which a reset, or a run order that opens a lease, waits for its row. Control takes precedence over
/// the journal.
const WAIT_MAX: Duration = Duration::from_millis(20);
/// Maximum number of trip snapshots that wait for their rows. Beyond that, the newest two are merged.
const UNKEPT_MAX: usize = 16;

/// A run order or reset that waits for its row.
#[derive(Clone, Copy, Debug)]
pub(super) struct OpeningOrder {
    row: RowNumber,
    /// The order is sent at this moment even if its row is not durable.
    pub until: MonoTime,
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
}

impl DriveWork {
    /// Its trips, as far as their rows are durable.
    #[must_use]
    pub const fn trips_kept(&self) -> &KeptTrips {
        self.kept.pictures.shown()
    }

    /// Everything up to `row` is durable.
    pub fn kept(&mut self, row: RowNumber) {
        self.has_changed |= self.kept.pictures.kept(row);
        self.has_changed |= self.usage.kept(row);
        self.opening.take_if(|opening| opening.row <= row);
    }

    /// Records a change of control. Returns its row, if any.
    pub fn keep_lease(&mut self, out: Out<'_>) -> Option<RowNumber> {
        let owner = self
            .guard
            .lease()
            .map(|(owner, _)| (owner, self.guard.is_orphaned()));
        if owner == self.said_owner {
            return None;
        }
        self.said_owner = owner;
        out.keep(
            self.drive,
            JournalEntry::Lease(owner.map(|(owner, _)| owner)),
        )
    }

    /// An order was accepted. One that `runs` waits for the row of its lease, if it has opened one.
    pub(super) fn open_lease(&mut self, runs: bool, now: MonoTime, out: Out<'_>) {
        let held_before = self.said_owner.map(|(owner, _)| owner);
        let row = self.keep_lease(out);
        let is_opened = self.guard.lease().map(|(owner, _)| owner) != held_before;
        if let Some(row) = row
            && runs
            && is_opened
        {
            self.opens_behind(row, now);
        }
    }

    /// Delays the accepted order until `row` is durable.
    pub(super) fn opens_behind(&mut self, row: RowNumber, now: MonoTime) {
        self.opening = Some(OpeningOrder {
            row,
            until: now + WAIT_MAX,
        });
    }

    /// When `execution` may begin, as far as the journal is concerned.
    pub(super) fn opens_at(&self, execution: &CommandExecution) -> MonoTime {
        match self.opening {
            Some(opening) if waits_for_row(execution) => opening.until,
            _ => MonoTime::ZERO,
        }
    }

    /// Ends the wait for the journal once it has lasted too long.
    pub(super) fn pass_opening(&mut self, now: MonoTime, out: Out<'_>) {
        let is_over = self
            .opening
            .take_if(|opening| now >= opening.until)
            .is_some();
        if is_over && self.current.iter().chain(&self.waiting).any(waits_for_row) {
            out.push_back(LineEffect::Note(self.drive, DriveNote::JournalSlow));
        }
    }

    /// Records new trips: `events`, or only the new baseline.
    pub(super) fn keep_trips(&mut self, events: &[TripEvent], out: Out<'_>) {
        let baseline = self.trips.baseline();
        let is_other = std::mem::replace(&mut self.kept.said, baseline) != baseline;
        let moved = (events.is_empty() && is_other).then_some(JournalEntry::Baseline(baseline));
        let entries = events
            .iter()
            .map(|event| JournalEntry::Trip(event.clone(), baseline))
            .chain(moved);
        let mut row = None;
        for entry in entries {
            row = out.keep(self.drive, entry);
        }
        if let Some(picture) = self.kept.new_picture(&self.trips, out.keeps()) {
            self.kept.pictures.show(row, picture);
        }
    }

    /// The line is left: work in progress ends here.
    pub fn end_attempts(&mut self, out: Out<'_>) {
        for mut execution in self
            .current
            .take()
            .into_iter()
            .chain(std::mem::take(&mut self.waiting))
        {
            let outcome = if execution.has_begun() {
                Outcome::Unknown
            } else {
                Outcome::Refused
            };
            self.tell(
                execution.waiter(),
                Report::new(outcome, Reason::ShuttingDown),
                true,
                out,
            );
        }
        let unread = self.trips.tell_unread();
        self.trip(unread, out);
        self.usage.keep(out);
        let Some(latch) = &mut self.latch else { return };
        let report = latch.late_report();
        for mut waiter in std::mem::take(latch.waiters()) {
            self.tell(&mut waiter, report, true, out);
        }
    }
}

impl DurableTrips {
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

/// Whether `execution` is an order to run, or a reset, that has not begun.
fn waits_for_row(execution: &CommandExecution) -> bool {
    let waits = match execution.order() {
        Order::Go(go) => go.run().is_some(),
        order => *order == Order::Reset,
    };
    execution.is_new() && !execution.has_begun() && waits
}
