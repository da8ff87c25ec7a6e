//! Files with secrets: which ones the configuration names, and whether every user of this host may read them.

use crate::config::{BrokerSettings, Config, HashSource, PasswordSource};
use crate::daemon::host::user_files;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

/// Longest file with a password or a hash in bytes.
const BYTES_MAX: u64 = 4096;
/// The read permission for others.
const BY_EVERYBODY: u32 = 0o004;

/// The text of a file with a password or a hash.
///
/// # Errors
/// Those of [`user_files::text`]; the file is longer than any secret, or not a regular file.
pub fn read(path: &Path) -> io::Result<String> {
    user_files::text(path, BYTES_MAX)
}

/// Warns of each file with a secret that every user of this host may read.
pub fn warn(config: &Config) {
    for file in secret_paths(config)
        .into_iter()
        .filter(|file| is_open(file))
    {
        let file = file.display();
        tracing::warn!(%file, "every user of this host can read this secret file; set its mode to 0600 or 0640");
    }
}

/// All that `config` names.
fn secret_paths(config: &Config) -> Vec<&Path> {
    let mut found = Vec::new();
    if let Some(mqtt) = &config.mqtt {
        let password = mqtt
            .credentials
            .as_ref()
            .and_then(|credentials| credentials.password.as_ref());
        if let Some(PasswordSource::File(file)) = password {
            found.push(file.as_path());
        }
        if let BrokerSettings::Tcp { tls: Some(tls), .. } = &mqtt.broker {
            found.extend(tls.client.as_ref().map(|client| client.key_file.as_path()));
        }
    }
    let listeners = config
        .listeners
        .iter()
        .filter_map(|listener| listener.tls.as_ref());
    found.extend(listeners.map(|tls| tls.key_file.as_path()));
    if let Some(http) = &config.http {
        found.extend(http.tls.as_ref().map(|tls| tls.key_file.as_path()));
        found.extend(http.users.iter().filter_map(|user| match &user.hash {
            HashSource::File(file) => Some(file.as_path()),
            HashSource::Text(_) => None,
        }));
    }
    found
}

/// A missing file is reported elsewhere.
fn is_open(file: &Path) -> bool {
    std::fs::metadata(file).is_ok_and(|it| it.permissions().mode() & BY_EVERYBODY != 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use crate::daemon::testing::Dir;
    use crate::vendors;
    use std::fs::Permissions;

    const FILE: &str = r#"
[gateway]
name = "plant-a"
[[line]]
name = "hall-1"
port = "/dev/ttyUSB0"
[[line.drive]]
name = "pump-1"
model = "hyundai-n700"
station = 1
[line.drive.control]
from = ["page", "mqtt"]
frequency_hz = { min = 0.0, max = 50.0 }
on_commander_lost = "stop"
lost_after = "10s"
on_shutdown = "stop"
[mqtt]
broker = "mqtts://broker.example"
user = "gateway"
password_file = "/secret/password"
client_cert_file = "/open/mqtt.pem"
client_key_file = "/secret/mqtt.key"
[[modbus_tcp]]
listen = "127.0.0.1:802"
[modbus_tcp.tls]
cert_file = "/open/modbus.pem"
key_file = "/secret/modbus.key"
client_ca_file = "/open/ca.pem"
roles = { viewer = [] }
[http]
listen = "127.0.0.1:8080"
[[http.users]]
name = "anna"
password_hash_file = "/secret/anna.hash"
[http.tls]
cert_file = "/open/http.pem"
key_file = "/secret/http.key"
"#;

    #[test]
    fn every_secret_is_looked_at_and_nothing_else() {
        let catalog = vendors::catalog();
        let config = config::load(FILE, &catalog).unwrap();
        let mut found = secret_paths(&config);
        found.sort();
        let right = [
            "anna.hash",
            "http.key",
            "modbus.key",
            "mqtt.key",
            "password",
        ];
        assert_eq!(found, right.map(|name| Path::new("/secret").join(name)));
    }

    #[test]
    fn a_file_that_everybody_may_read_is_open() {
        let dir = Dir::new();
        let place = dir.join("secret");
        std::fs::write(&place, "hunter2\n").unwrap();
        for (mode, right) in [(0o600, false), (0o640, false), (0o644, true), (0o604, true)] {
            std::fs::set_permissions(&place, Permissions::from_mode(mode)).unwrap();
            assert_eq!(is_open(&place), right, "{mode:o}");
        }
        assert_eq!(read(&place).unwrap(), "hunter2\n");
        std::fs::write(&place, "x".repeat(4097)).unwrap();
        assert!(read(&place).unwrap_err().to_string().contains("4096"));
        std::fs::remove_file(&place).unwrap();
        assert!(!is_open(&place) && read(&place).is_err());
        assert!(
            read(Path::new("/dev/zero")).is_err(),
            "what has no end is not read for ever"
        );
    }
}
