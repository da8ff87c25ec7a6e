//! The function block of `deploy/plc`, read by a parser that nobody here wrote and run in a cycle beside a Modbus client, in
//! front of the gateway whose configuration lies there: it starts and stops a drive, and starts none that nobody wants.

use super::mosquitto::free_port;
use super::outsiders::controller;
use super::rig::{Place, fields, program, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The parser takes two seconds of a processor before the first cycle.
const START_MAX: Duration = Duration::from_secs(120);
const UNIT: u8 = 101;
/// Of run command and setpoint, in words.
const STOP: u16 = 0;
const FORWARD: u16 = 1;
const REVERSE: u16 = 2;
/// More reads in a row than any test waits for.
const NEVER_FOUND: u32 = 1_000_000;

fn delivered(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("deploy/plc")
        .join(name)
}

#[test]
fn the_table_beside_it_is_the_gateways_own() {
    let unit = UNIT.to_string();
    let file = delivered("vfd-gateway.toml");
    let output = vfd_gateway(&[
        "map",
        "-c",
        file.to_str().unwrap(),
        "--unit",
        &unit,
        "--format",
        "csv",
    ]);
    assert!(output.status.success());
    let table = std::fs::read_to_string(delivered("uniform-map.csv")).unwrap();
    assert_eq!(
        String::from_utf8(output.stdout).unwrap(),
        table,
        "vfd-gateway map prints another one"
    );
}

/// A controller before a gateway with a drive that trips when it is told to.
struct Cabinet {
    controller: Started,
    gateway: Option<Started>,
    drive: Started,
    file: PathBuf,
    port: u16,
    told: usize,
    _place: Place,
}

impl Cabinet {
    fn new() -> Self {
        let place = Place::new();
        let (line, data) = (place.file("line"), place.file("data"));
        std::fs::create_dir(&data).unwrap();
        let mut command = program();
        command
            .args([
                "simulate",
                "--model",
                "frecon-fr500a",
                "--trip-on-enter",
                "--link",
            ])
            .arg(&line);
        let drive = Started::at_a_keyboard(command);
        drive.wait_for("that it plays", |line| {
            line.contains("station 1").then_some(())
        });
        let port = free_port();
        let file = place.write("gateway.toml", &configuration(&line, &data, port));
        let gateway = Some(run(&file));
        let address = SocketAddr::from(([127, 0, 0, 1], port));
        let controller = controller(&delivered("vfd-drive.st"), address, UNIT);
        until("the controller's first cycle", START_MAX, || {
            controller
                .find_all(|line| line.starts_with('{').then_some(()))
                .pop()
        });
        Self {
            controller,
            gateway,
            drive,
            file,
            port,
            told: 0,
            _place: place,
        }
    }

    fn set(&mut self, inputs: &Value) {
        self.look_from_now_on();
        self.controller.type_line(&inputs.to_string());
    }

    /// What is waited for next is what it puts out now or later.
    fn look_from_now_on(&mut self) {
        self.told = self.outputs().len().saturating_sub(1);
    }

    /// All that the block has put out so far.
    fn outputs(&self) -> Vec<Value> {
        self.controller
            .find_all(|line| serde_json::from_str(line).ok().filter(Value::is_object))
    }

    /// Waits until it puts these out, as it was when the last inputs were set or later.
    fn wait_for(&self, outputs: &Value) -> Value {
        let mut seen = 0;
        self.controller.wait_for(&outputs.to_string(), |line| {
            let found: Value = serde_json::from_str(line).ok().filter(Value::is_object)?;
            seen += 1;
            let wanted = outputs.as_object().unwrap();
            (seen > self.told && wanted.iter().all(|(name, value)| found[name] == *value))
                .then_some(found)
        })
    }

    /// Resets the trip as somebody at the controller's own host does.
    fn reset(&self) {
        let port = self.port.to_string();
        until(
            "the reset is taken, as soon as the stop has shown its effect",
            PATIENCE,
            || {
                let output = vfd_gateway(&[
                    "write",
                    "--port",
                    &port,
                    "--unit",
                    &UNIT.to_string(),
                    "run",
                    "reset",
                ]);
                output.status.success().then_some(())
            },
        );
    }

    /// What it has put out since [`look_from_now_on`](Self::look_from_now_on).
    fn since(&self) -> Vec<Value> {
        self.outputs().split_off(self.told)
    }

    fn run_state(&self) -> String {
        let port = self.port.to_string();
        let output = vfd_gateway(&[
            "read",
            "--port",
            &port,
            "--unit",
            &UNIT.to_string(),
            "--uniform",
            "run_state",
            "--json",
        ]);
        let read: Value = serde_json::from_slice(&output.stdout).unwrap();
        read["values"][0]["value"].as_str().unwrap().to_owned()
    }

    /// Starts with 20 Hz as somebody at a desk does, and lets the button go.
    fn start_at_20_hz(&mut self) {
        self.set(&json!({ "Enable": true, "Setpoint_Hz": 20.0 }));
        self.wait_for(
            &json!({ "Inhibited": false, "WriteEnable": true, "Running": false, "Tripped": false }),
        );
        self.set(&json!({ "Start": true }));
        self.wait_for(&json!({ "Wanted": true, "Running": true, "Output_Hz": 20.0 }));
    }
}

/// The delivered file on this machine.
fn configuration(line: &Path, data: &Path, port: u16) -> String {
    let text = std::fs::read_to_string(delivered("vfd-gateway.toml")).unwrap();
    let device = "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A10KZP1X-if00-port0";
    let here = [
        (device, line.to_str().unwrap().to_owned()),
        ("/var/lib/vfd-gateway", data.to_str().unwrap().to_owned()),
        ("10.0.0.5:1502", format!("127.0.0.1:{port}")),
        ("10.0.0.0/24", "127.0.0.0/8".to_owned()),
        ("10.0.0.10/32", "127.0.0.1/32".to_owned()),
    ];
    here.iter().fold(text, |text, (there, here)| {
        assert!(text.contains(there), "no {there}");
        text.replace(there, here)
    })
}

fn run(file: &Path) -> Started {
    let gateway = start(&["run", "-c", file.to_str().unwrap()]);
    gateway.wait_for("that the drive is there", |line| {
        let fields = fields(line)?;
        (fields["message"] == "drive online").then_some(())
    });
    gateway
}

#[test]
fn it_starts_sets_turns_round_and_stops_the_drive() {
    let mut cabinet = Cabinet::new();
    cabinet.start_at_20_hz();
    cabinet.set(&json!({ "Setpoint_Hz": 80.0 }));
    let refused = cabinet.wait_for(&json!({ "SetpointRefused": true }));
    assert_eq!(
        refused["Command"],
        json!([FORWARD, 2000]),
        "the last good setpoint holds"
    );
    cabinet.set(&json!({ "Setpoint_Hz": 25.5 }));
    cabinet.wait_for(&json!({ "SetpointRefused": false, "Output_Hz": 25.5 }));
    cabinet.set(&json!({ "Stop": true }));
    cabinet.wait_for(
        &json!({ "Wanted": false, "Command": [STOP, 2550], "Running": false, "Output_Hz": 0.0 }),
    );
    cabinet.set(&json!({ "Stop": false, "Start": false, "Reverse": true }));
    cabinet.set(&json!({ "Start": true }));
    cabinet.wait_for(
        &json!({ "Wanted": true, "Command": [REVERSE, 2550], "Running": true, "Output_Hz": 25.5 }),
    );
}

#[test]
fn a_start_that_is_held_starts_nothing_after_a_trip_or_a_restart() {
    let mut cabinet = Cabinet::new();
    cabinet.start_at_20_hz();
    cabinet.look_from_now_on();
    cabinet.drive.type_line("");
    cabinet.wait_for(&json!({ "Tripped": true, "Wanted": false, "Running": false }));
    cabinet.look_from_now_on();
    cabinet.reset();
    cabinet.wait_for(
        &json!({ "Tripped": false, "Inhibited": false, "Wanted": false, "Running": false }),
    );
    cabinet.set(&json!({ "Start": false }));
    cabinet.start_at_20_hz();

    cabinet.look_from_now_on();
    cabinet.gateway.take().unwrap().kill();
    cabinet.wait_for(&json!({ "Online": false, "Wanted": false, "WriteEnable": false }));
    cabinet.look_from_now_on();
    cabinet.gateway = Some(run(&cabinet.file));
    // It finds the drive running, and the first that it writes is a stop.
    cabinet.wait_for(
        &json!({ "Online": true, "Wanted": false, "Command": [STOP, 2000], "Output_Hz": 0.0 }),
    );
    assert!(
        cabinet.since().iter().all(|it| it["Wanted"] == false),
        "{:?}",
        cabinet.since()
    );
    cabinet.set(&json!({ "Start": false }));
    cabinet.start_at_20_hz();
}

#[test]
fn a_lost_read_stops_nothing_and_a_lost_gateway_ends_the_order() {
    let mut cabinet = Cabinet::new();
    cabinet.start_at_20_hz();
    // However slow this machine is, these are not lost for so long.
    cabinet.set(&json!({ "LostTime": 600.0, "lost": 3 }));
    cabinet.wait_for(&json!({ "WriteEnable": false, "Online": true, "Wanted": true, "Command": [FORWARD, 2000] }));
    cabinet.look_from_now_on();
    cabinet.wait_for(&json!({ "WriteEnable": true, "Output_Hz": 20.0 }));
    let kept = |it: &Value| it["Online"] == true && it["Running"] == true && it["Wanted"] == true;
    assert!(cabinet.since().iter().all(kept), "{:?}", cabinet.since());

    cabinet.set(&json!({ "LostTime": 2.0, "lost": NEVER_FOUND }));
    cabinet.wait_for(
        &json!({ "Online": false, "Wanted": false, "WriteEnable": false, "Command": [STOP, 2000] }),
    );
    cabinet.set(&json!({ "lost": 0 }));
    cabinet.wait_for(
        &json!({ "Online": true, "Wanted": false, "WriteEnable": true, "Running": false }),
    );
    assert!(
        cabinet.since().iter().all(|it| it["Wanted"] == false),
        "Start was held: {:?}",
        cabinet.since()
    );
}

#[test]
fn a_stop_is_written_although_nothing_is_answered_and_a_start_is_not_kept() {
    let mut cabinet = Cabinet::new();
    cabinet.start_at_20_hz();
    cabinet.set(&json!({ "LostTime": 600.0, "lost": NEVER_FOUND, "Stop": true }));
    cabinet.wait_for(&json!({ "Wanted": false, "WriteEnable": true, "Command": [STOP, 2000] }));
    until("the drive stands still", PATIENCE, || {
        (cabinet.run_state() == "stopped").then_some(())
    });
    let lost = cabinet
        .gateway
        .as_ref()
        .unwrap()
        .find_all(|line| line.contains("commander lost").then_some(()));
    assert!(lost.is_empty(), "it was the gateway that stopped it");
    cabinet.set(&json!({ "Stop": false, "Start": false }));
    cabinet.set(&json!({ "Start": true }));
    cabinet.set(&json!({ "Setpoint_Hz": 80.0 }));
    cabinet.wait_for(&json!({ "SetpointRefused": true, "Wanted": false, "WriteEnable": false }));
    cabinet.set(&json!({ "lost": 0 }));
    cabinet.wait_for(&json!({ "SetpointRefused": true, "WriteEnable": true, "Running": false }));
    assert!(
        cabinet.since().iter().all(|it| it["Wanted"] == false),
        "{:?}",
        cabinet.since()
    );
}
