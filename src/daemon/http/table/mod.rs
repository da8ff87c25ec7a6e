//! All metrics: name, unit, type, help, and where the number comes from.
//!
//! Each name begins with [`PREFIX`] and ends with its unit; a counter's ends with `_total` besides.

use super::reachable::CommandReachability;
use super::state::HttpState;
use crate::daemon::exchange::totals::{
    ModbusTotals, MqttTotals, ReadTotals, SerialTotals, SparkplugTotals,
};
use crate::daemon::journal::{JournalReport, JournalState};
use prometheus_client::metrics::MetricType;
use std::time::Duration;

mod drive;
mod line;

pub(super) use drive::{
    COMMANDS, DRIVE, OUTPUT_FREQUENCY, QUANTILES, REPLIES, REPLY, REPLY_TIME, STATION, VALUE,
    VALUE_AGE, WARNING,
};
pub(super) use line::{LINE, THREAD};

/// First part of all names.
pub(super) const PREFIX: &str = "vfd_gateway";

/// One family of samples of a `T`.
#[derive(Clone)]
pub(super) struct MetricFamily<T> {
    pub name: MetricName,
    pub sample: MetricSample<T>,
}

/// Name, unit, type and help of one family.
#[derive(Clone)]
pub(super) struct MetricName {
    pub name: &'static str,
    pub unit: Option<&'static str>,
    pub help: &'static str,
    pub kind: MetricType,
}

/// How a sample is taken; it is left out if that returns `None`.
#[derive(Clone)]
pub(super) enum MetricSample<T> {
    Counter(fn(&T) -> Option<u64>),
    Sum(fn(&T) -> Option<f64>),
    Gauge(fn(&T) -> Option<f64>),
    Flag(fn(&T) -> Option<bool>),
}

const fn counter<T>(
    name: &'static str,
    help: &'static str,
    take: fn(&T) -> Option<u64>,
) -> MetricFamily<T> {
    let name = MetricName {
        name,
        unit: None,
        help,
        kind: MetricType::Counter,
    };
    MetricFamily {
        name,
        sample: MetricSample::Counter(take),
    }
}

/// A counter of something other than a number of events.
const fn sum<T>(
    name: &'static str,
    help: &'static str,
    take: fn(&T) -> Option<f64>,
) -> MetricFamily<T> {
    let name = MetricName {
        name,
        unit: None,
        help,
        kind: MetricType::Counter,
    };
    MetricFamily {
        name,
        sample: MetricSample::Sum(take),
    }
}

const fn gauge<T>(
    name: &'static str,
    help: &'static str,
    take: fn(&T) -> Option<f64>,
) -> MetricFamily<T> {
    MetricFamily {
        name: plain(name, None, help),
        sample: MetricSample::Gauge(take),
    }
}

impl<T> MetricFamily<T> {
    const fn in_unit(mut self, unit: &'static str) -> Self {
        self.name.unit = Some(unit);
        self
    }
}

const fn plain(name: &'static str, unit: Option<&'static str>, help: &'static str) -> MetricName {
    MetricName {
        name,
        unit,
        help,
        kind: MetricType::Gauge,
    }
}

/// The version, as a label of the number 1.
pub(super) const BUILD: MetricName = plain("build_info", None, "Always 1; the version is a label.");

/// The gateway as a whole.
pub(super) const GATEWAY: &[MetricFamily<HttpState>] = &[
    gauge(
        "process_start_time",
        "When the gateway started, since 1970-01-01 UTC.",
        |state: &HttpState| Some(state.started_at.unix_ms as f64 / 1000.0),
    )
    .in_unit("seconds"),
    gauge(
        "ready",
        "1 while all lines can be used and the broker is reached, if one is configured.",
        |state| truth(state.is_ready()),
    ),
];

