//! The configuration ready to use: defaults filled in, all rules checked. Only [`super::load`] creates one.

pub use super::ready_broker::{
    BrokerCredentials, BrokerSettings, ClientCertificate, MqttSettings, PasswordSource,
    SparkplugSettings, TlsSettings,
};
use crate::domain::command::Rights;
use crate::domain::control::ControlSettings;
use crate::domain::ids::{CommanderName, Name, Station, UnitId};
use crate::domain::link::{DirectionControl, EchoPolicy, Framing, Interface, LinkSettings};
use crate::domain::problem::Problem;
use crate::domain::standby::StandbyPair;
use crate::drive::description::{DriveRatings, PointSettings};
use crate::guard::COMMAND_DEADLINE;
use crate::north::operator::password::StoredHash;
use crate::north::operator::rights::UserRights;
use crate::north::titles::PlantTitles;
use crate::profile::model::Model;
use ipnet::{IpNet, Ipv4Net};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// A whole configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Settings of the gateway as a whole.
    pub gateway: GatewaySettings,
    /// What people call its parts. They are no settings of these: a title that changes restarts no line.
    pub titles: PlantTitles,
    /// The journal, if there is a data directory.
    pub journal: JournalSettings,
    /// This gateway as one of a pair; `None`: it is the only one on its lines.
    pub standby: Option<StandbyPair>,
    /// The serial lines, in the order of the file; at least one.
    pub lines: Vec<LineSettings>,
    /// The Modbus TCP listeners, in the order of the file; may be none.
    pub listeners: Vec<ListenerSettings>,
    /// The serial masters, in the order of the file; may be none.
    pub serial_masters: Vec<SerialMasterSettings>,
    /// The broker connection, if there is one.
    pub mqtt: Option<MqttSettings>,
    /// The HTTP listener, if there is one.
    pub http: Option<HttpSettings>,
    /// Identifies these settings: a CRC over the content of the file, independent of order, spaces and comments.
    pub digest: u64,
    /// Warnings about settings without effect, in the order of the text.
    pub warnings: Vec<Problem>,
}

/// Settings of the gateway as a whole.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GatewaySettings {
    /// The gateway's name. `None`: the host's name, which only the daemon knows.
    pub name: Option<Name>,
    /// Directory for persistent data and the socket of the tools; an absolute path.
    pub data_dir: Option<PathBuf>,
    /// What a reload does about a drive in use that it would remove.
    pub on_removal: RemovalRule,
}

/// What a reload does about a drive that runs or is under control, if it would be removed or its line restarted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum RemovalRule {
    /// The reload is refused.
    #[default]
    Refuse,
    /// The drive is stopped first.
    Stop,
}

/// The journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JournalSettings {
    /// Maximum size of its file in bytes, 1,000,000 to 16,000,000,000.
    pub max_bytes: u64,
}

/// One serial line.
#[derive(Clone, Debug, PartialEq)]
pub struct LineSettings {
    /// Unique among the lines.
    pub name: Name,
    /// The port of the line. No other line has the same one, as far as the text shows.
    pub port: PortAddress,
    /// Speed and character format, supported by every model on the line; without meaning over Modbus TCP.
    pub link: LinkSettings,
    /// The physical interface, supported by every model on the line.
    pub interface: Interface,
    /// What switches the direction; the adapter for RS-232 and network ports.
    pub direction: DirectionControl,
    /// Whether the driver of a device is asked to deliver received bytes at once.
    pub low_latency: bool,
    /// The framing, supported by every model on the line.
    pub framing: Framing,
    /// What to do if the line echoes.
    pub echo: EchoPolicy,
    /// Silence between frames.
    pub silence: LineSilence,
    /// Minimum time between the end of one exchange and the next request. 0 unless configured.
    pub min_request_gap: Duration,
    /// Reply time-out of drives without their own, 1 ms to 60 s. `None`: from the models.
    pub reply_timeout: Option<Duration>,
    /// Maximum age of the fast values under an overfull plan, 100 ms to 1 h.
    pub max_status_age: Duration,
    /// The pair whose other gateway is on the same line; `None`: this one is alone there.
    pub standby: Option<StandbyPair>,
    /// The drives, in the order of the file; at least one, and exactly one on RS-232.
    pub drives: Vec<DriveSettings>,
}

/// The port of a line.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PortAddress {
    /// A serial device or a pseudo-terminal of this host: an absolute path.
    Device(PathBuf),
    /// A serial device server that forwards the frames of its line unchanged.
    Tcp {
        /// Name in lower case, or address; an IPv6 address without brackets.
        host: String,
        /// Port, from 1.
        port: u16,
    },
    /// A drive, or a converter before drives, that speaks Modbus TCP.
    ModbusTcp {
        /// As for the device server.
        host: String,
        /// Port, from 1.
        port: u16,
    },
}

impl PortAddress {
    /// The scheme before the host of a modbus-tcp address.
    pub(crate) const MODBUS_TCP: &str = "modbus-tcp";

