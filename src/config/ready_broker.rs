//! Ready values of the broker's table: how it is reached, as whom, and what is said there.

use crate::domain::ids::Name;
use crate::north::broker::{Qos, Version};
use crate::north::mqtt::{HomeAssistant, LeaseMode, Settings, Tree};
use crate::north::sparkplug;
use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

/// The connection to a broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MqttSettings {
    /// Where it is.
    pub broker: BrokerSettings,
    /// Who the gateway is there; nothing: anonymous.
    pub credentials: Option<Credentials>,
    /// The client identifier; nothing: see [`Self::client_id`].
    pub client_id: Option<String>,
    /// Protocol version.
    pub version: Version,
    /// At which quality of service commands are subscribed.
    pub subscription_qos: Qos,
    /// First levels of all topics, without a slash at either end.
    pub prefix: String,
    /// A value that does not change is published again after this time, 1 s to 1 h.
    pub heartbeat: Duration,
    /// The protocol's own sign of life, 5 s to 10 min, in whole seconds.
    pub keep_alive: Duration,
    /// What keeps the leases of the MQTT side alive: the way through the broker, if that keeps one of a drive.
    pub lease: LeaseMode,
    /// A topic whose payload `offline` says that the commanders are gone; nothing: none, as with explicit leases.
    pub alive_topic: Option<String>,
    /// How often the way through the broker is probed, 200 ms to 1 min.
    pub probe_interval: Duration,
    /// Deadline of a command that names none, 100 ms to 1 min; shorter than every lease.
    pub command_ttl: Duration,
    /// Topics under which a requester may ask for the response; nothing: response topics are ignored.
    pub response_prefix: Option<String>,
    /// Most changes of telemetry that are kept while the broker is away, 0 to 100,000; 0: none.
    pub keep_telemetry: u32,
    /// What is published beside that which always is, each once.
    pub publish: Vec<Tree>,
    /// Discovery by Home Assistant; nothing: nothing is said to it.
    pub home_assistant: Option<HomeAssistant>,
    /// Sparkplug B; nothing: nothing is said to its hosts.
    pub sparkplug: Option<SparkplugSettings>,
}

/// Sparkplug B at the same broker, by a connection of its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SparkplugSettings {
    /// The group: one level of a topic.
    pub group: String,
    /// The host without which nothing is born; nothing: nobody is waited for.
    pub primary_host: Option<String>,
    /// The client identifier; nothing: see [`MqttSettings::sparkplug_client_id`].
    pub client_id: Option<String>,
    /// The oldest that a command may be by its timestamp, 1 s to 5 min.
    pub max_command_age: Duration,
    /// Most changes of telemetry that are kept while no host can be told, 0 to 100,000.
    pub keep_telemetry: u32,
}

impl MqttSettings {
    /// Probes that may stay out before the connection is given up. A session lease outlives as many.
    pub const PROBES: u32 = 3;

    /// Whether the broker is a child of this process.
    #[must_use]
    pub fn is_embedded(&self) -> bool {
        self.broker == BrokerSettings::Embedded
    }

    /// The client identifier of the gateway called `gateway`.
    #[must_use]
    pub fn client_id(&self, gateway: &Name) -> String {
        self.client_id.clone().unwrap_or_else(|| format!("vfd-gateway-{gateway}"))
    }

    /// The client identifier of its Sparkplug side.
    #[must_use]
    pub fn sparkplug_client_id(&self, gateway: &Name) -> String {
        let own = self.sparkplug.as_ref().and_then(|sparkplug| sparkplug.client_id.clone());
        own.unwrap_or_else(|| format!("{}-sparkplug", self.client_id(gateway)))
    }

    /// What the Sparkplug session of the gateway called `gateway` needs; nothing: there is none.
    #[must_use]
    pub fn sparkplug_session(&self, gateway: Name) -> Option<sparkplug::Settings> {
        let settings = self.sparkplug.as_ref()?;
        Some(sparkplug::Settings {
            group: settings.group.clone(),
            primary_host: settings.primary_host.clone(),
            version: self.version,
            probe_topic: format!("{}/{gateway}/sparkplug/probe", self.prefix),
            node: gateway,
            probe_interval: self.probe_interval,
            probe_timeout: self.probe_interval * Self::PROBES,
            command_ttl: self.command_ttl,
            max_command_age: settings.max_command_age,
            keep_telemetry: usize::try_from(settings.keep_telemetry).unwrap_or(usize::MAX),
        })
    }

    /// What the MQTT session of the gateway called `gateway` needs.
    #[must_use]
    pub fn session(&self, gateway: Name) -> Settings {
        Settings {
            prefix: self.prefix.clone(),
            gateway,
            version: self.version,
            subscription_qos: self.subscription_qos,
            heartbeat: self.heartbeat,
            lease: self.lease,
            alive_topic: self.alive_topic.clone(),
            probe_interval: self.probe_interval,
            probe_timeout: self.probe_interval * Self::PROBES,
            command_ttl: self.command_ttl,
            response_prefix: self.response_prefix.clone(),
            keep_telemetry: usize::try_from(self.keep_telemetry).unwrap_or(usize::MAX),
            publish: self.publish.clone(),
            home_assistant: self.home_assistant.clone(),
        }
    }
}

/// Where the broker is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BrokerSettings {
    /// A child of this process, for trying out.
    Embedded,
    /// On the network.
    Tcp {
        /// Name or address; an IPv6 address without brackets.
        host: String,
        /// Port, from 1.
        port: u16,
        /// Where the other nodes of its cluster are.
        also_at: Vec<(String, u16)>,
        /// How the connection is encrypted; nothing: it is not.
        tls: Option<TlsSettings>,
    },
}

impl fmt::Display for BrokerSettings {
    /// As the file writes it, with its port.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Embedded => f.write_str("embedded"),
            Self::Tcp { host, port, tls, .. } => {
                let scheme = if tls.is_some() { "mqtts" } else { "mqtt" };
                if host.contains(':') {
                    write!(f, "{scheme}://[{host}]:{port}")
                } else {
                    write!(f, "{scheme}://{host}:{port}")
                }
            }
        }
    }
}

/// How a connection is encrypted. The broker's certificate is always verified.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TlsSettings {
    /// The authority that signed the broker's certificate; nothing: those that the system trusts.
    pub ca_file: Option<PathBuf>,
    /// By which certificate the broker knows the gateway; nothing: by none.
    pub client: Option<ClientCertificate>,
}

/// A certificate of the gateway's own. Absolute paths.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClientCertificate {
    /// The certificate with its chain.
    pub cert_file: PathBuf,
    /// Its key.
    pub key_file: PathBuf,
}

/// Who the gateway is at the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Credentials {
    /// The user's name.
    pub user: String,
    /// Where the password is; nothing: there is none.
    pub password: Option<PasswordSource>,
}

/// Where a password is read from when it is needed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PasswordSource {
    /// The text of the file at this absolute path.
    File(PathBuf),
    /// The environment variable of this name.
    Env(String),
}