/// The Modbus TCP side.
pub(super) const MODBUS: &[MetricFamily<ModbusTotals>] = &[
    gauge(
        "modbus_connections",
        "Modbus TCP connections that are open.",
        |modbus| Some(modbus.connections() as f64),
    ),
    counter(
        "modbus_accepted",
        "Modbus TCP connections accepted.",
        |modbus| Some(modbus.accepted()),
    ),
    counter(
        "modbus_refused",
        "Modbus TCP connections turned away.",
        |modbus| Some(modbus.turned_away()),
    ),
    counter(
        "modbus_handshakes_failed",
        "TLS handshakes of Modbus TCP that failed.",
        |modbus| Some(modbus.handshakes_failed()),
    ),
    counter(
        "modbus_closed_early",
        "Modbus TCP connections closed for want of room or memory.",
        |modbus| Some(modbus.dismissed()),
    ),
    counter("modbus_requests", "Modbus TCP requests.", |modbus| {
        Some(modbus.counters().requests)
    }),
    counter(
        "modbus_replies",
        "Modbus TCP answers that are no exceptions.",
        |modbus| Some(modbus.counters().replies),
    ),
    counter(
        "modbus_attempts_lost",
        "Attempts to write that stand in no audit, because too many came at once.",
        |modbus| Some(modbus.counters().attempts_lost),
    ),
];

/// The port of each serial master; label `master`.
pub(super) const SERIAL: &[MetricFamily<SerialTotals>] = &[
    counter(
        "serial_requests",
        "Requests of serial masters for units of the gateway.",
        |serial| Some(serial.counters().requests),
    ),
    counter(
        "serial_not_in_time",
        "Exceptions to serial masters because the answer was not there in time.",
        |serial| Some(serial.counters().not_in_time),
    ),
    counter(
        "serial_late",
        "Answers that were too late for a serial master and were thrown away.",
        |serial| Some(serial.counters().late),
    ),
    counter(
        "serial_damaged",
        "Damaged frames and noise at the ports of serial masters.",
        |serial| Some(serial.counters().damaged),
    ),
    counter(
        "serial_foreign",
        "Frames of other slaves at the ports of serial masters.",
        |serial| Some(serial.counters().foreign),
    ),
    counter(
        "serial_broadcasts",
        "Broadcasts of serial masters, which are ignored.",
        |serial| Some(serial.counters().broadcasts),
    ),
    counter(
        "serial_collisions",
        "Bytes of others that arrived during a reply to a serial master.",
        |serial| Some(serial.counters().collisions),
    ),
];

/// The native reads of each listener; label `listener`.
pub(super) const READS: &[MetricFamily<ReadTotals>] = &[
    counter(
        "modbus_native_reads_line",
        "Native reads that were passed to a line.",
        |reads| Some(reads.from_line()),
    ),
    counter(
        "modbus_native_reads_memory",
        "Native reads that were answered from memory (`cached`).",
        |reads| Some(reads.from_memory()),
    ),
    sum(
        "modbus_native_reads_memory_age",
        "Ages of the answers from memory, added up.",
        |reads: &ReadTotals| seconds(reads.age()),
    )
    .in_unit("seconds"),
    gauge(
        "modbus_native_reads_memory_age_longest",
        "Age of the oldest answer from memory.",
        |reads: &ReadTotals| seconds(reads.oldest()),
    )
    .in_unit("seconds"),
];

/// Exceptions on Modbus TCP; label `code`.
pub(super) const MODBUS_EXCEPTIONS: MetricName = MetricName {
    name: "modbus_exceptions",
    unit: None,
    help: "Modbus TCP exceptions by their code.",
    kind: MetricType::Counter,
};

