//! What goes in and out of the MQTT session.

use crate::domain::command::CommandRequest;
pub use crate::domain::control::LeaseMode;
use crate::domain::ids::Name;
use crate::domain::native::NativeRequest;
use crate::domain::report::{LineReport, StationReport};
use crate::drive::description::DriveRef;
use crate::journal::Attempt;
pub use crate::north::clock::Moment;
use std::sync::Arc;
use std::time::Duration;

/// How the MQTT side is set up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    /// First level or levels of all topics, without a slash at either end.
    pub prefix: String,
    /// The gateway's name: the level behind the prefix.
    pub gateway: Name,
    /// Protocol version of the connection.
    pub version: Version,
    /// Interval after which an unchanged value is published again.
    pub heartbeat: Duration,
    /// At which quality of service the inputs are subscribed.
    pub subscription_qos: Qos,
    /// What keeps a lease of the MQTT side alive.
    pub lease: LeaseMode,
    /// A topic whose payload `offline` says that the commanders behind the broker are gone; nothing: none.
    pub alive_topic: Option<String>,
    /// How often the way through the broker is probed.
    pub probe_interval: Duration,
    /// After this time without a probe's return the connection is given up.
    pub probe_timeout: Duration,
    /// Deadline of a command that names none.
    pub command_ttl: Duration,
    /// Topics under which a requester may ask for the response (MQTT 5); nothing: response topics are ignored.
    pub response_prefix: Option<String>,
    /// Most changes of telemetry that are kept while the broker is away; 0: none.
    pub keep_telemetry: usize,
    /// What is published beside that which always is: availability, status, results, events of trips, the probe.
    pub publish: Vec<Tree>,
    /// Discovery by Home Assistant; nothing: nothing is said to it, and nothing taken back.
    pub home_assistant: Option<HomeAssistant>,
}

/// Discovery by Home Assistant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HomeAssistant {
    /// Whether anything is announced; if not, what was announced before is taken back.
    pub discovery: bool,
    /// First level or levels of the topics that Home Assistant looks at, without a slash at either end.
    pub prefix: String,
    /// Each device is announced as a whole, not each entity for itself.
    pub devices: bool,
}

/// A part of what is published that can be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Tree {
    /// `state` of each drive: everything that is known of it, as JSON.
    State,
    /// Topics with one value each: run state, frequencies, measurements, the present trip, who holds control.
    Values,
    /// Registers that were asked for.
    Param,
    /// Status and counters of the lines.
    Line,
    /// What the gateway has.
    Info,
}

impl Tree {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::State, Self::Values, Self::Param, Self::Line, Self::Info];

    /// The word for it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::State => "state",
            Self::Values => "values",
            Self::Param => "param",
            Self::Line => "line",
            Self::Info => "info",
        }
    }
}

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

/// Something to be done.
#[derive(Clone, Debug, PartialEq)]
pub enum Act {
    /// Subscribe to these filters at quality of service 1, all in one packet.
    Subscribe(Vec<Filter>),
    /// Publish.
    Publish(Publication),
    /// Give a command to a drive.
    Command(DriveRef, CommandRequest),
    /// Ask a drive for registers.
    Read(DriveRef, NativeRequest),
    /// Tell every line that the way from the commanders is open.
    PathAlive,
    /// Tell every line that the way was opened anew.
    PathOpened,
    /// Keep this attempt to write, of which no line knows: it was refused, is a repeat, or was taken back before it was
    /// handed to a line. Nothing for the drive: the message is for all, or for one that does not exist.
    Keep(Option<DriveRef>, Attempt),
    /// The broker has the stored event with this number, or will not take it: it is not to be told again.
    EventTaken(u64),
    /// The session wants the first stored events with higher numbers that no broker has: now if there are any, else as
    /// soon as there is one. It is answered once, by [`Session::stored_events`](super::Session::stored_events).
    WantEvents {
        /// The highest number that it was given.
        after: u64,
    },
    /// Drop the connection and make a new one.
    Reconnect(&'static str),
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
