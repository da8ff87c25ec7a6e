//! What has been reported of a drive's trips, as it outlives the process.

/// Up to where the trips of a drive have been reported.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TripBaseline {
    /// The drive's own count; `None` if it does not count or has not been read yet.
    pub count: Option<u16>,
    /// Whether a reported trip was active, if known.
    pub held: Option<bool>,
    /// The vendor's number of the last active trip, or the bits of those active; `None` if it was not read.
    pub code: Option<u32>,
}
