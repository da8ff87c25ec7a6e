//! The flow of `deploy/node-red` in Node-RED as it stands, but for the broker's port and the gateway's name: it shows the
//! drive, moves it, stops it, and says what became of each command.

use super::mosquitto::free_port;
use super::plant::{FREQUENCY, Plant, RUN};
use super::rig::Place;
use super::started::{PATIENCE, Started, until};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// It reads some hundred files before it begins.
const START_MAX: Duration = Duration::from_secs(60);

pub struct NodeRed {
    program: Started,
    port: u16,
}

impl NodeRed {
    /// Starts it with `flow` in a directory of `place`, and waits until that is connected.
    pub fn start(place: &Place, flow: &str) -> Self {
        let (port, directory) = (free_port(), place.file("node-red"));
        std::fs::create_dir(&directory).unwrap();
        let settings = format!(
            "module.exports = {{ uiHost: '127.0.0.1', uiPort: {port}, lang: 'en-US', credentialSecret: false, \
             telemetry: {{ enabled: false, updateNotification: false }} }};"
        );
        std::fs::write(directory.join("settings.js"), settings).unwrap();
        std::fs::write(directory.join("flow.json"), flow).unwrap();
        let installed = root().join("tests/process/node-red/node_modules/node-red/red.js");
        assert!(
            installed.exists(),
            "Node-RED is not there; run tests/run, which installs it"
        );
        let mut command = Command::new("node");
        command
            .arg(installed)
            .arg("--userDir")
            .arg(&directory)
            .arg(directory.join("flow.json"));
        let program = Started::new(command);
        let is_connected = || {
            program
                .find_all(|line| line.contains("Connected to broker").then_some(()))
                .pop()
        };
        let end = Instant::now() + START_MAX;
        while is_connected().is_none() {
            assert!(
                Instant::now() < end,
                "Node-RED is not connected to the broker; it said:\n{}",
                program.text()
            );
            std::thread::sleep(Duration::from_millis(10));
        }
        Self { program, port }
    }

    /// Presses the button of an inject node.
    fn press(&self, node: &str) {
        let mut stream = TcpStream::connect((Ipv4Addr::LOCALHOST, self.port)).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        write!(
            stream,
            "POST /inject/{node} HTTP/1.0\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n"
        )
        .unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    }

    /// What a debug node has said so far.
    fn said(&self, node: &str) -> Vec<String> {
        let mark = format!("[debug:{node}] ");
        self.program
            .find_all(|line| line.split_once(&mark).map(|(_, text)| text.to_owned()))
    }

    /// Waits until it says something else than what it had said `before`, with `part` in it.
    pub fn wait_for(&self, node: &str, before: usize, part: &str) -> String {
        until(
            &format!("{part} of {node}; it said {:?}", self.program.text()),
            PATIENCE,
            || {
                self.said(node)
                    .into_iter()
                    .skip(before)
                    .find(|text| text.contains(part))
            },
        )
    }
}

/// The flow as an operator imports it, with the broker and the gateway of this test.
fn flow(plant: &Plant) -> String {
    let text = std::fs::read_to_string(root().join("deploy/node-red/flow.json")).unwrap();
    let port = format!("\"port\": \"{}\"", plant.broker.address().port());
    let (with_port, with_name) = (text.replace("\"port\": \"1883\"", &port), "vfd/plant/");
    assert!(with_port != text && with_port.contains("vfd/plant-a/"));
    with_port
        .replace("\"localhost\"", "\"127.0.0.1\"")
        .replace("vfd/plant-a/", with_name)
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_owned()
}

#[test]
fn the_flow_of_node_red_moves_the_drive_and_shows_it() {
    let plant = Plant::new();
    let node_red = NodeRed::start(&plant.place, &flow(&plant));
    node_red.wait_for("presence", 0, "online");

    node_red.press("vfd-forward");
    plant.wait_for_write(0, (FREQUENCY, 3000), PATIENCE);
    plant.wait_for_write(0, (RUN, 1), PATIENCE);
    assert!(
        node_red
            .wait_for("results", 0, "acknowledged")
            .starts_with("acknowledged")
    );
    node_red.wait_for("state", 0, "forward, 30 Hz");

    let seen = plant.written().len();
    node_red.press("vfd-setpoint");
    plant.wait_for_write(seen, (FREQUENCY, 2000), PATIENCE);
    node_red.wait_for("state", 0, "forward, 20 Hz");

    let (seen, results) = (plant.written().len(), node_red.said("results").len());
    node_red.press("vfd-stop");
    plant.wait_for_write(seen, (RUN, 0), PATIENCE);
    node_red.wait_for("results", results, "confirmed");
    node_red.wait_for("state", 0, "stopped, 0 Hz");
    assert_eq!(node_red.said("errors"), [""; 0]);
}
