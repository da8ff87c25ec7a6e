//! The configuration ready to use: every default filled in, every rule kept. Only [`super::load`] makes one.

pub use super::ready_broker::{
    BrokerSettings, ClientCertificate, Credentials, MqttSettings, PasswordSource, SparkplugSettings, TlsSettings,
};
use super::ready_http::HttpSettings;
use crate::domain::command::Rights;
use crate::domain::control::ControlSettings;
use crate::domain::ids::{Name, Station, UnitId};
use crate::domain::link::{DirectionControl, EchoPolicy, Framing, Interface, LinkSettings};
use crate::domain::problem::Problem;
use crate::drive::description::{Points, Ratings};
use crate::guard::COMMAND_DEADLINE;
use crate::profile::model::Model;
use ipnet::{IpNet, Ipv4Net};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// A whole configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// What concerns the gateway as a whole.
    pub gateway: GatewaySettings,
    /// What is kept beyond the life of the process, where there is a data directory.
    pub journal: JournalSettings,
    /// The serial lines, in the order of the file; at least one.
    pub lines: Vec<LineSettings>,
    /// The Modbus TCP listeners, in the order of the file; may be none.
    pub listeners: Vec<ListenerSettings>,
    /// The broker connection, where there is one.
    pub mqtt: Option<MqttSettings>,
    /// The HTTP listener, where there is one.
    pub http: Option<HttpSettings>,
    /// What tells these settings from others: a CRC over what the file says, whatever its order, spaces and comments.
    pub digest: u64,
    /// What of the file has no effect, in the order of the text.
    pub warnings: Vec<Problem>,
}

/// What concerns the gateway as a whole.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GatewaySettings {
    /// The gateway's name; nothing: the host's name, which only the daemon knows.
    pub name: Option<Name>,
    /// Where the gateway keeps what outlives it, and where its tools reach it; an absolute path.
    pub data_dir: Option<PathBuf>,
    /// What a reload does about a drive in use that it would take away.
    pub on_removal: Removal,
}

/// What a reload does about a drive that runs or is under control, if it would be removed or its line restarted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Removal {
    /// The reload is refused.
    #[default]
    Refuse,
    /// The drive is stopped first.
    Stop,
}

/// The journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JournalSettings {
    /// Bytes to which its file may grow, 1,000,000 to 16,000,000,000.
    pub max_bytes: u64,
}

impl Default for JournalSettings {
    fn default() -> Self {
        Self { max_bytes: 64_000_000 }
    }
}

/// One serial line.
#[derive(Clone, Debug, PartialEq)]
pub struct LineSettings {
    /// Unique among the lines.
    pub name: Name,
    /// What the line is reached through. No other line has the same port, as far as the text tells.
    pub port: PortAddress,
    /// Speed and character format; every model of the line has them.
    pub link: LinkSettings,
    /// What the line is physically; every model of the line has it.
    pub interface: Interface,
    /// Who turns the direction; the adapter on RS-232 and on the network.
    pub direction: DirectionControl,
    /// Whether the driver of a device is asked to hand over what it receives at once.
    pub low_latency: bool,
    /// How frames are told apart; every model of the line has it.
    pub framing: Framing,
    /// What to do if what is sent comes back.
    pub echo: EchoPolicy,
    /// Silence between frames.
    pub silence: Silence,
    /// Minimum time between the end of one exchange and the next request. 0 unless configured.
    pub min_request_gap: Duration,
    /// Reply time-out of drives that have none of their own, 1 ms to 60 s; nothing: from the models.
    pub reply_timeout: Option<Duration>,
    /// How old the fast values may become by a plan that is over-full, 100 ms to 1 h; none becomes older.
    pub max_status_age: Duration,
    /// The drives, in the order of the file; at least one, and exactly one on RS-232.
    pub drives: Vec<DriveSettings>,
}

/// What a line is reached through.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PortAddress {
    /// A serial device or a pseudo-terminal of this host: an absolute path.
    Device(PathBuf),
    /// A serial device server that passes the frames of its line on as they are.
    Tcp {
        /// Name in lower case, or address; an IPv6 address without brackets.
        host: String,
        /// Port, from 1.
        port: u16,
    },
}

impl PortAddress {
    /// How long a late reply may still be under way over this port, whatever the drive does.
    #[must_use]
    pub const fn max_lateness(&self) -> Duration {
        match self {
            Self::Device(_) => Duration::ZERO,
            Self::Tcp { .. } => TCP_LATENESS,
        }
    }
}

impl fmt::Display for PortAddress {
    /// As the file writes it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Device(path) => path.display().fmt(f),
            Self::Tcp { host, port } if host.contains(':') => write!(f, "tcp://[{host}]:{port}"),
            Self::Tcp { host, port } => write!(f, "tcp://{host}:{port}"),
        }
    }
}

/// How long a network may hold a frame back before the connection is given up for lost.
pub const TCP_LATENESS: Duration = Duration::from_secs(3);

/// Silence between the frames of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Silence {
    /// As the models of the line need it.
    Auto,
    /// This long. Shorter than the models need is for pseudo-terminals and network connections only: what a device
    /// is shows when it is opened, so the daemon checks it there.
    Fixed(Duration),
}

