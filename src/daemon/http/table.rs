//! All metrics: name, unit, type, help, and where the number comes from.
//!
//! Each name begins with [`PREFIX`] and ends with its unit; a counter's ends with `_total` besides.

use super::state::State;
use crate::daemon::journal::{JournalReport, JournalState};
use crate::daemon::totals::{ModbusTotals, MqttTotals};
use crate::domain::report::{LineReport, LineState, ReplyReport, StationReport};
use crate::drive::view::{ControlView, DriveView};
use crate::drive::watchdog::WatchdogState;
use crate::north::shown;
use prometheus_client::metrics::MetricType;
use std::time::Duration;

/// First part of all names.
pub(super) const PREFIX: &str = "vfd_gateway";

/// One family of samples of a `T`.
pub(super) struct Metric<T> {
    pub name: Name,
    pub sample: Sample<T>,
}

/// What stands in front of the samples of one family.
pub(super) struct Name {
    pub name: &'static str,
    pub unit: Option<&'static str>,
    pub help: &'static str,
    pub kind: MetricType,
}

/// How a sample is taken; nothing where there is none.
pub(super) enum Sample<T> {
    Counter(fn(&T) -> Option<u64>),
    Gauge(fn(&T) -> Option<f64>),
}

const fn counter<T>(name: &'static str, help: &'static str, take: fn(&T) -> Option<u64>) -> Metric<T> {
    let name = Name { name, unit: None, help, kind: MetricType::Counter };
    Metric { name, sample: Sample::Counter(take) }
}

const fn gauge<T>(name: &'static str, help: &'static str, take: fn(&T) -> Option<f64>) -> Metric<T> {
    Metric { name: plain(name, None, help), sample: Sample::Gauge(take) }
}

impl<T> Metric<T> {
    const fn in_unit(mut self, unit: &'static str) -> Self {
        self.name.unit = Some(unit);
        self
    }
}

const fn plain(name: &'static str, unit: Option<&'static str>, help: &'static str) -> Name {
    Name { name, unit, help, kind: MetricType::Gauge }
}

/// The version, as a label of the number 1.
pub(super) const BUILD: Name = plain("build_info", None, "Always 1; the version is a label.");

/// The gateway as a whole.
pub(super) const GATEWAY: &[Metric<State>] = &[
    gauge("process_start_time", "When the gateway started, since 1970-01-01 UTC.", |state: &State| {
        Some(state.started_at.unix_ms as f64 / 1000.0)
    })
    .in_unit("seconds"),
    gauge("ready", "1 while all lines can be used and the broker is reached, if one is configured.", |state| {
        truth(state.is_ready())
    }),
];

