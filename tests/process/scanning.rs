//! `scan`: drives are found with model and setting, and nothing but reads goes over a line that nobody else uses.

use super::rig::{Place, fields, gateway, program, simulate as simulate_usual, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::path::Path;
use std::process::Output;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use vfd_gateway::daemon::host::pty::Pty;

/// Simulated drives that hear only their own speed.
fn simulate(link: &Path, model: &str, stations: &[&str], more: &[&str]) -> Started {
    let stations: Vec<&str> = stations
        .iter()
        .flat_map(|station| ["--station", station])
        .collect();
    let link = link.to_str().unwrap();
    let drives = start(
        &[
            &["simulate", "--model", model, "--strict", "--link", link],
            &stations[..],
            more,
        ]
        .concat(),
    );
    drives.wait_for("that it plays", |line| {
        line.contains("station").then_some(())
    });
    drives
}

fn scan(port: &Path, more: &[&str]) -> Output {
    // The same for every model. On a busy machine a simulated drive may need a part of it.
    let args = [
        "scan",
        "--port",
        port.to_str().unwrap(),
        "--seconds-per-station",
        "0.5",
    ];
    vfd_gateway(&[&args, more].concat())
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn drives_are_found_with_model_and_setting_and_a_configuration_to_start_from() {
    // Each has a line of its own, and most of the time is that of its characters.
    std::thread::scope(|threads| {
        for (model, setting) in [
            ("hyundai-n700", "9600 8N1"),
            ("toshiba-vf-s15", "19200 8E1"),
            ("frecon-fr500a", "9600 8N2"),
        ] {
            threads.spawn(move || drives_are_found(model, setting));
        }
    });
}

/// Two drives of a model at its usual setting are found, and what is written passes the check.
fn drives_are_found(model: &str, setting: &str) {
    let place = Place::new();
    let port = place.file("line");
    let _drives = simulate(&port, model, &["3", "5"], &[]);
    let file = place.file("gateway.toml");
    let output = scan(
        &port,
        &[
            "--stations",
            "3-5",
            "--json",
            "--out",
            file.to_str().unwrap(),
        ],
    );
    let told = said(&output);
    assert_eq!(output.status.code(), Some(0), "{told}");
    assert!(
        told.contains("about ") && told.contains("if no drive answers"),
        "how long is said before: {told}"
    );
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    // A pseudo-terminal keeps no parity: a setting that differs in that alone is heard as well.
    let drives = json["drives"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|drive| drive["link"]["text"] == setting);
    let found: Vec<_> = drives
        .map(|drive| {
            (
                drive["station"].as_u64().unwrap(),
                &drive["models"][0],
                drive["confidence"].as_str().unwrap(),
            )
        })
        .collect();
    let model = Value::from(model);
    assert_eq!(
        found,
        [(3, &model, "probable"), (5, &model, "probable")],
        "{told}"
    );
    let checked = vfd_gateway(&["check", "-c", file.to_str().unwrap()]);
    assert_eq!(
        checked.status.code(),
        Some(0),
        "{}",
        String::from_utf8_lossy(&checked.stderr)
    );
    let again = scan(&port, &["--out", file.to_str().unwrap()]);
    assert_eq!(again.status.code(), Some(2), "{}", said(&again));
    assert!(said(&again).contains("already exists"));
}

#[test]
fn another_speed_is_found_on_request() {
    let place = Place::new();
    let port = place.file("line");
    let _drives = simulate(&port, "teco-e510", &["7"], &["--baud", "38400"]);
    let usual = scan(&port, &["--stations", "7"]);
    assert_eq!(usual.status.code(), Some(1), "{}", said(&usual));
    assert!(
        said(&usual).contains("nothing answers") && said(&usual).contains("--all-settings"),
        "{}",
        said(&usual)
    );
    let wanted = scan(
        &port,
        &[
            "--stations",
            "7",
            "--baud",
            "38400",
            "--parity",
            "none",
            "--stop-bits",
            "1",
        ],
    );
    let (told, made) = (
        said(&wanted),
        String::from_utf8_lossy(&wanted.stdout).into_owned(),
    );
    assert_eq!(wanted.status.code(), Some(0), "{told}");
    assert!(
        told.contains("38400 8N1") && told.contains("teco-e510"),
        "{told}"
    );
    assert!(
        made.contains("baud = 38400") && made.contains("model = \"teco-e510\""),
        "{made}"
    );
    let all = vfd_gateway(&[
        "scan",
        "--port",
        port.to_str().unwrap(),
        "--all-settings",
        "--dry-run",
    ]);
    assert!(said(&all).contains("38400 8E2"), "{}", said(&all));
}

#[test]
fn only_reads_go_over_the_line() {
    let place = Place::new();
    let port = place.file("line");
    let _drives = simulate(&port, "teco-e510", &["2"], &[]);
    let mut command = program();
    command.env("RUST_LOG", "vfd_gateway=trace");
    let args = [
        "scan",
        "--port",
        port.to_str().unwrap(),
        "--stations",
        "1-2",
        "--seconds-per-station",
        "0.1",
    ];
    let output = command.args(args).output().unwrap();
    let told = said(&output);
    let sent = told.lines().filter_map(|line| {
        let fields = fields(line)?;
        (fields["kind"] == "Request").then(|| fields["bytes"].as_str().unwrap().to_owned())
    });
    let sent: Vec<String> = sent.collect();
    assert!(sent.len() > 10, "{told}");
    for bytes in sent {
        let function = bytes
            .trim_start_matches('[')
            .split(", ")
            .nth(1)
            .map(str::to_owned);
        assert!(
            matches!(function.as_deref(), Some("1" | "2" | "3" | "4")),
            "{bytes}"
        );
    }
}

#[test]
fn a_line_on_which_somebody_asks_is_left_alone() {
    let line = Pty::new().unwrap();
    let over = AtomicBool::new(false);
    let output = std::thread::scope(|scope| {
        scope.spawn(|| {
            // Somebody reads one register of station 9 again and again.
            while !over.load(Ordering::Relaxed) {
                let _ = rustix::io::write(line.master(), &[9, 3, 1, 1, 0, 1, 0xD5, 0x7E]);
                std::thread::sleep(Duration::from_millis(100));
            }
        });
        let output = scan(line.path(), &[]);
        over.store(true, Ordering::Relaxed);
        output
    });
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(
        said(&output).contains("the line is in use"),
        "{}",
        said(&output)
    );
}

#[test]
fn a_port_that_a_gateway_has_open_is_refused_and_the_holder_named() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate_usual(&port);
    let gateway = gateway(&place, &port);
    gateway.wait_for_drive();
    let output = scan(&port, &[]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let holder = format!(
        "line test of the vfd-gateway that is process {}",
        gateway.program.id()
    );
    assert!(said(&output).contains(&holder), "{}", said(&output));
    let args = [
        "params",
        "dump",
        "--port",
        port.to_str().unwrap(),
        "--model",
        "hyundai-n700",
        "--station",
        "1",
    ];
    let output = vfd_gateway(&args);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains(&holder), "{}", said(&output));
}

#[test]
fn what_was_found_until_ctrl_c_is_kept() {
    let place = Place::new();
    let port = place.file("line");
    let _drives = simulate(&port, "hyundai-n700", &["1"], &[]);
    let setting = [
        "--baud",
        "9600",
        "--parity",
        "none",
        "--stop-bits",
        "1",
        "--stations",
        "1-2",
    ];
    let mut scan = start(&[&["scan", "--port", port.to_str().unwrap()], &setting[..]].concat());
    scan.wait_for("that the drive answers", |line| {
        line.contains("station 1 answers").then_some(())
    });
    scan.interrupt();
    assert_eq!(scan.end_within(PATIENCE).code(), Some(1));
    until("the end is told", PATIENCE, || {
        scan.text()
            .contains("interrupted before everything was tried")
            .then_some(())
    });
    assert!(scan.text().contains("station 1"), "{}", scan.text());
}
