//! What one client of Modbus TCP may use, and why its connection is closed.

use crate::wire::mbap::MalformedStream;
use std::time::Duration;

/// What one client may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// Most requests in flight. One more is answered with exception 06, unless it is a stop: for that there is one more
    /// place for each unit, because a stop never waits for anything else. Default 16: the most that the Modbus
    /// messaging on TCP/IP implementation guide V1.0b expects a server to accept from one client.
    pub pending_max: usize,
    /// A message must be complete within this time of its first byte. Default 5 s: longer than the retransmissions of a
    /// bad network need, short enough that half a message does not hold a connection.
    pub body_timeout: Duration,
    /// A connection without a request and with nothing pending is closed after this time; `None`: never. Default 10
    /// min: longer than the slowest usual poll, short enough that the sockets of vanished clients are freed.
    pub idle_timeout: Option<Duration>,
    /// The deadline of each call, from the arrival of its last byte. Default [`Self::ANSWER_WITHIN`].
    pub answer_within: Duration,
    /// The deadline of a read on its way to a drive, from the arrival of its last byte, if that is shorter than
    /// `answer_within`. Default 5 s. A serial master gives up sooner, and a read that no client awaits should not
    /// occupy a line.
    pub read_within: Duration,
}

impl ConnectionLimits {
    /// The default idle time-out.
    pub const IDLE_TIMEOUT: Duration = Duration::from_secs(600);
    /// The default deadline of a call: clients usually give up after 1 to 5 s, and an answer that no client awaits should not
    /// occupy a line.
    pub const ANSWER_WITHIN: Duration = Duration::from_secs(5);
}

impl Default for ConnectionLimits {
    fn default() -> Self {
        Self {
            pending_max: 16,
            body_timeout: Duration::from_secs(5),
            idle_timeout: Some(Self::IDLE_TIMEOUT),
            answer_within: Self::ANSWER_WITHIN,
            read_within: Self::ANSWER_WITHIN,
        }
    }
}

/// Why the gateway closes a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CloseReason {
    /// The stream contains something that is not Modbus TCP.
    #[error("not Modbus TCP: {0}")]
    Malformed(MalformedStream),
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
