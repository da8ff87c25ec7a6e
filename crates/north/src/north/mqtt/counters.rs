//! The counters of the MQTT session.

/// Counts of the MQTT session since start. All but [`MqttCounters::events_waiting`], [`MqttCounters::history_waiting`],
/// [`MqttCounters::alive_refused`] and [`MqttCounters::partner_online`] only rise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MqttCounters {
    /// Messages received.
    pub messages_in: u64,
    /// Messages handed out to be published.
    pub messages_out: u64,
    /// Received messages on topics that are none of ours, or whose drive has no valid name.
    pub ignored: u64,
    /// Commands given to drives.
    pub commands: u64,
    /// Inputs refused by the session, for whatever reason.
    pub refused: u64,
    /// Of these: replays.
    pub refused_retained: u64,
    /// Stops that were executed although they were published with the retain flag.
    pub retained_stops: u64,
    /// Repeats: answered with the first outcome, left to it, or refused.
    pub duplicates: u64,
    /// Probes that did not return.
    pub probes_lost: u64,
    /// New connections requested.
    pub reconnects: u64,
    /// Trip events that are not acknowledged by the broker.
    pub events_waiting: u64,
    /// Trip events dropped because the queue was full.
    pub events_dropped: u64,
    /// Trip events given up because the broker refused them.
    pub events_refused: u64,
    /// Changes of telemetry that wait for the broker.
    pub history_waiting: u64,
    /// Changes of telemetry dropped because more were to be kept than configured, or because the broker refused them.
    pub history_dropped: u64,
    /// Results dropped because too many waited.
    pub results_dropped: u64,
    /// Response topics that were not allowed.
    pub responses_ignored: u64,
    /// Publications that were larger than the broker accepts.
    pub too_large: u64,
    /// 1 while the broker does not let us read the alive topic.
    pub alive_refused: u64,
    /// Whether the partner reports that it is online; `None` without one, or while that cannot be known.
    pub partner_online: Option<bool>,
    /// Attempts to write that were lost because too many were waiting to be fetched.
    pub attempts_lost: u64,
    /// Commands and reads that were never answered.
    pub unanswered: u64,
}