/// The Sparkplug side, if it is configured.
pub(super) const SPARKPLUG: &[MetricFamily<SparkplugTotals>] = &[
    gauge(
        "sparkplug_connected",
        "1 while all is born and the way through the broker is proven; absent while another gateway is the edge node.",
        |it| {
            if it.counters().is_left_to_another {
                None
            } else {
                truth(it.is_connected())
            }
        },
    ),
    gauge(
        "sparkplug_host_awaited",
        "1 while births wait for the primary host; absent while another gateway is the edge node.",
        |it| {
            let counters = it.counters();
            (!counters.is_left_to_another).then_some(counters.host_awaited as f64)
        },
    ),
    counter(
        "sparkplug_host_losses",
        "Times that the primary host went offline.",
        |it| Some(it.counters().host_losses),
    ),
    gauge(
        "sparkplug_contested",
        "1 while another client wants our identifier at the broker.",
        |it| truth(it.is_contested()),
    ),
    counter(
        "sparkplug_births",
        "Births of the edge node, those that hosts asked for included.",
        |it| Some(it.counters().births),
    ),
    counter("sparkplug_rebirths", "Births that hosts asked for.", |it| {
        Some(it.counters().rebirths)
    }),
    counter("sparkplug_received", "Messages from the broker.", |it| {
        Some(it.counters().messages_in)
    }),
    counter("sparkplug_published", "Messages to the broker.", |it| {
        Some(it.counters().messages_out)
    }),
    counter("sparkplug_commands", "Commands given to drives.", |it| {
        Some(it.counters().commands)
    }),
    counter(
        "sparkplug_refused",
        "Commands refused before any line saw them.",
        |it| Some(it.counters().refused),
    ),
    counter(
        "sparkplug_refused_retained",
        "Commands refused because they were retained.",
        |it| Some(it.counters().refused_retained),
    ),
    counter(
        "sparkplug_refused_stale",
        "Commands refused because of their timestamp.",
        |it| Some(it.counters().refused_stale),
    ),
    counter(
        "sparkplug_unanswered",
        "Commands that no line ever answered.",
        |it| Some(it.counters().unanswered),
    ),
    counter(
        "sparkplug_attempts_lost",
        "Attempts to write that stand in no audit, because too many came at once.",
        |it| Some(it.counters().attempts_lost),
    ),
    counter(
        "sparkplug_probes_lost",
        "Times the broker was connected and did not send the probe back.",
        |it| Some(it.counters().probes_lost),
    ),
    counter(
        "sparkplug_too_large",
        "Messages that were larger than the broker takes.",
        |it| Some(it.counters().too_large),
    ),
    gauge(
        "sparkplug_history_waiting",
        "Changes waiting to be sent to a host.",
        |it| Some(it.counters().history_waiting as f64),
    ),
    counter(
        "sparkplug_history_dropped",
        "Changes dropped because more waited than are kept.",
        |it| Some(it.counters().history_dropped),
    ),
];

/// The MQTT side, if a broker is configured.
pub(super) const MQTT: &[MetricFamily<MqttTotals>] = &[
    gauge("mqtt_connected", "1 while the broker is reached.", |mqtt| {
        truth(mqtt.is_connected())
    }),
    counter("mqtt_connects", "Times the broker was reached.", |mqtt| {
        Some(mqtt.connects())
    }),
    gauge(
        "mqtt_contested",
        "1 while another client wants our identifier at the broker.",
        |mqtt| truth(mqtt.is_contested()),
    ),
    counter(
        "mqtt_takeovers",
        "Connections that ended because another client has our identifier.",
        |mqtt| Some(mqtt.takeovers()),
    ),
    counter("mqtt_received", "Messages from the broker.", |mqtt| {
        Some(mqtt.counters().messages_in)
    }),
    counter("mqtt_published", "Messages to the broker.", |mqtt| {
        Some(mqtt.counters().messages_out)
    }),
    counter("mqtt_commands", "Commands given to drives.", |mqtt| {
        Some(mqtt.counters().commands)
    }),
    counter(
        "mqtt_refused",
        "Inputs refused before any line saw them.",
        |mqtt| Some(mqtt.counters().refused),
    ),
    counter(
        "mqtt_refused_retained",
        "Commands refused because they were retained.",
        |mqtt| Some(mqtt.counters().refused_retained),
    ),
    counter(
        "mqtt_duplicates",
        "Commands that came again and were not carried out again.",
        |mqtt| Some(mqtt.counters().duplicates),
    ),
    counter(
        "mqtt_unanswered",
        "Commands and reads that no line ever answered.",
        |mqtt| Some(mqtt.counters().unanswered),
    ),
    counter(
        "mqtt_attempts_lost",
        "Attempts to write that stand in no audit, because too many came at once.",
        |mqtt| Some(mqtt.counters().attempts_lost),
    ),
    counter(
        "mqtt_probes_lost",
        "Times the broker was connected and did not send the probe back.",
        |mqtt| Some(mqtt.counters().probes_lost),
    ),
    gauge(
        "mqtt_alive_refused",
        "1 while the broker does not let us read `alive_topic`.",
        |mqtt| Some(mqtt.counters().alive_refused as f64),
    ),
    gauge(
        "mqtt_partner_online",
        "1 while the other gateway of `[standby]` says on MQTT that it is there; absent without one or without a broker.",
        |mqtt| truth(mqtt.counters().partner_online?),
    ),
    counter(
        "mqtt_too_large",
        "Publications that were larger than the broker takes.",
        |mqtt| Some(mqtt.counters().too_large),
    ),
    counter(
        "mqtt_results_dropped",
        "Results dropped because too many waited.",
        |mqtt| Some(mqtt.counters().results_dropped),
    ),
    gauge(
        "mqtt_events_waiting",
        "Trip events under way that the broker has not acknowledged.",
        |mqtt| Some(mqtt.counters().events_waiting as f64),
    ),
    counter(
        "mqtt_events_refused",
        "Trip events that the broker would not take.",
        |mqtt| Some(mqtt.counters().events_refused),
    ),
    counter(
        "mqtt_events_dropped",
        "Trip events dropped because too many waited; none with a journal.",
        |mqtt| Some(mqtt.counters().events_dropped),
    ),
    gauge(
        "mqtt_history_waiting",
        "Changes of telemetry that wait for the broker (`keep_telemetry`).",
        |mqtt| Some(mqtt.counters().history_waiting as f64),
    ),
    counter(
        "mqtt_history_dropped",
        "Changes of telemetry dropped because more waited than are kept.",
        |mqtt| Some(mqtt.counters().history_dropped),
    ),
];

