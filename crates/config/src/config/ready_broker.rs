//! Ready settings of the broker connection.

use crate::domain::ids::Name;
use crate::domain::standby::StandbyPair;
use crate::north::mqtt::Settings;
use crate::north::sparkplug;
use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

/// The connection to a broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MqttSettings {
    /// Its address.
    pub broker: BrokerSettings,
    /// The gateway's user. `None`: anonymous.
    pub credentials: Option<BrokerCredentials>,
    /// The client identifier. `None`: see [`Self::client_id`].
    pub client_id: Option<String>,
    /// The keep-alive interval of MQTT, 5 s to 10 min, in whole seconds.
    pub keep_alive: Duration,
    /// What the session with the broker needs to know.
    pub session: Settings,
    /// Sparkplug B. `None`: off.
    pub sparkplug: Option<SparkplugSettings>,
}

/// Sparkplug B at the same broker, over a separate connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SparkplugSettings {
    /// The group: one level of a topic.
    pub group: String,
    /// The primary host that births wait for. `None`: births do not wait.
    pub primary_host: Option<String>,
    /// The client identifier. `None`: see [`MqttSettings::sparkplug_client_id`].
    pub client_id: Option<String>,
    /// Maximum age of a command by its timestamp, 1 s to 5 min.
    pub max_command_age: Duration,
    /// Maximum number of telemetry changes kept while no host is online, 0 to 100,000.
    pub keep_telemetry: usize,
}

impl MqttSettings {
    /// Missing probes that end the connection. A session lease outlasts as many.
    pub const PROBES: u32 = 3;

    /// Whether the broker is embedded.
    #[must_use]
    pub fn is_embedded(&self) -> bool {
        self.broker == BrokerSettings::Embedded
    }

    /// The client identifier for a gateway called `gateway`, which is one of `standby`, if there are several.
    #[must_use]
    pub fn client_id(&self, gateway: &Name, standby: Option<&StandbyPair>) -> String {
        let client_id = self
            .client_id
            .clone()
            .unwrap_or_else(|| format!("vfd-gateway-{gateway}"));
        of_half(client_id, standby)
    }

    /// The client identifier of its Sparkplug connection. Of several gateways one at a time is the edge node: they have the
    /// same identifier, so that the broker ends the session of the one before.
    #[must_use]
    pub fn sparkplug_client_id(&self, gateway: &Name) -> String {
        let own = self
            .sparkplug
            .as_ref()
            .and_then(|sparkplug| sparkplug.client_id.clone());
        own.unwrap_or_else(|| format!("{}-sparkplug", self.client_id(gateway, None)))
    }

    /// The settings of the Sparkplug session for a gateway called `gateway`, which is one of several if `has_standby`;
    /// `None` without Sparkplug.
    #[must_use]
    pub fn sparkplug_session(
        &self,
        gateway: Name,
        has_standby: bool,
    ) -> Option<sparkplug::Settings> {
        let settings = self.sparkplug.as_ref()?;
        Some(sparkplug::Settings {
            group: settings.group.clone(),
            primary_host: settings.primary_host.clone(),
            version: self.session.version,
            probe_topic: format!("{}/{gateway}/sparkplug/probe", self.session.prefix),
            node: gateway,
            standby: has_standby,
            probe_interval: self.session.probe_interval,
            probe_timeout: self.session.probe_timeout,
            command_ttl: self.session.command_ttl,
            max_command_age: settings.max_command_age,
            keep_telemetry: settings.keep_telemetry,
        })
    }
}

/// Each of several gateways has a client identifier of its own.
fn of_half(client_id: String, standby: Option<&StandbyPair>) -> String {
    standby.map_or_else(
        || client_id.clone(),
        |pair| format!("{client_id}-{}", pair.half),
    )
}

/// The address of the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BrokerSettings {
    /// Embedded, for trials.
    Embedded,
    /// On the network.
    Tcp {
        /// Name or address; an IPv6 address without brackets.
        host: String,
        /// Port, from 1.
        port: u16,
        /// The other nodes of the broker's cluster: host and port of each.
        also_at: Vec<(String, u16)>,
        /// TLS settings. `None`: the connection is not encrypted.
        tls: Option<TlsSettings>,
    },
}

impl fmt::Display for BrokerSettings {
    /// As written in the file, with its port.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Embedded => f.write_str("embedded"),
            Self::Tcp {
                host, port, tls, ..
            } => {
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

/// TLS settings of a connection. The broker's certificate is always verified.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TlsSettings {
    /// The certificate authority of the broker. `None`: those that the system trusts.
    pub ca_file: Option<PathBuf>,
    /// The gateway's client certificate, if any.
    pub client: Option<ClientCertificate>,
}

/// A certificate of the gateway's own. Absolute paths.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClientCertificate {
    /// The certificate with its chain.
    pub cert_file: PathBuf,
    /// The key of the client certificate.
    pub key_file: PathBuf,
}

/// The gateway's user at the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BrokerCredentials {
    /// The user's name.
    pub user: String,
    /// The source of the password, if any.
    pub password: Option<PasswordSource>,
}

/// The source that a password is read from when needed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PasswordSource {
    /// The content of the file at this absolute path.
    File(PathBuf),
    /// The environment variable of this name.
    Env(String),
}
