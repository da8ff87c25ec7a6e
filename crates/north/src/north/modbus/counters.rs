//! Counters of a connection.

/// What happened on a connection so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ConnectionCounters {
    /// Whole messages received.
    pub requests: u64,
    /// Answers that are not exceptions.
    pub replies: u64,
    /// Exceptions by code; those without a place of their own (0, above 0B) are counted at 0.
    pub exceptions: [u64; Self::EXCEPTION_CODES],
    /// Attempts to write that were lost because too many were waiting to be fetched.
    pub attempts_lost: u64,
}

impl ConnectionCounters {
    /// Places in [`ConnectionCounters::exceptions`]: codes 01 to 0B, and one for all others.
    pub const EXCEPTION_CODES: usize = 12;

    /// One exception with this code was answered.
    pub(super) fn count_exception(&mut self, code: u8) {
        let place = usize::from(code);
        self.exceptions[if place < Self::EXCEPTION_CODES {
            place
        } else {
            0
        }] += 1;
    }
}
