//! Everything waiting to be written into the journal, and the state remembered of each drive. It collects what happened
//! and returns what is to be written; while writing is impossible, it keeps the newest.

use super::audit::{AuditRows, LostCounts};
use super::days::{DayNumber, DaySums, DayUsage};
use super::entry::{JournalEntry, WriteAttempt};
use super::record::{AuditRecord, LeaseChange};
use super::remembered::{RememberedDrive, RememberedLease};
use super::row::{self, JournalRow};
use super::trip;
use crate::domain::calendar::rfc3339;
use crate::domain::fail_safe::FailSafeRun;
use crate::domain::ids::Name;
use crate::domain::time::{MonoTime, WallTime};
use crate::drive::description::DriveDescription;
use crate::drive::usage::{UsagePart, UsageParts, UsageView};
use crate::drive::view::{TripEvent, TripEventKind};
use crate::profile::scale::Decimal;
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Maximum number of trip events waiting to be written.
pub const EVENTS_MAX: usize = 1024;
/// Maximum number of availability rows waiting to be written.
pub const AVAILABILITY_MAX: usize = 1024;

/// A trip event before it has a number.
#[derive(Clone, Debug, PartialEq)]
pub struct NewEvent {
    /// The drive.
    pub drive: Name,
    /// When it happened.
    pub at: WallTime,
    /// What happened.
    pub kind: &'static str,
    /// The published body, without its number.
    pub body: Map<String, Value>,
}

/// What is waiting to be written.
#[derive(Debug, Default)]
pub struct JournalBook {
    /// Attempts.
    pub audit: AuditRows,
    events: VecDeque<NewEvent>,
    availability: VecDeque<JournalRow>,
    memory: BTreeMap<Name, RememberedDrive>,
    /// The drives whose memory is to be written.
    touched: BTreeSet<Name>,
    /// The drives whose memory is to be written for what they have used alone, since then: that may wait.
    used: BTreeSet<Name>,
    used_since: Option<MonoTime>,
    /// What was used on each day.
    pub days: DaySums,
    /// The drives whose memory is to be removed.
    forgotten: BTreeSet<Name>,
    lost: u64,
}

/// How moments are labelled.
type Label<'l> = dyn Fn(MonoTime) -> WallTime + 'l;

impl JournalBook {
    /// An empty book, with the remembered state of the drives.
    #[must_use]
    pub fn new(memory: BTreeMap<Name, RememberedDrive>) -> Self {
        Self {
            memory,
            ..Self::default()
        }
    }

    /// Takes an entry of the line `source` about `drive`.
    pub fn take(
        &mut self,
        source: u64,
        drive: &DriveDescription,
        at: MonoTime,
        entry: JournalEntry,
        label: &Label<'_>,
    ) {
        let moment = label(at);
        let entry = entry.dated(label);
        let lease_before = self.remember(&drive.name, at, moment, &entry);
        let name = &drive.name;
        let record = match entry {
            JournalEntry::Attempt(attempt) => {
                self.attempt(source, Some(name), at, &attempt, label);
                None
            }
            JournalEntry::Ended { attempt, report } => {
                self.audit.end(at, (source, attempt), report);
                None
            }
            JournalEntry::Trip(event, _) => {
                self.trip(drive, &event, label);
                None
            }
            JournalEntry::Presence(presence) => {
                if let Some(row) = row::presence(moment, name.as_str(), presence) {
                    self.note(row);
                }
                None
            }
            JournalEntry::FailSafe {
                owner,
                action,
                cause,
            } => {
                let due = FailSafeRun::due(action, cause, at);
                Some(AuditRecord::of_failsafe(moment, name, owner, due))
            }
            JournalEntry::FailSafeCame(run) => {
                Some(AuditRecord::of_failsafe(moment, name, None, run))
            }
            JournalEntry::StopOver {
                is_effective: false,
            } => Some(AuditRecord::of_stop_given_up(moment, name)),
            JournalEntry::Lease(owner) => LeaseChange::of(lease_before, owner)
                .map(|(owner, change)| AuditRecord::of_lease(moment, name, owner, change)),
            JournalEntry::OutOfSight { last_seen } => {
                Some(AuditRecord::of_out_of_sight(moment, name, last_seen))
            }
            JournalEntry::InSight {
                confirmed_by: Some(owner),
            } => Some(AuditRecord::of_standstill(moment, name, owner)),
            JournalEntry::UsageReset { owner } => {
                Some(AuditRecord::of_usage_reset(moment, name, owner))
            }
            JournalEntry::InSight { confirmed_by: None }
            | JournalEntry::Baseline(_)
            | JournalEntry::ResetWord { .. }
            | JournalEntry::StopPending { .. }
            | JournalEntry::StopOver { .. }
            | JournalEntry::Usage(_) => None,
        };
        if let Some(record) = record {
            self.audit.add(at, record, None);
        }
    }

    /// Takes an attempt of `source`: a line, or a north interface that refused it.
    pub fn attempt(
        &mut self,
        source: u64,
        name: Option<&Name>,
        at: MonoTime,
        attempt: &WriteAttempt,
        label: &Label<'_>,
    ) {
        let place = attempt.report.is_none().then_some((source, attempt.id));
        self.audit
            .add(at, AuditRecord::of_attempt(label(at), name, attempt), place);
    }

