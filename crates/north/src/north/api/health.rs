//! The state of the gateway, its lines and its drives.

use super::{ApiText, FailSafeDocument, LastSeenDocument, StandbyDocument};
use crate::north::titles::PlantTitles;
use serde::{Deserialize, Serialize};

/// Everything that `vfd-gateway health` shows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct HealthDocument {
    /// The name of the gateway.
    pub gateway: ApiText,
    /// The version of the program.
    pub version: ApiText,
    /// Seconds since the start.
    pub uptime_seconds: u64,
    /// Whether it is ready.
    pub ready: bool,
    /// Its lines.
    pub lines: Vec<LineHealthDocument>,
    /// Its drives.
    pub drives: Vec<DriveHealthDocument>,
    /// Its MQTT broker, if it has one.
    pub mqtt: Option<BrokerHealthDocument>,
    /// Its Sparkplug hosts, if it has any.
    pub sparkplug: Option<HostHealthDocument>,
    /// Its journal, if it has one.
    pub journal: Option<JournalHealthDocument>,
    /// Its socket, if it has one.
    pub socket: Option<SocketHealthDocument>,
    /// What people call its parts; left out if none has a title.
    #[serde(skip_serializing_if = "PlantTitles::is_empty")]
    pub titles: PlantTitles,
}

/// Why the gateway is ready or not.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReadinessDocument {
    /// Whether it is ready.
    pub ready: bool,
    /// Its lines.
    pub lines: Vec<LineHealthDocument>,
    /// Its MQTT broker, if it has one.
    pub mqtt: Option<BrokerHealthDocument>,
    /// Its Sparkplug hosts, if it has any.
    pub sparkplug: Option<HostHealthDocument>,
}

/// A line.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LineHealthDocument {
    /// Its name.
    pub name: ApiText,
    /// `up` or `down`.
    pub state: ApiText,
    /// Why it is down.
    pub reason: Option<String>,
    /// What is suspected of it.
    pub suspicion: Option<String>,
    /// The role of the gateway there, if it shares the line.
    pub standby: Option<StandbyDocument>,
}

/// A drive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DriveHealthDocument {
    /// Its name.
    pub name: ApiText,
    /// The name of its line.
    pub line: ApiText,
    /// Its model.
    pub model: ApiText,
    /// Its native unit.
    pub unit: u8,
    /// Its uniform unit.
    pub uniform_unit: u8,
    /// Whether it answers.
    pub presence: ApiText,
    /// Whether anything was read of it since the start; `None` from a version that does not tell.
    pub was_read: Option<bool>,
    /// Its run state.
    pub run_state: ApiText,
    /// Whether it is out of sight and may still run.
    pub may_still_run: bool,
    /// What was last seen of it, if it is out of sight.
    pub last_seen: Option<LastSeenDocument>,
    /// The declared action that fell due, if any.
    pub failsafe: Option<FailSafeDocument>,
    /// Whether its output is outside the limits; `None` if it is read-only.
    pub output_outside: Option<bool>,
    /// Whether it was stopped elsewhere; `None` if it is read-only.
    pub stopped_elsewhere: Option<bool>,
    /// What it warns of.
    pub warning: Option<String>,
    /// A state that no document names.
    pub undocumented_state: Option<String>,
    /// The registers that it refuses to show.
    pub refused: Vec<RefusedRegisterDocument>,
    /// The state of its own watchdog, if that is known.
    pub watchdog: Option<String>,
    /// What is accepted because it was confirmed at this very drive; `None` if it is read-only.
    pub site: Option<Vec<String>>,
}

/// A register that a drive refuses to show.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RefusedRegisterDocument {
    /// Its address.
    pub register: ApiText,
    /// Its name, if the model describes it.
    pub name: Option<String>,
    /// The exception that the drive answers with.
    pub code: u8,
    /// Whether run state or trips are read there.
    pub essential: bool,
}

/// The connection to an MQTT broker.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct BrokerHealthDocument {
    /// Whether it is connected.
    pub connected: bool,
    /// Why not.
    pub reason: Option<String>,
    /// Whether another client uses the same client identifier.
    pub contested: bool,
    /// Whether the other gateway of `[standby]` is there; `None` if there is none, or it is not known.
    pub partner_online: Option<bool>,
    /// Events that wait for the broker.
    pub events_waiting: u64,
    /// Events that the broker refused.
    pub events_refused: u64,
    /// What is not published because it is larger than the broker takes.
    pub oversized: Vec<OversizedDocument>,
    /// The topic that says that the clients of the broker are offline.
    pub clients_gone: Option<String>,
}

/// The connection to the hosts of Sparkplug.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct HostHealthDocument {
    /// Whether hosts can command: all is born, the primary host is online, and the path is proven.
    pub connected: bool,
    /// Why not.
    pub reason: Option<String>,
    /// Whether another client uses the same client identifier.
    pub contested: bool,
    /// Whether the primary host is waited for.
    pub host_awaited: bool,
    /// By how many milliseconds the clock of the primary host went back, if it did.
    pub host_behind_ms: Option<u64>,
    /// What is not published because it is larger than the broker takes.
    pub oversized: Vec<OversizedDocument>,
    /// Values that wait for a host.
    pub history_waiting: u64,
}

/// A publication that is larger than the broker takes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct OversizedDocument {
    /// Its topic.
    pub topic: ApiText,
    /// Bytes of its packet.
    pub bytes: usize,
    /// Bytes of the largest packet that the broker takes.
    pub limit: usize,
}

/// The journal.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct JournalHealthDocument {
    /// Whether rows are kept.
    pub state: ApiText,
    /// Why not.
    pub reason: Option<String>,
    /// Where a damaged journal was moved to.
    pub moved_aside: Option<String>,
    /// What happened to its file while it was open.
    pub replaced: Option<String>,
    /// Rows written since the start.
    pub rows: u64,
    /// Rows lost since the start.
    pub lost: u64,
    /// Attempts to write among them.
    pub attempts_lost: u64,
    /// Rows that wait to be written.
    pub waiting: u64,
    /// Bytes of the file.
    pub size_bytes: u64,
    /// How long the last group of rows took.
    pub commit_ms: f64,
    /// How long the slowest group took.
    pub commit_ms_max: f64,
}

/// The socket in the data directory.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SocketHealthDocument {
    /// `ok` or `missing`.
    pub state: ApiText,
    /// Why it is missing.
    pub reason: Option<String>,
}
