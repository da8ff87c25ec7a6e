//! The guides that begin beside the demo: the README, MQTT by example, a PLC or a SCADA system. Each ends with a
//! gateway of the reader's own.

use super::super::mosquitto::free_port;
use super::super::rig::{Place, only_demo};
use super::super::started::{PATIENCE, Started, until};
use super::broker::Broker;
use super::first_steps::played;
use super::follow::{Guide, NotRun, Table, Typed};
use super::{ADAPTER, DATA_DIR};
use std::process::Command;

/// What is shown, and not typed.
const SHOWN: &str = "a document that is shown: the test of all documents reads it";

/// What a reader has in the place of the ports of the demo, the adapter and the directory.
fn places(place: &Place, demo: &'static str, [modbus, page]: [u16; 2]) -> Table {
    std::fs::create_dir(place.file("data")).unwrap();
    let here = |name: &str| place.file(name).to_str().unwrap().to_owned();
    vec![
        (ADAPTER, here("line")),
        (DATA_DIR, here("data")),
        (
            demo,
            format!("vfd-gateway demo --port {modbus} --http-port {page}"),
        ),
    ]
}

/// The demo says where its broker is: at the usual port, or at another one where that is taken.
fn broker_of_the_demo(guide: &mut Guide, typed: &Typed) {
    let found = typed.said.lines().find_map(|line| {
        line.strip_prefix("MQTT broker 127.0.0.1:")?
            .split(',')
            .next()
    });
    let port = found.unwrap_or_else(|| panic!("no broker in: {}", typed.said));
    guide.add_to_table(vec![("-p 1883", format!("-p {port}"))]);
}

/// Commands that the demo at this broker has taken.
struct Results {
    watcher: Started,
    before: usize,
}

impl Results {
    fn new(typed: &Typed) -> Self {
        let (_, rest) = typed.said.split_once("MQTT broker 127.0.0.1:").unwrap();
        let mut command = Command::new("stdbuf");
        command.args([
            "-oL",
            "mosquitto_sub",
            "-h",
            "127.0.0.1",
            "-p",
            rest.split(',').next().unwrap(),
            "-v",
        ]);
        command.args(["-t", "vfd/demo/drive/+/result", "-t", "vfd/demo/status"]);
        let watcher = Started::new(command);
        watcher.wait_for("the gateway", |line| line.ends_with("online").then_some(()));
        Self { watcher, before: 0 }
    }

    fn taken(&self) -> usize {
        let is_taken = |line: &String| {
            let result: serde_json::Value = serde_json::from_str(line.split_once(' ')?.1).ok()?;
            let is_good = ["acknowledged", "confirmed"]
                .iter()
                .any(|word| result["outcome"] == **word);
            (result["final"] == true && is_good).then_some(())
        };
        self.watcher.find_all(is_taken).len()
    }

    /// Waits for the end of a command that was published.
    fn wait_for_another(&mut self, line: &str) {
        let what = format!("the end of {line}");
        self.before = until(&what, PATIENCE, || {
            Some(self.taken()).filter(|taken| *taken > self.before)
        });
    }
}

#[test]
fn the_guide_to_mqtt_works() {
    const NOT_RUN: &[NotRun] = &[("{", SHOWN)];
    let alone = only_demo();
    let place = Place::new();
    let _drive = played(&place, "line", "hyundai-n700");
    let broker = Broker::start(&place);
    let mut table = places(&place, "vfd-gateway demo", [0, 0]);
    table.extend([
        (
            "mqtts://broker.example:8883",
            format!("mqtts://localhost:{}", broker.tls_port),
        ),
        (
            "-h broker.example -p 8883",
            format!("-h localhost -p {}", broker.tls_port),
        ),
        ("/run/secrets/mqtt", broker.password_file.clone()),
        ("/etc/vfd-gateway/broker-ca.pem", broker.authority.clone()),
    ]);
    let mut guide = Guide::new("docs/mqtt.md", place, table, NOT_RUN);
    guide.alone = Some(alone);
    let mut results = None;
    guide.follow(|guide, typed| {
        if typed.line == "vfd-gateway demo" {
            broker_of_the_demo(guide, typed);
            results = Some(Results::new(typed));
        } else if typed.line.starts_with("mosquitto_pub")
            && ["/command ", "/set "]
                .iter()
                .any(|it| typed.line.contains(it))
        {
            results.as_mut().unwrap().wait_for_another(&typed.line);
        } else if typed.line.starts_with("mosquitto_sub") {
            assert!(!typed.said.is_empty(), "{}", typed.line);
        }
    });
}

