//! What happens on a connection to a broker, in one form for both protocol versions, and the limits of both.

use super::settings::ConnectionSettings;
use crate::north::broker::{BrokerLimits, BrokerMessage, PublicationRefusal, SubscriptionFilter};
use bytes::Bytes;
use std::time::Duration;

/// Longest packet that is accepted, and sent unless the broker sets a smaller limit. Our packets are far smaller.
pub const PACKET_MAX: usize = 256 * 1024;
/// Most unacknowledged publications at once.
pub const INFLIGHT_MAX: u16 = 64;
/// Time for name, TCP, TLS and CONNACK together.
pub const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);

/// Something that happened on the connection.
#[derive(Debug)]
pub enum ConnectionIncident {
    /// The broker accepted it.
    Connected(BrokerTerms),
    /// The broker answered the subscription.
    Subscribed(Vec<bool>),
    /// A message was received.
    Message(ReceivedMessage),
    /// The broker acknowledged the publication with this identifier.
    Acknowledged(u16),
    /// The broker refused the publication with this identifier: the kind of refusal, and why.
    Refused(u16, PublicationRefusal, String),
    /// A publication was written to the socket with this identifier; 0 if it will not be acknowledged.
    PublicationLeft(u16),
    /// A subscription or DISCONNECT was written to the socket.
    OtherLeft,
    /// The broker violated the protocol: the connection is closed, and what was received with it is discarded.
    Offence(&'static str),
    /// The broker sent another packet.
    Heard,
    /// Nothing relevant.
    Nothing,
}

impl ConnectionIncident {
    /// Whether it proves that the broker is alive.
    pub const fn is_heard(&self) -> bool {
        !matches!(
            self,
            Self::PublicationLeft(_) | Self::OtherLeft | Self::Nothing
        )
    }
}

/// What the broker allows.
#[derive(Clone, Copy, Debug)]
pub struct BrokerTerms {
    /// What the session needs to know.
    pub broker: BrokerLimits,
    /// Longest packet that may be sent, in bytes.
    pub packet_max: usize,
    /// The keep-alive that it prescribes; `None` for ours.
    pub keep_alive: Option<Duration>,
}

impl Default for BrokerTerms {
    fn default() -> Self {
        let broker = BrokerLimits {
            maximum_packet_bytes: None,
            retains: true,
        };
        Self {
            broker,
            packet_max: PACKET_MAX,
            keep_alive: None,
        }
    }
}

/// A message, owned.
#[derive(Debug)]
pub struct ReceivedMessage {
    pub topic: String,
    pub payload: Bytes,
    pub retain: bool,
    pub duplicate: bool,
    pub expiry: Option<Duration>,
    pub response_topic: Option<String>,
    pub correlation: Option<Bytes>,
}

impl ReceivedMessage {
    pub fn as_message(&self) -> BrokerMessage<'_> {
        BrokerMessage {
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
pub struct BrokenConnection {
    /// The reason as text.
    pub reason: String,
    /// Whether what was read just before is recent. It is not if writing had stalled for an unknown time.
    pub is_fresh: bool,
    /// What it says about the broker.
    pub cause: EndCause,
    /// Whether it is certain that the broker has seen no CONNECT of ours.
    pub is_unsent: bool,
}

/// What the end of a connection says about the broker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndCause {
    /// The broker cannot be reached, or has closed the connection without a reason.
    Gone,
    /// The broker reports that another client has our identifier.
    TakenOver,
    /// The broker reports that a packet was larger than it takes.
    TooLarge,
    /// No conclusion.
    Other,
}

impl BrokenConnection {
    /// Given up by this side.
    pub fn because(reason: impl Into<String>) -> Self {
        Self {
            reason: reason.into(),
            is_fresh: false,
            cause: EndCause::Other,
            is_unsent: false,
        }
    }

    /// Given up by this side before anything was sent.
    pub fn unsent(reason: impl Into<String>) -> Self {
        Self {
            is_unsent: true,
            ..Self::because(reason)
        }
    }
}

/// Why a publication is not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnfitPublication {
    /// The message is too large for the broker, or for the protocol.
    TooLarge,
    /// Its topic has wildcards or is empty.
    Topic,
}

/// The queue was full although its packets are counted, or the topic is invalid although it was checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotQueued;

/// The keep-alive as CONNECT has it.
pub fn keep_alive_seconds(settings: &ConnectionSettings) -> u16 {
    u16::try_from(settings.keep_alive().as_secs()).unwrap_or(u16::MAX)
}

/// Checks that a broker would accept these filters.
pub fn check_filters(filters: &[SubscriptionFilter]) -> Result<(), NotQueued> {
    let are_valid = !filters.is_empty()
        && filters
            .iter()
            .all(|filter| rumqttc::valid_filter(&filter.path));
    if are_valid { Ok(()) } else { Err(NotQueued) }
}

/// Bytes of a packet that has `rest` bytes after its fixed header.
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
