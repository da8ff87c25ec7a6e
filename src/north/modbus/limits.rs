//! What one client of Modbus TCP may use, and why its connection is closed.

use crate::wire::mbap::Malformed;
use std::time::Duration;

/// What one client may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Most requests in flight. One more is answered with exception 06, unless it is a stop: that finds one more
    /// place for each unit, because a stop never waits for anything else. Default 16: the most that the Modbus
    /// messaging on TCP/IP implementation guide V1.0b expects a server to take from one client.
    pub pending_max: usize,
    /// Within this time of its first byte a message must be whole. Default 5 s: more than the repeats of a
    /// bad network need, little enough that half a message does not hold a connection.
    pub body_timeout: Duration,
    /// A connection without a request and with nothing pending is closed after this time; nothing: never. Default
    /// 10 min: longer than the slowest usual poll, short enough that the sockets of vanished clients come back.
    pub idle_timeout: Option<Duration>,
    /// The deadline of each call, from the moment its last byte arrived. Default 5 s: clients usually give
    /// up after 1 to 5 s, and an answer that nobody awaits should not occupy a line.
    pub answer_within: Duration,
}

impl Limits {
    /// The idle time-out unless another is wanted.
    pub const IDLE_TIMEOUT: Duration = Duration::from_secs(600);
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            pending_max: 16,
            body_timeout: Duration::from_secs(5),
            idle_timeout: Some(Self::IDLE_TIMEOUT),
            answer_within: Duration::from_secs(5),
        }
    }
}

/// Why the gateway closes a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CloseReason {
    /// The stream holds something that is no Modbus TCP.
    #[error("not Modbus TCP: {0}")]
    Malformed(Malformed),
    /// A message was begun and not finished in time.
    #[error("a message was begun and not finished in time")]
    BodyTimeout,
    /// No request for too long.
    #[error("no request for too long")]
    Idle,
    /// The client goes on asking and does not read the answers.
    #[error("the client does not read its answers")]
    NotReading,
}
