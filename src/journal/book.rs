//! Everything that waits to be written into the journal, and what is remembered of each drive. It is told what happened
//! and says what is to be written; while nothing can be written, it keeps the newest of it.

use super::audit::{Audit, Lost};
use super::entry::{Attempt, Entry};
use super::record::{LeaseChange, Record};
use super::remembered::{Remembered, RememberedLease};
use super::row::{self, Row};
use super::trip;
use crate::domain::calendar::rfc3339;
use crate::domain::ids::Name;
use crate::domain::time::{MonoTime, WallTime};
use crate::drive::description::DriveDescription;
use crate::drive::view::TripEvent;
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Most trip events that wait to be written.
pub const EVENTS_MAX: usize = 1024;
/// Most rows about comings and goings that wait to be written.
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
    /// What is published of it, without its number.
    pub body: Map<String, Value>,
}

/// What waits to be written.
#[derive(Debug, Default)]
pub struct Book {
    /// Attempts.
    pub audit: Audit,
    events: VecDeque<NewEvent>,
    availability: VecDeque<Row>,
    memory: BTreeMap<Name, Remembered>,
    /// The drives whose memory is to be written.
    touched: BTreeSet<Name>,
    /// The drives whose memory is to be removed.
    forgotten: BTreeSet<Name>,
    lost: u64,
}

/// How moments are labelled.
type Label<'l> = dyn Fn(MonoTime) -> WallTime + 'l;

impl Book {
    /// A book in which nothing waits, with what is remembered of the drives.
    #[must_use]
    pub fn new(memory: BTreeMap<Name, Remembered>) -> Self {
        Self { memory, ..Self::default() }
    }

    /// Takes what the line `source` says of `drive`.
    pub fn take(&mut self, source: u64, drive: &DriveDescription, at: MonoTime, entry: Entry, label: &Label<'_>) {
        let lease_before = self.remember(&drive.name, &entry);
        let moment = label(at);
        match entry {
            Entry::Attempt(attempt) => self.attempt(source, Some(&drive.name), at, &attempt, label),
            Entry::Ended { attempt, report } => self.audit.end(at, (source, attempt), report),
            Entry::Trip(event, _) => self.trip(drive, &event, label),
            Entry::FailSafe { owner, action, cause } => {
                self.audit.add(at, Record::of_failsafe(moment, &drive.name, owner, action, cause), None);
            }
            Entry::StopOver { is_effective: false } => {
                self.audit.add(at, Record::of_stop_given_up(moment, &drive.name), None);
            }
            Entry::Presence(presence) => {
                row::presence(moment, drive.name.as_str(), presence).into_iter().for_each(|row| self.note(row));
            }
            Entry::Lease(owner) => {
                if let Some((owner, change)) = LeaseChange::of(lease_before, owner) {
                    self.audit.add(at, Record::of_lease(moment, &drive.name, owner, change), None);
                }
            }
            Entry::Baseline(_) | Entry::ResetWord { .. } | Entry::StopPending { .. } | Entry::StopOver { .. } => {}
        }
    }

    /// Takes an attempt of `source`: a line, or a north side where it was refused.
    pub fn attempt(&mut self, source: u64, name: Option<&Name>, at: MonoTime, attempt: &Attempt, label: &Label<'_>) {
        let place = attempt.report.is_none().then_some((source, attempt.id));
        self.audit.add(at, Record::of_attempt(label(at), name, attempt), place);
    }

    fn trip(&mut self, drive: &DriveDescription, event: &TripEvent, label: &Label<'_>) {
        let body = trip::event(drive, &|at| rfc3339(label(at)), event);
        let (drive, at, kind) = (drive.name.clone(), label(event.at), trip::kind(&event.kind));
        self.events.push_back(NewEvent { drive, at, kind, body });
        if self.events.len() > EVENTS_MAX {
            self.events.pop_front();
            self.lost += 1;
        }
    }

    /// Takes a row about a coming or going.
    pub fn note(&mut self, row: Row) {
        self.availability.push_back(row);
        if self.availability.len() > AVAILABILITY_MAX {
            self.availability.pop_front();
            self.lost += 1;
        }
    }

    /// Returns the lease that was remembered before.
    fn remember(&mut self, name: &Name, entry: &Entry) -> Option<RememberedLease> {
        self.forgotten.remove(name);
        let memory = self.memory.entry(name.clone()).or_default();
        let before = *memory;
        memory.take(entry);
        if *memory != before {
            self.touched.insert(name.clone());
        }
        before.lease
    }

    /// The leases that an earlier life has left are given their time once: whoever finds them after this knows.
    pub fn orphan_leases(&mut self, now: MonoTime, at: WallTime) {
        for (name, memory) in &mut self.memory {
            if let Some(lease) = memory.lease.as_mut().filter(|lease| !lease.was_orphaned) {
                lease.was_orphaned = true;
                self.touched.insert(name.clone());
                let record = Record::of_lease(at, name, lease.owner, LeaseChange::Orphaned);
                self.audit.add(now, record, None);
            }
        }
    }

    /// What is remembered of the drive called `name` is not needed any more.
    pub fn forget(&mut self, name: &Name) {
        if self.memory.remove(name).is_some() {
            self.touched.remove(name);
            self.forgotten.insert(name.clone());
        }
    }

    /// The drives whose memory is to be removed.
    pub fn forgotten(&self) -> impl Iterator<Item = &Name> {
        self.forgotten.iter()
    }

    /// All memory is to be written, because what was written is not there any more.
    pub fn touch_all(&mut self) {
        self.touched = self.memory.keys().cloned().collect();
    }

    /// All that is remembered, by the names of the drives.
    #[must_use]
    pub const fn all_memory(&self) -> &BTreeMap<Name, Remembered> {
        &self.memory
    }

    /// The memory that is to be written, by the names of the drives.
    pub fn memory(&self) -> impl Iterator<Item = (&Name, &Remembered)> {
        self.touched.iter().filter_map(|name| self.memory.get_key_value(name))
    }

    /// Trip events that wait, oldest first.
    pub fn events(&self) -> impl Iterator<Item = &NewEvent> {
        self.events.iter()
    }

    /// Rows about comings and goings that wait, oldest first.
    pub fn availability(&self) -> impl Iterator<Item = &Row> {
        self.availability.iter()
    }

    /// Whether a trip waits: then what is written must reach the disk.
    #[must_use]
    pub fn has_trip(&self) -> bool {
        !self.events.is_empty()
    }

    /// How many rows wait.
    #[must_use]
    pub fn len(&self) -> usize {
        self.audit.len() + self.events.len() + self.availability.len() + self.touched.len() + self.forgotten.len()
    }

    /// Whether nothing waits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What could not be kept, since this was asked last.
    pub fn take_lost(&mut self) -> Lost {
        let mut lost = Lost { others: std::mem::take(&mut self.lost), ..Lost::default() };
        lost += self.audit.take_lost();
        lost
    }

    /// All that waited is written. Returns how many rows that were.
    pub fn written(&mut self) -> usize {
        let rows = self.len();
        self.audit.written();
        self.events.clear();
        self.availability.clear();
        self.touched.clear();
        self.forgotten.clear();
        rows
    }
}
