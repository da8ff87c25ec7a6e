//! The view of one drive for the north interfaces. It is replaced as a whole whenever something changes.

use super::plan::RefusedRegister;
use super::sight::SightView;
use super::snapshot::{DrivePresence, DriveSnapshot};
use super::status::UndocumentedState;
use super::usage::UsageView;
use super::watchdog::WatchdogView;
use crate::domain::address::Address;
use crate::domain::command::{Owner, Report, RunIntent};
use crate::domain::control::BusFunctions;
use crate::domain::fail_safe::FailSafeRun;
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use std::time::Duration;

/// Everything about one drive that can be shown. It is created by the line and never modified.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DriveView {
    /// Whether the line's port is open.
    pub line_is_up: bool,
    /// Presence and the last reading of each polled register.
    pub snapshot: DriveSnapshot,
    /// The run state.
    pub run_state: RunState,
    /// What was last seen of it, while it is out of sight.
    pub sight: SightView,
    /// Its status flags.
    pub status: StatusView,
    /// Trips, as currently known.
    pub trip: TripView,
    /// Trips that are stored in the journal.
    pub trip_kept: KeptTrips,
    /// Control; `None` if the drive has no control section.
    pub control: Option<ControlView>,
    /// The drive's own watchdog; `None` if the model has none.
    pub watchdog: Option<WatchdogView>,
    /// What it has used.
    pub usage: UsageView,
    /// Registers that it refuses to show, although its model says that it has them.
    pub refused: Vec<RefusedRegister>,
    /// What was ordered of it, for those who answer reads from memory.
    pub orders: OrdersView,
}

/// Orders and writes for a drive. What was read before the last of them may show a state that they have ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OrdersView {
    /// How many the line has taken, wrapping; renewals of a lease are none.
    pub taken: u64,
    /// When the last one was taken, or the last write was over; `None` while one is in progress.
    pub settled_at: Option<MonoTime>,
}

impl DriveView {
    /// Whether the drive is reachable: its line is up and it answers.
    #[must_use]
    pub fn is_online(&self) -> bool {
        self.line_is_up && self.snapshot.presence == DrivePresence::Online
    }
}

/// Status flags; each is `None` if the model has no such flag or it has not been read yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StatusView {
    /// Run commands are taken from the bus.
    pub bus_run: Option<bool>,
    /// The frequency is taken from the bus.
    pub bus_frequency: Option<bool>,
    /// The drive reports an alarm but keeps running.
    pub alarm: Option<bool>,
    /// The drive is ready to run.
    pub ready: Option<bool>,
    /// The word that a status register holds and no document names.
    pub undocumented: Option<UndocumentedState>,
}

impl StatusView {
    /// The flags, where only the functions of `bus` are meant to come over the bus: where other functions come from is
    /// no concern, so `None`.
    #[must_use]
    pub const fn of(self, bus: BusFunctions) -> Self {
        Self {
            bus_run: if bus.has_run() { self.bus_run } else { None },
            bus_frequency: if bus.has_frequency() {
                self.bus_frequency
            } else {
                None
            },
            ..self
        }
    }

    /// Whether panel or terminals give the run commands or the frequency; `None` if not known.
    #[must_use]
    pub const fn is_local(&self) -> Option<bool> {
        match (self.bus_run, self.bus_frequency) {
            (None, None) => None,
            (Some(false), _) | (_, Some(false)) => Some(true),
            _ => Some(false),
        }
    }
}

/// The run state of a drive. Uniform word 2 holds its number.
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
    /// The drive does not answer, or its line is down.
    Offline = 5,
    /// Running, direction not known.
    Running = 6,
    /// Stopping: ordered to stop, output not yet at zero.
    Stopping = 7,
}

impl RunState {
    /// The word used in topics.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
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

    /// The number used in uniform word 2.
    #[must_use]
    pub const fn number(self) -> u16 {
        self as u16
    }

    /// The state called `word` in topics; `None` if there is none.
    #[must_use]
    pub fn from_word(word: &str) -> Option<Self> {
        let all = [
            Self::Unknown,
            Self::Stopped,
            Self::Forward,
            Self::Reverse,
            Self::Tripped,
            Self::Offline,
        ];
        all.into_iter()
            .chain([Self::Running, Self::Stopping])
            .find(|state| state.keyword() == word)
    }

