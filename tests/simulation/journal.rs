//! A journal as a line sees it: rows are kept in their order, after a while, and some never before a kill.

use super::checker::kept::Kept;
use fastrand::Rng;
use std::collections::VecDeque;
use std::time::Duration;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::drive::view::TripEventKind;
use vfd_gateway::journal::{
    EntryToKeep, JournalEntry, RememberedDrive, RememberedLease, RememberedStop, RowNumber,
};

/// The journal of one line across restarts of the gateway.
pub struct Journal {
    rng: Rng,
    /// Rows under way to the disk, and when they are stored.
    on_the_way: VecDeque<(MonoTime, EntryToKeep)>,
    /// From then on nothing is stored any more.
    stuck_from: MonoTime,
    memory: Vec<RememberedDrive>,
    last_row: u64,
}

impl Journal {
    pub fn new(drives: usize, seed: u64) -> Self {
        Self {
            rng: Rng::with_seed(seed),
            on_the_way: VecDeque::new(),
            stuck_from: MonoTime::NEVER,
            memory: vec![RememberedDrive::default(); drives],
            last_row: 0,
        }
    }

    /// From `at` on nothing is kept before the next kill.
    pub fn gets_stuck(&mut self, at: MonoTime) {
        self.stuck_from = at;
    }

    /// Takes a row of the line. Rows are numbered without gaps.
    pub fn say(&mut self, now: MonoTime, keep: EntryToKeep) -> Result<(), String> {
        self.last_row += 1;
        let is_next = keep.row.0 == self.last_row;
        let number = (keep.row.0, self.last_row);
        let newest = self.on_the_way.back().map_or(MonoTime::ZERO, |(at, _)| *at);
        let at = newest.max(now + Duration::from_micros(self.rng.u64(0..50_000)));
        let at = if at >= self.stuck_from {
            MonoTime::NEVER
        } else {
            at
        };
        self.on_the_way.push_back((at, keep));
        if is_next {
            Ok(())
        } else {
            Err(format!("row {} instead of {}", number.0, number.1))
        }
    }

    /// When the next row is kept.
    pub fn due(&self) -> MonoTime {
        self.on_the_way
            .front()
            .map_or(MonoTime::NEVER, |(at, _)| *at)
    }

    /// The newest row that is kept by `now`, if there is a new one; `tell` is called with each of them.
    pub fn take(&mut self, now: MonoTime, mut tell: impl FnMut(usize, Kept)) -> Option<RowNumber> {
        let mut newest = None;
        while let Some((_, keep)) = self.on_the_way.pop_front_if(|(at, _)| *at <= now) {
            newest = Some(keep.row);
            let drive = keep.drive.get();
            self.remember(drive, &keep.entry);
            if let JournalEntry::Trip(event, _) = &keep.entry
                && let TripEventKind::Tripped { trips, .. } = event.kind
            {
                tell(
                    drive,
                    Kept::Trips {
                        trips,
                        count: event.count,
                    },
                );
            }
        }
        newest
    }

    fn remember(&mut self, drive: usize, entry: &JournalEntry) {
        let memory = &mut self.memory[drive];
        match entry {
            JournalEntry::Trip(event, baseline) => {
                memory.trips = Some(*baseline);
                if let TripEventKind::Tripped { trips, record } = &event.kind {
                    memory.trips_total += u32::from(*trips);
                    memory.last_code = record.code;
                }
            }
            JournalEntry::Baseline(baseline) => memory.trips = Some(*baseline),
            JournalEntry::Lease(owner) => {
                memory.lease = owner.map(|owner| RememberedLease {
                    owner,
                    was_orphaned: false,
                });
            }
            JournalEntry::StopPending { coast } => {
                memory.stop = Some(RememberedStop { coast: *coast })
            }
            JournalEntry::StopOver { .. } => memory.stop = None,
            JournalEntry::ResetWord { may_stand } => memory.reset = *may_stand,
            JournalEntry::Usage(usage) => {
                let before = std::mem::replace(&mut memory.usage, *usage).totals;
                let now = usage.totals;
                // They are never reset here.
                let is_less = now.energy_mj < before.energy_mj || now.running < before.running;
                assert!(
                    !is_less && now.starts >= before.starts && now.trips >= before.trips,
                    "{before:?}, then {now:?}"
                );
            }
            JournalEntry::OutOfSight { last_seen } => {
                (memory.may_still_run, memory.last_seen) = (true, *last_seen)
            }
            JournalEntry::InSight { .. } => {
                (memory.may_still_run, memory.last_seen) = (false, None)
            }
            JournalEntry::Attempt(_)
            | JournalEntry::Ended { .. }
            | JournalEntry::FailSafe { .. }
            | JournalEntry::FailSafeCame(_)
            | JournalEntry::Presence(_)
            | JournalEntry::UsageReset { .. } => {}
        }
    }

    /// The gateway is killed: rows under way are lost. Returns what the next one knows; the leases among it have
    /// expired after that.
    pub fn kill(&mut self) -> Vec<RememberedDrive> {
        self.on_the_way.clear();
        self.stuck_from = MonoTime::NEVER;
        self.last_row = 0;
        let told = self.memory.clone();
        for memory in &mut self.memory {
            memory.lease = memory.lease.map(|lease| RememberedLease {
                was_orphaned: true,
                ..lease
            });
        }
        told
    }
}