    /// How long a late reply may still be in transit through this port, whatever the drive does, and be mistaken for
    /// another.
    #[must_use]
    pub const fn max_lateness(&self) -> Duration {
        match self {
            Self::Device(_) | Self::ModbusTcp { .. } => Duration::ZERO,
            Self::Tcp { .. } => TCP_LATENESS,
        }
    }

    /// Host and port, if it is reached over a network.
    #[must_use]
    pub fn network(&self) -> Option<(&str, u16)> {
        match self {
            Self::Device(_) => None,
            Self::Tcp { host, port } | Self::ModbusTcp { host, port } => Some((host, *port)),
        }
    }

    /// Which device or server it is, whatever framing it is used with.
    #[must_use]
    pub fn place(&self) -> (Option<&Path>, Option<(&str, u16)>) {
        let device = if let Self::Device(path) = self {
            Some(path.as_path())
        } else {
            None
        };
        (device, self.network())
    }

    /// Whether it is a serial line, here or behind a device server: with characters, and a speed.
    #[must_use]
    pub const fn is_serial_line(&self) -> bool {
        !matches!(self, Self::ModbusTcp { .. })
    }
}

impl fmt::Display for PortAddress {
    /// As written in the file.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (scheme, host, port) = match self {
            Self::Device(path) => return path.display().fmt(f),
            Self::Tcp { host, port } => ("tcp", host, port),
            Self::ModbusTcp { host, port } => (Self::MODBUS_TCP, host, port),
        };
        match host.contains(':') {
            true => write!(f, "{scheme}://[{host}]:{port}"),
            false => write!(f, "{scheme}://{host}:{port}"),
        }
    }
}

/// How long a network may delay a frame before the connection is considered lost.
pub const TCP_LATENESS: Duration = Duration::from_secs(3);

/// Silence between the frames of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineSilence {
    /// As required by the models of the line.
    Auto,
    /// A fixed time. Less than the models require is allowed only for pseudo-terminals and network connections; the
    /// daemon checks that when it opens the device.
    Fixed(Duration),
}

/// One drive.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveSettings {
    /// Unique in the gateway.
    pub name: Name,
    /// The model for the framing of its line, with the registers that the configuration adds.
    pub model: Arc<Model>,
    /// Station number; in the model's range, unique on the line.
    pub station: Station,
    /// Unit of its own registers on Modbus TCP; unique among all units of a listener, like the uniform one.
    pub unit: UnitId,
    /// Unit of the uniform registers on Modbus TCP.
    pub uniform_unit: UnitId,
    /// The group in which the page shows it.
    pub group: Option<Name>,
    /// Period of the fast polls, 10 ms to 1 h.
    pub poll: Duration,
    /// Reply time-out, 1 ms to 60 s: the drive's own or else the line's. `None`: from the model.
    pub reply_timeout: Option<Duration>,
    /// How long after a time-out a late reply may still arrive, 10 ms to 60 s: the drive's own, or else the
    /// model's or the port's, whichever is longer.
    pub max_lateness: Duration,
    /// Limits of control, including the writable native registers. `None`: read-only.
    pub control: Option<Arc<ControlSettings>>,
    /// Rated values, for models that report in percent of them.
    pub ratings: DriveRatings,
    /// How its polled registers are published over MQTT.
    pub points: PointSettings,
}

/// One Modbus TCP listener.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListenerSettings {
    /// Address and port. No other listener has the same.
    pub listen: SocketAddr,
    /// Networks that may connect. `None`: every client that can, which is this host only (other listeners have a list).
    pub allow: Option<Vec<IpNet>>,
    /// The lines that it serves, as indices into [`Config::lines`]; `None`: all.
    pub lines: Option<Vec<usize>>,
    /// Networks that may write, each inside `allow` if there is one. With TLS, the role must grant it as well.
    pub write: Vec<IpNet>,
    /// Networks that may stop, including all of `write`. `None`: the same as `write`.
    pub stop: Option<Vec<IpNet>>,
    /// Whether reads of a drive's owner renew its lease.
    pub reads_renew: bool,
    /// Whether native reads may be answered from memory.
    pub cached: bool,
    /// The units that answer here, besides 255 and 0. `None`: all units of its lines.
    pub units: Option<Vec<UnitId>>,
    /// Maximum number of connections, excluding those with priority. `None`: as many as there are places.
    pub connections_max: Option<usize>,
    /// Networks whose connections never give way to others, each inside `allow` if there is one.
    pub priority: Vec<IpNet>,
    /// Time after which a connection without a request is closed, 1 s to 24 h. `None`: never.
    pub idle_timeout: Option<Duration>,
    /// Interval of TCP keep-alive probes, 1 s to 2 h in whole seconds. `None`: no probes.
    pub keep_alive: Option<Duration>,
    /// Modbus Security. `None`: connections are not encrypted.
    pub tls: Option<ListenerTls>,
}

/// TLS with certificates on both sides. Absolute paths.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListenerTls {
    /// The gateway's certificate with its chain.
    pub cert_file: PathBuf,
    /// The key of the gateway's certificate.
    pub key_file: PathBuf,
    /// The certificate authorities of accepted clients.
    pub client_ca_file: PathBuf,
    /// The rights of each role besides reading, by role name; at least one. Other roles have no rights. The empty name
    /// is the role of a certificate without one.
    pub roles: BTreeMap<String, Rights>,
}

