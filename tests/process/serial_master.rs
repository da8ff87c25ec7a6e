//! A serial master reads and commands drives through the gateway: pymodbus and mbpoll over a pair of pseudo-terminals.

use super::outsiders::{mbpoll_output, pymodbus_serial};
use super::rig::{Place, fields, start, terminal};
use super::started::{Started, until};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

const PATIENCE: Duration = Duration::from_secs(20);
/// A busy host may need longer for an answer than a master usually waits.
const PATIENT: &str = "answer_within = \"3s\"";

/// A drive that is played, a gateway, and the end of the cable that the master has.
struct Plant {
    place: Place,
    _drive: Started,
    _cable: Started,
    _gateway: Started,
}

impl Plant {
    /// A plant whose drive begins its replies after `turnaround_ms`, with these settings of the master's port.
    fn new(turnaround_ms: &str, settings: &str) -> Self {
        let place = Place::new();
        let line = place.file("line");
        let args =
            ["simulate", "--model", "hyundai-n700", "--station", "1", "--turnaround-ms", turnaround_ms, "--link"];
        let drive = start(&[&args[..], &[line.to_str().unwrap()]].concat());
        drive.wait_for("that it plays", |line| line.contains("station 1").then_some(()));
        let end = |name: &str| format!("pty,raw,echo=0,link={}", place.file(name).display());
        let mut command = Command::new("socat");
        command.args([end("master"), end("slave")]);
        let cable = Started::new(command);
        until("the cable", PATIENCE, || (place.file("master").exists() && place.file("slave").exists()).then_some(()));
        let text = format!(
            "[[line]]\nname = \"test\"\nport = \"{}\"\nreply_timeout = \"2s\"\n[[line.drive]]\nname = \"pump-1\"\n\
             model = \"hyundai-n700\"\nstation = 1\npoll = \"1s\"\n[line.drive.control]\nfrom = [\"modbus-tcp\"]\n\
             frequency_hz = {{ min = 0.0, max = 50.0 }}\non_commander_lost = \"stop\"\nlost_after = \"60s\"\n\
             on_shutdown = \"stop\"\n[[modbus_rtu]]\nname = \"panel\"\nport = \"{}\"\nbaud = 9600\nparity = \"none\"\n\
             {settings}\nallow_write = true\n",
            line.display(),
            place.file("slave").display()
        );
        let file = place.write("gateway.toml", &text);
        let gateway = start(&["run", "-c", file.to_str().unwrap()]);
        for event in ["serial master served", "drive online"] {
            gateway.wait_for(event, |line| (fields(line)?["message"] == event).then_some(()));
        }
        Self { place, _drive: drive, _cable: cable, _gateway: gateway }
    }

    fn ask(&self, more: &[&str], requests: &[&str]) -> Vec<Value> {
        pymodbus_serial(&self.place.file("master"), &[more, requests].concat())
    }

    fn run_state(&self, more: &[&str]) -> u64 {
        self.ask(more, &["read:101:2:1"])[0]["words"][0].as_u64().unwrap()
    }
}

fn noise(port: &Path, bytes: &[u8]) {
    terminal(port).write_all(bytes).unwrap();
}

/// Starts the drive, and stops it while it runs.
fn starts_and_stops(plant: &Plant, more: &[&str]) {
    assert_eq!(plant.ask(more, &["write:101:256:0"]), [json!({ "words": [0] })]);
    // Busy, as long as the stop is not seen to be effective.
    let setpoint = || plant.ask(more, &["write:101:257:2000"]) == [json!({ "words": [2000] })];
    until("that a setpoint is taken", PATIENCE, || setpoint().then_some(()));
    assert_eq!(plant.ask(more, &["write:101:256:1"]), [json!({ "words": [1] })]);
    until("that it runs", PATIENCE, || (plant.run_state(more) == 2).then_some(()));
    assert_eq!(plant.ask(more, &["write:101:256:0"]), [json!({ "words": [0] })]);
    until("that it stops", PATIENCE, || (plant.run_state(more) != 2).then_some(()));
}

#[test]
fn a_serial_master_reads_starts_and_stops_a_drive_between_noise() {
    let plant = Plant::new("2", PATIENT);
    let master = plant.place.file("master");
    let answers = plant.ask(&[], &["read:101:0:2", "read:1:0x0211:1", "read:7:0:1", "read:101:300:1"]);
    assert_eq!(answers[0]["words"][0], 1, "{answers:?}");
    assert_eq!(answers[1], json!({ "words": [3] }));
    assert_eq!(answers[2], json!({ "silent": true }), "a unit of another slave");
    assert_eq!(answers[3], json!({ "exception": 2 }));
    noise(&master, &[0xFF, 0, 0xAA]);
    // A read whose CRC is wrong.
    noise(&master, &[101, 3, 0, 0, 0, 1, 0, 0]);
    starts_and_stops(&plant, &[]);
    let mut command = Command::new("mbpoll");
    command.args(["-m", "rtu", "-b", "9600", "-P", "none", "-0", "-1", "-a", "101", "-r", "0", "-c", "2"]).arg(&master);
    let polled = mbpoll_output(&mut command);
    // Bit 0 of the status says that the drive is online.
    assert!(polled.values.len() == 2 && polled.values[0] & 1 == 1, "{}", polled.text);
}

#[test]
fn a_serial_master_may_speak_ascii() {
    let plant = Plant::new("2", &format!("{PATIENT}\nframing = \"ascii\""));
    noise(&plant.place.file("master"), b":0103\r\n:");
    starts_and_stops(&plant, &["--ascii"]);
}

#[test]
fn a_slow_line_is_answered_with_busy_and_a_late_answer_never_follows() {
    let plant = Plant::new("400", "");
    let (busy, silent) = (json!({ "exception": 6 }), json!({ "silent": true }));
    let requests = ["read:1:0x0211:1", "read:101:0:1", "read:1:0x0211:1", "read:101:0:1", "read:1:0x0211:1"];
    // A host under load may miss the moment of an exception, which is then left out: only silence may stand for it.
    until("an exception in time", PATIENCE, || {
        let answers = plant.ask(&[], &requests);
        for (request, answer) in requests.iter().zip(&answers) {
            let is_uniform = request.starts_with("read:101:");
            let is_answered = is_uniform && *answer == json!({ "words": [1] });
            assert!(is_answered || *answer == busy || *answer == silent, "{request}: {answers:?}");
        }
        answers.contains(&busy).then_some(())
    });
}
