//! Metrics of drives.

use super::{MetricFamily, MetricName, MetricSample, counter, gauge, plain, seconds, truth};
use crate::domain::report::{ReplyReport, StationReport};
use crate::drive::usage::UsagePart;
use crate::drive::view::{ControlView, DriveView};
use crate::drive::watchdog::WatchdogState;
use crate::north::points::{FLAGS, FlagGroup};
use crate::north::shown;
use prometheus_client::metrics::MetricType;
use std::sync::LazyLock;
use std::time::Duration;

/// Each drive as its line sees it; labels `line` and `drive`.
pub(in super::super) const STATION: &[MetricFamily<StationReport>] = &[
    gauge(
        "drive_oldest_age",
        "The oldest that a fast value became in the last minute or two.",
        |station: &StationReport| seconds(station.oldest_age),
    )
    .in_unit("seconds"),
    gauge(
        "drive_planned_age",
        "The oldest that one becomes by plan.",
        |station: &StationReport| seconds(station.planned_age?),
    )
    .in_unit("seconds"),
    counter("drive_replies", "Right replies.", |station| {
        Some(station.exchanges.replies)
    }),
    counter(
        "drive_exceptions",
        "Exceptions that the drive answered with.",
        |station| Some(station.exchanges.exceptions),
    ),
    counter(
        "drive_silent",
        "Time-outs without any frame from the drive.",
        |station| Some(station.exchanges.silent),
    ),
    counter(
        "drive_garbled",
        "Exchanges that ended with a damaged reply.",
        |station| Some(station.exchanges.garbled),
    ),
    counter("drive_retries", "Reads repeated after damage.", |station| {
        Some(station.exchanges.retries)
    }),
    counter(
        "drive_late",
        "Valid frames of the drive that came after their request had timed out.",
        |station| Some(station.damage.late),
    ),
    counter(
        "drive_late_beyond_limit",
        "Of these: later than the longest lateness that is declared.",
        |station| Some(station.damage.beyond_limit),
    ),
    counter(
        "drive_doubled",
        "Sound frames of the drive that no request explains.",
        |station| Some(station.damage.doubled),
    ),
    gauge(
        "drive_bad",
        "Bad ones of the last 100 exchanges; absent while too few were seen.",
        |station: &StationReport| {
            station
                .bad_per_cent
                .map(|per_cent| f64::from(per_cent) / 100.0)
        },
    )
    .in_unit("ratio"),
    gauge(
        "drive_suspended",
        "1 while run orders and higher setpoints are refused for the drive.",
        |station| truth(station.is_suspended),
    ),
];

/// Its replies; labels `line`, `drive` and `class`.
pub(in super::super) const REPLIES: &[MetricFamily<ReplyReport>] = &[
    gauge(
        "drive_reply_timeout",
        "How long the start of a reply is waited for.",
        |reply: &ReplyReport| seconds(reply.timeout),
    )
    .in_unit("seconds"),
    gauge(
        "drive_reply_times",
        "Replies that the reply times rest on.",
        |reply: &ReplyReport| Some(f64::from(reply.count)),
    ),
];

/// From the end of a request to the start of its reply; labels as those, and `share`: the share of all that took no
/// longer, 1 for the longest.
pub(in super::super) const REPLY_TIME: MetricName = plain(
    "drive_reply_time",
    Some("seconds"),
    "From the end of a request to the start of its reply.",
);

