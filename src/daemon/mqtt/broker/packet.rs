//! The packets of clients and the broker, in one form for both versions of the protocol.

use crate::north::broker::MqttVersion;
use std::sync::Arc;
use std::time::Duration;

/// Reasons of MQTT 5 that this broker gives.
pub mod reason {
    pub const SUCCESS: u8 = 0x00;
    pub const NO_SUBSCRIPTION_EXISTED: u8 = 0x11;
    pub const REFUSED: u8 = 0x80;
    pub const MALFORMED: u8 = 0x81;
    pub const PROTOCOL_ERROR: u8 = 0x82;
    pub const UNSUPPORTED_VERSION: u8 = 0x84;
    pub const CLIENT_IDENTIFIER_INVALID: u8 = 0x85;
    pub const BAD_AUTHENTICATION_METHOD: u8 = 0x8C;
    pub const KEEP_ALIVE_TIMEOUT: u8 = 0x8D;
    pub const TAKEN_OVER: u8 = 0x8E;
    pub const FILTER_INVALID: u8 = 0x8F;
    pub const TOPIC_INVALID: u8 = 0x90;
    pub const IDENTIFIER_NOT_FOUND: u8 = 0x92;
    pub const RECEIVE_MAXIMUM_EXCEEDED: u8 = 0x93;
    pub const TOPIC_ALIAS_INVALID: u8 = 0x94;
    pub const PACKET_TOO_LARGE: u8 = 0x95;
    pub const QUOTA_EXCEEDED: u8 = 0x97;
}

/// Why a connection cannot continue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProtocolFault {
    /// The reason code of MQTT 5.
    pub reason: u8,
    /// For the log.
    pub why: &'static str,
}

impl ProtocolFault {
    /// The bytes are not a packet.
    pub const fn malformed(why: &'static str) -> Self {
        Self {
            reason: reason::MALFORMED,
            why,
        }
    }

    /// The packet is valid, but not allowed here.
    pub const fn protocol(why: &'static str) -> Self {
        Self {
            reason: reason::PROTOCOL_ERROR,
            why,
        }
    }
}

/// Quality of service.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[expect(clippy::enum_variant_names, reason = "the specification calls them so")]
pub enum PacketQos {
    AtMostOnce = 0,
    AtLeastOnce = 1,
    ExactlyOnce = 2,
}

impl PacketQos {
    /// From its number; `None` for others than 0 to 2.
    pub const fn new(number: u8) -> Option<Self> {
        match number {
            0 => Some(Self::AtMostOnce),
            1 => Some(Self::AtLeastOnce),
            2 => Some(Self::ExactlyOnce),
            _ => None,
        }
    }
}

/// A message as it was published.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PublishedMessage {
    pub topic: Arc<str>,
    pub payload: Vec<u8>,
    pub qos: PacketQos,
    pub retain: bool,
    /// How long it may still be delivered.
    pub expiry: Option<Duration>,
    /// Properties that every receiver gets unchanged: payload format, content type, response topic, correlation data,
    /// user properties.
    pub properties: Vec<u8>,
}

impl PublishedMessage {
    /// Approximately how much memory it takes.
    pub fn weight(&self) -> usize {
        self.topic.len() + self.payload.len() + self.properties.len() + 100
    }
}

/// A packet from a client.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum IncomingPacket {
    Publish {
        message: PublishedMessage,
        /// Above quality of service 0.
        packet_id: Option<u16>,
    },
    /// Acknowledged at quality of service 1.
    Acked(u16),
    /// PUBREC of quality of service 2; whether the client accepts the message.
    Received {
        packet_id: u16,
        is_taken: bool,
    },
    /// PUBREL of quality of service 2, from the sender of the message.
    Released(u16),
    /// PUBCOMP of quality of service 2.
    Completed(u16),
    Subscribe {
        packet_id: u16,
        wanted: Vec<WantedFilter>,
    },
    Unsubscribe {
        packet_id: u16,
        filters: Vec<String>,
    },
    Ping,
    Disconnect {
        /// Whether the will is to be published all the same.
        with_will: bool,
        /// Replaces the one of the connection.
        expiry: Option<SessionExpiry>,
    },
}

/// CONNECT.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConnectPacket {
    pub version: MqttVersion,
    /// If empty, the broker chooses one.
    pub client: String,
    pub clean_start: bool,
    /// Zero for none.
    pub keep_alive: Duration,
    pub expiry: SessionExpiry,
    /// How many messages above quality of service 0 it accepts at once.
    pub receive_maximum: u16,
    /// The longest packet that it accepts, in bytes.
    pub packet_maximum: usize,
    pub will: Option<WillMessage>,
}

/// How long a session lasts without a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SessionExpiry {
    After(Duration),
    /// The session lasts as long as there is room.
    Never,
}

impl SessionExpiry {
    /// The session ends with its connection.
    pub const AT_ONCE: Self = Self::After(Duration::ZERO);

    /// From the session expiry interval of MQTT 5.
    pub const fn from_seconds(seconds: u32) -> Self {
        if seconds == u32::MAX {
            Self::Never
        } else {
            Self::After(Duration::from_secs(seconds as u64))
        }
    }
}

/// A message that is published when a connection breaks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WillMessage {
    pub message: PublishedMessage,
    pub delay: Duration,
}

/// One filter of SUBSCRIBE.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WantedFilter {
    pub filter: String,
    pub options: SubscriptionOptions,
    pub retained: RetainHandling,
}

/// How messages of a subscription are delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SubscriptionOptions {
    pub qos: PacketQos,
    /// Without messages that this client has published itself.
    pub no_local: bool,
    /// With the retain flag as it was published; otherwise live messages have none.
    pub as_published: bool,
    /// Sent with every message.
    pub identifier: Option<u32>,
}

/// When retained messages are sent at a subscription.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RetainHandling {
    Always,
    IfNew,
    Never,
}

/// Why there is no connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConnectRefusal {
    /// The client's version is unknown, so no answer is sent.
    Silent(ProtocolFault),
    /// CONNACK with this code.
    Said(MqttVersion, u8),
}

/// A packet to a client.
#[derive(Debug)]
pub enum OutgoingPacket<'a> {
    ConnAck {
        session_present: bool,
        /// 0 for success; the codes are those of the version.
        code: u8,
        /// The identifier that the broker has chosen.
        assigned: Option<&'a str>,
    },
    Publish {
        message: &'a PublishedMessage,
        qos: PacketQos,
        retain: bool,
        /// Above quality of service 0; whether it is sent again.
        packet_id: Option<(u16, bool)>,
        /// The remaining time in seconds.
        expiry: Option<u32>,
        identifiers: &'a [u32],
    },
    Acked(u16),
    Received(u16),
    Released(u16, u8),
    Completed(u16, u8),
    SubAck(u16, &'a [u8]),
    UnsubAck(u16, &'a [u8]),
    Pong,
    /// The reason code and its text; the text is empty for a client that accepts only short packets.
    Disconnect(u8, &'static str),
}
