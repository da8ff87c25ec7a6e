//! A serial master reads and commands drives through the gateway: pymodbus and mbpoll over a pair of pseudo-terminals.

use super::outsiders::{libmodbus, mbpoll_output, pymodbus_serial};
use super::rig::{Place, fields, reserved, start, terminal};
use super::started::{Started, until};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::time::Duration;
use vfd_gateway::wire::rtu;

const PATIENCE: Duration = Duration::from_secs(20);
/// A busy host may need longer for an answer than a master usually waits.
const PATIENT: &str = "answer_within = \"3s\"";

/// A drive that is played, a gateway, and the end of the cable that the master has.
struct Plant {
    place: Place,
    _drive: Started,
    cable: Started,
    gateway: Started,
}

/// The table of the master at the port `slave` in `place`, with `settings`.
fn master(place: &Place, settings: &str) -> String {
    let port = place.file("slave");
    format!(
        "[[modbus_rtu]]\nname = \"panel\"\nport = \"{}\"\nparity = \"none\"\n{settings}\n",
        port.display()
    )
}

/// A cable between the ports `master` and `slave` in `place`.
fn cable(place: &Place) -> Started {
    let end = |name: &str| format!("pty,raw,echo=0,link={}", place.file(name).display());
    let mut command = Command::new("socat");
    command.args([end("master"), end("slave")]);
    let cable = Started::new(command);
    until("the cable", PATIENCE, || {
        (place.file("master").exists() && place.file("slave").exists()).then_some(())
    });
    cable
}

/// A drive at the port `line` in `place` that begins its replies after `turnaround_ms`.
fn drive(place: &Place, turnaround_ms: &str) -> Started {
    let line = place.file("line");
    let args = [
        "simulate",
        "--model",
        "hyundai-n700",
        "--station",
        "1",
        "--turnaround-ms",
        turnaround_ms,
        "--link",
    ];
    let drive = start(&[&args[..], &[line.to_str().unwrap()]].concat());
    drive.wait_for("that it plays", |line| {
        line.contains("station 1").then_some(())
    });
    drive
}

fn message(line: &str) -> Option<String> {
    Some(fields(line)?["message"].as_str()?.to_owned())
}

impl Plant {
    /// A plant whose drive begins its replies after `turnaround_ms`, with these settings of the master's port.
    fn new(turnaround_ms: &str, settings: &str) -> Self {
        Self::with(turnaround_ms, settings, "60s")
    }

    /// The same, with the time for which the master may be silent.
    fn with(turnaround_ms: &str, settings: &str, lost_after: &str) -> Self {
        let place = Place::new();
        let drive = drive(&place, turnaround_ms);
        let cable = cable(&place);
        let text = format!(
            "[[line]]\nname = \"test\"\nport = \"{}\"\nreply_timeout = \"2s\"\n[[line.drive]]\nname = \"pump-1\"\n\
             model = \"hyundai-n700\"\nstation = 1\npoll = \"1s\"\n[line.drive.control]\nfrom = [\"modbus-tcp\"]\n\
             frequency_hz = {{ min = 5.0, max = 50.0 }}\non_commander_lost = \"stop\"\nlost_after = \"{lost_after}\"\n\
             on_shutdown = \"stop\"\n{}",
            place.file("line").display(),
            master(
                &place,
                &format!("baud = 9600\n{settings}\nallow_write = true")
            )
        );
        let file = place.write("gateway.toml", &text);
        let gateway = start(&["run", "-c", file.to_str().unwrap()]);
        for event in ["serial master served", "drive online"] {
            gateway.wait_for(event, |line| (message(line)? == event).then_some(()));
        }
        Self {
            place,
            _drive: drive,
            cable,
            gateway,
        }
    }

    /// How often the log has said `event`.
    fn told(&self, event: &str) -> usize {
        self.gateway
            .find_all(|line| (message(line)? == event).then_some(()))
            .len()
    }

    fn ask(&self, more: &[&str], requests: &[&str]) -> Vec<Value> {
        pymodbus_serial(&self.place.file("master"), &[more, requests].concat())
    }

    fn run_state(&self, more: &[&str]) -> u64 {
        self.ask(more, &["read:101:2:1"])[0]["words"][0]
            .as_u64()
            .unwrap()
    }
}

/// The frame of `pdu` for unit 101.
fn framed(pdu: &[u8]) -> Vec<u8> {
    let mut frame = Vec::new();
    rtu::encode(&mut frame, 101, |out| out.extend_from_slice(pdu));
    frame
}

fn noise(port: &Path, bytes: &[u8]) {
    terminal(port).write_all(bytes).unwrap();
}

