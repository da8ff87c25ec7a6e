//! The topics of one edge node: building them, and parsing the topic of a message.

use super::types::Settings;
use crate::domain::ids::Name;
use crate::north::broker::{Qos, SubscriptionFilter};

/// The namespace of Sparkplug B, the same in all versions.
const NAMESPACE: &str = "spBv1.0";

/// What a message's topic is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SparkplugInbound<'t> {
    /// Our own probe.
    Probe,
    /// The state of the primary host.
    State,
    /// A command for the edge node.
    NodeCommand,
    /// A command for the device with this name, which may not exist.
    DeviceCommand(&'t str),
}

/// Kinds of messages that an edge node sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MessageKind {
    Birth,
    Data,
    Death,
}

impl MessageKind {
    const fn keyword(self) -> &'static str {
        match self {
            Self::Birth => "NBIRTH",
            Self::Data => "NDATA",
            Self::Death => "NDEATH",
        }
    }
}

/// Kinds of messages that it sends for its devices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DeviceKind {
    Birth,
    Data,
    Death,
}

impl DeviceKind {
    const fn keyword(self) -> &'static str {
        match self {
            Self::Birth => "DBIRTH",
            Self::Data => "DDATA",
            Self::Death => "DDEATH",
        }
    }
}

/// All topics of one edge node.
#[derive(Debug)]
pub(super) struct SparkplugTopics {
    group: String,
    node: Name,
    node_command: String,
    /// With the slash at its end.
    device_commands: String,
    state: Option<String>,
    probe: String,
}

impl SparkplugTopics {
    pub(super) fn new(settings: &Settings) -> Self {
        let group = settings.group.clone();
        let node = settings.node.clone();
        Self {
            node_command: format!("{NAMESPACE}/{group}/NCMD/{node}"),
            device_commands: format!("{NAMESPACE}/{group}/DCMD/{node}/"),
            state: settings
                .primary_host
                .as_ref()
                .map(|host| format!("{NAMESPACE}/STATE/{host}")),
            probe: settings.probe_topic.clone(),
            group,
            node,
        }
    }

    pub(super) fn node(&self, kind: MessageKind) -> String {
        format!(
            "{NAMESPACE}/{}/{}/{}",
            self.group,
            kind.keyword(),
            self.node
        )
    }

    pub(super) fn device(&self, kind: DeviceKind, device: &Name) -> String {
        format!(
            "{NAMESPACE}/{}/{}/{}/{device}",
            self.group,
            kind.keyword(),
            self.node
        )
    }

    pub(super) fn probe(&self) -> String {
        self.probe.clone()
    }

    /// What is subscribed. A retained state is valid; a retained command is a replay.
    pub(super) fn filters(&self) -> Vec<SubscriptionFilter> {
        // The specification asks for quality of service 1 (tck-id-message-flow-edge-node-ncmd-subscribe).
        let filter = |path, wants_retained| SubscriptionFilter {
            path,
            qos: Qos::AtLeastOnce,
            wants_retained,
        };
        let live = |path| filter(path, false);
        let state = self.state.clone().map(|path| filter(path, true));
        let commands = [
            self.node_command.clone(),
            format!("{}+", self.device_commands),
            self.probe.clone(),
        ];
        commands.into_iter().map(live).chain(state).collect()
    }

    pub(super) fn parse<'t>(&self, topic: &'t str) -> Option<SparkplugInbound<'t>> {
        if topic == self.probe {
            return Some(SparkplugInbound::Probe);
        }
        if topic == self.node_command {
            return Some(SparkplugInbound::NodeCommand);
        }
        if self.state.as_deref() == Some(topic) {
            return Some(SparkplugInbound::State);
        }
        topic
            .strip_prefix(self.device_commands.as_str())
            .map(SparkplugInbound::DeviceCommand)
    }
}
