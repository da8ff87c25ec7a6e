//! The guides for a drive in a plant: a real drive, and installing and running it.

use super::super::mosquitto::free_port;
use super::super::rig::Place;
use super::broker::Broker;
use super::first_steps::played;
use super::follow::{Guide, NotRun};
use super::text::document;
use super::{ADAPTER, DATA_DIR};

/// What changes the host.
const HOST: &str = "it changes the host";

#[test]
fn the_guide_to_a_real_drive_works() {
    const NOT_RUN: &[NotRun] = &[
        ("ls -l /dev/serial/by-id/", "there is no adapter"),
        ("sudo ", HOST),
        (
            "connection: &hall-1",
            "it is for ser2net at another host: `network` runs ser2net with it",
        ),
        (
            "[[line]]\nname = \"press\"",
            "there is no such server: `modbus_tcp_drives` has some",
        ),
        (
            "vfd-gateway qualify pump-1  ",
            "a person says what the panel shows: `qualifying` does",
        ),
    ];
    let place = Place::new();
    let _drive = played(&place, "line", "hyundai-n700");
    let _unknown = played(&place, "unknown-line", "teco-e510");
    let broker = Broker::start(&place);
    let here = |name: &str| place.file(name).to_str().unwrap().to_owned();
    std::fs::create_dir(place.file("data")).unwrap();
    let [modbus, page] = [free_port(), free_port()];
    let mut table = vec![
        (ADAPTER, here("line")),
        (DATA_DIR, here("data")),
        ("/dev/ttyUSB0", here("unknown-line")),
        (
            "mqtts://broker.example:8883",
            format!("mqtts://localhost:{}", broker.tls_port),
        ),
        ("/run/secrets/mqtt", broker.password_file.clone()),
        ("/etc/vfd-gateway/broker-ca.pem", broker.authority.clone()),
        ("10.0.0.5:1502", format!("127.0.0.5:{modbus}")),
        ("10.0.0.0/24", "127.0.0.0/24".to_owned()),
        // The host that may write is this one.
        ("10.0.0.10/32", "127.0.0.1/32".to_owned()),
        (
            "--host 10.0.0.5",
            format!("--host 127.0.0.5 --port {modbus}"),
        ),
        ("127.0.0.1:8080", format!("127.0.0.1:{page}")),
    ];
    let socket = here("data/vfd-gateway.sock");
    let over_socket = [
        "health",
        "verify",
        "enable",
        "reload",
        "qualify",
        "params dump",
        "params diff",
        "params restore",
    ];
    for command in over_socket {
        let there: &'static str = format!("vfd-gateway {command}").leak();
        table.push((there, format!("{there} --socket {socket}")));
    }
    Guide::new("docs/real-drive.md", place, table, NOT_RUN).follow(|guide, typed| {
        if typed.line.starts_with("vfd-gateway enable") {
            guide.edit("put `qualify = true` into its control section", |text| {
                text.replace(
                    "on_shutdown = \"stop\"\n",
                    "on_shutdown = \"stop\"\nqualify = true\n",
                )
            });
        }
    });
}

#[test]
fn the_guide_to_the_simulator_works() {
    const NOT_RUN: &[NotRun] = &[("cargo build --release", "the program is built already")];
    let place = Place::new();
    let port = free_port();
    let table = vec![
        (
            "target/release/vfd-gateway read",
            format!("vfd-gateway read --port {port}"),
        ),
        ("target/release/vfd-gateway", "vfd-gateway".to_owned()),
        (
            "/tmp/vfd-line",
            place.file("line").to_str().unwrap().to_owned(),
        ),
        ("127.0.0.1:1502", format!("127.0.0.1:{port}")),
    ];
    Guide::new("docs/simulator.md", place, table, NOT_RUN).follow(|_, _| {});
}