/// How a quantile is taken.
type Quantile = (&'static str, fn(&ReplyReport) -> Duration);

/// The quantiles of [`REPLY_TIME`].
pub(in super::super) const QUANTILES: [Quantile; 5] = [
    ("0.5", |reply| reply.p50),
    ("0.9", |reply| reply.p90),
    ("0.99", |reply| reply.p99),
    ("0.999", |reply| reply.p999),
    ("1", |reply| reply.max),
];

/// All its reply times, in buckets; labels as those.
pub(in super::super) const REPLY: MetricName = MetricName {
    name: "drive_reply",
    unit: Some("seconds"),
    help: "From the end of a request to the start of its reply, all since the start in buckets.",
    kind: MetricType::Histogram,
};

/// Outcomes of attempts to command each drive; labels `line`, `drive`, `source` and `outcome`.
pub(in super::super) const COMMANDS: MetricName = MetricName {
    name: "drive_outcomes",
    unit: None,
    help: "Attempts to command or to write that have ended; sources of none are absent.",
    kind: MetricType::Counter,
};

/// Each drive; labels `line` and `drive`. Metrics of control exist only for drives with a control section.
pub(in super::super) static DRIVE: LazyLock<Vec<MetricFamily<DriveView>>> = LazyLock::new(|| {
    let of_drive = flags(FlagGroup::Drive);
    let of_control = flags(FlagGroup::Control);
    [of_drive, STATE.to_vec(), of_control, CONTROL.to_vec()].concat()
});

/// The flags of a group.
fn flags(group: FlagGroup) -> Vec<MetricFamily<DriveView>> {
    let flags = FLAGS.iter().filter(|flag| flag.group == group);
    let families = flags.filter_map(|flag| {
        let (name, help) = flag.metric?;
        Some(MetricFamily {
            name: plain(name, None, help),
            sample: MetricSample::Flag(flag.read),
        })
    });
    families.collect()
}

/// What is read and counted of each drive.
const STATE: &[MetricFamily<DriveView>] = &[
    gauge(
        "drive_run_state",
        "0 unknown, 1 stopped, 2 forward, 3 reverse, 4 tripped, 5 offline, 6 running, 7 stopping.",
        |view| Some(f64::from(shown::run_state(view).number())),
    ),
    counter(
        "drive_trips_seen",
        "Trips that this process has seen.",
        |view| Some(u64::from(view.trip.seen)),
    ),
    counter(
        "drive_energy",
        "Energy that the drive has used; absent where it is not known.",
        |view: &DriveView| {
            view.usage
                .parts
                .energy
                .map(|_| view.usage.totals.energy_mj / 1000)
        },
    )
    .in_unit("joules"),
    counter(
        "drive_running",
        "Time in which the motor ran.",
        |view: &DriveView| {
            view.usage
                .parts
                .has(UsagePart::RunningHours)
                .then_some(view.usage.totals.running.as_secs())
        },
    )
    .in_unit("seconds"),
    counter(
        "drive_starts",
        "How often the motor began to run.",
        |view| {
            view.usage
                .parts
                .has(UsagePart::Starts)
                .then(|| u64::from(view.usage.totals.starts))
        },
    ),
    counter(
        "drive_trips",
        "Trips, including those that earlier processes have seen.",
        |view| {
            view.usage
                .parts
                .has(UsagePart::Trips)
                .then(|| u64::from(view.usage.totals.trips))
        },
    ),
    gauge(
        "drive_trip_active",
        "1 while a trip holds; absent while that is not known.",
        |view| truth(view.trip.active?),
    ),
    gauge(
        "drive_trip_code",
        "The vendor's number of the newest trip; absent without one that is known.",
        |view| view.trip_kept.last_code.map(f64::from),
    ),
    gauge(
        "drive_watchdog_in_order",
        "1 while the drive's own watchdog is known to be on and to fit; for models with one.",
        |view| truth(view.watchdog?.is_in_order()),
    ),
    gauge(
        "drive_watchdog",
        "Time of the drive's own watchdog, 0 while it is off; absent while that is not known.",
        |view: &DriveView| {
            let watchdog = view
                .watchdog
                .filter(|watchdog| watchdog.state != WatchdogState::Unknown)?;
            seconds(watchdog.time.unwrap_or_default())
        },
    )
    .in_unit("seconds"),
    gauge(
        "drive_registers_refused",
        "Polled registers that the drive refuses to show.",
        |view| u32::try_from(view.refused.len()).ok().map(f64::from),
    ),
];

/// What is known of control beside the flags.
const CONTROL: &[MetricFamily<DriveView>] = &[
    gauge(
        "drive_failsafe_stage",
        "How far it has come: 0 none, 1 due, 2 sent, 3 effective, 4 not needed, 5 given up.",
        |view| {
            let run = view.control.as_ref()?.failsafe;
            Some(run.map_or(0.0, |run| f64::from(1 + run.stage as u8)))
        },
    ),
    gauge(
        "drive_commander_lost",
        "1 while that action's cause is a commander that was lost.",
        |view| {
            of_control(view, |control| {
                control
                    .failsafe
                    .is_some_and(|run| run.cause.is_lost_commander())
            })
        },
    ),
    gauge(
        "drive_lease_held",
        "1 while a client holds control.",
        |view| of_control(view, |control| control.lease.is_some()),
    ),
    counter(
        "drive_commands",
        "Commands so far; it wraps at 65536, as the register does.",
        |view| Some(u64::from(view.control.as_ref()?.commands)),
    ),
];

/// Whether it warns; labels `line` and `drive`.
pub(in super::super) const WARNING: MetricName = plain(
    "drive_warning_active",
    None,
    "1 while the drive shows a warning; absent while that is not known, and for models without warnings.",
);

/// The output frequency as the drive reports it, while it is fresh; labels `line` and `drive`.
pub(in super::super) const OUTPUT_FREQUENCY: MetricName = plain(
    "drive_output_frequency",
    Some("hertz"),
    "Output frequency; absent while it is stale.",
);

/// Every other polled register, while it is fresh; labels `line`, `drive`, `name` and `unit`.
pub(in super::super) const VALUE: MetricName = plain(
    "drive_value",
    None,
    "Polled registers in their units; absent while stale.",
);

/// Age of its values; labels `line` and `drive`.
pub(in super::super) const VALUE_AGE: MetricName = plain(
    "drive_value_age",
    Some("seconds"),
    "Age of the oldest fast value now; absent while one was never read.",
);

fn of_control(view: &DriveView, what: fn(&ControlView) -> bool) -> Option<f64> {
    view.control
        .as_ref()
        .and_then(|control| truth(what(control)))
}
