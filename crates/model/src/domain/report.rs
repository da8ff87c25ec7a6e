//! States and counters shared by log, page, metrics and topics. Plain numbers, no clock.

use super::counts::{CommandCounts, DamageCounts, ExchangeCounts, ReplyCounts};
use super::standby::StandbyReport;
use super::suspicion::LineSuspicion;
use std::sync::Arc;
use std::time::Duration;

/// Whether a line can be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LineState {
    /// The port is open and the line is usable.
    Up,
    /// The port is closed or gone, or unusable: the fault says why.
    Down,
}

/// Why a line is down.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum LineFault {
    /// The device reported end of file: unplugged, or the other side of a pseudo-terminal was closed.
    #[error("the device is gone")]
    Gone,
    /// Reading or writing failed.
    #[error("reading or writing failed")]
    Failed,
    /// The device accepted no more bytes although the line should long have been free.
    #[error("the device accepts no bytes")]
    Stuck,
    /// The port accepts all bytes, but no drive has answered for long: the adapter is half open, its cable is cut, or
    /// everything on the line is switched off. The port stays in use and is reopened from time to time.
    #[error(
        "nothing received: every drive is silent, or the adapter is disconnected from the line"
    )]
    Mute,
    /// The adapter echoes what is sent, and the configuration does not allow that.
    #[error("the adapter echoes what is sent: switch its echo off, or set `echo = \"strip\"`")]
    Echo,
    /// What is received is no stream of Modbus TCP messages. The connection is closed and opened again.
    #[error("out of step: what the peer sends is not a Modbus TCP message")]
    OutOfStep,
    /// Something on the line sends without a pause. Only stops are still tried.
    #[error("jammed: something on the line never stops sending")]
    Jammed,
}

impl LineFault {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Gone,
        Self::Failed,
        Self::Stuck,
        Self::Mute,
        Self::Echo,
        Self::OutOfStep,
        Self::Jammed,
    ];

    /// The machine-readable name.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Gone => "gone",
            Self::Failed => "failed",
            Self::Stuck => "stuck",
            Self::Mute => "mute",
            Self::Echo => "echo",
            Self::OutOfStep => "out_of_step",
            Self::Jammed => "jammed",
        }
    }
}

/// One line as the north interfaces show it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LineReport {
    /// Whether it can be used.
    pub state: LineState,
    /// Why it was last down; `None` if it never was.
    pub fault: Option<LineFault>,
    /// Why its port cannot be opened now, with the name of the port; `None` while it is open.
    pub open_error: Option<Arc<str>>,
    /// Its counters.
    pub counters: LineCounters,
    /// Upper bounds of how long a stop waits.
    pub stop: StopBounds,
    /// Thousandths of the line's time that its polls would take if each was on time: 1000 is all of it.
    pub planned_use_per_mille: u32,
    /// Measured times.
    pub measured: LineMeasured,
    /// How good it is.
    pub quality: LineQuality,
    /// What is probably wrong with it.
    pub suspicion: Option<LineSuspicion>,
    /// What is waiting to be sent.
    pub waiting: LineWaiting,
    /// Its role among several gateways; `None` if it is the only one.
    pub standby: Option<StandbyReport>,
}

impl LineReport {
    /// Why it cannot be used; `None` if it can.
    #[must_use]
    pub fn down_reason(&self) -> Option<String> {
        match (self.state, &self.open_error, self.fault) {
            (LineState::Up, ..) => None,
            (LineState::Down, Some(error), _) => Some(error.to_string()),
            (LineState::Down, None, Some(fault)) => Some(fault.to_string()),
            (LineState::Down, None, None) => Some("not opened yet".to_owned()),
        }
    }
}

/// How much is waiting to be sent on a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineWaiting {
    /// Unanswered native requests, including those on the wire.
    pub requests: usize,
    /// Commands without a final outcome.
    pub commands: usize,
    /// Drives whose stop is not effective yet.
    pub stops: usize,
}

/// How good a line is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineQuality {
    /// Per cent of bad exchanges among the last 100; `None` while there are too few.
    pub bad_per_cent: Option<u8>,
    /// Whether run orders and higher setpoints are refused for all its drives.
    pub is_suspended: bool,
}

