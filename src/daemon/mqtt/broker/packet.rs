//! What clients and the broker say to each other, in one set of words for both versions of the protocol.

use crate::north::broker::Version;
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

/// Why a connection cannot go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    /// As MQTT 5 says it.
    pub reason: u8,
    /// For the log.
    pub why: &'static str,
}

impl Fault {
    /// The bytes are not a packet.
    pub const fn malformed(why: &'static str) -> Self {
        Self { reason: reason::MALFORMED, why }
    }

    /// The packet is one, and may not come so.
    pub const fn protocol(why: &'static str) -> Self {
        Self { reason: reason::PROTOCOL_ERROR, why }
    }
}

/// Quality of service.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[expect(clippy::enum_variant_names, reason = "the specification calls them so")]
pub enum Qos {
    AtMostOnce = 0,
    AtLeastOnce = 1,
    ExactlyOnce = 2,
}

impl Qos {
    /// From its number; 3 is none.
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
pub struct Message {
    pub topic: Arc<str>,
    pub payload: Vec<u8>,
    pub qos: Qos,
    pub retain: bool,
    /// How long it may be delivered.
    pub expiry: Option<Duration>,
    /// Properties that every receiver gets as they came: payload format, content type, response topic, correlation data,
    /// user properties.
    pub properties: Vec<u8>,
}

impl Message {
    /// How much memory it takes, about.
    pub fn weight(&self) -> usize {
        self.topic.len() + self.payload.len() + self.properties.len() + 100
    }
}

/// What a client may say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Incoming {
    Publish {
        message: Message,
        /// Above quality of service 0.
        packet_id: Option<u16>,
    },
    /// Acknowledged at quality of service 1.
    Acked(u16),
    /// First half of quality of service 2; whether the client takes it.
    Received {
        packet_id: u16,
        is_taken: bool,
    },
    /// Second half, from the one who sent the message.
    Released(u16),
    /// The end of quality of service 2.
    Completed(u16),
    Subscribe {
        packet_id: u16,
        wanted: Vec<Wanted>,
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
        expiry: Option<Expiry>,
    },
}

/// CONNECT.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Connect {
    pub version: Version,
    /// Empty: the broker chooses one.
    pub client: String,
    pub clean_start: bool,
    /// Zero: none.
    pub keep_alive: Duration,
    pub expiry: Expiry,
    /// How many messages above quality of service 0 it takes at once.
    pub receive_maximum: u16,
    /// The longest packet that it takes, in bytes.
    pub packet_maximum: usize,
    pub will: Option<Will>,
}

/// How long a session lasts without a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expiry {
    After(Duration),
    /// As long as there is room.
    Never,
}

impl Expiry {
    /// It ends with its connection.
    pub const AT_ONCE: Self = Self::After(Duration::ZERO);

    /// As MQTT 5 counts it.
    pub const fn from_seconds(seconds: u32) -> Self {
        if seconds == u32::MAX { Self::Never } else { Self::After(Duration::from_secs(seconds as u64)) }
    }
}

/// What is published when a connection breaks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Will {
    pub message: Message,
    pub delay: Duration,
}

/// One filter of SUBSCRIBE.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wanted {
    pub filter: String,
    pub options: Options,
    pub retained: RetainHandling,
}

/// How messages of a subscription are delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    pub qos: Qos,
    /// Not what this client has published itself.
    pub no_local: bool,
    /// With the retain flag as it was published; otherwise live messages have none.
    pub as_published: bool,
    /// Is said with every message.
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
pub enum Refusal {
    /// The bytes do not say which answer would be understood.
    Silent(Fault),
    /// CONNACK with this code says it.
    Said(Version, u8),
}

/// What the broker may say.
#[derive(Debug)]
pub enum Outgoing<'a> {
    ConnAck {
        session_present: bool,
        /// 0 is yes; the numbers are those of the version.
        code: u8,
        /// The identifier that the broker has chosen.
        assigned: Option<&'a str>,
    },
    Publish {
        message: &'a Message,
        qos: Qos,
        retain: bool,
        /// Above quality of service 0; whether it is sent again.
        packet_id: Option<(u16, bool)>,
        /// Seconds that are left to it.
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
    /// The reason, as a number and in words; no words for a client that takes only short packets.
    Disconnect(u8, &'static str),
}
