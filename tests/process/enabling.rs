//! `verify` and `enable`: a drive that obeys its panel is found, set, and found right.

use super::plant::{Plant, Wish};
use super::raw::Raw;
use super::rig::{self, assert_says, fields, program, vfd_gateway};
use super::started::{PATIENCE, until};
use serde_json::{Value, json};
use std::os::unix::fs::PermissionsExt;
use std::process::{Output, Stdio};
use vfd_gateway::daemon::host::pty::Pty;

/// Frequency source and run source, and their words for panel keys and operator panel, and for communication. Typed from
/// the manual.
const F010: u16 = 0x0211;
const F011: u16 = 0x0212;
const PANEL: u16 = 2;
const BUS: u16 = 3;

/// A plant whose drive obeys its panel.
fn at_the_panel() -> Plant {
    Plant::with(Wish {
        simulate: &["--sources", "2"],
        ..Wish::default()
    })
}

fn socket(plant: &Plant) -> String {
    plant
        .place
        .file("data/vfd-gateway.sock")
        .to_str()
        .unwrap()
        .to_owned()
}

fn run(plant: &Plant, command: &str, more: &[&str]) -> Output {
    vfd_gateway(&[&[command, "pump-1", "--socket", &socket(plant)], more].concat())
}

/// What the drive itself holds.
fn sources(plant: &Plant) -> Vec<u16> {
    Raw::connect(plant.modbus).read(F010, 2).unwrap()
}

/// `(what, old, new, outcome)` of each line of the log that says what was set.
fn logged(plant: &Plant) -> Vec<(String, u64, u64, String)> {
    plant.logged(|line| {
        let fields = fields(line).filter(|fields| fields["message"] == "set for bus control")?;
        assert_eq!(
            (&fields["by"], &fields["drive"]),
            (&json!("local"), &json!("pump-1"))
        );
        let text = |key: &str| fields[key].as_str().unwrap().to_owned();
        Some((
            text("what"),
            fields["old"].as_u64()?,
            fields["new"].as_u64()?,
            text("outcome"),
        ))
    })
}

#[test]
fn a_drive_that_obeys_its_panel_is_found_and_set() {
    let plant = at_the_panel();
    assert_says(
        &run(&plant, "verify", &[]),
        1,
        &[
            "F010",
            "wanted 3 (communication)",
            "found 2 (panel keys)",
            "WRONG",
            "b037",
            "at the drive itself",
            "2 wrong",
        ],
    );
    let json: Value = serde_json::from_slice(&run(&plant, "verify", &["--json"]).stdout).unwrap();
    let of_f010 = json["items"]
        .as_array()
        .unwrap()
        .iter()
        .find(|item| item["what"] == "F010");
    assert_eq!(
        (&json["right"], of_f010.map(|item| &item["result"])),
        (&json!(false), Some(&json!("wrong"))),
        "{json}"
    );
    assert_eq!(plant.written(), [], "whoever looks writes nothing");

    assert_says(
        &run(&plant, "enable", &[]),
        2,
        &[
            "2 (panel keys) -> 3 (communication)",
            "no terminal",
            "--yes",
        ],
    );
    assert_eq!(
        (plant.written(), sources(&plant)),
        (vec![], vec![PANEL, PANEL])
    );

    assert_says(
        &run(&plant, "enable", &["--yes"]),
        0,
        &["-> 3 (communication)", "\nconfirmed\n", "ok"],
    );
    assert_eq!(plant.written(), [(F010, BUS), (F011, BUS)]);
    assert_eq!(sources(&plant), [BUS, BUS]);
    let set = |what: &str| {
        (
            what.to_owned(),
            u64::from(PANEL),
            u64::from(BUS),
            "confirmed".to_owned(),
        )
    };
    assert_eq!(logged(&plant), [set("F010"), set("F011")]);

    assert_says(
        &run(&plant, "verify", &[]),
        0,
        &["found 3 (communication)", "ok"],
    );
    let seen = plant.written().len();
    assert_says(&run(&plant, "enable", &[]), 0, &["nothing to set"]);
    assert_eq!(plant.written().len(), seen);
    // The motor now follows the gateway.
    plant.run_over_mqtt();
    until("it runs fast enough", PATIENCE, || {
        (plant.output() > Some(1500)).then_some(())
    });
    assert_eq!(refusal(&plant), "other_owner");
    // A stop by somebody else ends the lease, and the motor turns on by its ramp.
    plant.write_uniform(&mut Raw::connect(plant.modbus), 256, 0);
    let is_pending = |reason: &String| ["other_owner", "stop_pending"].contains(&reason.as_str());
    let reason = until("the stop is effective", PATIENCE, || {
        Some(refusal(&plant)).filter(|it| !is_pending(it))
    });
    assert_eq!(reason, "moving");
    assert!(plant.output() > Some(0));
    assert!(
        !plant.written()[seen..]
            .iter()
            .any(|(address, _)| [F010, F011].contains(address))
    );
    plant.wait_until_it_stands();
    let set = until("it is known to stand", PATIENCE, || {
        Some(order(&plant)).filter(|it| it["outcome"] != "refused")
    });
    assert_eq!(set["outcome"], "confirmed", "{set}");
}

