//! The configuration as written: each value with its location, before defaults and cross-checks.

use super::broker::BrokerAddress;
use super::ready::{LineSilence, PortAddress, RemovalRule};
use super::ready_http::PageViewers;
use super::words::{CommandInterface, RoleRight};
use crate::domain::command::Direction;
use crate::domain::control::{BusFunctions, ControlAction, FailSafe, OnOutputOutside, Ownership};
use crate::domain::frequency::Hertz;
use crate::domain::ids::{CommanderName, Name, Station, UnitId};
use crate::domain::link::{DirectionControl, EchoPolicy, Framing, Interface, Parity};
use crate::domain::standby::OnGatewayLost;
use crate::north::broker::{MqttVersion, Qos};
use crate::north::mqtt::{CombinedEntity, LeaseMode, TopicTree};
use crate::north::operator::rights::UserRole;
use crate::profile::register::RegisterFile;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey, RequiredKey};
use ipnet::IpNet;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// A configuration file.
#[derive(Debug)]
pub(super) struct ConfigFile {
    pub gateway: GatewayFile,
    pub journal: OptionalKey<JournalFile>,
    pub standby: OptionalKey<StandbyFile>,
    pub lines: Vec<LineFile>,
    pub mqtt: OptionalKey<MqttFile>,
    pub listeners: Vec<ListenerFile>,
    pub serial: Vec<SerialFile>,
    pub http: OptionalKey<HttpFile>,
}

/// `[gateway]`
#[derive(Debug)]
pub(super) struct GatewayFile {
    pub name: OptionalKey<Name>,
    pub data_dir: OptionalKey<PathBuf>,
    pub model_dirs: OptionalKey<Vec<LocatedValue<PathBuf>>>,
    pub on_removal: OptionalKey<RemovalRule>,
}

impl GatewayFile {
    /// The values without the table.
    pub const LEFT_OUT: Self = Self {
        name: OptionalKey::Absent,
        data_dir: OptionalKey::Absent,
        model_dirs: OptionalKey::Absent,
        on_removal: OptionalKey::Absent,
    };
}

/// `[journal]`
#[derive(Debug)]
pub(super) struct JournalFile {
    pub location: KeyLocation,
    /// In bytes.
    pub max_size: OptionalKey<u64>,
}

/// `[standby]`
#[derive(Debug)]
pub(super) struct StandbyFile {
    pub location: KeyLocation,
    pub half: RequiredKey<Name>,
    pub partner: RequiredKey<Name>,
    pub rank: OptionalKey<u8>,
    pub take_over_after: OptionalKey<Option<Duration>>,
}

impl ConfigFile {
    /// Everything that serves units to Modbus clients: first the listeners, then the serial masters.
    pub fn units_servers(&self) -> Vec<&ListenerFile> {
        self.listeners
            .iter()
            .chain(self.serial.iter().map(|serial| &serial.serving))
            .collect()
    }
}

/// One `[[line]]`.
#[derive(Debug)]
pub(super) struct LineFile {
    pub location: KeyLocation,
    pub name: RequiredKey<Name>,
    pub port: RequiredKey<PortAddress>,
    pub baud: OptionalKey<u32>,
    pub data_bits: OptionalKey<u8>,
    pub parity: OptionalKey<Parity>,
    pub stop_bits: OptionalKey<u8>,
    pub framing: OptionalKey<Framing>,
    pub interface: OptionalKey<Interface>,
    pub echo: OptionalKey<EchoPolicy>,
    pub direction: OptionalKey<DirectionControl>,
    pub low_latency: OptionalKey<bool>,
    pub silence: OptionalKey<LineSilence>,
    pub min_request_gap: OptionalKey<Duration>,
    pub reply_timeout: OptionalKey<Option<Duration>>,
    pub max_status_age: OptionalKey<Duration>,
    pub standby: OptionalKey<bool>,
    pub drives: Vec<DriveFile>,
}

impl LineFile {
    /// The line's label in messages: its name, or its location if it has none.
    pub fn label(&self) -> String {
        match &self.name {
            Some(name) => format!("line `{}`", name.value),
            None => format!("the line at {}", self.location.key),
        }
    }
}

/// One `[[line.drive]]`.
#[derive(Debug)]
pub(super) struct DriveFile {
    pub location: KeyLocation,
    pub name: RequiredKey<Name>,
    pub model: RequiredKey<String>,
    pub station: RequiredKey<Station>,
    pub unit: OptionalKey<UnitId>,
    pub uniform_unit: OptionalKey<UnitId>,
    pub group: OptionalKey<Name>,
    pub poll: OptionalKey<Duration>,
    pub reply_timeout: OptionalKey<Option<Duration>>,
    pub max_lateness: OptionalKey<Duration>,
    /// In mA.
    pub rated_current: OptionalKey<u32>,
    /// In mV.
    pub rated_voltage: OptionalKey<u32>,
    /// In thousandths of a hertz.
    pub full_scale: OptionalKey<u32>,
    pub registers: Vec<RegisterFile>,
    pub dead_bands: OptionalKey<Vec<(String, LocatedValue<f64>)>>,
    pub heartbeats: OptionalKey<Vec<(String, LocatedValue<Duration>)>>,
    pub decimals: OptionalKey<Vec<(String, LocatedValue<u8>)>>,
    pub control: OptionalKey<ControlFile>,
    pub native: OptionalKey<NativeFile>,
}

