//! States and counters that log, page, metrics and topics share. Plain numbers, no clock.

use super::counts::{CommandCounts, DamageCounts, ExchangeCounts, ReplyCounts};
use super::suspicion::Suspicion;
use std::time::Duration;

/// Whether a line can be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LineState {
    /// The port is open and the line is usable.
    Up,
    /// The port is closed or gone, or nothing can be asked over it: the fault says why.
    Down,
}

/// Why a line is down.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum LineFault {
    /// The device reported its end: unplugged, or the other side of a pseudo-terminal closed.
    #[error("the device is gone")]
    Gone,
    /// Reading or writing failed.
    #[error("reading or writing failed")]
    Failed,
    /// The device took no more bytes although the line should long have been free.
    #[error("the device takes no bytes")]
    Stuck,
    /// The port takes all bytes, and nothing has come back for long, from no drive: the adapter is half open, its cable is
    /// cut, or everything on the line is switched off. The port stays in use and is opened anew at times.
    #[error("nothing is heard: every drive is silent, or the adapter is cut off from the line")]
    Mute,
    /// What is sent comes back, and the configuration does not say that this may be.
    #[error("the adapter sends back what is sent: switch its echo off, or say `echo = \"strip\"`")]
    Echo,
    /// Something on the line never stops talking. Only stops are still tried.
    #[error("jammed: something on the line never stops talking")]
    Jammed,
}

/// One line as the north sides show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineReport {
    /// Whether it can be used.
    pub state: LineState,
    /// Why it was down last; nothing if it never was.
    pub fault: Option<LineFault>,
    /// What was counted.
    pub counters: LineCounters,
    /// How long a stop may have to wait.
    pub stop: StopBounds,
    /// Thousandths of the line's time that its polls would take if each came in time: 1000 is all of it.
    pub planned_use_per_mille: u32,
    /// What was measured.
    pub measured: LineMeasured,
    /// How good it is.
    pub quality: LineQuality,
    /// What is probably wrong with it.
    pub suspicion: Option<Suspicion>,
    /// What waits to go over it.
    pub waiting: LineWaiting,
}

/// What waits to go over a line, in numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineWaiting {
    /// Native requests without an answer, those on the wire included.
    pub requests: usize,
    /// Commands that have not ended.
    pub commands: usize,
    /// Drives whose stop is not effective yet.
    pub stops: usize,
}

/// How good a line is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineQuality {
    /// Bad ones of the last 100 exchanges, in per cent; nothing while too few have been seen.
    pub bad_per_cent: Option<u8>,
    /// Run orders and higher setpoints are refused for all its drives.
    pub is_suspended: bool,
}

impl Default for LineReport {
    fn default() -> Self {
        Self {
            state: LineState::Down,
            fault: None,
            counters: LineCounters::default(),
            stop: StopBounds::default(),
            planned_use_per_mille: 0,
            measured: LineMeasured::default(),
            quality: LineQuality::default(),
            suspicion: None,
            waiting: LineWaiting::default(),
        }
    }
}

/// Longest times from the acceptance of a stop for one drive to its first bit, while the line is open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StopBounds {
    /// While every drive answers within what its documents say.
    pub all_healthy: Duration,
    /// With a drive that does not answer.
    pub one_silent: Duration,
    /// What each further stop at the same time adds for the last of them, while every drive answers.
    pub each_further: Duration,
}

/// What was measured on one line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineMeasured {
    /// Longest time so far from the acceptance of a stop to its first bit, while the line was open.
    pub longest_stop: Duration,
    /// Least time before a frame of ours beyond the silence that is due; nothing before the first frame.
    pub shortest_gap: Option<Duration>,
    /// The median of those times over the newest frames. On a line with little to do it is long.
    pub median_gap: Duration,
}

/// One drive as its line sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StationReport {
    /// How long its replies take to reads, writes, and writes of stored registers.
    pub replies: [ReplyReport; 3],
    /// The oldest that one of its fast values has become within the last minute or two.
    pub oldest_age: Duration,
    /// The oldest that one becomes by plan; nothing if it has none.
    pub planned_age: Option<Duration>,
    /// How the exchanges with it ended.
    pub exchanges: ExchangeCounts,
    /// What was wrong with what came from it.
    pub damage: DamageCounts,
    /// All its reply times, in the order of `replies`.
    pub reply_counts: [ReplyCounts; 3],
    /// What became of attempts to command it or to write to it.
    pub commands: CommandCounts,
    /// Bad ones of the last 100 exchanges with it, in per cent; nothing while too few have been seen.
    pub bad_per_cent: Option<u8>,
    /// Run orders and higher setpoints are refused for it, because of it or of its line.
    pub is_suspended: bool,
}

/// Names of the classes of requests, in the order of [`StationReport::replies`].
pub const REPLY_CLASSES: [&str; 3] = ["read", "write", "stored_write"];

/// How long the replies to one class of requests take, from the end of the request to the start of the reply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReplyReport {
    /// How many replies this rests on; older ones fade. With 0 the times mean nothing.
    pub count: u16,
    /// Half of them took no longer.
    pub p50: Duration,
    /// Nine of ten.
    pub p90: Duration,
    /// All but one in a hundred.
    pub p99: Duration,
    /// All but one in a thousand.
    pub p999: Duration,
    /// The longest.
    pub max: Duration,
    /// How long a reply is waited for now.
    pub timeout: Duration,
    /// How long it would be waited for if that followed from these times, whatever is configured; nothing while there are
    /// too few of them.
    pub suggested: Option<Duration>,
}

/// Counts of one line since start. They only rise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineCounters {
    /// Frames sent.
    pub requests: u64,
    /// Right replies.
    pub replies: u64,
    /// Exceptions that drives answered with.
    pub exceptions: u64,
    /// Time-outs without any frame from the station.
    pub silent: u64,
    /// Exchanges that ended with a damaged reply.
    pub garbled: u64,
    /// Frames of the asked station that were not the answer: late ones above all.
    pub strays: u64,
    /// Sound frames of stations that were not asked.
    pub foreign: u64,
    /// Requests of somebody else.
    pub other_master: u64,
    /// Frames of ours that came back.
    pub echoes: u64,
    /// Bytes that made no frame.
    pub noise_bytes: u64,
    /// Times that such bytes came while no reply was waited for.
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
    /// Commands that were not sent because the client who gave them was gone.
    pub withdrawn: u64,
    /// Times the port was opened.
    pub port_ups: u64,
    /// Times the port was lost.
    pub port_downs: u64,
    /// Times the line was jammed.
    pub jams: u64,
    /// Microseconds in which an exchange was open: its rise over a span is the use of the line in that span.
    pub busy_us: u64,
}
