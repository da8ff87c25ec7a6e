//! The configuration as it is written: each value with its place, nothing filled in, nothing compared.

use super::broker::Address;
use super::ready::{PortAddress, Removal, Silence};
use super::words::{RoleRight, Way};
use crate::domain::command::Direction;
use crate::domain::control::{ControlAction, FailSafe, Ownership};
use crate::domain::frequency::Hertz;
use crate::domain::ids::{CommanderName, Name, Station, UnitId};
use crate::domain::link::{DirectionControl, EchoPolicy, Framing, Interface, Parity};
use crate::north::mqtt::{LeaseMode, Qos, Tree, Version};
use crate::profile::reader::{Given, Needed, Place, Written};
use crate::profile::register::RegisterFile;
use ipnet::IpNet;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// The whole file.
#[derive(Debug)]
pub(super) struct File {
    pub gateway: GatewayFile,
    pub journal: Given<JournalFile>,
    pub lines: Vec<LineFile>,
    pub mqtt: Given<MqttFile>,
    pub listeners: Vec<ListenerFile>,
    pub http: Given<HttpFile>,
}

/// `[gateway]`
#[derive(Debug)]
pub(super) struct GatewayFile {
    pub name: Given<Name>,
    pub data_dir: Given<PathBuf>,
    pub model_dirs: Given<Vec<Written<PathBuf>>>,
    pub on_removal: Given<Removal>,
}

impl GatewayFile {
    /// What holds without the table.
    pub const LEFT_OUT: Self =
        Self { name: Given::LeftOut, data_dir: Given::LeftOut, model_dirs: Given::LeftOut, on_removal: Given::LeftOut };
}

/// `[journal]`
#[derive(Debug)]
pub(super) struct JournalFile {
    pub place: Place,
    /// In bytes.
    pub max_size: Given<u64>,
}

/// One `[[line]]`.
#[derive(Debug)]
pub(super) struct LineFile {
    pub place: Place,
    pub name: Needed<Name>,
    pub port: Needed<PortAddress>,
    pub baud: Given<u32>,
    pub data_bits: Given<u8>,
    pub parity: Given<Parity>,
    pub stop_bits: Given<u8>,
    pub framing: Given<Framing>,
    pub interface: Given<Interface>,
    pub echo: Given<EchoPolicy>,
    pub direction: Given<DirectionControl>,
    pub low_latency: Given<bool>,
    pub silence: Given<Silence>,
    pub min_request_gap: Given<Duration>,
    pub reply_timeout: Given<Option<Duration>>,
    pub max_status_age: Given<Duration>,
    pub drives: Vec<DriveFile>,
}

impl LineFile {
    /// The line as a message calls it: by its name, or by its place while it has none.
    pub fn label(&self) -> String {
        match &self.name {
            Some(name) => format!("line `{}`", name.value),
            None => format!("the line at {}", self.place.key),
        }
    }
}

/// One `[[line.drive]]`.
#[derive(Debug)]
pub(super) struct DriveFile {
    pub place: Place,
    pub name: Needed<Name>,
    pub model: Needed<String>,
    pub station: Needed<Station>,
    pub unit: Given<UnitId>,
    pub uniform_unit: Given<UnitId>,
    pub poll: Given<Duration>,
    pub reply_timeout: Given<Option<Duration>>,
    pub max_lateness: Given<Duration>,
    /// In mA.
    pub rated_current: Given<u32>,
    /// In mV.
    pub rated_voltage: Given<u32>,
    pub registers: Vec<RegisterFile>,
    pub dead_bands: Given<Vec<(String, Written<f64>)>>,
    pub heartbeats: Given<Vec<(String, Written<Duration>)>>,
    pub decimals: Given<Vec<(String, Written<u8>)>>,
    pub control: Given<ControlFile>,
    pub native: Given<NativeFile>,
}

impl DriveFile {
    /// The drive as a message calls it: by its name, or by its place while it has none.
    pub fn label(&self) -> String {
        match &self.name {
            Some(name) => format!("drive `{}`", name.value),
            None => format!("the drive at {}", self.place.key),
        }
    }
}

/// `[line.drive.control]`
#[derive(Debug)]
pub(super) struct ControlFile {
    pub from: Needed<Vec<Written<Way>>>,
    pub limits: Option<LimitsFile>,
    pub directions: Given<Vec<Written<Direction>>>,
    pub reverse_below: Given<Hertz>,
    pub on_commander_lost: Needed<FailSafe>,
    pub lost_after: Needed<Duration>,
    pub on_shutdown: Needed<FailSafe>,
    pub accept_unverified: Given<Vec<Written<ControlAction>>>,
    pub allow_release: Given<bool>,
    pub strict: Given<bool>,
    pub restart_delay: Given<Duration>,
    pub stop_effect_timeout: Given<Duration>,
    pub stop_pending_for: Given<Duration>,
    pub ownership: Given<Ownership>,
    pub allow_take: Given<bool>,
    pub lease: Given<LeaseMode>,
    pub min_start_interval: Given<Duration>,
    pub watchdog: Given<Duration>,
    pub require_watchdog: Given<bool>,
    pub failsafe_confirm_timeout: Given<Duration>,
}