/// Starts the drive, and stops it while it runs.
fn starts_and_stops(plant: &Plant, more: &[&str]) {
    assert_eq!(
        plant.ask(more, &["write:101:256:0"]),
        [json!({ "words": [0] })]
    );
    // Busy, as long as the stop is not seen to be effective.
    let setpoint = || plant.ask(more, &["write:101:257:2000"]) == [json!({ "words": [2000] })];
    until("that a setpoint is taken", PATIENCE, || {
        setpoint().then_some(())
    });
    assert_eq!(
        plant.ask(more, &["write:101:256:1"]),
        [json!({ "words": [1] })]
    );
    until("that it runs", PATIENCE, || {
        (plant.run_state(more) == 2).then_some(())
    });
    assert_eq!(
        plant.ask(more, &["write:101:256:0"]),
        [json!({ "words": [0] })]
    );
    until("that it stops", PATIENCE, || {
        (plant.run_state(more) != 2).then_some(())
    });
}

#[test]
fn a_serial_master_reads_starts_and_stops_a_drive_between_noise() {
    let plant = Plant::new("2", PATIENT);
    let master = plant.place.file("master");
    let answers = plant.ask(
        &[],
        &[
            "read:101:0:2",
            "read:1:0x0211:1",
            "read:7:0:1",
            "read:101:300:1",
        ],
    );
    assert_eq!(answers[0]["words"][0], 1, "{answers:?}");
    assert_eq!(answers[1], json!({ "words": [3] }));
    assert_eq!(
        answers[2],
        json!({ "silent": true }),
        "a unit of another slave"
    );
    assert_eq!(answers[3], json!({ "exception": 2 }));
    noise(&master, &[0xFF, 0, 0xAA]);
    // A read whose CRC is wrong.
    noise(&master, &[101, 3, 0, 0, 0, 1, 0, 0]);
    starts_and_stops(&plant, &[]);
    let mut command = Command::new("mbpoll");
    command
        .args([
            "-m", "rtu", "-b", "9600", "-P", "none", "-0", "-1", "-a", "101", "-r", "0", "-c", "2",
        ])
        .arg(&master);
    let polled = mbpoll_output(&mut command);
    // Bit 0 of the status says that the drive is online.
    assert!(
        polled.values.len() == 2 && polled.values[0] & 1 == 1,
        "{}",
        polled.text
    );
}

#[test]
fn a_stop_is_executed_though_another_request_comes_with_it() {
    let plant = Plant::new("2", PATIENT);
    let master = plant.place.file("master");
    starts_and_stops(&plant, &[]);
    let (stop, run, read) = (
        framed(&[6, 1, 0, 0, 0]),
        framed(&[6, 1, 0, 0, 1]),
        framed(&[3, 0, 0, 0, 1]),
    );
    until("that it starts again", PATIENCE, || {
        (plant.ask(&[], &["write:101:256:1"]) == [json!({ "words": [1] })]).then_some(())
    });
    until("that it runs", PATIENCE, || {
        (plant.run_state(&[]) == 2).then_some(())
    });
    noise(&master, &[&stop[..], &read].concat());
    until("that it stops", PATIENCE, || {
        (plant.run_state(&[]) == 1).then_some(())
    });
    // What the master has given up starts nothing.
    noise(&master, &[&run[..], &read].concat());
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(
        plant.ask(&[], &["read:101:256:1", "read:101:2:1"]),
        [json!({ "words": [0] }), json!({ "words": [1] })]
    );
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
    let requests = [
        "read:1:0x0211:1",
        "read:101:0:1",
        "read:1:0x0211:1",
        "read:101:0:1",
        "read:1:0x0211:1",
    ];
    // A host under load may miss the moment of an exception, which is then left out: only silence may stand for it.
    until("an exception in time", PATIENCE, || {
        let answers = plant.ask(&[], &requests);
        for (request, answer) in requests.iter().zip(&answers) {
            let is_uniform = request.starts_with("read:101:");
            let is_answered = is_uniform && *answer == json!({ "words": [1] });
            assert!(
                is_answered || *answer == busy || *answer == silent,
                "{request}: {answers:?}"
            );
        }
        answers.contains(&busy).then_some(())
    });
}

#[test]
fn a_slow_line_answers_a_master_from_memory_where_that_is_allowed() {
    // The drive itself never answers in time, and what it has answered to polls stays good for 4 s.
    let plant = Plant::new("400", "cached = true");
    until("an answer from memory", PATIENCE, || {
        (plant.ask(&[], &["read:1:0x0211:1"]) == [json!({ "words": [3] })]).then_some(())
    });
}

#[test]
fn libmodbus_is_a_serial_master() {
    let plant = Plant::new("2", PATIENT);
    let master = plant.place.file("master");
    let output = libmodbus(&plant.place.file(""), master.to_str().unwrap(), 101);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        output.status.success() && text.contains("ALL THAT APPLIES PASSES"),
        "{text}"
    );
}

