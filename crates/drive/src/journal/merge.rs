//! Equal refusals and superseded setpoints of one client and drive share a row for a second, with a count, so that
//! neither a controller that repeats a refused command nor a dragged slider fills the journal.

use super::record::AuditRecord;
use crate::domain::command::{Outcome, Owner, Reason};
use crate::domain::ids::Name;
use crate::domain::time::MonoTime;
use std::collections::{HashMap, VecDeque};
use std::time::Duration;

/// How long a row is shared.
pub const SHARED_FOR: Duration = Duration::from_secs(1);
/// Maximum number of shared rows. The oldest is no longer shared when it is exceeded.
pub const SHARES_MAX: usize = 1024;

/// Records with equal keys may share a row.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct MergeKey {
    name: Option<Name>,
    by: Option<Owner>,
    what: MergedOutcome,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum MergedOutcome {
    /// Attempt, reason, and the holder of control.
    Refused(String, Reason, Option<Owner>),
    Superseded,
}

impl MergeKey {
    /// The key of `record`; `None` if it does not share a row.
    #[must_use]
    pub fn of(record: &AuditRecord) -> Option<Self> {
        let report = record.report?;
        let what = match report.outcome {
            Outcome::Refused => {
                MergedOutcome::Refused(record.tried.clone(), report.reason, report.holder)
            }
            Outcome::Superseded if record.is_setpoint => MergedOutcome::Superseded,
            _ => return None,
        };
        Some(Self {
            name: record.name.clone(),
            by: record.by,
            what,
        })
    }
}

#[derive(Debug)]
struct SharedRow {
    since: MonoTime,
    record: AuditRecord,
    /// How much of its count is already stored.
    kept: u64,
}

/// The rows that are shared.
#[derive(Debug, Default)]
pub struct SharedRows {
    shares: HashMap<MergeKey, SharedRow>,
    /// Oldest first. It may contain rows that are no longer shared.
    order: VecDeque<(MonoTime, MergeKey)>,
}

impl SharedRows {
    /// Adds `record` to a shared row; returns that and how much of its count is already stored. `None` if it needs a
    /// row of its own, see [`begin`](Self::begin).
    pub fn join(
        &mut self,
        key: &MergeKey,
        record: &AuditRecord,
        now: MonoTime,
    ) -> Option<(AuditRecord, u64)> {
        let share = self
            .shares
            .get_mut(key)
            .filter(|share| now < share.since + SHARED_FOR)?;
        share.record.count += record.count;
        // The newest setpoint; equal refusals have the same text.
        share.record.tried.clone_from(&record.tried);
        Some((share.record.clone(), share.kept))
    }

    /// Shares the row of `record` from now on.
    pub fn begin(&mut self, key: MergeKey, record: AuditRecord, now: MonoTime) {
        self.shares.insert(
            key.clone(),
            SharedRow {
                since: now,
                record,
                kept: 0,
            },
        );
        self.order.push_back((now, key));
        while let Some((since, oldest)) = self.order.front() {
            if now < *since + SHARED_FOR && self.order.len() <= SHARES_MAX {
                break;
            }
            if self
                .shares
                .get(oldest)
                .is_some_and(|share| share.since == *since)
            {
                self.shares.remove(oldest);
            }
            self.order.pop_front();
        }
    }

    /// All rows have been stored as they are now.
    pub fn kept(&mut self) {
        self.shares
            .values_mut()
            .for_each(|share| share.kept = share.record.count);
    }

    /// The row of `record` is no longer shared.
    pub fn end(&mut self, record: &AuditRecord) {
        if let Some(key) = MergeKey::of(record)
            && self
                .shares
                .get(&key)
                .is_some_and(|share| share.record.number == record.number)
        {
            self.shares.remove(&key);
        }
    }
}
