//! `params`: what a drive holds goes to a file, is compared, and comes back, at standstill and read back.

use super::plant::{Plant, Wish};
use super::rig::{Place, assert_says, fields, start, vfd_gateway};
use std::process::Output;

/// Acceleration time. Typed from the manual.
const F007: u16 = 0x020C;

fn params(args: &[&str]) -> Output {
    vfd_gateway(&[&["params"], args].concat())
}

/// `text` with the word of the parameter `code` exchanged.
fn changed(text: &str, code: &str, raw: u16) -> String {
    let head = format!("code = \"{code}\"\n");
    let (before, rest) = text.split_once(&head).unwrap();
    let (address, rest) = rest.split_once("raw = ").unwrap();
    let (_, rest) = rest.split_once('\n').unwrap();
    format!("{before}{head}{address}raw = {raw}\n{rest}")
}

/// What was set, as the log has it: old and new.
fn logged(plant: &Plant) -> Vec<(String, u64, u64, String)> {
    plant.logged(|line| {
        let fields = fields(line).filter(|fields| fields["message"] == "parameter set")?;
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
fn a_drive_is_dumped_compared_and_restored_through_its_gateway() {
    let plant = Plant::new();
    let socket = plant.place.file("data/vfd-gateway.sock");
    let socket = socket.to_str().unwrap();
    let file = plant.place.file("pump-1.toml");
    let file = file.to_str().unwrap();
    assert_says(
        &params(&["dump", "pump-1", "--socket", socket, "--out", file]),
        0,
        &["parameters in"],
    );
    assert_says(
        &params(&["dump", "pump-1", "--socket", socket, "--out", file]),
        2,
        &["already exists"],
    );
    assert_says(
        &params(&["diff", file, "live", "--socket", socket]),
        0,
        &["nothing differs"],
    );
    let text = std::fs::read_to_string(file).unwrap();
    assert!(
        text.contains("model = \"hyundai-n700\"") && text.contains("code = \"F007\""),
        "{text}"
    );
    assert_eq!(plant.written(), [], "whoever looks writes nothing");

    let wanted = changed(&changed(&text, "F007", 42), "F010", 2);
    let wanted = plant
        .place
        .write("wanted.toml", &changed(&wanted, "F201", 1000));
    let wanted = wanted.to_str().unwrap();
    assert_says(
        &params(&["diff", file, wanted]),
        0,
        &["F007", "100", "42", "F010", "F201"],
    );
    let json = params(&["diff", file, wanted, "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(json["differences"].as_array().unwrap().len(), 3);

    let restore =
        |more: &[&str]| params(&[&["restore", wanted, "--socket", socket], more].concat());
    let shown = [
        "F007",
        "100 -> 42",
        "F201",
        "at the drive itself",
        "--with-link writes it too",
        "limited number",
    ];
    assert_says(&restore(&["--dry-run"]), 0, &shown);
    assert_says(&restore(&[]), 2, &["there is no terminal to ask on"]);
    assert_eq!(plant.written(), [], "nobody has agreed");
    assert_says(&restore(&["--yes"]), 0, &["1 written and read back"]);
    assert_eq!(plant.written(), [(F007, 42)]);
    assert_eq!(
        logged(&plant),
        [("F007".to_owned(), 100, 42, "confirmed".to_owned())]
    );
    assert_says(&restore(&["--yes"]), 0, &["there is nothing to write"]);
    assert_says(
        &restore(&["--yes", "--with-link"]),
        1,
        &["F010", "WARNING", "no_release", "nothing was written"],
    );
    assert_eq!(plant.written(), [(F007, 42)]);
}

#[test]
fn a_dump_and_a_restore_say_what_they_do_not_hold() {
    let plant = Plant::new();
    let socket = plant.place.file("data/vfd-gateway.sock");
    let socket = socket.to_str().unwrap();
    let dump = params(&["dump", "pump-1", "--socket", socket]);
    let text = String::from_utf8(dump.stdout).unwrap();
    for part in [
        "# It holds ",
        "It does not hold:",
        "#   run_command: a command register, which cannot be read",
        "[[left_out]]",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let (before, after) = text.split_once("[[parameter]]\ncode = \"F007\"").unwrap();
    let (_, after) = after.split_once("\n\n").unwrap();
    let file = plant
        .place
        .write("without.toml", &format!("{before}{after}"));
    let restored = params(&[
        "restore",
        file.to_str().unwrap(),
        "--socket",
        socket,
        "--dry-run",
    ]);
    assert_says(
        &restored,
        0,
        &[
            "the file does not hold:",
            "run_command",
            "F007",
            "it is not in the file",
        ],
    );
}

#[test]
fn a_drive_with_groups_is_dumped_by_them() {
    let place = Place::new();
    let port = place.file("line");
    let drive = [
        "simulate",
        "--model",
        "frecon-fr500a",
        "--station",
        "1",
        "--strict",
        "--link",
        port.to_str().unwrap(),
    ];
    let drive = start(&drive);
    drive.wait_for("that it plays", |line| {
        line.contains("station 1").then_some(())
    });
    let on_port = [
        "--port",
        port.to_str().unwrap(),
        "--model",
        "frecon-fr500a",
        "--station",
        "1",
    ];
    let run = |args: &[&str]| params(&[args, &on_port].concat());
    let dump = run(&["dump"]);
    let text = String::from_utf8(dump.stdout).unwrap();
    assert!(
        text.contains("#   F22.00 to F22.15: the drive refuses to show it"),
        "{text}"
    );
    assert!(
        text.contains("#   group F22 behind F22.15: not read"),
        "{text}"
    );
    // A parameter that the model does not describe is compared, and never written.
    let other = "[[parameter]]\ncode = \"F22.01\"\naddress = 0x1601\nraw = 5\ntitle = \"\"\n";
    let file = place.write("wanted.toml", &format!("{text}\n{other}"));
    let file = file.to_str().unwrap();
    assert_says(&run(&["diff", file, "live"]), 0, &["F22.01"]);
    let shown = [
        "F22.01",
        "the model does not know what it does",
        "there is nothing to write",
    ];
    assert_says(&run(&["restore", file, "--dry-run"]), 0, &shown);
}

#[test]
fn a_motor_that_turns_is_not_set() {
    let plant = Plant::new();
    let socket = plant.place.file("data/vfd-gateway.sock");
    let socket = socket.to_str().unwrap();
    let dump = params(&["dump", "pump-1", "--socket", socket]);
    let text = String::from_utf8(dump.stdout).unwrap();
    let file = plant
        .place
        .write("wanted.toml", &changed(&text, "F007", 42));
    let file = file.to_str().unwrap();
    let other = plant
        .place
        .write("other.toml", &text.replace("hyundai-n700", "teco-e510"));
    let other = params(&[
        "restore",
        other.to_str().unwrap(),
        "--socket",
        socket,
        "--yes",
    ]);
    assert_says(&other, 2, &["teco-e510", "hyundai-n700"]);
    let seen = plant.run_over_mqtt();
    assert_says(
        &params(&["restore", file, "--socket", socket, "--yes"]),
        1,
        &["F007: refused", "nothing was written"],
    );
    assert_eq!(plant.written().len(), seen);
}

#[test]
fn a_drive_that_is_read_only_is_shown_and_not_set() {
    let plant = Plant::with(Wish {
        read_only: true,
        ..Wish::default()
    });
    let socket = plant.place.file("data/vfd-gateway.sock");
    let socket = socket.to_str().unwrap();
    let dump = params(&["dump", "pump-1", "--socket", socket]);
    let file = plant.place.write(
        "wanted.toml",
        &changed(&String::from_utf8(dump.stdout).unwrap(), "F007", 42),
    );
    let restored = params(&[
        "restore",
        file.to_str().unwrap(),
        "--socket",
        socket,
        "--yes",
    ]);
    assert_says(&restored, 1, &["nothing was written", "control"]);
    assert_eq!(plant.written(), []);
}

#[test]
fn a_drive_on_a_port_is_dumped_and_restored_without_a_gateway() {
    let place = Place::new();
    let port = place.file("line");
    let drive = [
        "simulate",
        "--model",
        "teco-e510",
        "--station",
        "4",
        "--strict",
        "--link",
        port.to_str().unwrap(),
    ];
    let drive = start(&drive);
    drive.wait_for("that it plays", |line| {
        line.contains("station 4").then_some(())
    });
    let on_port = [
        "--port",
        port.to_str().unwrap(),
        "--model",
        "teco-e510",
        "--station",
        "4",
    ];
    let run = |args: &[&str]| params(&[args, &on_port].concat());
    let file = place.file("drive.toml");
    let file = file.to_str().unwrap();
    assert_says(&run(&["dump", "--out", file]), 0, &["parameters in"]);
    let text = std::fs::read_to_string(file).unwrap();
    assert!(text.contains("station = 4"), "{text}");
    let wanted = place.write("wanted.toml", &changed(&text, "00-14", 77));
    let wanted = wanted.to_str().unwrap();
    assert_says(&run(&["diff", wanted, "live"]), 0, &["00-14", "77"]);
    assert_says(
        &run(&["restore", wanted, "--yes"]),
        0,
        &["1 written and read back"],
    );
    assert_says(&run(&["diff", wanted, "live"]), 0, &["nothing differs"]);
    let wrong = params(&[
        "dump",
        "--port",
        on_port[1],
        "--model",
        "teco-e510",
        "--station",
        "5",
    ]);
    assert_says(&wrong, 1, &["station 5", "no answer"]);
}