impl ControlFile {
    /// Whether `from` names `way`; its place if so.
    pub fn names(&self, way: Way) -> Option<&Place> {
        let from = self.from.as_ref()?;
        from.value.iter().find(|named| named.value == way).map(|named| &named.place)
    }
}

/// `frequency_hz` of a control section.
#[derive(Debug)]
pub(super) struct LimitsFile {
    pub min: Needed<Hertz>,
    pub max: Needed<Hertz>,
}

/// `[line.drive.native]`
#[derive(Debug)]
pub(super) struct NativeFile {
    pub write: Needed<Vec<Written<String>>>,
    pub stored_write_interval: Given<Duration>,
}

/// `[mqtt]`
#[derive(Debug)]
pub(super) struct MqttFile {
    pub broker: Needed<Address>,
    pub also_at: Given<Vec<Written<Address>>>,
    pub user: Given<String>,
    pub password_file: Given<PathBuf>,
    pub password_env: Given<String>,
    pub allow_plain_password: Given<bool>,
    pub client_id: Given<String>,
    pub version: Given<Version>,
    pub subscription_qos: Given<Qos>,
    pub prefix: Given<String>,
    pub heartbeat: Given<Duration>,
    pub keep_alive: Given<Duration>,
    pub lease: Given<LeaseMode>,
    pub alive_topic: Given<Option<String>>,
    pub probe_interval: Given<Duration>,
    pub command_ttl: Given<Duration>,
    pub response_prefix: Given<String>,
    pub keep_telemetry: Given<u32>,
    pub publish: Given<Vec<Written<Tree>>>,
    pub home_assistant: Given<HomeAssistantFile>,
    pub sparkplug: Given<SparkplugFile>,
    pub ca_file: Given<PathBuf>,
    pub client_cert_file: Given<PathBuf>,
    pub client_key_file: Given<PathBuf>,
}

/// `home_assistant` of `[mqtt]`
#[derive(Clone, Debug)]
pub(super) struct HomeAssistantFile {
    pub discovery: Needed<bool>,
    pub prefix: Given<String>,
    pub devices: Given<bool>,
}

/// `[mqtt.sparkplug]`
#[derive(Debug)]
pub(super) struct SparkplugFile {
    pub place: Place,
    pub group: Needed<String>,
    pub primary_host: Given<String>,
    pub client_id: Given<String>,
    pub max_command_age: Given<Duration>,
    pub keep_telemetry: Given<u32>,
}

/// `[http]`
#[derive(Debug)]
pub(super) struct HttpFile {
    pub place: Place,
    pub listen: Needed<SocketAddr>,
    pub allow: Given<Vec<IpNet>>,
    pub hosts: Given<Vec<Written<String>>>,
    pub users: Vec<HttpUserFile>,
    pub tls: Given<HttpTlsFile>,
}

/// One `[[http.users]]`.
#[derive(Debug)]
pub(super) struct HttpUserFile {
    pub place: Place,
    pub name: Needed<CommanderName>,
    pub password_hash: Given<String>,
    pub password_hash_file: Given<PathBuf>,
}

/// `[http.tls]`
#[derive(Debug)]
pub(super) struct HttpTlsFile {
    pub cert_file: Needed<PathBuf>,
    pub key_file: Needed<PathBuf>,
}

/// One `[[modbus_tcp]]`.
#[derive(Debug)]
pub(super) struct ListenerFile {
    pub place: Place,
    pub listen: Needed<SocketAddr>,
    pub allow: Given<Vec<IpNet>>,
    pub lines: Given<Vec<Written<String>>>,
    pub write: Given<Vec<Written<IpNet>>>,
    pub stop: Given<Vec<Written<IpNet>>>,
    pub reads_renew: Given<bool>,
    pub units: Given<Vec<Written<UnitId>>>,
    pub connections_max: Given<u32>,
    pub priority: Given<Vec<Written<IpNet>>>,
    pub idle_timeout: Given<Duration>,
    pub keep_alive: Given<Duration>,
    pub tls: Given<ListenerTlsFile>,
}

/// `[modbus_tcp.tls]`
#[derive(Debug)]
pub(super) struct ListenerTlsFile {
    pub cert_file: Needed<PathBuf>,
    pub key_file: Needed<PathBuf>,
    pub client_ca_file: Needed<PathBuf>,
    pub roles: Needed<Vec<RoleFile>>,
}

/// A role, and what it may do.
#[derive(Clone, Debug)]
pub(super) struct RoleFile {
    pub name: String,
    pub rights: Written<Vec<Written<RoleRight>>>,
}

impl ListenerFile {
    /// The listener as a message calls it: by its address, or by its place while it has none.
    pub fn label(&self) -> String {
        match &self.listen {
            Some(listen) => format!("the listener {}", listen.value),
            None => format!("the listener at {}", self.place.key),
        }
    }
}