impl DriveFile {
    /// The drive's label in messages: its name, or its location if it has none.
    pub fn label(&self) -> String {
        match &self.name {
            Some(name) => format!("drive `{}`", name.value),
            None => format!("the drive at {}", self.location.key),
        }
    }
}

/// `[line.drive.control]`
#[derive(Debug)]
pub(super) struct ControlFile {
    pub from: RequiredKey<Vec<LocatedValue<CommandInterface>>>,
    pub bus: OptionalKey<BusFunctions>,
    pub limits: Option<LimitsFile>,
    pub directions: OptionalKey<Vec<LocatedValue<Direction>>>,
    pub reverse_below: OptionalKey<Hertz>,
    pub on_commander_lost: RequiredKey<FailSafe>,
    pub lost_after: RequiredKey<Duration>,
    pub on_shutdown: RequiredKey<FailSafe>,
    pub on_output_outside: OptionalKey<OnOutputOutside>,
    pub on_gateway_lost: OptionalKey<OnGatewayLost>,
    pub accept_unverified: OptionalKey<Vec<LocatedValue<ControlAction>>>,
    pub qualify: OptionalKey<bool>,
    pub allow_release: OptionalKey<bool>,
    pub strict: OptionalKey<bool>,
    pub restart_delay: OptionalKey<Duration>,
    pub stop_effect_timeout: OptionalKey<Duration>,
    pub stop_pending_for: OptionalKey<Duration>,
    pub ownership: OptionalKey<Ownership>,
    pub allow_take: OptionalKey<bool>,
    pub lease: OptionalKey<LeaseMode>,
    pub min_start_interval: OptionalKey<Duration>,
    pub watchdog: OptionalKey<Duration>,
    pub require_watchdog: OptionalKey<bool>,
    pub failsafe_confirm_timeout: OptionalKey<Duration>,
}

impl ControlFile {
    /// The location of `way` in `from`, if it is named there.
    pub fn names(&self, way: CommandInterface) -> Option<&KeyLocation> {
        let from = self.from.as_ref()?;
        from.value
            .iter()
            .find(|named| named.value == way)
            .map(|named| &named.location)
    }
}

/// `frequency_hz` of a control section.
#[derive(Debug)]
pub(super) struct LimitsFile {
    pub min: RequiredKey<Hertz>,
    pub max: RequiredKey<Hertz>,
}

/// `[line.drive.native]`
#[derive(Debug)]
pub(super) struct NativeFile {
    pub write: RequiredKey<Vec<LocatedValue<String>>>,
    pub stored_write_interval: OptionalKey<Duration>,
    pub store: OptionalKey<bool>,
}

/// `[mqtt]`
#[derive(Debug)]
pub(super) struct MqttFile {
    pub broker: RequiredKey<BrokerAddress>,
    pub also_at: OptionalKey<Vec<LocatedValue<BrokerAddress>>>,
    pub user: OptionalKey<String>,
    pub password_file: OptionalKey<PathBuf>,
    pub password_env: OptionalKey<String>,
    pub allow_plain_password: OptionalKey<bool>,
    pub client_id: OptionalKey<String>,
    pub version: OptionalKey<MqttVersion>,
    pub subscription_qos: OptionalKey<Qos>,
    pub prefix: OptionalKey<String>,
    pub heartbeat: OptionalKey<Duration>,
    pub keep_alive: OptionalKey<Duration>,
    pub lease: OptionalKey<LeaseMode>,
    pub alive_topic: OptionalKey<Option<String>>,
    pub probe_interval: OptionalKey<Duration>,
    pub command_ttl: OptionalKey<Duration>,
    pub response_prefix: OptionalKey<String>,
    pub keep_telemetry: OptionalKey<u32>,
    pub publish: OptionalKey<Vec<LocatedValue<TopicTree>>>,
    pub home_assistant: OptionalKey<HomeAssistantFile>,
    pub sparkplug: OptionalKey<SparkplugFile>,
    pub ca_file: OptionalKey<PathBuf>,
    pub client_cert_file: OptionalKey<PathBuf>,
    pub client_key_file: OptionalKey<PathBuf>,
}