/// One drive.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveSettings {
    /// Unique over the gateway.
    pub name: Name,
    /// The model as it is on a line of this framing, with the registers that the configuration adds to it.
    pub model: Arc<Model>,
    /// Number on the line; in the model's range, unique on the line.
    pub station: Station,
    /// Unit of its own registers on Modbus TCP; unique, as the uniform one, among all units of a listener.
    pub unit: UnitId,
    /// Unit of the uniform registers on Modbus TCP.
    pub uniform_unit: UnitId,
    /// Period of the fast polls, 10 ms to 1 h.
    pub poll: Duration,
    /// Reply time-out, 1 ms to 60 s: the drive's own or else the line's; nothing: from the model.
    pub reply_timeout: Option<Duration>,
    /// How long after a time-out a late reply may still come, 10 ms to 60 s: the drive's own, or else the
    /// model's or the port's, whichever is longer.
    pub max_lateness: Duration,
    /// What may be commanded, the native registers that may be written included; nothing: read-only.
    pub control: Option<Arc<ControlSettings>>,
    /// Rated values, for models that report in per cent of them.
    pub ratings: Ratings,
    /// How its polled registers are published over MQTT.
    pub points: Points,
}

/// One Modbus TCP listener.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListenerSettings {
    /// Address and port. No other listener has the same.
    pub listen: SocketAddr,
    /// Who may connect; nothing: whoever can, which is this host only (a listener elsewhere has a list).
    pub allow: Option<Vec<IpNet>>,
    /// The lines it serves, as indices into [`Config::lines`]; nothing: all.
    pub lines: Option<Vec<usize>>,
    /// From where may be written. Each lies in `allow` where there is one. With TLS the role must grant it as well.
    pub write: Vec<IpNet>,
    /// From where may be stopped; nothing: from where may be written, which it holds.
    pub stop: Option<Vec<IpNet>>,
    /// Whether reads of a drive's owner renew its lease.
    pub reads_renew: bool,
    /// The units that answer here, besides 255 and 0; nothing: all of its lines.
    pub units: Option<Vec<UnitId>>,
    /// Most connections at once, those with priority not counted; nothing: as many as there are places.
    pub connections_max: Option<usize>,
    /// Whose connections never give way to others. Each lies in `allow` where there is one.
    pub priority: Vec<IpNet>,
    /// A connection without a request is closed after this time, 1 s to 24 h; nothing: never.
    pub idle_timeout: Option<Duration>,
    /// Whether a silent client is still there is asked after this time, 1 s to 2 h in whole seconds; nothing: never.
    pub keep_alive: Option<Duration>,
    /// Modbus Security; nothing: connections are not encrypted.
    pub tls: Option<ListenerTls>,
}

/// TLS with certificates on both sides. Absolute paths.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListenerTls {
    /// The gateway's certificate with its chain.
    pub cert_file: PathBuf,
    /// Its key.
    pub key_file: PathBuf,
    /// The authorities whose clients are let in.
    pub client_ca_file: PathBuf,
    /// What each role may do besides reading, by its text; at least one. Whoever has another role may nothing. The empty
    /// text is the role of a certificate without one.
    pub roles: BTreeMap<String, Rights>,
}

/// The networks that Docker and Podman give their bridge by default.
const BRIDGES: [Ipv4Net; 2] =
    [Ipv4Net::new_assert(Ipv4Addr::new(172, 17, 0, 0), 16), Ipv4Net::new_assert(Ipv4Addr::new(10, 88, 0, 0), 16)];

/// What it means that an address list names one of [`ListenerSettings::bridges`].
pub const BEHIND_A_BRIDGE: &str = "behind the bridge of a container every client may come from there, whoever it is; use the \
                                   host's network (--network host) and list the addresses of the clients";

impl ListenerSettings {
    /// What its lists name of the networks that bridges of containers have by default: in a container behind such a bridge
    /// all clients may have its address, and whom a list means is anybody then.
    #[must_use]
    pub fn bridges(&self) -> BTreeSet<IpNet> {
        let lists = [self.allow.as_ref(), Some(&self.write), self.stop.as_ref()].into_iter().flatten().flatten();
        let is_bridge = |net: &&IpNet| BRIDGES.iter().any(|bridge| IpNet::V4(*bridge).contains(*net));
        lists.filter(is_bridge).copied().collect()
    }

    /// Whether the drives of the line at index `line` are reached through this listener.
    #[must_use]
    pub fn serves(&self, line: usize) -> bool {
        self.lines.as_ref().is_none_or(|lines| lines.contains(&line))
    }

    /// Whether `unit` of such a line answers here.
    #[must_use]
    pub fn answers_at(&self, unit: UnitId) -> bool {
        self.units.as_ref().is_none_or(|units| units.contains(&unit))
    }
}

/// The longest that a command to a drive of `control` may wait before its first frame leaves, where it sets no
/// time of its own: every lease of the drive is longer.
#[must_use]
pub fn command_deadline(control: &ControlSettings, mqtt: Option<&MqttSettings>) -> Duration {
    let by_broker = control.from_mqtt || control.from_sparkplug;
    let over_mqtt = mqtt.filter(|_| by_broker).map(|mqtt| mqtt.command_ttl);
    let others = (control.from_modbus_tcp || control.from_page).then_some(COMMAND_DEADLINE);
    over_mqtt.max(others).unwrap_or(COMMAND_DEADLINE)
}