/// Each line; label `line`.
pub(super) const LINE: &[Metric<LineReport>] = &[
    gauge(
        "line_up",
        "1 while the line can be used: its port is open, and it is not jammed, echoing or mute.",
        |line| truth(line.state == LineState::Up),
    ),
    counter("line_requests", "Frames sent.", |line| Some(line.counters.requests)),
    counter("line_replies", "Right replies.", |line| Some(line.counters.replies)),
    counter("line_exceptions", "Exceptions that drives answered with.", |line| Some(line.counters.exceptions)),
    counter("line_silent", "Time-outs without any frame from the station.", |line| Some(line.counters.silent)),
    counter("line_garbled", "Exchanges that ended with a damaged reply.", |line| Some(line.counters.garbled)),
    counter("line_strays", "Frames of the asked station that were not the answer, late ones above all.", |line| {
        Some(line.counters.strays)
    }),
    counter("line_foreign", "Sound frames of stations that were not asked.", |line| Some(line.counters.foreign)),
    counter("line_other_master", "Requests of somebody else on the line.", |line| Some(line.counters.other_master)),
    counter("line_echoes", "Frames of ours that came back.", |line| Some(line.counters.echoes)),
    counter("line_jams", "Times the line was jammed.", |line| Some(line.counters.jams)),
    gauge("line_bad", "Bad ones of the last 100 exchanges; absent while too few were seen.", |line: &LineReport| {
        line.quality.bad_per_cent.map(|per_cent| f64::from(per_cent) / 100.0)
    })
    .in_unit("ratio"),
    gauge(
        "line_suspended",
        "1 while run orders and higher setpoints are refused for all drives of the line.",
        |line| truth(line.quality.is_suspended),
    ),
    gauge("line_suspicion", "1 while something is probably wrong with the line; `health --json` says what.", |line| {
        truth(line.suspicion.is_some())
    }),
    counter("line_noise", "Bytes that made no frame.", |line: &LineReport| Some(line.counters.noise_bytes))
        .in_unit("bytes"),
    counter("line_retries", "Exchanges repeated at once after damage.", |line| Some(line.counters.retries)),
    counter("line_barriers", "Exchanges sent only to prove that no late reply can follow.", |line| {
        Some(line.counters.barriers)
    }),
    counter("line_broadcasts", "Stops sent to all drives of the line in one frame.", |line| {
        Some(line.counters.broadcasts)
    }),
    counter("line_joined", "Native reads that joined an exchange somebody else had asked for.", |line| {
        Some(line.counters.joined)
    }),
    counter("line_queue_full", "Native requests refused because a queue was full.", |line| {
        Some(line.counters.queue_full)
    }),
    counter("line_expired", "Native requests whose deadline passed in the queue.", |line| Some(line.counters.expired)),
    counter("line_withdrawn", "Commands that were not sent because the client who gave them was gone.", |line| {
        Some(line.counters.withdrawn)
    }),
    counter("line_port_ups", "Times the port was opened.", |line| Some(line.counters.port_ups)),
    counter("line_busy_microseconds", "Time in which an exchange was open.", |line| Some(line.counters.busy_us)),
    counter("line_port_downs", "Times the port was lost.", |line| Some(line.counters.port_downs)),
    gauge(
        "line_planned_use",
        "Part of the line's time that its polls would take if each came in time.",
        |line: &LineReport| Some(f64::from(line.planned_use_per_mille) / 1000.0),
    )
    .in_unit("ratio"),
    gauge("line_stop_bound_healthy", "Longest wait of a stop while every drive answers.", |line: &LineReport| {
        seconds(line.stop.all_healthy)
    })
    .in_unit("seconds"),
    gauge("line_stop_bound", "Longest wait of a stop with a drive that does not answer.", |line: &LineReport| {
        seconds(line.stop.one_silent)
    })
    .in_unit("seconds"),
    gauge("line_stop_bound_further", "What each further stop at the same time adds to that.", |line: &LineReport| {
        seconds(line.stop.each_further)
    })
    .in_unit("seconds"),
    gauge("line_stop_longest", "Longest wait of a stop so far, for its first bit.", |line: &LineReport| {
        seconds(line.measured.longest_stop)
    })
    .in_unit("seconds"),
    gauge("line_gap_shortest", "Least time before a frame beyond the silence that is due.", |line: &LineReport| {
        seconds(line.measured.shortest_gap?)
    })
    .in_unit("seconds"),
    gauge("line_gap_median", "Median of those times over the newest frames.", |line: &LineReport| {
        seconds(line.measured.median_gap)
    })
    .in_unit("seconds"),
];

/// Each drive as its line sees it; labels `line` and `drive`.
pub(super) const STATION: &[Metric<StationReport>] = &[
    gauge(
        "drive_oldest_age",
        "The oldest that a fast value became in the last minute or two.",
        |station: &StationReport| seconds(station.oldest_age),
    )
    .in_unit("seconds"),
    gauge("drive_planned_age", "The oldest that one becomes by plan.", |station: &StationReport| {
        seconds(station.planned_age?)
    })
    .in_unit("seconds"),
    counter("drive_retries", "Exchanges repeated at once after damage.", |station| Some(station.retries)),
    counter("drive_silent", "Time-outs without any frame from the drive.", |station| Some(station.silent)),
];

/// Its replies; labels `line`, `drive` and `class`.
pub(super) const REPLIES: &[Metric<ReplyReport>] = &[
    gauge("drive_reply_timeout", "How long the start of a reply is waited for.", |reply: &ReplyReport| {
        seconds(reply.timeout)
    })
    .in_unit("seconds"),
    gauge("drive_reply_times", "Replies that the reply times rest on.", |reply: &ReplyReport| {
        Some(f64::from(reply.count))
    }),
];

/// From the end of a request to the start of its reply; labels as those, and `quantile`, 1 for the longest.
pub(super) const REPLY_TIME: Name =
    plain("drive_reply_time", Some("seconds"), "From the end of a request to the start of its reply.");

