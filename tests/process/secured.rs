//! Modbus Security with programs that nobody here wrote: pymodbus by its role, and what OpenSSL finds.

use super::outsiders::{make_certificates, openssl_client, pymodbus_tls_client};
use super::raw::Raw;
use super::rig::{Place, fields, simulate, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use serde_json::{Value, json};
use std::io::{ErrorKind, Read};
use std::net::{SocketAddr, TcpStream};
use std::path::PathBuf;
use std::time::Duration;

/// Of the uniform map.
const RUN: u16 = 256;
const SETPOINT: u16 = 257;
const OWNER: u16 = 19;
/// The owner is the one who asks.
const OURSELVES: u16 = 3;

/// A gateway with a drive behind a listener with TLS. The certificates are in `tls`.
struct Secured {
    gateway: Started,
    address: SocketAddr,
    _drive: Started,
    tls: PathBuf,
    place: Place,
}

impl Secured {
    fn new() -> Self {
        let place = Place::new();
        let tls = place.file("tls");
        for args in [
            &["gateway", "127.0.0.1"][..],
            &["client", "scada", "operator"],
            &["client", "plc", "operator"],
            &["client", "panel", "viewer"],
            &["client", "intern", "intern"],
            &["client", "nobody"],
        ] {
            make_certificates(&tls, args);
        }
        std::fs::copy(tls.join("ca.pem"), tls.join("clients.pem")).unwrap();
        std::fs::create_dir(place.file("data")).unwrap();
        let port = place.file("line");
        let drive = simulate(&port);
        let file = place.write("gateway.toml", &configuration(&place));
        let gateway = start(&["run", "-c", file.to_str().unwrap()]);
        let address = gateway.wait_for("where it listens", |line| {
            let fields = fields(line)?;
            (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
        });
        gateway.wait_for("that the drive is there", |line| {
            let fields = fields(line)?;
            (fields["message"] == "drive online").then_some(())
        });
        Self {
            gateway,
            address,
            _drive: drive,
            tls,
            place,
        }
    }

    fn client(&self, name: &str, source: &str) -> Client {
        Client {
            program: pymodbus_tls_client(self.address, &self.tls, name, source),
            asked: 0,
        }
    }

    /// What OpenSSL says, with the certificate of `name` if it has one.
    fn openssl(&self, name: Option<&str>, args: &[&str]) -> (bool, String) {
        let file = |name: &str| self.tls.join(name).to_str().unwrap().to_owned();
        let mut all = vec![
            "-CAfile".to_owned(),
            file("ca.pem"),
            "-verify_return_error".to_owned(),
        ];
        if let Some(name) = name {
            all.extend([
                "-cert".to_owned(),
                file(&format!("{name}.pem")),
                "-key".to_owned(),
                file(&format!("{name}.key")),
            ]);
        }
        all.extend(args.iter().map(|arg| (*arg).to_owned()));
        openssl_client(
            self.address,
            &all.iter().map(String::as_str).collect::<Vec<_>>(),
        )
    }

    /// Has the configuration taken anew, and returns what the log says of it.
    fn reload(&self) -> String {
        let told = |line: &str| {
            let fields = fields(line)?;
            let message = fields["message"].as_str()?;
            let is_it = message == "configuration reloaded"
                || message.starts_with("configuration unchanged");
            is_it.then(|| message.to_owned())
        };
        let before = self.gateway.find_all(|line| told(line)).len();
        self.gateway.signal("HUP");
        until("the log tells of the reload", PATIENCE, || {
            self.gateway
                .find_all(|line| told(line))
                .get(before)
                .cloned()
        })
    }

    /// The rows of the audit as text.
    fn audit(&self) -> Vec<String> {
        let data = self.place.file("data");
        let output = vfd_gateway(&[
            "journal",
            "audit",
            "--data-dir",
            data.to_str().unwrap(),
            "--json",
            "--last",
            "1000",
        ]);
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8(output.stdout)
            .unwrap()
            .lines()
            .map(str::to_owned)
            .collect()
    }
}

fn configuration(place: &Place) -> String {
    let (port, data, tls) = (place.file("line"), place.file("data"), place.file("tls"));
    format!(
        r#"
[gateway]
data_dir = "{}"

[[line]]
name = "hall-1"
port = "{}"

[[line.drive]]
name = "pump-1"
model = "hyundai-n700"
station = 1
poll = "200ms"

[line.drive.control]
from = ["modbus-tcp"]
frequency_hz = {{ min = 5.0, max = 50.0 }}
on_commander_lost = "stop"
lost_after = "60s"
on_shutdown = "stop"

[[modbus_tcp]]
listen = "127.0.0.1:0"

[modbus_tcp.tls]
cert_file = "{tls}/gateway.pem"
key_file = "{tls}/gateway.key"
client_ca_file = "{tls}/clients.pem"
roles = {{ operator = ["write", "stop"], viewer = [] }}
"#,
        data.display(),
        port.display(),
        tls = tls.display()
    )
}

/// A client that stays connected.
struct Client {
    program: Started,
    asked: usize,
}

impl Client {
    /// What is answered to a request as `client.py` reads it.
    fn ask(&mut self, request: &str) -> Value {
        self.program.type_line(request);
        self.asked += 1;
        until(&format!("an answer to {request}"), PATIENCE, || {
            self.answers().get(self.asked - 1).cloned()
        })
    }

    fn answers(&self) -> Vec<Value> {
        self.program
            .find_all(|line| serde_json::from_str(line).ok().filter(Value::is_object))
    }

    fn read(&mut self, register: u16) -> Value {
        self.ask(&format!("read:101:{register}:1"))
    }

    fn write(&mut self, register: u16, word: u16) -> Value {
        self.ask(&format!("write:101:{register}:{word}"))
    }

    /// Starts the drive at 30 Hz as a controller does. As long as its stop is not effective, the start is refused.
    fn start_the_drive(&mut self) {
        for (register, word) in [(RUN, 0), (SETPOINT, 3000), (RUN, 1)] {
            until(&format!("{word} at {register} is taken"), PATIENCE, || {
                let answer = self.write(register, word);
                assert!(answer == words(word) || answer == exception(6), "{answer}");
                (answer == words(word)).then_some(())
            });
        }
    }

    /// Waits until it is sent away.
    fn wait_until_sent_away(mut self) {
        until("it is sent away", PATIENCE, || {
            self.program.type_line("read:101:0:1");
            self.asked += 1;
            // One that was sent away ends with the next request, and takes no other.
            until("an answer or the end", PATIENCE, || {
                match self.program.text().contains("Connection") {
                    true => Some(Some(())),
                    false => (self.answers().len() >= self.asked).then_some(None),
                }
            })
        });
    }
}

fn words(word: u16) -> Value {
    json!({"words": [word]})
}

fn exception(code: u8) -> Value {
    json!({"exception": code})
}

#[test]
fn pymodbus_reads_and_commands_as_its_role_says() {
    let secured = Secured::new();
    let mut scada = secured.client("scada", "127.0.0.1");
    scada.start_the_drive();
    assert_eq!(scada.read(OWNER), words(OURSELVES));

    let mut panel = secured.client("panel", "127.0.0.1");
    assert_eq!(panel.read(SETPOINT), words(3000));
    for request in [
        "write:101:256:0",
        "write:101:257:1000",
        "write:1:0x0002:0",
        "coil:255:0:1",
    ] {
        assert_eq!(panel.ask(request), exception(1), "{request}");
    }
    for name in ["intern", "nobody"] {
        let mut client = secured.client(name, "127.0.0.1");
        for request in ["read:101:0:1", "read:1:0x0101:1", "write:101:256:0"] {
            assert_eq!(client.ask(request), exception(1), "{name} {request}");
        }
    }

    // The owner is who the certificate says, wherever it connects from.
    let mut elsewhere = secured.client("scada", "127.0.0.2");
    drop(scada);
    assert_eq!(elsewhere.read(OWNER), words(OURSELVES));
    assert_eq!(elsewhere.write(SETPOINT, 2000), words(2000));
    let mut plc = secured.client("plc", "127.0.0.2");
    assert_eq!(
        plc.write(SETPOINT, 1000),
        exception(6),
        "another client holds control"
    );
    assert_eq!(elsewhere.write(RUN, 0), words(0));

    let rows = secured.audit();
    for parts in [
        ["modbus-security scada", "run forward", "ed\""],
        ["modbus-security panel", "not_allowed", "refused"],
        ["modbus-security intern", "not_allowed", "refused"],
        ["modbus-security nobody", "not_allowed", "refused"],
        ["modbus-security plc", "other_owner", "refused"],
    ] {
        assert!(
            rows.iter()
                .any(|row| parts.iter().all(|part| row.contains(part))),
            "{parts:?} in {rows:#?}"
        );
    }
}

#[test]
fn openssl_finds_1_2_and_1_3_and_nothing_weaker() {
    let secured = Secured::new();
    for (version, name) in [("-tls1_2", "TLSv1.2"), ("-tls1_3", "TLSv1.3")] {
        let (is_content, text) = secured.openssl(Some("panel"), &[version]);
        assert!(
            is_content && text.contains("Verify return code: 0 (ok)") && text.contains(name),
            "{text}"
        );
    }
    for args in [
        ["-tls1_1", "-cipher", "DEFAULT@SECLEVEL=0"],
        ["-tls1_2", "-cipher", "AES128-GCM-SHA256:AES256-GCM-SHA384"],
        [
            "-tls1_2",
            "-cipher",
            "ECDHE-ECDSA-AES128-SHA256:ECDHE-ECDSA-AES128-SHA",
        ],
        [
            "-tls1_2",
            "-cipher",
            "ECDHE-ECDSA-AES128-CCM:ECDHE-ECDSA-AES128-CCM8",
        ],
    ] {
        let (is_content, text) = secured.openssl(Some("panel"), &args);
        assert!(
            !is_content && text.contains("alert handshake failure"),
            "{args:?}: {text}"
        );
    }
}

#[test]
fn anyone_who_has_no_certificate_that_counts_is_not_let_in() {
    let secured = Secured::new();
    let elsewhere = secured.place.file("elsewhere");
    make_certificates(&elsewhere, &["client", "stranger", "operator"]);
    for file in ["stranger.pem", "stranger.key"] {
        std::fs::copy(elsewhere.join(file), secured.tls.join(file)).unwrap();
    }
    for version in ["-tls1_2", "-tls1_3"] {
        // No certificate; one of another authority; one that is not for clients.
        for name in [None, Some("stranger"), Some("gateway")] {
            // It stays until the gateway ends the connection.
            let (_, text) = secured.openssl(name, &[version, "-ign_eof"]);
            assert!(text.contains("alert"), "{version} {name:?}: {text}");
        }
    }
    let why = "failed: the client presented no certificate";
    secured.gateway.wait_for("why", |line| {
        (line.contains("TLS handshake") && line.contains(why)).then_some(())
    });
    assert!(
        secured
            .gateway
            .find_all(|line| line.contains("secure connection").then_some(()))
            .is_empty()
    );
}

#[test]
fn clients_that_stall_hold_up_nobody() {
    let secured = Secured::new();
    let mut plain = Raw::connect(secured.address);
    plain.send(&[0, 1, 0, 0, 0, 6, 101, 3, 0, 0, 0, 1]);
    secured.gateway.wait_for("that this is no TLS", |line| {
        line.contains("failed: the client does not speak TLS")
            .then_some(())
    });
    let stalled: Vec<_> = (0..100)
        .map(|_| TcpStream::connect(secured.address).unwrap())
        .collect();
    assert!(secured.client("panel", "127.0.0.1").read(0)["words"].is_array());
    // All of them are gone in time: the first because others came, the last because it took too long.
    for mut stream in stalled {
        stream
            .set_read_timeout(Some(Duration::from_secs(10)))
            .unwrap();
        match stream.read(&mut [0]) {
            Ok(0) => {}
            Err(error) if error.kind() == ErrorKind::ConnectionReset => {}
            other => panic!("it stays: {other:?}"),
        }
    }
}

#[test]
fn a_reload_takes_new_certificates_and_keeps_whom_it_still_trusts() {
    let secured = Secured::new();
    let mut panel = secured.client("panel", "127.0.0.1");
    assert!(panel.read(0)["words"].is_array());
    let serial = || {
        let (_, text) = secured.openssl(Some("panel"), &[]);
        let (_, certificate) = text.split_once("-----BEGIN CERTIFICATE-----").expect(&text);
        certificate.split_once("-----END").unwrap().0.to_owned()
    };
    let before = serial();
    make_certificates(&secured.tls, &["gateway", "127.0.0.1"]);
    assert_eq!(serial(), before, "not before the reload");
    assert_eq!(secured.reload(), "configuration reloaded");
    assert_ne!(serial(), before);
    assert!(panel.read(0)["words"].is_array(), "it stays");

    let (key, good) = (
        secured.tls.join("gateway.key"),
        std::fs::read(secured.tls.join("gateway.key")).unwrap(),
    );
    std::fs::write(&key, "no key").unwrap();
    let told = secured.reload();
    assert!(
        told.contains("gateway.key: it contains no private key"),
        "{told}"
    );
    assert!(panel.read(0)["words"].is_array(), "nothing has changed");
    std::fs::write(&key, good).unwrap();

    let elsewhere = secured.place.file("elsewhere");
    make_certificates(&elsewhere, &["client", "other", "viewer"]);
    std::fs::copy(elsewhere.join("ca.pem"), secured.tls.join("clients.pem")).unwrap();
    assert_eq!(secured.reload(), "configuration reloaded");
    panel.wait_until_sent_away();
}

#[test]
fn certificates_that_cannot_be_read_are_named_at_the_start() {
    let place = Place::new();
    std::fs::create_dir(place.file("data")).unwrap();
    let file = place.write("gateway.toml", &configuration(&place));
    let output = vfd_gateway(&["run", "-c", file.to_str().unwrap()]);
    let text = [output.stdout, output.stderr]
        .map(|it| String::from_utf8_lossy(&it).into_owned())
        .concat();
    assert!(!output.status.success(), "{text}");
    for name in ["gateway.pem", "gateway.key", "clients.pem"] {
        assert!(
            text.contains(&format!("/tls/{name}: No such file")),
            "{name}: {text}"
        );
    }
}
