//! What the north sides see of one drive: a picture that is replaced as a whole whenever something changes.

use super::snapshot::{DriveSnapshot, Presence};
use super::watchdog::WatchdogView;
use crate::domain::command::{Owner, Report, RunIntent};
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use std::time::Duration;

/// Everything about one drive that can be shown. It is made by the line and never changed by anybody else.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DriveView {
    /// Whether the line's port is open.
    pub line_is_up: bool,
    /// Presence and the last reading of each polled register.
    pub snapshot: DriveSnapshot,
    /// What the drive does, as far as it is known.
    pub run_state: RunState,
    /// What its status registers tell.
    pub status: StatusView,
    /// Trips, counted and read, as they are now.
    pub trip: TripView,
    /// Trips as far as they are kept.
    pub trip_kept: KeptTrips,
    /// Control; nothing if the drive has no control section.
    pub control: Option<ControlView>,
    /// The drive's own watchdog; nothing where the model has none.
    pub watchdog: Option<WatchdogView>,
}

impl DriveView {
    /// Whether the drive can be asked: its line is up and it answers.
    #[must_use]
    pub fn is_online(&self) -> bool {
        self.line_is_up && self.snapshot.presence == Presence::Online
    }
}

/// What the status registers tell; nothing in each where the model has no such flag or it was not read yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StatusView {
    /// Run commands are taken from the bus.
    pub bus_run: Option<bool>,
    /// The frequency is taken from the bus.
    pub bus_frequency: Option<bool>,
    /// Something is not as it should be, and the drive goes on.
    pub alarm: Option<bool>,
    /// The drive would run if it were ordered to.
    pub ready: Option<bool>,
}

impl StatusView {
    /// Whether the drive obeys somebody else: panel or terminals give its run commands or its frequency.
    #[must_use]
    pub const fn is_local(&self) -> Option<bool> {
        match (self.bus_run, self.bus_frequency) {
            (None, None) => None,
            (Some(false), _) | (_, Some(false)) => Some(true),
            _ => Some(false),
        }
    }
}

/// What a drive does. The number stands in uniform word 2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum RunState {
    /// Not known.
    #[default]
    Unknown = 0,
    /// At standstill.
    Stopped = 1,
    /// Running forward.
    Forward = 2,
    /// Running in reverse.
    Reverse = 3,
    /// Tripped.
    Tripped = 4,
    /// It does not answer, or its line is down.
    Offline = 5,
    /// Running, direction not known.
    Running = 6,
    /// Stopping: ordered to stop, output not yet at zero.
    Stopping = 7,
}

impl RunState {
    /// The word as it stands in topics.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Stopped => "stopped",
            Self::Forward => "forward",
            Self::Reverse => "reverse",
            Self::Tripped => "tripped",
            Self::Offline => "offline",
            Self::Running => "running",
            Self::Stopping => "stopping",
        }
    }

    /// The number as it stands in uniform word 2.
    #[must_use]
    pub const fn number(self) -> u16 {
        self as u16
    }

    /// Whether the output is known to be active.
    #[must_use]
    pub const fn is_running(self) -> bool {
        matches!(self, Self::Forward | Self::Reverse | Self::Running | Self::Stopping)
    }
}

/// What is known of a drive's trips.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TripView {
    /// Whether a trip holds now; nothing while that is not known.
    pub active: Option<bool>,
    /// Trips as the drive counts them; nothing before the first reading.
    pub count: Option<u16>,
    /// Trips that this process has seen.
    pub seen: u32,
    /// The newest trip that this process has seen.
    pub last: Option<TripRecord>,
}

/// What is kept of a drive's trips: what is shown of it outlives the gateway. Without a journal it is what is known now.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KeptTrips {
    /// Trips as the drive counted them then.
    pub count: Option<u16>,
    /// Trips that are kept, those of earlier lives of the gateway included.
    pub total: u32,
    /// The newest trip of this life.
    pub last: Option<TripRecord>,
    /// The vendor's number of the newest trip of all.
    pub last_code: Option<u16>,
}

/// What was read after a trip.
#[derive(Clone, Debug, PartialEq)]
pub struct TripRecord {
    /// When it was seen.
    pub at: MonoTime,
    /// The vendor's number of the cause; nothing if the record could not be read.
    pub code: Option<u16>,
    /// The words of the record by the names of their registers, each with its scale and unit in the model.
    pub words: Vec<(u16, u16)>,
}

/// A trip or its clearing, in the order in which they happen.
#[derive(Clone, Debug, PartialEq)]
pub struct TripEvent {
    /// What happened.
    pub kind: TripEventKind,
    /// The drive's own count afterwards, if known.
    pub count: Option<u16>,
    /// When it was seen.
    pub at: MonoTime,
    /// It happened while the drive was not seen: it was found at the start, or when the drive was back.
    pub while_away: bool,
}

/// What happened.
#[derive(Clone, Debug, PartialEq)]
pub enum TripEventKind {
    /// So many trips since the last reading (more than one if they came faster than the polls), the newest with
    /// its record.
    Tripped {
        /// How many, at least 1.
        trips: u16,
        /// The newest record.
        record: TripRecord,
    },
    /// The trip holds no more.
    Cleared,
}

/// Who controls a drive and what is ordered.
///
/// The default is a drive that nobody has commanded yet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ControlView {
    /// Who holds control, and until when without a sign of life.
    pub lease: Option<(Owner, MonoTime)>,
    /// What is ordered: uniform word 256.
    pub intent: RunIntent,
    /// The last accepted setpoint: uniform word 257.
    pub setpoint: Option<Hertz>,
    /// RUN is refused until stop and run were commanded anew.
    pub start_inhibited: bool,
    /// A command is on its way or a stop is not effective yet.
    pub command_pending: bool,
    /// A stop that is not effective yet.
    pub stop_pending: bool,
    /// A stop had no effect in time.
    pub not_effective: bool,
    /// The fail-safe action ran since the last RUN.
    pub failsafe: bool,
    /// New at every connect to the broker and at every stop.
    pub epoch: u64,
    /// The last command's report.
    pub last: Option<Report>,
    /// Commands so far, wrapping.
    pub commands: u16,
    /// Who stops the drive again and again although it was started elsewhere.
    pub stopped_again: Option<StoppedAgain>,
}

/// Somebody stops a drive again and again that others start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoppedAgain {
    /// Who.
    pub by: Owner,
    /// How often in a row.
    pub times: u16,
    /// When the last time.
    pub at: MonoTime,
}

impl StoppedAgain {
    /// So many in a row are told.
    pub const TOLD_FROM: u16 = 3;
    /// After so long without one the next is the first again.
    pub const WITHIN: Duration = Duration::from_secs(60);
}