fn refusal(plant: &Plant) -> String {
    let answer = order(plant);
    assert_eq!(answer["outcome"], "refused", "{answer}");
    answer["reason"].as_str().unwrap().to_owned()
}

/// Orders over the socket what `enable` itself would not, because nothing differs.
fn order(plant: &Plant) -> Value {
    use std::io::{Read, Write};
    let mut stream = std::os::unix::net::UnixStream::connect(socket(plant)).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let body = json!({ "addresses": [F010, F011] }).to_string();
    let head = "POST /api/v1/drives/pump-1/setup HTTP/1.1\r\nHost: here\r\nConnection: close\r\nContent-Length";
    write!(stream, "{head}: {}\r\n\r\n{body}", body.len()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    serde_json::from_str(answer.split_once("\r\n\r\n").unwrap().1).unwrap()
}

#[test]
fn the_person_at_the_terminal_is_asked() {
    let plant = at_the_panel();
    for (typed, code) in [("n", 1), ("", 1), ("Y", 0)] {
        let terminal = Pty::new().unwrap();
        let mut command = program();
        command.args(["enable", "pump-1", "--socket", &socket(&plant)]);
        command
            .stdin(rig::terminal(terminal.path()))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let child = command.spawn().unwrap();
        // What is typed waits in the terminal until it is read.
        rustix::io::write(terminal.master(), format!("{typed}\n").as_bytes()).unwrap();
        assert_says(
            &child.wait_with_output().unwrap(),
            code,
            &["set this? [y/N]"],
        );
        assert_eq!(sources(&plant) == [BUS, BUS], code == 0, "{typed}");
    }
}

#[test]
fn who_may_not_or_cannot_is_reported_why() {
    let plant = at_the_panel();
    let socket = socket(&plant);
    let file = plant.place.file("data/vfd-gateway.sock");
    assert_eq!(file.metadata().unwrap().permissions().mode() & 0o777, 0o600);
    for command in ["verify", "enable"] {
        let named = |drive: &str| vfd_gateway(&[command, drive, "--socket", &socket]);
        assert_says(
            &named("pump-2"),
            2,
            &["no drive is called pump-2; did you mean pump-1?"],
        );
        assert_says(&named("a/b"), 2, &["not a valid drive name"]);
        assert_says(&vfd_gateway(&[command]), 2, &["DRIVE"]);
        assert_says(
            &vfd_gateway(&[command, "pump-1", "--socket", "/nonexistent"]),
            1,
            &["cannot connect"],
        );
    }
    let path = "/api/v1/drives/pump-1/setup";
    assert_eq!(plant.get(path).unwrap().0, 404, "not over TCP");
    assert_says(
        &vfd_gateway(&["verify", "pump-1", "-c", plant.file.to_str().unwrap()]),
        1,
        &["WRONG"],
    );
}

#[test]
fn a_drive_without_a_control_section_is_not_set() {
    let plant = Plant::with(Wish {
        simulate: &["--sources", "2"],
        read_only: true,
        ..Wish::default()
    });
    assert_says(
        &run(&plant, "enable", &["--yes"]),
        1,
        &["refused", "read-only", "(read_only)", "2 wrong"],
    );
    assert_eq!(
        (plant.written(), sources(&plant)),
        (vec![], vec![PANEL, PANEL])
    );
}

#[test]
fn a_drive_that_does_not_answer_is_not_set() {
    let plant = at_the_panel();
    plant.silence_the_drive();
    for command in ["verify", "enable"] {
        assert_says(
            &run(&plant, command, &[]),
            1,
            &["not answered", "0 wrong, 2 not answered"],
        );
    }
    assert_eq!(plant.written(), []);
}
