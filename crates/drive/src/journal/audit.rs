//! Audit rows on their way into the journal. Each attempt has exactly one row, which is written when it is made and
//! again when its outcome is known.

use super::entry::AttemptId;
use super::merge::{MergeKey, SharedRows};
use super::record::{AuditRecord, RecordKind};
use crate::domain::command::Report;
use crate::domain::time::MonoTime;
use std::collections::{BTreeMap, HashMap, VecDeque};

/// Maximum number of rows waiting to be written.
pub const WAITING_MAX: usize = 4096;
/// How many of them may be stops before a stop is dropped.
pub const STOPS_MAX: usize = 1024;
/// Maximum number of attempts without an outcome. A line has far fewer; a dropped one stays without an outcome.
pub const OPEN_MAX: usize = 65_536;

/// Identifies an attempt: its source (one run of a line or a north interface), and its number there.
pub type AttemptKey = (u64, AttemptId);

/// A change to one row.
#[derive(Clone, Debug, PartialEq)]
pub enum RowChange {
    /// Insert or replace it.
    Put(AuditRecord),
    /// Remove it: it is counted in another one.
    Remove,
}

#[derive(Debug)]
struct WaitingRow {
    change: RowChange,
    /// How much of its count is already in the journal.
    kept: u64,
    /// The open attempt, if its outcome is awaited.
    place: Option<AttemptKey>,
}

/// Rows waiting to be written, and attempts without an outcome.
#[derive(Debug, Default)]
pub struct AuditRows {
    /// The number of the newest row.
    newest: u64,
    /// The newest row when all was last written.
    kept: u64,
    waiting: BTreeMap<u64, WaitingRow>,
    stops_waiting: usize,
    open: HashMap<AttemptKey, AuditRecord>,
    /// Oldest first. It may contain attempts that have ended.
    order: VecDeque<AttemptKey>,
    merges: SharedRows,
    lost: LostCounts,
}

/// Counts of what could not be stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LostCounts {
    /// Attempts to write without a row.
    pub attempts: u64,
    /// Outcomes of attempts, trips and other rows.
    pub others: u64,
}

impl LostCounts {
    /// The sum.
    #[must_use]
    pub const fn total(self) -> u64 {
        self.attempts + self.others
    }
}

impl std::ops::AddAssign for LostCounts {
    fn add_assign(&mut self, more: Self) {
        self.attempts += more.attempts;
        self.others += more.others;
    }
}

impl AuditRows {
    /// Adds an attempt or action. `place`: the attempt whose outcome will follow, if any.
    pub fn add(&mut self, now: MonoTime, mut record: AuditRecord, place: Option<AttemptKey>) {
        if let Some(key) = MergeKey::of(&record) {
            return self.add_shared(now, key, record);
        }
        record.number = self.next_number();
        if let Some(place) = place {
            self.open.insert(place, record.clone());
            self.order.push_back(place);
            self.forget_oldest();
        }
        self.put(record, 0, place);
    }

    /// Records the outcome of the attempt at `place`.
    pub fn end(&mut self, now: MonoTime, place: AttemptKey, report: Report) {
        let Some(record) = self.open.remove(&place) else {
            return;
        };
        let record = AuditRecord {
            report: Some(report),
            ..record
        };
        let kept = u64::from(record.number <= self.kept);
        let Some(key) = MergeKey::of(&record) else {
            return self.put(record, kept, None);
        };
        match self.merges.join(&key, &record, now) {
            Some((shared, shared_kept)) => {
                self.remove(record.number, kept > 0);
                // The stored count of this one moves into the other.
                self.put(shared, shared_kept, None);
            }
            None => {
                self.put(record.clone(), kept, None);
                self.merges.begin(key, record, now);
            }
        }
    }

    fn add_shared(&mut self, now: MonoTime, key: MergeKey, mut record: AuditRecord) {
        if let Some((shared, kept)) = self.merges.join(&key, &record, now) {
            return self.put(shared, kept, None);
        }
        record.number = self.next_number();
        self.put(record.clone(), 0, None);
        self.merges.begin(key, record, now);
    }

    const fn next_number(&mut self) -> u64 {
        self.newest += 1;
        self.newest
    }

    fn put(&mut self, record: AuditRecord, kept: u64, place: Option<AttemptKey>) {
        let number = record.number;
        let is_stop = record.is_stop;
        let change = RowChange::Put(record);
        if self
            .waiting
            .insert(
                number,
                WaitingRow {
                    change,
                    kept,
                    place,
                },
            )
            .is_none()
        {
            self.stops_waiting += usize::from(is_stop);
        }
        while self.waiting.len() > WAITING_MAX {
            self.give_way();
        }
    }

    fn remove(&mut self, number: u64, is_in_journal: bool) {
        if is_in_journal {
            self.waiting.insert(
                number,
                WaitingRow {
                    change: RowChange::Remove,
                    kept: 0,
                    place: None,
                },
            );
        } else {
            self.waiting.remove(&number);
        }
    }

    /// Drops the oldest row; a stop only if there are too many of them.
    fn give_way(&mut self) {
        let may_go = |waiting: &WaitingRow| match &waiting.change {
            RowChange::Put(record) => self.stops_waiting > STOPS_MAX || !record.is_stop,
            RowChange::Remove => false,
        };
        let number = self
            .waiting
            .iter()
            .find(|(_, waiting)| may_go(waiting))
            .map(|(number, _)| *number);
        let number = number.or_else(|| self.waiting.keys().next().copied());
        let Some(gone) = number.and_then(|number| self.waiting.remove(&number)) else {
            return;
        };
        if let RowChange::Put(record) = gone.change {
            self.stops_waiting -= usize::from(record.is_stop).min(self.stops_waiting);
            let count = record.count.saturating_sub(gone.kept);
            match record.kind {
                RecordKind::Attempt => self.lost.attempts += count,
                RecordKind::FailSafe(_)
                | RecordKind::StopGivenUp
                | RecordKind::Lease(_)
                | RecordKind::MayStillRun(_)
                | RecordKind::StandstillConfirmed
                | RecordKind::UsageReset => self.lost.others += count,
            }
            self.merges.end(&record);
        }
        if gone.kept == 0
            && let Some(place) = gone.place
        {
            self.open.remove(&place);
        }
    }

    fn forget_oldest(&mut self) {
        while self.order.len() > OPEN_MAX {
            if let Some(place) = self.order.pop_front() {
                self.open.remove(&place);
            }
        }
        // Attempts that have ended must not push out open ones.
        if self.order.len() > 2 * self.open.len() + 64 {
            self.order.retain(|place| self.open.contains_key(place));
        }
    }

    /// The changes to be written, by row number.
    pub fn waiting(&self) -> impl Iterator<Item = (u64, &RowChange)> {
        self.waiting
            .iter()
            .map(|(number, waiting)| (*number, &waiting.change))
    }

    /// The number of rows waiting to be written.
    #[must_use]
    pub fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Whether no row is waiting.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Takes the counts of what could not be stored since the last call.
    pub fn take_lost(&mut self) -> LostCounts {
        std::mem::take(&mut self.lost)
    }

    /// The number of the newest row when all was last written.
    #[must_use]
    pub const fn kept(&self) -> u64 {
        self.kept
    }

    /// Everything has been written.
    pub fn written(&mut self) {
        self.waiting.clear();
        self.stops_waiting = 0;
        self.kept = self.newest;
        self.merges.kept();
    }
}
