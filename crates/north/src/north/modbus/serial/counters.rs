//! What a slave on a serial port counts.

/// What a slave has counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SlaveCounters {
    /// Requests for the gateway's units.
    pub requests: u64,
    /// Exceptions that the slave sent because there was no answer in time.
    pub not_in_time: u64,
    /// Answers that came too late and were thrown away.
    pub late: u64,
    /// Frames that were damaged, and noise.
    pub damaged: u64,
    /// Requests and replies of other slaves on the bus.
    pub foreign: u64,
    /// Broadcasts, which are ignored.
    pub broadcasts: u64,
    /// Bytes of others that arrived while a reply was being sent.
    pub collisions: u64,
}
