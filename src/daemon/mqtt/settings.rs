//! How the broker is reached.

use crate::config::TlsSettings;
use crate::north::broker::MqttVersion;
use std::fmt;
use std::time::Duration;

/// Shortest keep-alive that is used: a slow answer is not a dead connection.
const KEEP_ALIVE_MIN: Duration = Duration::from_secs(5);
/// Longest keep-alive that is used. The protocol allows 18 hours, during which a dead connection would go unnoticed.
const KEEP_ALIVE_MAX: Duration = Duration::from_secs(600);

/// How the broker is reached, and as whom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConnectionSettings {
    /// Its host name or address.
    pub host: String,
    /// Its TCP port.
    pub port: u16,
    /// Other addresses of the same broker, such as the nodes of a cluster: after each connection the next one is tried.
    pub also_at: Vec<(String, u16)>,
    /// How it is authenticated; `None` for plain TCP.
    pub tls: Option<TlsSettings>,
    /// Client identifier; must be unique at the broker.
    pub client_id: String,
    /// User name.
    pub user: Option<String>,
    /// Password.
    pub password: Option<HiddenText>,
    /// Longest silence of this side; limited to 5 s to 600 s.
    pub keep_alive: Duration,
    /// Protocol version.
    pub version: MqttVersion,
    /// What the broker keeps for this client while it is disconnected.
    pub keeps: BrokerKeeps,
}

/// What a broker keeps for a disconnected client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BrokerKeeps {
    /// Nothing: messages that waited would be stale.
    #[default]
    Nothing,
    /// Its subscriptions, and messages for them at quality of service 1. Messages are valid at any age.
    Session,
}

impl ConnectionSettings {
    /// The keep-alive that is actually used.
    #[must_use]
    pub fn keep_alive(&self) -> Duration {
        self.keep_alive.clamp(KEEP_ALIVE_MIN, KEEP_ALIVE_MAX)
    }

    /// These settings with the broker's next address.
    #[must_use]
    pub fn at_next_place(mut self) -> Self {
        if !self.also_at.is_empty() {
            let (host, port) = self.also_at.remove(0);
            self.also_at.push((
                std::mem::replace(&mut self.host, host),
                std::mem::replace(&mut self.port, port),
            ));
        }
        self
    }
}

/// A text that is hidden in debug output.
#[derive(Clone, PartialEq, Eq)]
pub struct HiddenText(String);

impl HiddenText {
    /// Hides `text`.
    #[must_use]
    pub const fn new(text: String) -> Self {
        Self(text)
    }

    /// The text itself.
    #[must_use]
    pub fn expose(&self) -> &str {
        &self.0
    }
}

impl fmt::Debug for HiddenText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("***")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> ConnectionSettings {
        ConnectionSettings {
            host: "broker".to_owned(),
            port: 1883,
            also_at: Vec::new(),
            tls: None,
            client_id: "gateway".to_owned(),
            user: None,
            password: Some(HiddenText::new("hunter2".to_owned())),
            keep_alive: Duration::from_secs(30),
            version: MqttVersion::V5,
            keeps: BrokerKeeps::Nothing,
        }
    }

    #[test]
    fn places_of_a_broker_take_turns() {
        let also_at = vec![("second".to_owned(), 2883), ("third".to_owned(), 3883)];
        let mut settings = ConnectionSettings {
            also_at,
            ..settings()
        };
        let turns: Vec<_> = (0..4)
            .map(|_| {
                settings = settings.clone().at_next_place();
                (settings.host.clone(), settings.port)
            })
            .collect();
        let expected = [
            ("second", 2883),
            ("third", 3883),
            ("broker", 1883),
            ("second", 2883),
        ];
        assert_eq!(turns, expected.map(|(host, port)| (host.to_owned(), port)));
        let alone = ConnectionSettings {
            also_at: Vec::new(),
            ..settings
        };
        assert_eq!(alone.clone().at_next_place(), alone);
    }

    #[test]
    fn a_password_is_never_shown() {
        let settings = settings();
        assert!(!format!("{settings:?}").contains("hunter2"));
        assert_eq!(
            settings.password.as_ref().map(HiddenText::expose),
            Some("hunter2")
        );
    }
}