/// The default networks of Docker and Podman bridges.
const BRIDGES: [Ipv4Net; 2] = [
    Ipv4Net::new_assert(Ipv4Addr::new(172, 17, 0, 0), 16),
    Ipv4Net::new_assert(Ipv4Addr::new(10, 88, 0, 0), 16),
];

/// The warning about a list that names one of [`ListenerSettings::bridges`].
pub const BEHIND_A_BRIDGE: &str = "behind a container's bridge every client may appear with this \
                                   address; use the host's network (--network host) and list the \
                                   addresses of the clients";

impl ListenerSettings {
    /// The default networks of container bridges that its lists name: in a container behind such a bridge, all clients
    /// may appear under its address, so that the list means every client.
    #[must_use]
    pub fn bridges(&self) -> BTreeSet<IpNet> {
        let lists = [self.allow.as_ref(), Some(&self.write), self.stop.as_ref()]
            .into_iter()
            .flatten()
            .flatten();
        let is_bridge = |net: &&IpNet| {
            BRIDGES
                .iter()
                .any(|bridge| IpNet::V4(*bridge).contains(*net))
        };
        lists.filter(is_bridge).copied().collect()
    }

    /// Whether this listener serves the drives of the line at index `line`.
    #[must_use]
    pub fn serves(&self, line: usize) -> bool {
        self.lines
            .as_ref()
            .is_none_or(|lines| lines.contains(&line))
    }

    /// Whether `unit` of such a line answers on this listener.
    #[must_use]
    pub fn answers_at(&self, unit: UnitId) -> bool {
        self.units
            .as_ref()
            .is_none_or(|units| units.contains(&unit))
    }
}

/// A serial port at which the gateway is a slave: its master is the only client there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialMasterSettings {
    /// Unique among the serial masters.
    pub name: CommanderName,
    /// Neither a line nor another master has the same one, as far as the text shows.
    pub port: PortAddress,
    /// Speed and character format.
    pub link: LinkSettings,
    /// How the master delimits frames.
    pub framing: Framing,
    /// What switches the direction.
    pub direction: DirectionControl,
    /// Whether the driver of a device is asked to deliver received bytes at once.
    pub low_latency: bool,
    /// Time from the end of a request until an exception has been sent, if there is no answer: 20 ms to 5 s, and longer
    /// than the silence and the exception take.
    pub answer_within: Duration,
    /// What the master reaches and may do, in the words of a listener: its one client is this host.
    pub serving: ListenerSettings,
}

impl SerialMasterSettings {
    /// Whether `other` uses the same port in the same way, so that the port stays open over a change.
    #[must_use]
    pub fn has_port_of(&self, other: &Self) -> bool {
        Self {
            serving: other.serving.clone(),
            ..self.clone()
        } == *other
    }
}

/// The HTTP listener.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HttpSettings {
    /// Address and port. No other listener has the same.
    pub listen: SocketAddr,
    /// Networks that may connect. `None`: every client that can, which is this host only (other listeners have a list).
    pub allow: Option<Vec<IpNet>>,
    /// Additional host names for browsers, besides addresses and the host's own name, in lower case.
    pub hosts: Vec<String>,
    /// Who sees the drives.
    pub view: PageViewers,
    /// Users with the role for it change the configuration in the page.
    pub setup: bool,
    /// Users that may sign in and command. Empty: the page is read-only. Only on loopback or with TLS.
    pub users: Vec<UserSettings>,
    /// TLS settings. `None`: connections are not encrypted.
    pub tls: Option<HttpTls>,
}

/// Who sees the drives on the page and below `/api/v1/`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PageViewers {
    /// Every client that may connect.
    Anyone,
    /// Users who have signed in.
    SignedIn,
}

/// A user who may sign in on the page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UserSettings {
    /// Unique among the users; the owner of their commands.
    pub name: CommanderName,
    /// The password as a hash.
    pub hash: HashSource,
    /// What they may do.
    pub rights: UserRights,
}

/// The source of a password's hash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HashSource {
    /// In the configuration.
    Text(StoredHash),
    /// The content of the file at this absolute path.
    File(PathBuf),
}

/// TLS of the HTTP listener. Absolute paths.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HttpTls {
    /// The gateway's certificate with its chain.
    pub cert_file: PathBuf,
    /// The key of the gateway's certificate.
    pub key_file: PathBuf,
}

/// Maximum wait of a command without its own deadline before its first frame is sent to a drive with `control`: every
/// lease of the drive is longer.
#[must_use]
pub fn command_deadline(control: &ControlSettings, mqtt: Option<&MqttSettings>) -> Duration {
    let by_broker = control.from_mqtt || control.from_sparkplug;
    let over_mqtt = match mqtt {
        Some(mqtt) if by_broker => Some(mqtt.session.command_ttl),
        _ => None,
    };
    let others = (control.from_modbus_tcp || control.from_page).then_some(COMMAND_DEADLINE);
    over_mqtt.max(others).unwrap_or(COMMAND_DEADLINE)
}
