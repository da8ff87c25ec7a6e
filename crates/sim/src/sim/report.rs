//! Counters of an observer on a simulated bus, and of each drive.

use std::fmt;
use std::time::Duration;

/// Counters of one bus since its creation. Gaps and overlaps are counted on a paced bus only: without character
/// times there is no silence to measure.
#[derive(Clone, Debug, Default)]
pub struct BusReport {
    /// Requests with a valid check, for any station.
    pub requests_heard: u64,
    /// Normal and exception replies on the wire, in time or late, whole or damaged.
    pub replies_sent: u64,
    /// Transmissions of the master that form no valid frame.
    pub bad_crc: u64,
    /// Silences before a request that were shorter than required.
    pub gaps_too_short: u64,
    /// Times that the master began to transmit while a drive transmitted or before a reply that was on time
    /// was complete. A late reply counts only from its first bit on: it is unknown before.
    pub talked_over: u64,
    /// Replies that two drives transmitted at the same time, so that both were damaged.
    pub collisions: u64,
    /// Replies lost by a fault, or by too many waiting ones.
    pub replies_lost: u64,
    /// Replies that a fault made late.
    pub replies_late: u64,
    /// Requests that a drive ignored because it still had a late reply to send.
    pub requests_ignored: u64,
    /// Requests that a drive ignored because it needed a pause after a write.
    pub requests_too_soon: u64,
    /// Bursts that a fault put on the wire.
    pub bursts: u64,
    /// The shortest silence before a request.
    pub shortest_gap: Option<Duration>,
    gaps: SilenceGaps,
}

/// Counters of one drive since its creation: forbidden writes, and its own actions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DriveReport {
    /// Run commands that the model says must never be written. The drive did not do them.
    pub forbidden_words: u64,
    /// Run commands with the reset bit while it was still set from the one before.
    pub resets_held: u64,
    /// Times that the drive's own watchdog found the bus silent.
    pub watchdog_expiries: u64,
    /// Writes from the bus to registers that are stored in a memory of limited endurance, all registers together.
    pub stored_writes: u64,
}

/// Individual silences; too many to print.
#[derive(Clone, Default)]
struct SilenceGaps(Vec<Duration>);

impl fmt::Debug for SilenceGaps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} gaps", self.0.len())
    }
}

impl BusReport {
    /// Maximum number of gaps kept individually (16 MB); later ones are only counted.
    pub const MAX_GAPS: usize = 1_000_000;

    /// The silences before the first requests, in order, at most [`Self::MAX_GAPS`]. There is none before
    /// the very first transmission on the bus.
    #[must_use]
    pub fn gaps(&self) -> &[Duration] {
        &self.gaps.0
    }

    /// Counts a silence before a request against the one that is required.
    pub(super) fn count_gap(&mut self, gap: Duration, required: Duration) {
        self.gaps_too_short += u64::from(gap < required);
        self.shortest_gap = Some(self.shortest_gap.map_or(gap, |shortest| shortest.min(gap)));
        if self.gaps.0.len() < Self::MAX_GAPS {
            self.gaps.0.push(gap);
        }
    }
}
