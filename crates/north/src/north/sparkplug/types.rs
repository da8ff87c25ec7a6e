//! Inputs and outputs of the Sparkplug session.

use crate::domain::ids::Name;
use crate::north::broker::MqttVersion;
use std::time::Duration;

/// Settings of the Sparkplug side.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    /// The group: one level of a topic.
    pub group: String,
    /// The edge node: the gateway's name.
    pub node: Name,
    /// Whether it is one of several gateways that are the same edge node, one at a time.
    pub standby: bool,
    /// The host application without which nothing is born; `None`: no host is waited for.
    pub primary_host: Option<String>,
    /// Protocol version of the connection.
    pub version: MqttVersion,
    /// The topic of the probe.
    pub probe_topic: String,
    /// How often the way through the broker is probed.
    pub probe_interval: Duration,
    /// After this time without a returned probe the connection is given up.
    pub probe_timeout: Duration,
    /// Deadline of a command, counted from its arrival.
    pub command_ttl: Duration,
    /// Largest age of a command by its timestamp; older ones are refused.
    pub max_command_age: Duration,
    /// Most changes of telemetry that are kept while no host can be reached, over all drives; 0: none.
    pub keep_telemetry: usize,
}

/// Counts of the Sparkplug session since start. All but [`SparkplugCounters::history_waiting`] and
/// [`SparkplugCounters::host_awaited`] only rise; [`SparkplugCounters::host_behind_ms`] and [`SparkplugCounters::is_left_to_another`] are states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SparkplugCounters {
    /// Messages received.
    pub messages_in: u64,
    /// Messages handed out to be published, except the probe.
    pub messages_out: u64,
    /// Received messages without a meaning here.
    pub ignored: u64,
    /// Births of the edge node.
    pub births: u64,
    /// Births that a host requested.
    pub rebirths: u64,
    /// Commands given to drives.
    pub commands: u64,
    /// Commands refused by the session, for whatever reason.
    pub refused: u64,
    /// Of these: replays.
    pub refused_retained: u64,
    /// Of these: older than allowed.
    pub refused_stale: u64,
    /// 1 while births wait for the primary host.
    pub host_awaited: u64,
    /// While births wait for the primary host: by how many milliseconds the message in which it says that it is online is
    /// older than one before it, which is why it does not count.
    pub host_behind_ms: Option<u64>,
    /// Another gateway of the pair is the edge node, or the role is not known yet.
    pub is_left_to_another: bool,
    /// Times that the primary host went offline while the edge node was born.
    pub host_losses: u64,
    /// Probes that did not return.
    pub probes_lost: u64,
    /// Changes that wait for the host.
    pub history_waiting: u64,
    /// Changes dropped because more were to be kept than configured.
    pub history_dropped: u64,
    /// Messages that were larger than the broker accepts.
    pub too_large: u64,
    /// Attempts to write that were lost because too many were waiting to be fetched.
    pub attempts_lost: u64,
    /// Commands that were never answered.
    pub unanswered: u64,
}
