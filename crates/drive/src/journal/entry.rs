//! Journal entries: attempts to write and their outcomes, trips, leases, stops, availability.

use super::remembered::TripBaseline;
use crate::domain::address::Address;
use crate::domain::command::{Order, Owner, Report};
use crate::domain::control::FailSafe;
pub use crate::domain::fail_safe::FailSafeCause;
use crate::domain::fail_safe::FailSafeRun;
use crate::domain::ids::DriveIndex;
use crate::domain::time::{MonoTime, WallTime};
use crate::drive::sight::{LastSeen, SeenAt};
use crate::drive::snapshot::DrivePresence;
use crate::drive::usage::KeptUsage;
use crate::drive::view::TripEvent;

/// The number of a row among those of one line in one run of the gateway, from 1. Rows are stored in the order of their
/// numbers, so that one number covers all before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RowNumber(pub u64);

/// An attempt to write, among those of one line or one north interface in one run of the gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AttemptId(pub u64);

/// An entry to be stored, from a line.
#[derive(Clone, Debug, PartialEq)]
pub struct EntryToKeep {
    /// Its number.
    pub row: RowNumber,
    /// The drive that it is about.
    pub drive: DriveIndex,
    /// When it happened.
    pub at: MonoTime,
    /// What happened.
    pub entry: JournalEntry,
}

/// What happened.
#[derive(Clone, Debug, PartialEq)]
pub enum JournalEntry {
    /// A client tried to write.
    Attempt(WriteAttempt),
    /// The final outcome of an accepted attempt.
    Ended {
        /// The attempt.
        attempt: AttemptId,
        /// The outcome.
        report: Report,
    },
    /// The drive tripped, or its trip is over; with the count and state up to which trips are now reported.
    Trip(TripEvent, TripBaseline),
    /// The count or the state of the drive's trips changed without an event: it was read for the first time, or the
    /// count fell.
    Baseline(TripBaseline),
    /// Control is leased to this owner; `None` if the lease has ended.
    Lease(Option<Owner>),
    /// A stop was accepted: it is pending until it is effective or given up.
    StopPending {
        /// The output is cut off instead of ramped down.
        coast: bool,
    },
    /// No stop is pending any more.
    StopOver {
        /// The stop took effect. If not, it was given up because the drive stayed offline.
        is_effective: bool,
    },
    /// Whether the drive's run command may hold the reset word has changed.
    ResetWord {
        /// The drive's run command may hold the reset word.
        may_stand: bool,
    },
    /// A declared action has come further.
    FailSafeCame(FailSafeRun),
    /// A declared action falls due, without a command.
    FailSafe {
        /// Whose control it ends.
        owner: Option<Owner>,
        /// What is done.
        action: FailSafe,
        /// Why.
        cause: FailSafeCause,
    },
    /// The drive is out of sight and was not seen at standstill: it may still run.
    OutOfSight {
        /// What was last seen of it.
        last_seen: Option<LastSeen>,
    },
    /// The drive is no longer out of sight, or its motor was confirmed to stand.
    InSight {
        /// The person who confirmed that the motor stands; `None` if the drive was seen again.
        confirmed_by: Option<Owner>,
    },
    /// The drive went online or offline.
    Presence(DrivePresence),
    /// What the drive has used so far.
    Usage(KeptUsage),
    /// The sums of what the drive has used are set back to 0.
    UsageReset {
        /// Who has requested it.
        owner: Owner,
    },
}

impl JournalEntry {
    /// The entry with wall clock times, which outlive the process, in what is remembered.
    #[must_use]
    pub fn dated(self, label: impl Fn(MonoTime) -> WallTime) -> Self {
        let date = |seen: LastSeen| match seen.at {
            SeenAt::Here(at) => LastSeen {
                at: SeenAt::Before(label(at)),
                ..seen
            },
            SeenAt::Before(_) => seen,
        };
        match self {
            Self::OutOfSight { last_seen } => Self::OutOfSight {
                last_seen: last_seen.map(date),
            },
            other => other,
        }
    }
}

/// Who tried to write what.
#[derive(Clone, Debug, PartialEq)]
pub struct WriteAttempt {
    /// Its number, which the outcome refers to.
    pub id: AttemptId,
    /// Who.
    pub owner: Owner,
    /// What.
    pub tried: TriedWrite,
    /// The outcome, if already known: it was refused, or there was nothing to do. Then no [`JournalEntry::Ended`] follows.
    pub report: Option<Report>,
}

/// What a client tried to write.
#[derive(Clone, Debug, PartialEq)]
pub enum TriedWrite {
    /// An order.
    Order(Order),
    /// Registers of the drive that are no order, from this address on.
    Registers {
        /// Address of the first on the wire.
        address: Address,
        /// The words of the registers.
        values: Vec<u16>,
    },
    /// Unparsable input as received, shortened.
    Text(String),
}