#[test]
fn a_master_whose_port_is_unplugged_loses_control_and_moves_nothing_when_it_is_back() {
    let mut plant = Plant::with("2", PATIENT, "5s");
    plant.ask(&[], &["write:101:256:0"]);
    let setpoint =
        |plant: &Plant| plant.ask(&[], &["write:101:257:2000"]) == [json!({ "words": [2000] })];
    until("that a setpoint is taken", PATIENCE, || {
        setpoint(&plant).then_some(())
    });
    assert_eq!(
        plant.ask(&[], &["write:101:256:1"]),
        [json!({ "words": [1] })]
    );
    let served = plant.told("serial master served");
    // Its links stay, and would lead the gateway to the cable of another test.
    let ends = ["master", "slave"].map(|name| reserved(&plant.place.file(name)));
    plant.cable.kill();
    plant.gateway.wait_for("that the port is lost", |line| {
        (message(line)? == "serial master lost").then_some(())
    });
    plant
        .gateway
        .wait_for("that the declared action runs", |line| {
            message(line)?
                .contains("commander lost (modbus-rtu panel): the declared action is stop")
                .then_some(())
        });
    for name in ["master", "slave"] {
        std::fs::remove_file(plant.place.file(name)).unwrap();
    }
    plant.cable = cable(&plant.place);
    drop(ends);
    until("that it is served again", PATIENCE, || {
        (plant.told("serial master served") > served).then_some(())
    });
    let stands = |plant: &Plant| plant.ask(&[], &["read:101:2:1"]) == [json!({ "words": [1] })];
    until("that the drive stands", PATIENCE, || {
        stands(&plant).then_some(())
    });
    // Nothing is ordered, and the old order is not taken up again.
    assert_eq!(
        plant.ask(&[], &["read:101:256:1"]),
        [json!({ "words": [0] })]
    );
    assert_eq!(
        plant.ask(&[], &["write:101:256:1"]),
        [json!({ "exception": 6 })],
        "the start is inhibited"
    );
    assert!(stands(&plant));
    starts_and_stops(&plant, &[]);
}

#[test]
fn a_serial_master_is_added_changed_and_removed_by_a_reload() {
    let place = Place::new();
    let drive = drive(&place, "2");
    let cable = cable(&place);
    let line = format!(
        "[[line]]\nname = \"test\"\nport = \"{}\"\nreply_timeout = \"2s\"\n[[line.drive]]\nname = \"pump-1\"\n\
         model = \"hyundai-n700\"\nstation = 1\npoll = \"1s\"\n",
        place.file("line").display()
    );
    let file = place.write("gateway.toml", &line);
    let gateway = start(&["run", "-c", file.to_str().unwrap()]);
    gateway.wait_for("drive online", |line| {
        (message(line)? == "drive online").then_some(())
    });
    let plant = Plant {
        place,
        _drive: drive,
        cable,
        gateway,
    };
    let changes = |line: &String| {
        let fields = fields(line)?;
        (fields["message"] == "configuration reloaded")
            .then(|| fields["changes"].as_str().unwrap().to_owned())
    };
    let reload = |plant: &Plant, text: &str| {
        let before = plant.gateway.find_all(changes).len();
        plant.place.write("gateway.toml", text);
        plant.gateway.signal("HUP");
        until("the log tells of the reload", PATIENCE, || {
            plant.gateway.find_all(changes).get(before).cloned()
        })
    };
    let served = |plant: &Plant, times: usize| {
        until("that it is served", PATIENCE, || {
            (plant.told("serial master served") == times).then_some(())
        });
    };
    let (both, uniform) = (["read:1:0x0211:1", "read:101:0:1"], json!({ "words": [1] }));
    let silent = json!({ "silent": true });
    assert_eq!(plant.ask(&[], &both), [silent.clone(), silent.clone()]);

    let of_master = |settings: &str| {
        format!(
            "{line}{}",
            master(&plant.place, &format!("{PATIENT}\n{settings}"))
        )
    };
    let texts = [
        "baud = 9600",
        "baud = 9600\nunits = [101]",
        "baud = 19200\nunits = [101]",
    ]
    .map(of_master);
    assert_eq!(reload(&plant, &texts[0]), "modbus_rtu panel: added");
    served(&plant, 1);
    assert_eq!(
        plant.ask(&[], &both),
        [json!({ "words": [3] }), uniform.clone()]
    );
    // What it reaches changes while its port stays open.
    assert_eq!(reload(&plant, &texts[1]), "modbus_rtu panel: changed");
    assert_eq!(plant.ask(&[], &both), [silent.clone(), uniform.clone()]);
    assert_eq!(
        (
            plant.told("serial master served"),
            plant.told("serial port closed")
        ),
        (1, 0)
    );
    // Another speed is another opening; a pseudo-terminal takes any.
    assert_eq!(reload(&plant, &texts[2]), "modbus_rtu panel: changed");
    served(&plant, 2);
    assert_eq!(plant.ask(&[], &both), [silent.clone(), uniform]);
    assert_eq!(reload(&plant, &line), "modbus_rtu panel: removed");
    until("that the port is closed", PATIENCE, || {
        (plant.told("serial port closed") == 2).then_some(())
    });
    assert_eq!(plant.ask(&[], &both), [silent.clone(), silent]);
}