    fn trip(&mut self, drive: &DriveDescription, event: &TripEvent, label: &Label<'_>) {
        let mut body = trip::event(drive, &|at| rfc3339(label(at)), event);
        if matches!(event.kind, TripEventKind::Tripped { .. }) {
            body.insert("running_hours".to_owned(), self.running_hours(drive).into());
        }
        let kind = trip::kind(&event.kind);
        self.events.push_back(NewEvent {
            drive: drive.name.clone(),
            at: label(event.at),
            kind,
            body,
        });
        if self.events.len() > EVENTS_MAX {
            self.events.pop_front();
            self.lost += 1;
        }
    }

    /// How long the motor of `drive` has run; `None` if that is not known.
    fn running_hours(&self, drive: &DriveDescription) -> Option<f64> {
        let totals = self.memory.get(&drive.name)?.usage.totals;
        let usage = UsageView {
            parts: UsageParts::of(&drive.model),
            totals,
        };
        usage.value(UsagePart::RunningHours).map(Decimal::value)
    }

    /// Takes an availability row.
    pub fn note(&mut self, row: JournalRow) {
        self.availability.push_back(row);
        if self.availability.len() > AVAILABILITY_MAX {
            self.availability.pop_front();
            self.lost += 1;
        }
    }

    /// Updates the remembered state; returns the lease remembered before.
    fn remember(
        &mut self,
        name: &Name,
        at: MonoTime,
        moment: WallTime,
        entry: &JournalEntry,
    ) -> Option<RememberedLease> {
        self.forgotten.remove(name);
        let memory = self.memory.entry(name.clone()).or_default();
        let before = *memory;
        memory.take(entry);
        if let JournalEntry::Usage(usage) = entry {
            let totals = usage.totals.since(&before.usage.totals);
            self.days.add(
                name,
                DayNumber::of(moment),
                DayUsage {
                    totals,
                    energy_from: usage.energy_from,
                },
            );
            self.used.insert(name.clone());
            self.used_since.get_or_insert(at);
        } else if *memory != before {
            self.touched.insert(name.clone());
        }
        before.lease
    }

    /// Since when what drives have used is waiting, if it is.
    #[must_use]
    pub const fn used_since(&self) -> Option<MonoTime> {
        self.used_since
    }

    /// Marks the leases left by an earlier run as orphaned, so that they get their time only once.
    pub fn orphan_leases(&mut self, now: MonoTime, at: WallTime) {
        for (name, memory) in &mut self.memory {
            if let Some(lease) = memory.lease.as_mut().filter(|lease| !lease.was_orphaned) {
                lease.was_orphaned = true;
                self.touched.insert(name.clone());
                let record = AuditRecord::of_lease(at, name, lease.owner, LeaseChange::Orphaned);
                self.audit.add(now, record, None);
            }
        }
    }

    /// Removes the remembered state of the drive called `name`.
    pub fn forget(&mut self, name: &Name) {
        if self.memory.remove(name).is_some() {
            self.touched.remove(name);
            self.used.remove(name);
            self.forgotten.insert(name.clone());
        }
    }

    /// The drives whose memory is to be removed.
    pub fn forgotten(&self) -> impl Iterator<Item = &Name> {
        self.forgotten.iter()
    }

    /// Marks all memory as to be written, because the stored one is gone.
    pub fn touch_all(&mut self) {
        self.touched = self.memory.keys().cloned().collect();
        self.days.touch_all();
    }

    /// All remembered state, by drive name.
    #[must_use]
    pub const fn all_memory(&self) -> &BTreeMap<Name, RememberedDrive> {
        &self.memory
    }

    /// The memory to be written, by drive name.
    pub fn memory(&self) -> impl Iterator<Item = (&Name, &RememberedDrive)> {
        self.touched
            .union(&self.used)
            .filter_map(|name| self.memory.get_key_value(name))
    }

    /// Waiting trip events, oldest first.
    pub fn events(&self) -> impl Iterator<Item = &NewEvent> {
        self.events.iter()
    }

    /// Waiting availability rows, oldest first.
    pub fn availability(&self) -> impl Iterator<Item = &JournalRow> {
        self.availability.iter()
    }

    /// Whether a trip event is waiting: then the write must be synced to disk.
    #[must_use]
    pub fn has_trip(&self) -> bool {
        !self.events.is_empty()
    }

    /// The number of waiting rows.
    #[must_use]
    pub fn len(&self) -> usize {
        let memory = self.touched.len() + self.used.len() + self.forgotten.len();
        self.audit.len() + self.events.len() + self.availability.len() + memory + self.days.count()
    }

    /// Whether no row is waiting.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Takes the counts of what could not be stored since the last call.
    pub fn take_lost(&mut self) -> LostCounts {
        let mut lost = LostCounts {
            others: std::mem::take(&mut self.lost),
            ..LostCounts::default()
        };
        lost += self.audit.take_lost();
        lost
    }

    /// Everything has been written. Returns the number of rows.
    pub fn written(&mut self) -> usize {
        let rows = self.len();
        self.audit.written();
        self.events.clear();
        self.availability.clear();
        self.touched.clear();
        self.used.clear();
        self.used_since = None;
        self.days.written();
        self.forgotten.clear();
        rows
    }
}