#[test]
fn the_guide_to_the_installation_works() {
    const CLUSTER: &str =
        "there is no cluster: `clusters` holds the files against the schemas of Kubernetes";
    const COMPOSE: &str =
        "there is no daemon of Docker: `composing` runs the broker of the compose file";
    const PACKAGE: &str =
        "it needs a system with systemd: `tests/run package` boots one and does it there";
    const EDITOR: &str = "a person types into it";
    const NOT_RUN: &[NotRun] = &[
        (
            "sh install.sh",
            "there is no release to fetch: `tests/supply_chain/installing.rs` installs one",
        ),
        ("echo 'deb ", HOST),
        ("sudo apt-get", HOST),
        ("cargo install cargo-deb", PACKAGE),
        ("deploy/debian/build", PACKAGE),
        ("sudo apt install", PACKAGE),
        ("ls -l /dev/serial/by-id/", "there is no adapter"),
        (
            "sudo -u vfd-gateway vfd-gateway scan",
            "it takes minutes on a whole line: `scanning` does it on a short one",
        ),
        ("sudo nano", EDITOR),
        (
            "sudo systemctl enable --now",
            "what the unit starts is started in its place",
        ),
        ("sudo install", HOST),
        (
            "[Service]",
            "it is for systemd: `services` holds the unit against it",
        ),
        ("cargo build", "the program is built already"),
        ("sudo systemd-sysusers", HOST),
        ("sudo udevadm", HOST),
        ("sudo systemctl daemon-reload", HOST),
        ("cd deploy/compose", COMPOSE),
        ("cp .env.example", COMPOSE),
        ("nano ", EDITOR),
        ("sudo ./make-secrets.sh", COMPOSE),
        ("docker compose", COMPOSE),
        ("cd deploy/kubernetes", CLUSTER),
        ("mkdir -p secrets", CLUSTER),
        ("cp /path/to/", CLUSTER),
        ("kubectl ", CLUSTER),
    ];
    let place = Place::new();
    let _drive = played(&place, "line", "hyundai-n700");
    let here = |name: &str| place.file(name).to_str().unwrap().to_owned();
    for directory in ["data", "etc"] {
        std::fs::create_dir(place.file(directory)).unwrap();
    }
    let [modbus, page] = [free_port(), free_port()];
    // What the package brings, with the adapter that a person puts in, and ports of its own.
    let brought = [
        ("/dev/serial/by-id/REPLACE-ME", here("line")),
        (DATA_DIR, here("data")),
        ("127.0.0.1:1502", format!("127.0.0.1:{modbus}")),
        ("127.0.0.1:8080", format!("127.0.0.1:{page}")),
    ];
    let file = brought.iter().fold(
        document("deploy/debian/vfd-gateway.toml"),
        |text, (there, here)| {
            assert!(text.contains(there), "no {there} in {text}");
            text.replace(there, here)
        },
    );
    place.write("etc/vfd-gateway.toml", &file);
    let table = vec![
        (
            "sudo vfd-gateway health",
            format!(
                "vfd-gateway health --socket {}",
                here("data/vfd-gateway.sock")
            ),
        ),
        ("sudo vfd-gateway check", "vfd-gateway check".to_owned()),
        ("/etc/vfd-gateway/", here("etc/")),
        (
            "vfd-gateway read --unit",
            format!("vfd-gateway read --port {modbus} --unit"),
        ),
    ];
    Guide::new("docs/deployment.md", place, table, NOT_RUN).follow(|guide, typed| {
        if typed.line.starts_with("sudo vfd-gateway check") {
            let unit = document("deploy/systemd/vfd-gateway.service");
            let start = unit
                .lines()
                .find_map(|line| line.strip_prefix("ExecStart=/usr/bin/"))
                .unwrap();
            guide.start_service(start);
        } else if typed.line.starts_with("sudo vfd-gateway health") {
            assert!(
                typed
                    .said
                    .contains("drive drive-1 (hyundai-n700 on line-1): online"),
                "{}",
                typed.said
            );
        }
    });
}
