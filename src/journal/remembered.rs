//! What a line is told about its drives from an earlier life of the gateway.

use crate::domain::command::Owner;
pub use crate::drive::trips::TripBaseline;

/// What is remembered of one drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Remembered {
    /// Up to where its trips were told; nothing: it was never seen.
    pub trips: Option<TripBaseline>,
    /// How many of its trips are kept.
    pub trips_total: u32,
    /// The vendor's number of the newest of them, if it was read.
    pub last_code: Option<u16>,
    /// Control was leased when the gateway ended.
    pub lease: Option<RememberedLease>,
    /// A stop was not effective yet when the gateway ended.
    pub stop: Option<RememberedStop>,
    /// The word that resets may stand in its run command.
    pub reset: bool,
}

/// A lease that nobody ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RememberedLease {
    /// Who held control.
    pub owner: Owner,
    /// An earlier life had found it already and given it its time. It ended before that was over: it gets no more.
    pub was_orphaned: bool,
}

/// A stop that was accepted and not seen to take effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RememberedStop {
    /// The output is cut off instead of ramped down.
    pub coast: bool,
}
