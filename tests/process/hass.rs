//! Home Assistant itself, without a screen: its directory, its start and its REST interface.

use super::mosquitto::free_port;
use super::rig::Place;
use super::started::{PATIENCE, Started, until};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

/// How long its start may take on a machine that is busy with other tests.
const START: Duration = Duration::from_secs(120);
/// The key of the only user's token, and that token, signed with it: good until 2096.
const KEY: &str = "0000000000000000000000000000000000000000000000000000000000000000";
const TOKEN: &str = "eyJhbGciOiJIUzI1NiIsInR5cCI6IkpXVCJ9.\
                     eyJpc3MiOiJyMSIsImlhdCI6MTcwMDAwMDAwMCwiZXhwIjo0MDAwMDAwMDAwfQ.\
                     J0z6ZBO3tC_9ZDiVmGIU6cadEnKunKOCbCRxYEOwm3A";

/// The program: that of `tests/run`, or another one that HASS names. Nothing where this machine has no Python for it.
pub fn program() -> Option<PathBuf> {
    if std::env::var_os("WITHOUT_HOME_ASSISTANT").is_some() {
        println!("left out: there is no Home Assistant for this Python");
        return None;
    }
    let own = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/.venv-ha/bin/hass");
    Some(std::env::var_os("HASS").map_or_else(|| own.into(), PathBuf::from))
}

/// A running Home Assistant.
pub struct Hass {
    pub program: Started,
    http: SocketAddr,
}

impl Hass {
    /// Starts it in a directory of `place`, with a broker at `broker` and the delivered package, and waits until it is up.
    pub fn start(program: PathBuf, place: &Place, broker: SocketAddr) -> Self {
        let http = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
        let directory = place.file("hass");
        std::fs::create_dir_all(directory.join(".storage")).unwrap();
        std::fs::write(directory.join("package.yaml"), package()).unwrap();
        let settings = format!(
            "homeassistant:\n  packages:\n    vfd_gateway: !include package.yaml\n\
             http:\n  server_host: 127.0.0.1\n  server_port: {}\napi:\nlogger:\n  default: warning\n",
            http.port()
        );
        std::fs::write(directory.join("configuration.yaml"), settings).unwrap();
        for (name, data) in [
            ("auth", auth()),
            ("core.config_entries", json!({ "entries": [entry(broker)] })),
            (
                "onboarding",
                json!({ "done": ["user", "core_config", "analytics", "integration"] }),
            ),
        ] {
            let document = json!({ "version": 1, "minor_version": 1, "key": name, "data": data });
            std::fs::write(directory.join(".storage").join(name), document.to_string()).unwrap();
        }
        let mut command = Command::new(&program);
        // What it needs is installed; it shall fetch nothing.
        command.arg("--skip-pip").arg("-c").arg(&directory);
        assert!(
            program.exists(),
            "{} is not there; run tests/run, which installs it",
            program.display()
        );
        let hass = Self {
            program: Started::new(command),
            http,
        };
        until("Home Assistant is up", START, || {
            let config = hass.ask("GET", "/api/config", "")?;
            (config["state"] == "RUNNING").then_some(())
        });
        hass
    }

    /// State and attributes of an entity; nothing as long as it is not there.
    pub fn entity(&self, id: &str) -> Option<Value> {
        self.ask("GET", &format!("/api/states/{id}"), "")
            .filter(|it| it.get("state").is_some())
    }

    /// Waits until an entity is in a state.
    pub fn wait_for(&self, id: &str, state: &str) {
        until(&format!("{id} is {state}"), PATIENCE, || {
            self.entity(id).filter(|it| it["state"] == state)
        });
    }

    /// Calls a service, as an automation or a person does.
    pub fn call(&self, service: &str, data: &Value) {
        self.ask(
            "POST",
            &format!("/api/services/{service}"),
            &data.to_string(),
        )
        .expect("an answer");
    }

    /// All entities.
    pub fn entities(&self) -> Vec<Value> {
        self.ask("GET", "/api/states", "")
            .and_then(|it| it.as_array().cloned())
            .unwrap_or_default()
    }

    fn ask(&self, method: &str, path: &str, body: &str) -> Option<Value> {
        let mut stream = TcpStream::connect(self.http).ok()?;
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let length = body.len();
        let head = format!(
            "{method} {path} HTTP/1.0\r\nHost: localhost\r\nAuthorization: Bearer {TOKEN}\r\n\
             Content-Type: application/json\r\nContent-Length: {length}\r\n\r\n"
        );
        stream.write_all((head + body).as_bytes()).ok()?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).ok()?;
        serde_json::from_str(answer.split_once("\r\n\r\n")?.1).ok()
    }
}

/// The delivered package, whose automations and script are for `pump-1` of the gateway `plant`.
pub fn package() -> String {
    std::fs::read_to_string(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/deploy/home-assistant/package.yaml"
    ))
    .unwrap()
}

/// One user, who owns it, with one token.
fn auth() -> Value {
    json!({
        "users": [{
            "id": "u1", "group_ids": ["system-admin"], "is_owner": true, "is_active": true, "name": "test",
            "system_generated": false, "local_only": false,
        }],
        "groups": [
            { "id": "system-admin", "name": "Administrators" },
            { "id": "system-users", "name": "Users" },
            { "id": "system-read-only", "name": "Read Only" },
        ],
        "credentials": [],
        "refresh_tokens": [{
            "id": "r1", "user_id": "u1", "client_id": null, "client_name": "test", "client_icon": null,
            "token_type": "long_lived_access_token", "created_at": "2024-01-01T00:00:00+00:00",
            "access_token_expiration": 3_153_600_000.0, "token": "ab", "jwt_key": KEY, "last_used_at": null,
            "last_used_ip": null, "expire_at": null, "credential_id": null, "version": "2024.3.3",
        }],
    })
}

/// The MQTT integration at `broker`.
fn entry(broker: SocketAddr) -> Value {
    json!({
        "entry_id": "mqtt1", "version": 1, "minor_version": 1, "domain": "mqtt", "title": "broker",
        "data": {
            "broker": broker.ip().to_string(), "port": broker.port(), "discovery": true,
            "discovery_prefix": "homeassistant",
        },
        "options": {}, "pref_disable_new_entities": false, "pref_disable_polling": false, "source": "user",
        "unique_id": null, "disabled_by": null,
    })
}
