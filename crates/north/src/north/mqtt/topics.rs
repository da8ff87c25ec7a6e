//! The topics of one gateway: building them, and parsing the topic of a message.

use super::types::{GatewayIdentity, Settings};
use crate::domain::ids::Name;
use crate::north::broker::{Qos, SubscriptionFilter};

/// All topics of one gateway.
#[derive(Debug)]
pub(super) struct MqttTopics {
    prefix: String,
    /// The gateway's name.
    pub(super) name: Name,
    /// `PREFIX/GATEWAY/`.
    base: String,
    alive: Option<String>,
    /// This one of several gateways of the name.
    half: Option<Name>,
    /// At which quality of service the inputs are subscribed.
    qos: Qos,
}

/// What a message's topic is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MqttInbound<'t> {
    /// Our own probe.
    Probe,
    /// The heartbeat of the clients.
    Alive,
    /// STOP for all drives.
    AllRun,
    /// An input of a drive.
    Drive(InputAddress<'t>),
    /// What one of several gateways of the name publishes.
    Peer(PeerTopic<'t>),
}

/// What the gateways of one name publish for each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PeerTopic<'t> {
    /// Whether the gateway is online.
    Status,
    /// The report of the gateway of this name in the pair.
    Standby(&'t str),
    /// A trip event of the drive of this name.
    Event(&'t str),
    /// The record of its last trip.
    Last(&'t str),
}

/// Which input of which drive, and of which client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct InputAddress<'t> {
    /// The client whose own topic it is, not checked; `None`: the shared topic.
    pub(super) by: Option<&'t str>,
    /// The name of the drive, which may not exist.
    pub(super) drive: &'t str,
    /// The input.
    pub(super) input: DriveInput<'t>,
}

/// An input of a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DriveInput<'t> {
    Frequency,
    Run,
    Reset,
    Take,
    Release,
    Command,
    Lease,
    ParamGet(&'t str),
    ParamSet(&'t str),
}

impl DriveInput<'_> {
    /// Whether an empty payload has a meaning. Elsewhere it clears a retained message.
    pub(super) const fn takes_empty(self) -> bool {
        matches!(self, Self::Lease | Self::ParamGet(_))
    }

    /// Whether it orders nothing.
    pub(super) const fn only_reads(self) -> bool {
        matches!(self, Self::ParamGet(_))
    }

    /// Whether it attempts a write. Reading is no attempt, and renewing a lease is none.
    pub(super) const fn is_attempt(self) -> bool {
        !matches!(self, Self::ParamGet(_) | Self::Lease)
    }
}

impl MqttTopics {
    pub(super) fn new(gateway: &GatewayIdentity, settings: &Settings) -> Self {
        let base = format!("{}/{}/", settings.prefix, gateway.name);
        Self {
            prefix: settings.prefix.clone(),
            name: gateway.name.clone(),
            base,
            alive: settings.alive_topic.clone(),
            half: gateway.standby.as_ref().map(|pair| pair.half.clone()),
            qos: settings.subscription_qos,
        }
    }

    /// What is subscribed: inputs only, so that none of our publications is delivered to us; with another gateway of the
    /// name also what both publish.
    pub(super) fn filters(&self) -> Vec<SubscriptionFilter> {
        /// The shared topic, and that of each client with topics of its own.
        const ORDERS: [&str; 8] = [
            "run/set",
            "frequency/set",
            "trip/reset",
            "control/take",
            "control/release",
            "command",
            "lease",
            "param/+/set",
        ];
        let orders = ["", "by/+/"]
            .into_iter()
            .flat_map(|by| ORDERS.map(|rest| format!("{by}drive/+/{rest}")));
        let others = ["all/run/set", "drive/+/param/+/get", "probe"].map(str::to_owned);
        let inputs = orders
            .chain(others)
            .map(|rest| self.filter(self.gateway(&rest), false));
        // A message on the alive topic that was published while we were disconnected is valid.
        let alive = self.alive.clone().map(|path| self.filter(path, true));
        let mut filters: Vec<SubscriptionFilter> = inputs.chain(alive).collect();
        if self.half.is_some() {
            let shared = [
                "status",
                "standby/+",
                "drive/+/trip/event",
                "drive/+/trip/last",
            ];
            filters.extend(shared.map(|rest| self.filter(self.gateway(rest), true)));
        }
        filters
    }

    /// The subscription of `path`.
    pub(super) const fn filter(&self, path: String, wants_retained: bool) -> SubscriptionFilter {
        SubscriptionFilter {
            path,
            qos: self.qos,
            wants_retained,
        }
    }

    /// This one of several gateways of the name; `None` if it is the only one.
    pub(super) const fn half(&self) -> Option<&Name> {
        self.half.as_ref()
    }

    /// The topic on which the one called `half` of several gateways reports itself.
    pub(super) fn standby(&self, half: &str) -> String {
        self.gateway(&format!("standby/{half}"))
    }

    /// A topic of the gateway as a whole.
    pub(super) fn gateway(&self, rest: &str) -> String {
        format!("{}{rest}", self.base)
    }

    /// The levels of `topic` below those of the gateway.
    pub(super) fn below<'t>(&self, topic: &'t str) -> &'t str {
        topic.strip_prefix(self.base.as_str()).unwrap_or(topic)
    }

    /// A topic of a line.
    pub(super) fn line(&self, name: &str, rest: &str) -> String {
        format!("{}line/{name}/{rest}", self.base)
    }

    /// A topic of a drive.
    pub(super) fn drive(&self, name: &str, rest: &str) -> String {
        format!("{}drive/{name}/{rest}", self.base)
    }

    /// What `topic` is for; `None` if it is none of those that are subscribed.
    pub(super) fn parse<'t>(&self, topic: &'t str) -> Option<MqttInbound<'t>> {
        if self.alive.as_deref() == Some(topic) {
            return Some(MqttInbound::Alive);
        }
        let rest = topic.strip_prefix(self.base.as_str())?;
        let peer = self.half.as_ref().and_then(|_| parse_peer_topic(rest));
        if rest == "probe" {
            Some(MqttInbound::Probe)
        } else {
            peer.map(MqttInbound::Peer).or_else(|| command(rest))
        }
    }

    /// Whether a response may be sent to `topic`: it is under `allowed`, is a plain topic, and is neither ours nor an
    /// input of another gateway under our prefix.
    pub(super) fn may_respond_to(&self, topic: &str, allowed: &str) -> bool {
        let is_under = topic
            .strip_prefix(allowed)
            .is_some_and(|rest| rest.starts_with('/') && rest.len() > 1);
        let is_plain = topic.len() <= 1024
            && !topic
                .chars()
                .any(|c| matches!(c, '+' | '#') || c.is_control());
        let is_ours = topic.starts_with(&self.base) || self.alive.as_deref() == Some(topic);
        is_under && is_plain && !is_ours && !self.is_input_of_a_neighbour(topic)
    }

    fn is_input_of_a_neighbour(&self, topic: &str) -> bool {
        let below = topic
            .strip_prefix(self.prefix.as_str())
            .and_then(|rest| rest.strip_prefix('/'));
        let rest = below
            .and_then(|below| below.split_once('/'))
            .map(|(_, rest)| rest);
        rest.is_some_and(|rest| rest == "probe" || command(rest).is_some())
    }
}