impl Default for LineReport {
    fn default() -> Self {
        Self {
            state: LineState::Down,
            fault: None,
            open_error: None,
            counters: LineCounters::default(),
            stop: StopBounds::default(),
            planned_use_per_mille: 0,
            measured: LineMeasured::default(),
            quality: LineQuality::default(),
            suspicion: None,
            waiting: LineWaiting::default(),
            standby: None,
        }
    }
}

/// Longest times from the acceptance of a stop for one drive to its first bit, while the line is open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StopBounds {
    /// While every drive answers within its documented time.
    pub all_healthy: Duration,
    /// With a drive that does not answer.
    pub one_silent: Duration,
    /// What each further simultaneous stop adds for the last of them, while every drive answers.
    pub each_further: Duration,
}

/// Times measured on one line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineMeasured {
    /// Longest time from the acceptance of a stop to its first bit so far, while the line was open.
    pub longest_stop: Duration,
    /// Shortest time before one of our frames in excess of the required silence; `None` before the first frame.
    pub shortest_gap: Option<Duration>,
    /// Median of those times over the newest frames. It is long on an idle line.
    pub median_gap: Duration,
}

/// One drive as its line sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StationReport {
    /// Reply times for reads, writes, and writes of stored registers.
    pub replies: [ReplyReport; 3],
    /// Maximum age of its fast values within the last minute or two.
    pub oldest_age: Duration,
    /// Maximum age of its fast values by plan; `None` if it has none.
    pub planned_age: Option<Duration>,
    /// How the exchanges with it ended.
    pub exchanges: ExchangeCounts,
    /// Damage in the data received from it.
    pub damage: DamageCounts,
    /// Cumulative reply times, in the order of `replies`.
    pub reply_counts: [ReplyCounts; 3],
    /// Outcomes of attempts to command it or to write to it.
    pub commands: CommandCounts,
    /// Per cent of bad exchanges among the last 100 with it; `None` while there are too few.
    pub bad_per_cent: Option<u8>,
    /// Whether run orders and higher setpoints are refused for it, because of it or of its line.
    pub is_suspended: bool,
}

/// Names of the classes of requests, in the order of [`StationReport::replies`].
pub const REPLY_CLASSES: [&str; 3] = ["read", "write", "stored_write"];

/// Reply times for one class of requests, from the end of the request to the start of the reply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReplyReport {
    /// Number of replies that this is based on; older ones fade. If 0, the times are meaningless.
    pub count: u16,
    /// Median.
    pub p50: Duration,
    /// 90th percentile.
    pub p90: Duration,
    /// 99th percentile.
    pub p99: Duration,
    /// 99.9th percentile.
    pub p999: Duration,
    /// The longest.
    pub max: Duration,
    /// Current reply timeout.
    pub timeout: Duration,
    /// The timeout that these times suggest, whatever is configured; `None` while there are too few of them.
    pub suggested: Option<Duration>,
}

/// Counters of one line since start. They only rise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineCounters {
    /// Frames sent.
    pub requests: u64,
    /// Valid replies.
    pub replies: u64,
    /// Exception replies of drives.
    pub exceptions: u64,
    /// Timeouts without any frame from the station.
    pub silent: u64,
    /// Exchanges that ended with a damaged reply.
    pub garbled: u64,
    /// Frames of the addressed station that were not the answer, mostly late ones.
    pub strays: u64,
    /// Sound frames of stations that were not addressed.
    pub foreign: u64,
    /// Requests of another master.
    pub other_master: u64,
    /// Frames of ours that were echoed.
    pub echoes: u64,
    /// Bytes that belong to no frame.
    pub noise_bytes: u64,
    /// How often such bytes arrived while no reply was awaited.
    pub noise_between: u64,
    /// Reads repeated after damage.
    pub retries: u64,
    /// Exchanges sent only to prove that no late reply can follow.
    pub barriers: u64,
    /// Stops sent to all drives of the line in one frame.
    pub broadcasts: u64,
    /// Native reads that joined an exchange of another client.
    pub joined: u64,
    /// Native requests refused because a queue was full.
    pub queue_full: u64,
    /// Native requests whose deadline passed in the queue.
    pub expired: u64,
    /// Commands that were not sent because their client was gone.
    pub withdrawn: u64,
    /// Times the port was opened.
    pub port_ups: u64,
    /// Times the port was lost.
    pub port_downs: u64,
    /// Times the line was jammed.
    pub jams: u64,
    /// Microseconds in which an exchange was open: the increase over a span is the use of the line in that span.
    pub busy_us: u64,
}
