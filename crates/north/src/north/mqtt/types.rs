//! Inputs and outputs of the MQTT session.

pub use crate::domain::control::LeaseMode;
use crate::domain::ids::Name;
use crate::domain::standby::StandbyPair;
use crate::north::broker::{MqttVersion, Qos};
use std::time::Duration;

/// Which gateway a session is of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GatewayIdentity {
    /// The gateway's name: the level of its topics after the prefix.
    pub name: Name,
    /// Which of several gateways of this name it is; `None` if it is the only one.
    pub standby: Option<StandbyPair>,
}

/// Settings of the MQTT side, as they are configured.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    /// First level or levels of all topics, without a slash at either end.
    pub prefix: String,
    /// Protocol version of the connection.
    pub version: MqttVersion,
    /// Interval after which an unchanged value is published again.
    pub heartbeat: Duration,
    /// At which quality of service the inputs are subscribed.
    pub subscription_qos: Qos,
    /// What keeps a lease of the MQTT side alive.
    pub lease: LeaseMode,
    /// A topic whose payload `offline` means that the clients of the broker are gone; `None`: no such topic.
    pub alive_topic: Option<String>,
    /// How often the path through the broker is probed.
    pub probe_interval: Duration,
    /// After this time without a returned probe the connection is given up.
    pub probe_timeout: Duration,
    /// Deadline of a command that names none.
    pub command_ttl: Duration,
    /// Topics under which a requester may ask for the response (MQTT 5); `None`: response topics are ignored.
    pub response_prefix: Option<String>,
    /// Most changes of telemetry that are kept while the broker is away; 0: none.
    pub keep_telemetry: usize,
    /// What is published besides what always is: availability, status, results, trip events, the probe.
    pub publish: Vec<TopicTree>,
    /// Discovery by Home Assistant; `None`: nothing is announced, and nothing taken back.
    pub home_assistant: Option<HomeAssistant>,
}

/// Discovery by Home Assistant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HomeAssistant {
    /// Whether anything is announced; if not, what was announced before is taken back.
    pub discovery: bool,
    /// First level or levels of Home Assistant's discovery topics, without a slash at either end.
    pub prefix: String,
    /// Each device is announced as a whole, not each entity separately.
    pub devices: bool,
    /// What each drive is announced as besides.
    pub combined: Vec<CombinedEntity>,
    /// The address of the gateway's page, which the devices lead to.
    pub page: Option<String>,
}

/// An entity that a drive that may be commanded is announced as besides its buttons.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CombinedEntity {
    /// On is forward, off is stop.
    Switch,
    /// With a speed in per cent of the highest frequency, and a direction where both are allowed.
    Fan,
}

/// A part of what is published that can be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TopicTree {
    /// `state` of each drive: everything that is known of it, as JSON.
    State,
    /// Topics with one value each: run state, frequencies, measurements, the active trip, the owner of control.
    Values,
    /// Registers that were asked for.
    Param,
    /// Status and counters of the lines.
    Line,
    /// The gateway's lines and drives.
    Info,
}

impl TopicTree {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::State,
        Self::Values,
        Self::Param,
        Self::Line,
        Self::Info,
    ];

    /// The word for it.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::State => "state",
            Self::Values => "values",
            Self::Param => "param",
            Self::Line => "line",
            Self::Info => "info",
        }
    }
}