/// The input in the levels after the gateway's name.
fn command(rest: &str) -> Option<MqttInbound<'_>> {
    if rest == "all/run/set" {
        return Some(MqttInbound::AllRun);
    }
    let Some(rest) = rest.strip_prefix("by/") else {
        return Some(MqttInbound::Drive(place(None, rest)?));
    };
    let (by, rest) = rest.split_once('/')?;
    let place = place(Some(by), rest)?;
    (!place.input.only_reads()).then_some(MqttInbound::Drive(place))
}

/// What is published in the levels after the gateway's name.
fn parse_peer_topic(rest: &str) -> Option<PeerTopic<'_>> {
    if rest == "status" {
        return Some(PeerTopic::Status);
    }
    if let Some(half) = rest.strip_prefix("standby/") {
        return Some(PeerTopic::Standby(half));
    }
    let (drive, what) = rest.strip_prefix("drive/")?.split_once('/')?;
    match what {
        "trip/event" => Some(PeerTopic::Event(drive)),
        "trip/last" => Some(PeerTopic::Last(drive)),
        _ => None,
    }
}

fn place<'t>(by: Option<&'t str>, rest: &'t str) -> Option<InputAddress<'t>> {
    let (drive, input) = rest.strip_prefix("drive/")?.split_once('/')?;
    Some(InputAddress {
        by,
        drive,
        input: drive_input(input)?,
    })
}

fn drive_input(rest: &str) -> Option<DriveInput<'_>> {
    match rest {
        "frequency/set" => Some(DriveInput::Frequency),
        "run/set" => Some(DriveInput::Run),
        "trip/reset" => Some(DriveInput::Reset),
        "control/take" => Some(DriveInput::Take),
        "control/release" => Some(DriveInput::Release),
        "command" => Some(DriveInput::Command),
        "lease" => Some(DriveInput::Lease),
        _ => param(rest.strip_prefix("param/")?),
    }
}

