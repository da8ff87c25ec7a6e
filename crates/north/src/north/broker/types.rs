//! Events and messages between a session and its broker, independent of the payload format.

use crate::domain::ids::Name;
use crate::domain::report::{LineReport, StationReport};
use std::sync::Arc;
use std::time::Duration;

/// Protocol version.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MqttVersion {
    /// MQTT 3.1.1.
    V4,
    /// MQTT 5.
    V5,
}

/// What a broker stated when it accepted the connection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BrokerLimits {
    /// Longest packet that it accepts, in bytes; `None` if it names no limit.
    pub maximum_packet_bytes: Option<usize>,
    /// Whether it keeps retained messages.
    pub retains: bool,
}

/// Something that happened on the connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BrokerEvent<'a> {
    /// The broker accepted the connection.
    Connected(BrokerLimits),
    /// The broker answered the subscription: whether it granted each filter, in order.
    Subscribed(Vec<bool>),
    /// A message arrived.
    Message(BrokerMessage<'a>),
    /// The broker acknowledged the publication with this token.
    Acknowledged(u64),
    /// The broker refused the publication with this token (MQTT 5).
    Refused(u64, PublicationRefusal),
    /// The process was suspended for this long, or for an unknown time: what arrives from now on may have been delayed
    /// by it, until something sent after this event has returned.
    Stalled(Duration),
    /// The connection is lost.
    Lost,
}

/// Why a broker refused a publication.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PublicationRefusal {
    /// The broker accepts no more for now, whatever it is.
    Full,
    /// The broker failed to take this one.
    Failed,
    /// The broker will not accept this one: it is not allowed, or its topic or payload is wrong for that broker.
    Never,
}

/// A message from the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BrokerMessage<'a> {
    /// Its topic.
    pub topic: &'a str,
    /// Its payload.
    pub payload: &'a [u8],
    /// The retain flag as received: set if the message was delivered at subscribe or, with MQTT 5, published with it.
    pub retain: bool,
    /// The duplicate flag of the sender or the broker.
    pub duplicate: bool,
    /// Remaining lifetime (MQTT 5).
    pub expiry: Option<Duration>,
    /// Response topic (MQTT 5).
    pub response_topic: Option<&'a str>,
    /// Correlation data for the response (MQTT 5).
    pub correlation: Option<&'a [u8]>,
}

/// One filter of a subscription. The retain flag arrives as it was published (MQTT 5).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SubscriptionFilter {
    /// The topic, with or without wildcards.
    pub path: String,
    /// The highest quality of service at which the broker delivers messages.
    pub qos: Qos,
    /// Whether the broker sends retained messages (MQTT 5; with 3.1.1 it always does). A retained command is a replay,
    /// but a retained state is valid.
    pub wants_retained: bool,
}

/// A message to the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Publication {
    /// Its topic.
    pub topic: String,
    /// Its payload; empty and retained clears the topic.
    pub payload: Vec<u8>,
    /// Whether the broker retains it.
    pub retain: bool,
    /// Quality of service.
    pub qos: Qos,
    /// How long the broker may keep it (MQTT 5); `None`: without limit.
    pub expiry: Option<Duration>,
    /// Correlation data of a response (MQTT 5).
    pub correlation: Option<Vec<u8>>,
    /// The session wants to be notified when the broker has acknowledged it. Only with quality of service 1.
    pub token: Option<u64>,
}

impl Publication {
    /// A publication that the broker neither acknowledges nor retains.
    #[must_use]
    pub const fn new(topic: String, payload: Vec<u8>) -> Self {
        Self {
            topic,
            payload,
            retain: false,
            qos: Qos::AtMostOnce,
            expiry: None,
            correlation: None,
            token: None,
        }
    }
}

/// Quality of service.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Qos {
    /// At most once.
    AtMostOnce,
    /// At least once.
    AtLeastOnce,
}

/// A line as the session shows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SessionLine {
    /// Its name.
    pub name: Name,
    /// Its state and counters.
    pub report: LineReport,
    /// How it sees its drives, in order; empty for a session that does not show them.
    pub stations: Vec<Arc<StationReport>>,
}
