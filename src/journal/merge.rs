//! Equal refusals and superseded setpoints of one commander and drive share a row for a second, with a count: neither a
//! controller that repeats what is refused nor a slider that is dragged fills the journal.

use super::record::Record;
use crate::domain::command::{Outcome, Owner, Reason};
use crate::domain::ids::Name;
use crate::domain::time::MonoTime;
use std::collections::{HashMap, VecDeque};
use std::time::Duration;

/// How long a row is shared.
pub const SHARED_FOR: Duration = Duration::from_secs(1);
/// Most rows that are shared at a time. The oldest is shared no more.
pub const SHARES_MAX: usize = 1024;

/// What may share a row.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Key {
    name: Option<Name>,
    by: Option<Owner>,
    what: What,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum What {
    /// Also by who stood in the way.
    Refused(String, Reason, Option<Owner>),
    Superseded,
}

impl Key {
    /// With what `record` may share a row; nothing: it stands alone.
    #[must_use]
    pub fn of(record: &Record) -> Option<Self> {
        let report = record.report?;
        let what = match report.outcome {
            Outcome::Refused => What::Refused(record.tried.clone(), report.reason, report.holder),
            Outcome::Superseded if record.is_setpoint => What::Superseded,
            _ => return None,
        };
        Some(Self { name: record.name.clone(), by: record.by, what })
    }
}

#[derive(Debug)]
struct Share {
    since: MonoTime,
    record: Record,
    /// How many of its count are kept already.
    kept: u64,
}

/// The rows that are shared.
#[derive(Debug, Default)]
pub struct Merges {
    shares: HashMap<Key, Share>,
    /// Oldest first. One that is shared no more may still stand here.
    order: VecDeque<(MonoTime, Key)>,
}

impl Merges {
    /// `record` as it stands in a row that is shared, and how many of that are kept already; nothing: it needs a row of
    /// its own, and is told by [`begin`](Self::begin).
    pub fn join(&mut self, key: &Key, record: &Record, now: MonoTime) -> Option<(Record, u64)> {
        let share = self.shares.get_mut(key).filter(|share| now < share.since + SHARED_FOR)?;
        share.record.count += record.count;
        // The newest setpoint; of refusals all are the same.
        share.record.tried.clone_from(&record.tried);
        Some((share.record.clone(), share.kept))
    }

    /// From now on the row of `record` is shared.
    pub fn begin(&mut self, key: Key, record: Record, now: MonoTime) {
        self.shares.insert(key.clone(), Share { since: now, record, kept: 0 });
        self.order.push_back((now, key));
        while let Some((since, oldest)) = self.order.front() {
            if now < *since + SHARED_FOR && self.order.len() <= SHARES_MAX {
                break;
            }
            if self.shares.get(oldest).is_some_and(|share| share.since == *since) {
                self.shares.remove(oldest);
            }
            self.order.pop_front();
        }
    }

    /// All rows are kept as they are now.
    pub fn kept(&mut self) {
        self.shares.values_mut().for_each(|share| share.kept = share.record.count);
    }

    /// The row with this number is shared no more.
    pub fn end(&mut self, record: &Record) {
        if let Some(key) = Key::of(record)
            && self.shares.get(&key).is_some_and(|share| share.record.number == record.number)
        {
            self.shares.remove(&key);
        }
    }
}
