//! How the broker is reached.

use crate::north::mqtt::Version;
use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

/// Shortest keep-alive that is used; the client library takes no shorter one.
const KEEP_ALIVE_MIN: Duration = Duration::from_secs(5);
/// Longest keep-alive that is used. The protocol allows 18 hours, in which nobody would notice a dead connection.
const KEEP_ALIVE_MAX: Duration = Duration::from_secs(600);

/// How the broker is reached, and as whom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConnectionSettings {
    /// Its name or address.
    pub host: String,
    /// Its TCP port.
    pub port: u16,
    /// How it is proven; nothing: plain TCP.
    pub tls: Option<TlsSettings>,
    /// Client identifier; no other client of the broker may have it.
    pub client_id: String,
    /// User name.
    pub user: Option<String>,
    /// Password.
    pub password: Option<Secret>,
    /// Longest silence of this side; used are 5 s to 600 s.
    pub keep_alive: Duration,
    /// Protocol version.
    pub version: Version,
}

impl ConnectionSettings {
    /// The keep-alive that is really used.
    #[must_use]
    pub fn keep_alive(&self) -> Duration {
        self.keep_alive.clamp(KEEP_ALIVE_MIN, KEEP_ALIVE_MAX)
    }
}

/// How the broker is proven to be the right one. It always is: there is no switch for that.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TlsSettings {
    /// PEM file with the authorities to trust, and no others; nothing: those of the system.
    pub ca_file: Option<PathBuf>,
    /// PEM files with a certificate chain and its key, to prove this side.
    pub client_cert: Option<(PathBuf, PathBuf)>,
}

/// A text that is not shown.
#[derive(Clone, PartialEq, Eq)]
pub struct Secret(String);

impl Secret {
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

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("***")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_password_is_never_shown() {
        let settings = ConnectionSettings {
            host: "broker".to_owned(),
            port: 1883,
            tls: None,
            client_id: "gateway".to_owned(),
            user: None,
            password: Some(Secret::new("hunter2".to_owned())),
            keep_alive: Duration::from_secs(30),
            version: Version::V5,
        };
        assert!(!format!("{settings:?}").contains("hunter2"));
        assert_eq!(settings.password.as_ref().map(Secret::expose), Some("hunter2"));
    }
}
