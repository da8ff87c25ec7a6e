//! Metrics of lines.

use super::{MetricFamily, counter, gauge, seconds, sum, truth};
use crate::daemon::exchange::shared::SharedLine;
use crate::domain::report::{LineReport, LineState};
use crate::domain::standby::LineRole;

/// Each line; label `line`.
pub(in super::super) const LINE: &[MetricFamily<LineReport>] = &[
    gauge(
        "line_up",
        "1 while the line can be used: its port is open, and it is not jammed, echoing or mute.",
        |line| truth(line.state == LineState::Up),
    ),
    counter("line_requests", "Frames sent.", |line| {
        Some(line.counters.requests)
    }),
    counter("line_replies", "Right replies.", |line| {
        Some(line.counters.replies)
    }),
    counter(
        "line_exceptions",
        "Exceptions that drives answered with.",
        |line| Some(line.counters.exceptions),
    ),
    counter(
        "line_silent",
        "Time-outs without any frame from the station.",
        |line| Some(line.counters.silent),
    ),
    counter(
        "line_garbled",
        "Exchanges that ended with a damaged reply.",
        |line| Some(line.counters.garbled),
    ),
    counter(
        "line_strays",
        "Frames of the asked station that were not the answer, late ones above all.",
        |line| Some(line.counters.strays),
    ),
    counter(
        "line_foreign",
        "Sound frames from stations that were not asked.",
        |line| Some(line.counters.foreign),
    ),
    counter(
        "line_other_master",
        "Requests of another master on the line.",
        |line| Some(line.counters.other_master),
    ),
    counter("line_echoes", "Frames of ours that came back.", |line| {
        Some(line.counters.echoes)
    }),
    counter("line_jams", "Times the line was jammed.", |line| {
        Some(line.counters.jams)
    }),
    gauge(
        "line_bad",
        "Bad ones of the last 100 exchanges; absent while too few were seen.",
        |line: &LineReport| {
            line.quality
                .bad_per_cent
                .map(|per_cent| f64::from(per_cent) / 100.0)
        },
    )
    .in_unit("ratio"),
    gauge(
        "line_suspended",
        "1 while run orders and higher setpoints are refused for all drives of the line.",
        |line| truth(line.quality.is_suspended),
    ),
    gauge(
        "line_suspicion",
        "1 while something is probably wrong with the line; `health --json` says what.",
        |line| truth(line.suspicion.is_some()),
    ),
    counter(
        "line_noise",
        "Bytes that made no frame.",
        |line: &LineReport| Some(line.counters.noise_bytes),
    )
    .in_unit("bytes"),
    counter(
        "line_noise_between",
        "Times that such bytes came while no reply was waited for.",
        |line| Some(line.counters.noise_between),
    ),
    counter("line_retries", "Reads repeated after damage.", |line| {
        Some(line.counters.retries)
    }),
    counter(
        "line_barriers",
        "Exchanges sent only to prove that no late reply can follow.",
        |line| Some(line.counters.barriers),
    ),
    counter(
        "line_broadcasts",
        "Stops sent to all drives of the line in one frame.",
        |line| Some(line.counters.broadcasts),
    ),
    counter(
        "line_joined",
        "Native reads that joined an exchange of another client.",
        |line| Some(line.counters.joined),
    ),
    counter(
        "line_queue_full",
        "Native requests refused because a queue was full.",
        |line| Some(line.counters.queue_full),
    ),
    counter(
        "line_expired",
        "Native requests whose deadline passed in the queue.",
        |line| Some(line.counters.expired),
    ),
    counter(
        "line_withdrawn",
        "Commands that were not sent because the client who gave them was gone.",
        |line| Some(line.counters.withdrawn),
    ),
    counter("line_port_ups", "Times the port was opened.", |line| {
        Some(line.counters.port_ups)
    }),
    sum(
        "line_busy",
        "Time in which an exchange was open.",
        |line: &LineReport| Some(line.counters.busy_us as f64 / 1e6),
    )
    .in_unit("seconds"),
    counter("line_port_downs", "Times the port was lost.", |line| {
        Some(line.counters.port_downs)
    }),
    gauge(
        "line_planned_use",
        "Part of the line's time that its polls would take if each came in time.",
        |line: &LineReport| Some(f64::from(line.planned_use_per_mille) / 1000.0),
    )
    .in_unit("ratio"),
    gauge(
        "line_stop_bound_healthy",
        "Longest wait of a stop while every drive answers.",
        |line: &LineReport| seconds(line.stop.all_healthy),
    )
    .in_unit("seconds"),
    gauge(
        "line_stop_bound",
        "Longest wait of a stop with a drive that does not answer.",
        |line: &LineReport| seconds(line.stop.one_silent),
    )
    .in_unit("seconds"),
    gauge(
        "line_stop_bound_further",
        "What each further stop at the same time adds to that.",
        |line: &LineReport| seconds(line.stop.each_further),
    )
    .in_unit("seconds"),
    gauge(
        "line_stop_longest",
        "Longest wait of a stop so far, for its first bit.",
        |line: &LineReport| seconds(line.measured.longest_stop),
    )
    .in_unit("seconds"),
    gauge(
        "line_gap_shortest",
        "Least time before a frame beyond the silence that is due.",
        |line: &LineReport| seconds(line.measured.shortest_gap?),
    )
    .in_unit("seconds"),
    gauge(
        "line_gap_median",
        "Median of those times over the newest frames.",
        |line: &LineReport| seconds(line.measured.median_gap),
    )
    .in_unit("seconds"),
    gauge(
        "line_waiting_requests",
        "Native requests without an answer, those on the wire included.",
        |line| Some(line.waiting.requests as f64),
    ),
    gauge(
        "line_waiting_commands",
        "Commands that have not ended, stops not among them.",
        |line| Some(line.waiting.commands as f64),
    ),
    gauge(
        "line_waiting_stops",
        "Drives whose stop is not effective yet.",
        |line| Some(line.waiting.stops as f64),
    ),
    gauge(
        "line_active",
        "1 while this gateway sends on the line, 0 while it only listens; absent where it is alone.",
        |line| truth(line.standby?.role == LineRole::Active),
    ),
    gauge(
        "line_hears_other",
        "1 while another gateway or master is heard on the line; absent where it is alone.",
        |line| truth(line.standby?.hears_other),
    ),
    gauge(
        "line_listener",
        "1 while another gateway is ready to take the line over from this one, 0 while none answers; absent where this one \
         does not send, or does not know.",
        |line| truth(line.standby?.listener?),
    ),
    gauge(
        "line_deaf",
        "1 while this gateway hears no sound frame although it should; absent where it is alone.",
        |line| truth(line.standby?.trouble.is_deaf),
    ),
    gauge(
        "line_files_differ",
        "1 while the other gateway of the line has other drives, limits or declared actions there, or talks to a station that \
         this one lacks; absent where it is alone.",
        |line| {
            truth(
                line.standby
                    .map(|it| it.trouble.files_differ || it.trouble.unknown_station.is_some())?,
            )
        },
    ),
    counter(
        "line_take_overs",
        "Times that this gateway took the line over.",
        |line| Some(line.standby?.take_overs),
    ),
    counter(
        "line_given_up",
        "Times that this gateway gave the line up.",
        |line| Some(line.standby?.given_up),
    ),
    counter(
        "line_rivals",
        "Times that another master was heard while this gateway was active.",
        |line| Some(line.standby?.rivals),
    ),
];

/// The thread of each line; label `line`.
pub(in super::super) const THREAD: &[MetricFamily<SharedLine>] = &[gauge(
    "line_hangs",
    "1 while the line's thread hangs: no stop leaves on it then.",
    |line| truth(line.hangs()),
)];