#[test]
fn the_guide_to_plcs_works() {
    const NOT_RUN: &[NotRun] = &[(
        "status := word 1;",
        "structured text: `controller` runs the block that it explains",
    )];
    let alone = only_demo();
    let place = Place::new();
    let _drive = played(&place, "line", "teco-e510");
    let [demo, own, office] = [free_port(), free_port(), free_port()];
    let mut table = places(&place, "vfd-gateway demo", [demo, 0]);
    table.extend([
        ("-p 1502 127.0.0.1", format!("-p {demo} 127.0.0.1")),
        ("-p 1502 10.0.0.5", format!("-p {own} 127.0.0.5")),
        ("10.0.0.5:1502", format!("127.0.0.5:{own}")),
        ("10.0.0.5:1503", format!("127.0.0.5:{office}")),
        ("10.0.0.0/24", "127.0.0.0/24".to_owned()),
        ("10.0.0.10/32", "127.0.0.10/32".to_owned()),
        ("10.0.0.11/32", "127.0.0.11/32".to_owned()),
    ]);
    let mut guide = Guide::new("docs/plc-and-scada.md", place, table, NOT_RUN);
    guide.alone = Some(alone);
    guide.follow(|guide, typed| {
        if typed.line.ends_with("-r 258 -p 1502 127.0.0.1 1") {
            // It was started two lines before, and this line has renewed its lease.
            let read = format!("vfd-gateway read --port {demo} --unit 101 --uniform");
            until("the motor turns", PATIENCE, || {
                guide.frequency(&read).filter(|hz| *hz > 1.0)
            });
        }
    });
}

/// What the README says of things that no test may do to its host.
const README_NOT_RUN: &[NotRun] = &[
    ("tests/run", "it runs these tests"),
    (
        "vfd-gateway init",
        "a person answers its questions: `initialising` does",
    ),
];

/// What `init` would write for the drive at `line`.
fn initialised(place: &Place, modbus: u16) {
    std::fs::create_dir(place.file("data")).unwrap();
    let here = |name: &str| place.file(name).to_str().unwrap().to_owned();
    let text = format!(
        r#"
[gateway]
data_dir = "{}"

[[line]]
name = "line-1"
port = "{}"

[[line.drive]]
name = "drive-1"
model = "hyundai-n700"
station = 1

[[modbus_tcp]]
listen = "127.0.0.1:{modbus}"
"#,
        here("data"),
        here("line")
    );
    place.write("vfd-gateway.toml", &text);
}

#[test]
fn the_readme_works() {
    let alone = only_demo();
    let place = Place::new();
    let _drive = played(&place, "line", "hyundai-n700");
    let [modbus, page] = [free_port(), free_port()];
    initialised(&place, modbus);
    let socket = place
        .file("data/vfd-gateway.sock")
        .to_str()
        .unwrap()
        .to_owned();
    let table = vec![
        (
            "cargo run --release -- demo",
            format!("vfd-gateway demo --port {modbus} --http-port {page}"),
        ),
        ("target/release/vfd-gateway", "vfd-gateway".to_owned()),
        ("-p 1502", format!("-p {modbus}")),
        ("127.0.0.1:8080", format!("127.0.0.1:{page}")),
        (
            "vfd-gateway read --unit",
            format!("vfd-gateway read --port {modbus} --unit"),
        ),
        (
            "vfd-gateway write --unit",
            format!("vfd-gateway write --port {modbus} --unit"),
        ),
        (
            "vfd-gateway health  ",
            format!("vfd-gateway health --socket {socket} "),
        ),
    ];
    let mut guide = Guide::new("README.md", place, table, README_NOT_RUN);
    guide.alone = Some(alone);
    guide.follow(|guide, typed| {
        if typed.line.ends_with("-- demo") {
            broker_of_the_demo(guide, typed);
        } else if typed.line.starts_with("mosquitto_sub") {
            // A person who reads what the line shows is slower than the first answers of the drive.
            guide
                .watcher("mosquitto_sub")
                .wait_for("that the drive stands", |line| {
                    (line == "vfd/demo/drive/pump-1/run/state stopped").then_some(())
                });
        } else if typed.line.starts_with("mosquitto_pub") {
            let said = |what: &str, found: &dyn Fn(&str) -> bool| {
                guide
                    .watcher("mosquitto_sub")
                    .wait_for(what, |line| found(line).then_some(()));
            };
            said("the result", &|line| {
                line.contains("/pump-1/result ") && line.contains("acknowledged")
            });
            let turns = |text: &str| text.parse::<f64>().is_ok_and(|hz| hz > 1.0);
            said("the rising frequency", &|line| {
                line.strip_prefix("vfd/demo/drive/pump-1/frequency/output ")
                    .is_some_and(turns)
            });
        } else if typed.line.starts_with("mbpoll") {
            guide
                .watcher("mbpoll")
                .wait_for("the output frequency", |line| {
                    let word: u16 = line.strip_prefix("[4]:")?.trim().parse().ok()?;
                    (word > 100).then_some(())
                });
        }
    });
}