/// `home_assistant` of `[mqtt]`
#[derive(Clone, Debug)]
pub(super) struct HomeAssistantFile {
    pub discovery: RequiredKey<bool>,
    pub prefix: OptionalKey<String>,
    pub devices: OptionalKey<bool>,
    pub combined: OptionalKey<Vec<LocatedValue<CombinedEntity>>>,
    pub page: OptionalKey<String>,
}

/// `[mqtt.sparkplug]`
#[derive(Debug)]
pub(super) struct SparkplugFile {
    pub location: KeyLocation,
    pub group: RequiredKey<String>,
    pub primary_host: OptionalKey<String>,
    pub client_id: OptionalKey<String>,
    pub max_command_age: OptionalKey<Duration>,
    pub keep_telemetry: OptionalKey<u32>,
}

/// `[http]`
#[derive(Debug)]
pub(super) struct HttpFile {
    pub location: KeyLocation,
    pub listen: RequiredKey<SocketAddr>,
    pub allow: OptionalKey<Vec<IpNet>>,
    pub hosts: OptionalKey<Vec<LocatedValue<String>>>,
    pub view: OptionalKey<PageViewers>,
    pub setup: OptionalKey<bool>,
    pub users: Vec<HttpUserFile>,
    pub tls: OptionalKey<HttpTlsFile>,
}

impl HttpFile {
    /// Whether the configuration is changed in the page.
    pub fn sets_up(&self) -> bool {
        self.setup.valid().is_some_and(|written| written.value)
    }
}

/// One `[[http.users]]`.
#[derive(Debug)]
pub(super) struct HttpUserFile {
    pub location: KeyLocation,
    pub name: RequiredKey<CommanderName>,
    pub password_hash: OptionalKey<String>,
    pub password_hash_file: OptionalKey<PathBuf>,
    pub role: OptionalKey<UserRole>,
    pub groups: OptionalKey<Vec<LocatedValue<Name>>>,
}

/// `[http.tls]`
#[derive(Debug)]
pub(super) struct HttpTlsFile {
    pub cert_file: RequiredKey<PathBuf>,
    pub key_file: RequiredKey<PathBuf>,
}

/// One `[[modbus_tcp]]`.
#[derive(Debug)]
pub(super) struct ListenerFile {
    pub location: KeyLocation,
    pub listen: RequiredKey<SocketAddr>,
    pub allow: OptionalKey<Vec<IpNet>>,
    pub lines: OptionalKey<Vec<LocatedValue<String>>>,
    pub write: OptionalKey<Vec<LocatedValue<IpNet>>>,
    pub stop: OptionalKey<Vec<LocatedValue<IpNet>>>,
    pub reads_renew: OptionalKey<bool>,
    pub cached: OptionalKey<bool>,
    pub units: OptionalKey<Vec<LocatedValue<UnitId>>>,
    pub connections_max: OptionalKey<u32>,
    pub priority: OptionalKey<Vec<LocatedValue<IpNet>>>,
    pub idle_timeout: OptionalKey<Duration>,
    pub keep_alive: OptionalKey<Duration>,
    pub tls: OptionalKey<ListenerTlsFile>,
}

/// One `[[modbus_rtu]]`.
#[derive(Debug)]
pub(super) struct SerialFile {
    pub location: KeyLocation,
    pub name: RequiredKey<CommanderName>,
    pub port: RequiredKey<PortAddress>,
    pub baud: RequiredKey<u32>,
    pub data_bits: OptionalKey<u8>,
    pub parity: RequiredKey<Parity>,
    pub stop_bits: OptionalKey<u8>,
    pub framing: OptionalKey<Framing>,
    pub direction: OptionalKey<DirectionControl>,
    pub low_latency: OptionalKey<bool>,
    pub allow_write: OptionalKey<bool>,
    pub allow_stop: OptionalKey<bool>,
    pub answer_within: OptionalKey<Duration>,
    /// What it serves, in the words of a listener whose one client is this host.
    pub serving: ListenerFile,
}

/// `[modbus_tcp.tls]`
#[derive(Debug)]
pub(super) struct ListenerTlsFile {
    pub cert_file: RequiredKey<PathBuf>,
    pub key_file: RequiredKey<PathBuf>,
    pub client_ca_file: RequiredKey<PathBuf>,
    pub roles: RequiredKey<Vec<RoleFile>>,
}

/// A role and its rights.
#[derive(Clone, Debug)]
pub(super) struct RoleFile {
    pub name: String,
    pub rights: LocatedValue<Vec<LocatedValue<RoleRight>>>,
}

impl ListenerFile {
    /// The listener's label in messages: its address, or its location if it has none, as a serial master.
    pub fn label(&self) -> String {
        match &self.listen {
            Some(listen) => format!("the listener {}", listen.value),
            None => format!("the listener at {}", self.location.key),
        }
    }
}
