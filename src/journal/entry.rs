//! What should be kept: attempts to write and what became of them, trips, leases, stops, comings and goings.

use super::remembered::TripBaseline;
use crate::domain::command::{Order, Owner, Report};
use crate::domain::control::FailSafe;
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::drive::snapshot::Presence;
use crate::drive::view::TripEvent;

/// The number of a row among those of one line in one life of the gateway, from 1. Rows are kept in the order of their
/// numbers, so that one number tells of all before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RowNumber(pub u64);

/// An attempt to write, among those of one line or one north side in one life of the gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AttemptId(pub u64);

/// Something to be kept, by the line that says so.
#[derive(Clone, Debug, PartialEq)]
pub struct Keep {
    /// Its number.
    pub row: RowNumber,
    /// The drive that it is about.
    pub drive: DriveIndex,
    /// When it happened.
    pub at: MonoTime,
    /// What happened.
    pub entry: Entry,
}

/// What happened.
#[derive(Clone, Debug, PartialEq)]
pub enum Entry {
    /// Somebody tried to write.
    Attempt(Attempt),
    /// What became in the end of an attempt that was taken.
    Ended {
        /// The attempt.
        attempt: AttemptId,
        /// What became of it.
        report: Report,
    },
    /// The drive tripped, or its trip is over; and the count and state up to which trips are now told.
    Trip(TripEvent, TripBaseline),
    /// The count or the state of the drive's trips is another without an event: it was seen for the first time, or its
    /// count fell.
    Baseline(TripBaseline),
    /// Control is leased to this owner, or to nobody any more.
    Lease(Option<Owner>),
    /// A stop was accepted: it is pending until it is effective or given up.
    StopPending {
        /// The output is cut off instead of ramped down.
        coast: bool,
    },
    /// No stop is pending any more.
    StopOver {
        /// It took effect. If not, it was given up because the drive stayed away.
        is_effective: bool,
    },
    /// The word that resets may stand in the drive's run command from now on, or does not any more.
    ResetWord {
        /// It may.
        may_stand: bool,
    },
    /// A declared action runs although nobody commanded it.
    FailSafe {
        /// Whose control it ends.
        owner: Option<Owner>,
        /// What is done.
        action: FailSafe,
        /// Why.
        cause: Cause,
    },
    /// The drive has come or gone.
    Presence(Presence),
}

/// Why a declared action runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Cause {
    /// The commander fell silent.
    CommanderLost,
    /// The gateway is ended on purpose.
    Shutdown,
    /// The lease of an earlier life of the gateway was not taken up again.
    Orphaned,
    /// The gateway ended again before the lease of an earlier life could end.
    CrashLoop,
    /// The drive leaves the configuration.
    Removed,
}

impl Cause {
    /// The word as it stands in the journal.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::CommanderLost => "commander_lost",
            Self::Shutdown => "shutdown",
            Self::Orphaned => "orphaned",
            Self::CrashLoop => "crash_loop",
            Self::Removed => "removed",
        }
    }
}

/// Who tried to write what.
#[derive(Clone, Debug, PartialEq)]
pub struct Attempt {
    /// By which its end is told.
    pub id: AttemptId,
    /// Who.
    pub owner: Owner,
    /// What.
    pub tried: Tried,
    /// What became of it, if that is known already: it was refused, or there was nothing to do. Then no end follows.
    pub report: Option<Report>,
}

/// What somebody tried to write.
#[derive(Clone, Debug, PartialEq)]
pub enum Tried {
    /// An order.
    Order(Order),
    /// Registers of the drive that are no order, from this address on.
    Registers {
        /// Address of the first on the wire.
        address: u16,
        /// Their words.
        values: Vec<u16>,
    },
    /// Something that was not understood, as it came, shortened.
    Text(String),
}