fn param(rest: &str) -> Option<DriveInput<'_>> {
    let (code, way) = rest.split_once('/')?;
    match way {
        "get" => Some(DriveInput::ParamGet(code)),
        "set" => Some(DriveInput::ParamSet(code)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::north::broker::MqttVersion;
    use crate::north::mqtt::harness::{identity, settings};

    fn topics() -> MqttTopics {
        MqttTopics::new(&identity(), &settings(MqttVersion::V5))
    }

    fn everybody(input: DriveInput<'_>) -> Option<MqttInbound<'_>> {
        Some(MqttInbound::Drive(InputAddress {
            by: None,
            drive: "pump",
            input,
        }))
    }

    fn own(input: DriveInput<'_>) -> Option<MqttInbound<'_>> {
        Some(MqttInbound::Drive(InputAddress {
            by: Some("plc-2"),
            drive: "pump",
            input,
        }))
    }

    #[test]
    fn inputs_are_distinguished_and_nothing_else_is_one() {
        let topics = topics();
        let table = [
            ("vfd/plant/probe", Some(MqttInbound::Probe)),
            ("home/status", Some(MqttInbound::Alive)),
            ("vfd/plant/all/run/set", Some(MqttInbound::AllRun)),
            ("vfd/plant/drive/pump/run/set", everybody(DriveInput::Run)),
            (
                "vfd/plant/drive/pump/frequency/set",
                everybody(DriveInput::Frequency),
            ),
            (
                "vfd/plant/drive/pump/trip/reset",
                everybody(DriveInput::Reset),
            ),
            (
                "vfd/plant/drive/pump/control/release",
                everybody(DriveInput::Release),
            ),
            (
                "vfd/plant/drive/pump/command",
                everybody(DriveInput::Command),
            ),
            ("vfd/plant/drive/pump/lease", everybody(DriveInput::Lease)),
            (
                "vfd/plant/drive/pump/param/F007/get",
                everybody(DriveInput::ParamGet("F007")),
            ),
            (
                "vfd/plant/drive/pump/param/F007/set",
                everybody(DriveInput::ParamSet("F007")),
            ),
            (
                "vfd/plant/drive/pump/control/take",
                everybody(DriveInput::Take),
            ),
            (
                "vfd/plant/by/plc-2/drive/pump/run/set",
                own(DriveInput::Run),
            ),
            (
                "vfd/plant/by/plc-2/drive/pump/frequency/set",
                own(DriveInput::Frequency),
            ),
            (
                "vfd/plant/by/plc-2/drive/pump/trip/reset",
                own(DriveInput::Reset),
            ),
            (
                "vfd/plant/by/plc-2/drive/pump/control/take",
                own(DriveInput::Take),
            ),
            (
                "vfd/plant/by/plc-2/drive/pump/control/release",
                own(DriveInput::Release),
            ),
            (
                "vfd/plant/by/plc-2/drive/pump/command",
                own(DriveInput::Command),
            ),
            (
                "vfd/plant/by/plc-2/drive/pump/lease",
                own(DriveInput::Lease),
            ),
            (
                "vfd/plant/by/plc-2/drive/pump/param/F007/set",
                own(DriveInput::ParamSet("F007")),
            ),
            ("vfd/plant/by/plc-2/drive/pump/param/F007/get", None),
            ("vfd/plant/by/plc-2/all/run/set", None),
            ("vfd/plant/by/plc-2/probe", None),
            ("vfd/plant/by/a/b/drive/pump/run/set", None),
            ("vfd/plant/drive/pump/param/F007", None),
            ("vfd/plant/drive/pump/param/a/b/set", None),
            ("vfd/plant/drive/pump/run/state", None),
            ("vfd/plant/drive/pump", None),
            ("vfd/other/drive/pump/run/set", None),
            ("vfd/plantx/probe", None),
            ("", None),
        ];
        for (topic, expected) in table {
            assert_eq!(topics.parse(topic), expected, "{topic}");
        }
    }

    #[test]
    fn responses_stay_within_their_prefix_and_off_every_input() {
        let topics = topics();
        assert!(topics.may_respond_to("vfd/answers/me", "vfd/answers"));
        for (topic, allowed) in [
            ("vfd/answersme", "vfd/answers"),
            ("vfd/answers", "vfd/answers"),
            ("vfd/answers/", "vfd/answers"),
            ("vfd/answers/+", "vfd/answers"),
            ("vfd/answers/a\0b", "vfd/answers"),
            ("elsewhere/me", "vfd/answers"),
            ("vfd/plant/drive/pump/run/set", "vfd"),
            ("vfd/plant/status", "vfd"),
            ("vfd/other/drive/pump/run/set", "vfd"),
            ("vfd/other/all/run/set", "vfd"),
            ("vfd/other/by/plc-2/drive/pump/run/set", "vfd"),
            ("home/status", "home"),
        ] {
            assert!(!topics.may_respond_to(topic, allowed), "{topic}");
        }
    }
}
