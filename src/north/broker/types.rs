//! What a session and its broker say to each other, whatever the payloads are.

use crate::domain::ids::Name;
use crate::domain::report::{LineReport, StationReport};
use std::sync::Arc;
use std::time::Duration;

/// Protocol version.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Version {
    /// MQTT 3.1.1.
    V4,
    /// MQTT 5.
    V5,
}

/// What a broker said when the connection was accepted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Broker {
    /// Longest packet that it takes, in bytes; nothing: it names no limit.
    pub maximum_packet_bytes: Option<usize>,
    /// Whether it keeps retained messages.
    pub retains: bool,
}

/// Something that happened on the connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// The broker accepted the connection.
    Connected(Broker),
    /// The broker answered the subscription: whether it granted each filter, in order.
    Subscribed(Vec<bool>),
    /// A message came.
    Message(Message<'a>),
    /// The broker acknowledged the publication with this token.
    Acknowledged(u64),
    /// The broker does not take the publication with this token (MQTT 5).
    Refused(u64, Refusal),
    /// This side stood still for so long, or nobody knows how long: what comes from now on may have waited for it, up to
    /// what is said from now on and comes back.
    Stalled(Duration),
    /// The connection is gone.
    Lost,
}

/// What it means that a broker does not take a publication.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Refusal {
    /// It takes no more for now, whatever it is.
    Full,
    /// It failed to take this one.
    Failed,
    /// It will not take this one: it is not allowed, or its topic or payload is wrong for that broker.
    Never,
}

/// A message from the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message<'a> {
    /// Its topic.
    pub topic: &'a str,
    /// Its payload.
    pub payload: &'a [u8],
    /// The retain flag as it arrived: set if it was delivered at subscribe or, with MQTT 5, published so.
    pub retain: bool,
    /// The sender's or the broker's mark of a repeat.
    pub duplicate: bool,
    /// Rest of its life (MQTT 5).
    pub expiry: Option<Duration>,
    /// Where its sender wants the response (MQTT 5).
    pub response_topic: Option<&'a str>,
    /// What the response shall carry (MQTT 5).
    pub correlation: Option<&'a [u8]>,
}

/// One filter of a subscription. The retain flag arrives as it was published (MQTT 5).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Filter {
    /// The topic, with or without wildcards.
    pub path: String,
    /// The best quality of service at which the broker shall send what it has.
    pub qos: Qos,
    /// Whether the broker shall send what it has retained (MQTT 5; with 3.1.1 it always does). A retained command is a
    /// replay, but a retained state is what holds.
    pub wants_retained: bool,
}

/// A message to the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Publication {
    /// Its topic.
    pub topic: String,
    /// Its payload; empty and retained clears the topic.
    pub payload: Vec<u8>,
    /// Whether the broker keeps it.
    pub retain: bool,
    /// Quality of service.
    pub qos: Qos,
    /// How long the broker may keep it (MQTT 5); nothing: for good.
    pub expiry: Option<Duration>,
    /// What a response carries back (MQTT 5).
    pub correlation: Option<Vec<u8>>,
    /// The session wants to be told when the broker acknowledged it. Only with quality of service 1.
    pub token: Option<u64>,
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
pub struct LineState {
    /// Its name.
    pub name: Name,
    /// Its state and counters.
    pub report: LineReport,
    /// How it sees its drives, in order.
    pub stations: Vec<Arc<StationReport>>,
}
