//! What a line gets at start about its drives from an earlier run of the gateway.

use crate::domain::command::Owner;
use crate::drive::sight::LastSeen;
pub use crate::drive::trips::TripBaseline;
use crate::drive::usage::KeptUsage;

/// The remembered state of one drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RememberedDrive {
    /// Up to where its trips have been reported; `None` if it was never read.
    pub trips: Option<TripBaseline>,
    /// Number of its stored trips.
    pub trips_total: u32,
    /// The vendor's number of the newest of them, if it was read.
    pub last_code: Option<u16>,
    /// The lease of control when the gateway exited.
    pub lease: Option<RememberedLease>,
    /// The stop that was not effective yet when the gateway exited.
    pub stop: Option<RememberedStop>,
    /// The drive is out of sight and was not seen at standstill.
    pub may_still_run: bool,
    /// What was then last seen of it.
    pub last_seen: Option<LastSeen>,
    /// Whether its run command may hold the reset word.
    pub reset: bool,
    /// What it has used.
    pub usage: KeptUsage,
}

/// A lease that was not ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RememberedLease {
    /// Who held control.
    pub owner: Owner,
    /// Whether an earlier run already found it and gave it its time, but exited before that was over: it gets no more.
    pub was_orphaned: bool,
}

/// A stop that was accepted but not confirmed as effective.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RememberedStop {
    /// The output is cut off instead of ramped down.
    pub coast: bool,
}
