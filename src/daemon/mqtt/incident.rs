//! What happens on a connection to a broker, in words that both protocol versions have, and the limits of both.

use super::settings::ConnectionSettings;
use crate::north::broker::{Broker, Filter, Message, Refusal};
use bytes::Bytes;
use std::time::Duration;

/// Longest packet that is taken, and sent where the broker names no smaller limit. Nothing of ours comes near it.
pub const PACKET_MAX: usize = 256 * 1024;
/// Publications that wait for their acknowledgement at once.
pub const INFLIGHT_MAX: u16 = 64;
/// Time for name, TCP, TLS and CONNACK together.
pub const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);

/// Something that happened on the connection.
#[derive(Debug)]
pub enum Incident {
    /// The broker accepted it.
    Connected(Terms),
    /// The broker answered the subscription.
    Subscribed(Vec<bool>),
    /// A message came.
    Message(Received),
    /// The broker took the publication with this identifier.
    Acknowledged(u16),
    /// The broker answered that it does not take the publication with this identifier, what that means, and why.
    Refused(u16, Refusal, String),
    /// A publication was written to the socket with this identifier; 0: it is not acknowledged.
    PublicationLeft(u16),
    /// A subscription or DISCONNECT was written to the socket.
    OtherLeft,
    /// The broker sent what the protocol forbids: the connection ends, and what came with it is not believed.
    Offence(&'static str),
    /// The broker said something else.
    Heard,
    /// Nothing that matters.
    Nothing,
}

impl Incident {
    /// Whether it proves that the broker is alive.
    pub const fn is_heard(&self) -> bool {
        !matches!(self, Self::PublicationLeft(_) | Self::OtherLeft | Self::Nothing)
    }
}

/// What the broker allows.
#[derive(Clone, Copy, Debug)]
pub struct Terms {
    /// What the session is told.
    pub broker: Broker,
    /// Longest packet that may be sent, in bytes.
    pub packet_max: usize,
    /// The keep-alive that it prescribes; nothing: ours.
    pub keep_alive: Option<Duration>,
}

impl Default for Terms {
    fn default() -> Self {
        let broker = Broker { maximum_packet_bytes: None, retains: true };
        Self { broker, packet_max: PACKET_MAX, keep_alive: None }
    }
}

/// A message, owned.
#[derive(Debug)]
pub struct Received {
    pub topic: String,
    pub payload: Bytes,
    pub retain: bool,
    pub duplicate: bool,
    pub expiry: Option<Duration>,
    pub response_topic: Option<String>,
    pub correlation: Option<Bytes>,
}

impl Received {
    pub fn as_message(&self) -> Message<'_> {
        Message {
            topic: &self.topic,
            payload: &self.payload,
            retain: self.retain,
            duplicate: self.duplicate,
            expiry: self.expiry,
            response_topic: self.response_topic.as_deref(),
            correlation: self.correlation.as_deref(),
        }
    }
}

/// Why a connection is over.
#[derive(Debug)]
pub struct Broken {
    /// For people.
    pub reason: String,
    /// Whether what was read just before is as young as that. It is not if writing had stalled for an unknown time.
    pub is_fresh: bool,
    /// What it tells of the broker.
    pub cause: Cause,
    /// Whether it is certain that the broker has seen no CONNECT of ours.
    pub is_unsent: bool,
}

/// What the end of a connection tells of the broker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// It is not there, or has closed the connection without a word.
    Gone,
    /// It says that another client has our identifier.
    TakenOver,
    /// Nothing.
    Other,
}

impl Broken {
    /// Given up by this side.
    pub fn because(reason: impl Into<String>) -> Self {
        Self { reason: reason.into(), is_fresh: false, cause: Cause::Other, is_unsent: false }
    }

    /// The same before anything was sent.
    pub fn unsent(reason: impl Into<String>) -> Self {
        Self { is_unsent: true, ..Self::because(reason) }
    }
}

/// Why a publication is not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unfit {
    /// It is too large for the broker, or for the protocol.
    TooLarge,
    /// Its topic has wildcards or is empty.
    Topic,
}

/// The queue was full although it was counted, or the topic is impossible although it was checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotQueued;

/// The keep-alive as CONNECT has it.
pub fn keep_alive_seconds(settings: &ConnectionSettings) -> u16 {
    u16::try_from(settings.keep_alive().as_secs()).unwrap_or(u16::MAX)
}

/// Whether a broker would take these filters.
pub fn check_filters(filters: &[Filter]) -> Result<(), NotQueued> {
    let are_valid = !filters.is_empty() && filters.iter().all(|filter| rumqttc::valid_filter(&filter.path));
    if are_valid { Ok(()) } else { Err(NotQueued) }
}

/// Bytes of a packet whose part behind the fixed header has `rest` bytes.
pub const fn with_header(rest: usize) -> usize {
    1 + length_bytes(rest) + rest
}

/// Bytes that the protocol's variable-length number takes.
pub const fn length_bytes(length: usize) -> usize {
    match length {
        0..128 => 1,
        128..16_384 => 2,
        16_384..2_097_152 => 3,
        _ => 4,
    }
}
