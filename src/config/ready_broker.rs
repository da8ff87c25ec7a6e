//! Ready settings of the broker connection.

use crate::domain::ids::Name;
use crate::domain::standby::StandbyPair;
use crate::north::broker::{MqttVersion, Qos};
use crate::north::mqtt::{HomeAssistant, LeaseMode, Settings, TopicTree};
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
    /// Protocol version.
    pub version: MqttVersion,
    /// QoS of the command subscriptions.
    pub subscription_qos: Qos,
    /// First levels of all topics, without a slash at either end.
    pub prefix: String,
    /// Interval after which an unchanged value is published again, 1 s to 1 h.
    pub heartbeat: Duration,
    /// The keep-alive interval of MQTT, 5 s to 10 min, in whole seconds.
    pub keep_alive: Duration,
    /// What renews the leases of MQTT clients: the session, if it renews that of any drive.
    pub lease: LeaseMode,
    /// A topic whose payload `offline` means that the clients are gone. `None`: none, as with explicit leases.
    pub alive_topic: Option<String>,
    /// Interval of probes of the path through the broker, 200 ms to 1 min.
    pub probe_interval: Duration,
    /// Default deadline of a command, 100 ms to 1 min; shorter than every lease.
    pub command_ttl: Duration,
    /// Prefix of the response topics that a requester may name. `None`: response topics are ignored.
    pub response_prefix: Option<String>,
    /// Maximum number of telemetry changes kept while the broker is unreachable, 0 to 100,000.
    pub keep_telemetry: u32,
    /// Optional topics to publish, each once.
    pub publish: Vec<TopicTree>,
    /// Discovery by Home Assistant. `None`: off.
    pub home_assistant: Option<HomeAssistant>,
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
    pub keep_telemetry: u32,
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
            version: self.version,
            probe_topic: format!("{}/{gateway}/sparkplug/probe", self.prefix),
            node: gateway,
            standby: has_standby,
            probe_interval: self.probe_interval,
            probe_timeout: self.probe_interval * Self::PROBES,
            command_ttl: self.command_ttl,
            max_command_age: settings.max_command_age,
            keep_telemetry: usize::try_from(settings.keep_telemetry).unwrap_or(usize::MAX),
        })
    }

    /// The settings of the MQTT session for a gateway called `gateway`, which is one of `standby`, if there are several.
    #[must_use]
    pub fn session(&self, gateway: Name, standby: Option<StandbyPair>) -> Settings {
        // Announcements must not depend on who makes them, and each has a page of its own.
        let home_assistant = self.home_assistant.clone().map(|it| HomeAssistant {
            page: match standby {
                None => it.page.clone(),
                Some(_) => None,
            },
            ..it
        });
        Settings {
            prefix: self.prefix.clone(),
            gateway,
            standby,
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
            home_assistant,
        }
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