/// How a quantile is taken.
type Quantile = (&'static str, fn(&ReplyReport) -> Duration);

/// The quantiles of [`REPLY_TIME`].
pub(super) const QUANTILES: [Quantile; 5] = [
    ("0.5", |reply| reply.p50),
    ("0.9", |reply| reply.p90),
    ("0.99", |reply| reply.p99),
    ("0.999", |reply| reply.p999),
    ("1", |reply| reply.max),
];

/// Each drive; labels `line` and `drive`. What control says is there only for drives with a control section.
pub(super) const DRIVE: &[Metric<DriveView>] = &[
    gauge("drive_online", "1 while the drive answers.", |view| truth(view.is_online())),
    gauge(
        "drive_run_state",
        "0 unknown, 1 stopped, 2 forward, 3 reverse, 4 tripped, 5 offline, 6 running, 7 stopping.",
        |view| Some(f64::from(shown::run_state(view).number())),
    ),
    counter("drive_trips_seen", "Trips that this process has seen.", |view| Some(u64::from(view.trip.seen))),
    gauge("drive_trip_active", "1 while a trip holds; absent while that is not known.", |view| {
        truth(view.trip.active?)
    }),
    gauge(
        "drive_watchdog_in_order",
        "1 while the drive's own watchdog is known to be on and to fit; for models with one.",
        |view| truth(view.watchdog?.is_in_order()),
    ),
    gauge(
        "drive_watchdog",
        "Time of the drive's own watchdog, 0 while it is off; absent while that is not known.",
        |view: &DriveView| {
            let watchdog = view.watchdog.filter(|watchdog| watchdog.state != WatchdogState::Unknown)?;
            seconds(watchdog.time.unwrap_or_default())
        },
    )
    .in_unit("seconds"),
    gauge("drive_start_inhibited", "1 while RUN needs a stop and a new run command first.", |view| {
        of_control(view, |control| control.start_inhibited)
    }),
    gauge("drive_stop_pending", "1 while a stop is not effective yet.", |view| {
        of_control(view, |control| control.stop_pending)
    }),
    gauge("drive_not_effective", "1 while a stop had no effect in time.", |view| {
        of_control(view, |control| control.not_effective)
    }),
    gauge("drive_failsafe", "1 while the fail-safe action was the last to act.", |view| {
        of_control(view, |control| control.failsafe)
    }),
    gauge("drive_lease_held", "1 while somebody holds control.", |view| {
        of_control(view, |control| control.lease.is_some())
    }),
    counter("drive_commands", "Commands so far; it wraps at 65536, as the register does.", |view| {
        Some(u64::from(view.control.as_ref()?.commands))
    }),
];

/// The output frequency as the drive reports it, while it is fresh; labels `line` and `drive`.
pub(super) const OUTPUT_FREQUENCY: Name =
    plain("drive_output_frequency", Some("hertz"), "Output frequency; absent while it is stale.");

/// Every other polled register, while it is fresh; labels `line`, `drive`, `name` and `unit`.
pub(super) const VALUE: Name = plain("drive_value", None, "Polled registers in their units; absent while stale.");

/// The Modbus TCP side.
pub(super) const MODBUS: &[Metric<ModbusTotals>] = &[
    gauge("modbus_connections", "Modbus TCP connections that are open.", |modbus| Some(modbus.connections() as f64)),
    counter("modbus_accepted", "Modbus TCP connections accepted.", |modbus| Some(modbus.accepted())),
    counter("modbus_refused", "Modbus TCP connections turned away.", |modbus| Some(modbus.turned_away())),
    counter("modbus_handshakes_failed", "TLS handshakes of Modbus TCP that failed.", |modbus| {
        Some(modbus.handshakes_failed())
    }),
    counter("modbus_closed_early", "Modbus TCP connections closed for want of room or memory.", |modbus| {
        Some(modbus.dismissed())
    }),
    counter("modbus_requests", "Modbus TCP requests.", |modbus| Some(modbus.counters().requests)),
    counter("modbus_replies", "Modbus TCP answers that are no exceptions.", |modbus| Some(modbus.counters().replies)),
    counter(
        "modbus_attempts_lost",
        "Attempts to write that stand in no audit, because too many came at once.",
        |modbus| Some(modbus.counters().attempts_lost),
    ),
];

/// Exceptions on Modbus TCP; label `code`.
pub(super) const MODBUS_EXCEPTIONS: Name = Name {
    name: "modbus_exceptions",
    unit: None,
    help: "Modbus TCP exceptions by their code.",
    kind: MetricType::Counter,
};

/// The MQTT side, if a broker is configured.
pub(super) const MQTT: &[Metric<MqttTotals>] = &[
    gauge("mqtt_connected", "1 while the broker is reached.", |mqtt| truth(mqtt.is_connected())),
    counter("mqtt_connects", "Times the broker was reached.", |mqtt| Some(mqtt.connects())),
    gauge("mqtt_contested", "1 while another client wants our identifier at the broker.", |mqtt| {
        truth(mqtt.is_contested())
    }),
    counter("mqtt_takeovers", "Connections that ended because another client has our identifier.", |mqtt| {
        Some(mqtt.takeovers())
    }),
    counter("mqtt_received", "Messages from the broker.", |mqtt| Some(mqtt.counters().messages_in)),
    counter("mqtt_published", "Messages to the broker.", |mqtt| Some(mqtt.counters().messages_out)),
    counter("mqtt_commands", "Commands given to drives.", |mqtt| Some(mqtt.counters().commands)),
    counter("mqtt_refused", "Inputs refused before any line saw them.", |mqtt| Some(mqtt.counters().refused)),
    counter("mqtt_refused_retained", "Commands refused because they were retained.", |mqtt| {
        Some(mqtt.counters().refused_retained)
    }),
    counter("mqtt_duplicates", "Commands that came again and were not carried out again.", |mqtt| {
        Some(mqtt.counters().duplicates)
    }),
    counter("mqtt_unanswered", "Commands and reads that no line ever answered.", |mqtt| {
        Some(mqtt.counters().unanswered)
    }),
    counter("mqtt_attempts_lost", "Attempts to write that stand in no audit, because too many came at once.", |mqtt| {
        Some(mqtt.counters().attempts_lost)
    }),
    counter("mqtt_probes_lost", "Times the broker was connected and did not send the probe back.", |mqtt| {
        Some(mqtt.counters().probes_lost)
    }),
    gauge("mqtt_alive_refused", "1 while the broker does not let us read `alive_topic`.", |mqtt| {
        Some(mqtt.counters().alive_refused as f64)
    }),
    counter("mqtt_too_large", "Publications that were larger than the broker takes.", |mqtt| {
        Some(mqtt.counters().too_large)
    }),
    counter("mqtt_results_dropped", "Results dropped because too many waited.", |mqtt| {
        Some(mqtt.counters().results_dropped)
    }),
    gauge("mqtt_events_waiting", "Trip events under way that the broker has not acknowledged.", |mqtt| {
        Some(mqtt.counters().events_waiting as f64)
    }),
    counter("mqtt_events_refused", "Trip events that the broker would not take.", |mqtt| {
        Some(mqtt.counters().events_refused)
    }),
    counter("mqtt_events_dropped", "Trip events dropped because too many waited; none with a journal.", |mqtt| {
        Some(mqtt.counters().events_dropped)
    }),
    gauge("mqtt_history_waiting", "Changes of telemetry that wait for the broker (`keep_telemetry`).", |mqtt| {
        Some(mqtt.counters().history_waiting as f64)
    }),
    counter("mqtt_history_dropped", "Changes of telemetry dropped because more waited than are kept.", |mqtt| {
        Some(mqtt.counters().history_dropped)
    }),
];

/// The journal, if there is a data directory.
pub(super) const JOURNAL: &[Metric<JournalReport>] = &[
    gauge("journal_ok", "1 while rows can be written to the journal; else the newest are in memory.", |journal| {
        truth(journal.state == JournalState::Ok)
    }),
    counter("journal_rows", "Rows written.", |journal| Some(journal.rows)),
    counter("journal_lost", "Attempts, trips and other rows that could not be kept.", |journal| Some(journal.lost)),
    counter("journal_attempts_lost", "Of these: attempts to write.", |journal| Some(journal.attempts_lost)),
    gauge("journal_moved_aside", "1 if a damaged journal was moved aside since the start.", |journal| {
        truth(journal.moved_aside.is_some())
    }),
    counter("journal_commits", "Groups of rows written.", |journal| Some(journal.commits)),
    counter("journal_failures", "Times the journal could not be opened or written.", |journal| Some(journal.failures)),
    gauge("journal_waiting", "Rows that wait to be written.", |journal| Some(journal.waiting as f64)),
    gauge("journal_size", "Size of the journal's file.", |journal: &JournalReport| Some(journal.size_bytes as f64))
        .in_unit("bytes"),
    gauge("journal_commit_time", "How long the last group took to write.", |journal: &JournalReport| {
        seconds(journal.commit_time)
    })
    .in_unit("seconds"),
    gauge("journal_commit_time_longest", "How long the slowest group took to write.", |journal: &JournalReport| {
        seconds(journal.commit_time_max)
    })
    .in_unit("seconds"),
];

fn seconds(time: Duration) -> Option<f64> {
    Some(time.as_secs_f64())
}

fn truth(is_true: bool) -> Option<f64> {
    Some(f64::from(u8::from(is_true)))
}

fn of_control(view: &DriveView, what: fn(&ControlView) -> bool) -> Option<f64> {
    view.control.as_ref().and_then(|control| truth(what(control)))
}