/// The socket for the program's own commands, if there is a data directory.
pub(super) const SOCKET: &[MetricFamily<CommandReachability>] = &[gauge(
    "socket_ok",
    "1 while the program's own commands reach the gateway.",
    |socket| truth(socket.refusal().is_none()),
)];

/// The journal, if there is a data directory.
pub(super) const JOURNAL: &[MetricFamily<JournalReport>] = &[
    gauge(
        "journal_ok",
        "1 while rows can be written to the journal; else the newest are in memory.",
        |journal| truth(journal.state == JournalState::Ok),
    ),
    counter("journal_rows", "Rows written.", |journal| {
        Some(journal.rows)
    }),
    counter(
        "journal_lost",
        "Attempts, trips and other rows that could not be kept.",
        |journal| Some(journal.lost),
    ),
    counter(
        "journal_attempts_lost",
        "Of these: attempts to write.",
        |journal| Some(journal.attempts_lost),
    ),
    gauge(
        "journal_moved_aside",
        "1 if a damaged journal was moved aside since the start.",
        |journal| truth(journal.moved_aside.is_some()),
    ),
    counter("journal_commits", "Groups of rows written.", |journal| {
        Some(journal.commits)
    }),
    counter(
        "journal_failures",
        "Times the journal could not be opened or written.",
        |journal| Some(journal.failures),
    ),
    gauge(
        "journal_waiting",
        "Rows that wait to be written.",
        |journal| Some(journal.waiting as f64),
    ),
    gauge(
        "journal_size",
        "Size of the journal's file.",
        |journal: &JournalReport| Some(journal.size_bytes as f64),
    )
    .in_unit("bytes"),
    gauge(
        "journal_commit_time",
        "How long the last group took to write.",
        |journal: &JournalReport| seconds(journal.commit_time),
    )
    .in_unit("seconds"),
    gauge(
        "journal_commit_time_longest",
        "How long the slowest group took to write.",
        |journal: &JournalReport| seconds(journal.commit_time_max),
    )
    .in_unit("seconds"),
];

fn seconds(time: Duration) -> Option<f64> {
    Some(time.as_secs_f64())
}

fn truth(is_true: bool) -> Option<f64> {
    Some(f64::from(u8::from(is_true)))
}