    /// Whether the output is known to be active.
    #[must_use]
    pub const fn is_running(self) -> bool {
        matches!(
            self,
            Self::Forward | Self::Reverse | Self::Running | Self::Stopping
        )
    }
}

/// What is known of a drive's trips.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TripView {
    /// Whether a trip is active; `None` while that is not known.
    pub active: Option<bool>,
    /// Trips as the drive counts them; `None` before the first reading.
    pub count: Option<u16>,
    /// Trips that this process has seen.
    pub seen: u32,
    /// The newest trip that this process has seen.
    pub last: Option<TripRecord>,
}

/// The stored trips of a drive: what is shown of them outlives the process. Without a journal: the trips known now.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KeptTrips {
    /// Trips as the drive counted them at that time.
    pub count: Option<u16>,
    /// Stored trips, including those of earlier runs of the gateway.
    pub total: u32,
    /// The newest trip of this run.
    pub last: Option<TripRecord>,
    /// The vendor's number of the newest trip of all runs.
    pub last_code: Option<u16>,
}

/// The record read after a trip.
#[derive(Clone, Debug, PartialEq)]
pub struct TripRecord {
    /// When it was seen.
    pub at: MonoTime,
    /// The vendor's number of the cause; `None` if the record could not be read.
    pub code: Option<u16>,
    /// The words of the record by the names of their registers, each with its scale and unit in the model.
    pub words: Vec<(Address, u16)>,
}

/// A trip or its clearing.
#[derive(Clone, Debug, PartialEq)]
pub struct TripEvent {
    /// What happened.
    pub kind: TripEventKind,
    /// The drive's own count afterwards, if known.
    pub count: Option<u16>,
    /// When it was seen.
    pub at: MonoTime,
    /// The trip happened while the drive was not polled or offline, and was detected at the start or on its return.
    pub while_away: bool,
}

/// What happened.
#[derive(Clone, Debug, PartialEq)]
pub enum TripEventKind {
    /// Trips since the last reading (more than one if they happen faster than the polls), the newest with its record.
    Tripped {
        /// How many, at least 1.
        trips: u16,
        /// The newest record.
        record: TripRecord,
    },
    /// The trip is no longer active.
    Cleared,
}

/// Who controls a drive and what is ordered.
///
/// The default is a drive that no client has commanded yet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ControlView {
    /// Who holds control, and when the lease expires without a heartbeat.
    pub lease: Option<(Owner, MonoTime)>,
    /// What is ordered: uniform word 256.
    pub intent: RunIntent,
    /// The last accepted setpoint: uniform word 257.
    pub setpoint: Option<Hertz>,
    /// RUN is refused until stop and then run are commanded.
    pub start_inhibited: bool,
    /// A command is in progress or a stop is not effective yet.
    pub command_pending: bool,
    /// A stop that is not effective yet.
    pub stop_pending: bool,
    /// A stop had no effect in time.
    pub not_effective: bool,
    /// The declared action that fell due since the last RUN, and how far it has come.
    pub failsafe: Option<FailSafeRun>,
    /// The output was seen outside the limits or far from the setpoint, and not right since.
    pub output_outside: bool,
    /// The drive has stopped following its last order to run, without an order from here.
    pub stopped_elsewhere: bool,
    /// New at every connect to the broker and at every stop.
    pub epoch: u64,
    /// The last command's report.
    pub last: Option<Report>,
    /// Commands so far, wrapping.
    pub commands: u16,
    /// Set if a client keeps stopping the drive although it is started from elsewhere.
    pub stopped_again: Option<StoppedAgain>,
}

/// A client keeps stopping a drive that is started from elsewhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoppedAgain {
    /// The client.
    pub by: Owner,
    /// Number of consecutive stops.
    pub times: u16,
    /// When the last one happened.
    pub at: MonoTime,
}

impl StoppedAgain {
    /// Number of consecutive stops from which they are reported.
    pub const TOLD_FROM: u16 = 3;
    /// After this time without one the count restarts.
    pub const WITHIN: Duration = Duration::from_secs(60);
}
