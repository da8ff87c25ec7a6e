//! `health`, `read`, `write` and `watch` against a running gateway, and what they say when something is wrong.

use super::mosquitto::free_port;
use super::rig::{Place, gateway, reserved, simulate, start, vfd_gateway};
use super::roles::HEARS;
use super::standin::StandIn;
use super::started::{PATIENCE, Started, until};
use serde_json::{Value, json};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::process::Output;
use std::sync::Arc;
use std::time::Duration;
use tokio::task::LocalSet;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::daemon::http::socket::OwnSocket;
use vfd_gateway::daemon::http::{self, ClientRequirements, HttpControl, HttpState};
use vfd_gateway::daemon::lines::build;
use vfd_gateway::daemon::local::LocalSide;
use vfd_gateway::domain::report::{LineReport, LineState};
use vfd_gateway::domain::time::WallTime;
use vfd_gateway::{config, vendors};

/// `COMMAND --host .. --port .. --unit UNIT` and `more`.
fn args<'a>(command: &'a str, port: &'a str, unit: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&[command, "--port", port, "--unit", unit], more].concat()
}

fn ask(command: &str, address: SocketAddr, unit: &str, more: &[&str]) -> Output {
    vfd_gateway(&args(command, &address.port().to_string(), unit, more))
}

fn begin(command: &str, address: SocketAddr, unit: &str, more: &[&str]) -> Started {
    start(&args(command, &address.port().to_string(), unit, more))
}

fn out(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The exit code, and what was said about it.
fn failure(output: &Output) -> (Option<i32>, String) {
    (
        output.status.code(),
        String::from_utf8_lossy(&output.stderr).into_owned(),
    )
}

#[track_caller]
fn assert_fails(output: &Output, code: i32, words: &[&str]) {
    let (exit, said) = failure(output);
    assert_eq!(exit, Some(code), "{said}");
    for word in words {
        assert!(said.contains(word), "no `{word}` in: {said}");
    }
}

#[test]
fn read_prints_registers_in_decimal_and_hexadecimal() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    let gateway = gateway(&place, &port);
    gateway.wait_for_drive();
    let address = gateway.address;
    assert_eq!(
        out(&ask("read", address, "1", &["0x0211"])),
        "0x0211      3  0x0003\n"
    );
    assert_eq!(
        out(&ask("read", address, "1", &["529", "--count", "2"])),
        "0x0211      3  0x0003\n0x0212      3  0x0003\n"
    );
    let json: Value =
        serde_json::from_str(&out(&ask("read", address, "1", &["529", "--json"]))).unwrap();
    assert_eq!(
        json,
        json!({ "unit": 1, "values": [{ "address": 529, "raw": 3 }] })
    );
    assert_fails(
        &ask("read", address, "9", &["529"]),
        1,
        &["no such unit", "exception 0A"],
    );
    assert_fails(
        &ask("read", address, "1", &["0xFFFF", "--count", "2"]),
        2,
        &["pass the last one"],
    );
    assert_fails(
        &ask("read", address, "1", &["output_frequency"]),
        2,
        &["add --uniform"],
    );
    assert_fails(
        &ask("read", address, "101", &["setpiont", "--uniform"]),
        2,
        &["did you mean setpoint?"],
    );
    assert_fails(&ask("read", address, "1", &[]), 2, &["REGISTER"]);
    assert_fails(&vfd_gateway(&["read", "529"]), 2, &["--unit"]);
}

#[test]
fn a_write_that_is_refused_says_why_and_writes_nothing() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    let gateway = gateway(&place, &port);
    gateway.wait_for_drive();
    let refused = ask("write", gateway.address, "1", &["0x0201", "5000"]);
    assert_fails(&refused, 1, &["0x0201 5000", "not allowed", "exception 01"]);
    assert_eq!(
        out(&ask("read", gateway.address, "1", &["0x0201"])),
        "0x0201      0  0x0000\n"
    );
    for wrong in [
        ["0x0201", "70000"],
        ["F001", "1"],
        ["run", "backwards"],
        ["frequency", "42.505"],
    ] {
        assert_eq!(
            ask("write", gateway.address, "1", &wrong).status.code(),
            Some(2),
            "{wrong:?}"
        );
    }
}

#[test]
fn who_does_not_listen_is_named() {
    // Not one that the system would give to whoever listens or connects next.
    let nobody = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
    for (command, more) in [
        ("read", &["1"][..]),
        ("write", &["60000", "7"]),
        ("watch", &["1"]),
    ] {
        assert_fails(
            &ask(command, nobody, "1", more),
            1,
            &["cannot connect", &nobody.to_string()],
        );
    }
}

#[test]
fn read_knows_the_names_of_a_uniform_unit() {
    let unit = StandIn::new(&[(1, 0b11), (2, 2), (4, 4250), (10, 0x8000)]);
    let read = |name: &str| out(&ask("read", unit.address, "101", &["--uniform", name]));
    assert_eq!(read("output_frequency"), "output_frequency  42.50 Hz\n");
    assert_eq!(read("run_state"), "run_state  forward\n");
    assert_eq!(read("torque"), "torque  not available\n");
    let all = out(&ask("read", unit.address, "101", &["--uniform"]));
    assert_eq!(all.lines().count(), 4, "those that are there: {all}");
    let json = out(&ask(
        "read",
        unit.address,
        "101",
        &["--uniform", "--json", "output_frequency"],
    ));
    let json: Value = serde_json::from_str(&json).unwrap();
    let value = json!({ "address": 4, "raw": 4250, "name": "output_frequency", "value": 42.5, "unit": "Hz" });
    assert_eq!(json["values"], json!([value]));
}

#[test]
fn watch_prints_what_changes_and_ends_when_it_is_reported_to() {
    let unit = StandIn::new(&[(4, 0), (5, 5000)]);
    let mut watch = begin(
        "watch",
        unit.address,
        "101",
        &["--uniform", "--every", "20ms"],
    );
    watch.wait_for("the first value", |line| {
        line.contains("output_frequency  0.00 Hz").then_some(())
    });
    watch.wait_for("the second value", |line| {
        line.contains("setpoint  50.00 Hz").then_some(())
    });
    unit.set(4, 1250);
    watch.wait_for("the change", |line| {
        line.contains("output_frequency  12.50 Hz").then_some(())
    });
    watch.terminate();
    assert_eq!(watch.end_within(Duration::from_secs(2)).code(), Some(0));
    assert_eq!(watch.text().lines().count(), 3, "{}", watch.text());
}

#[test]
fn watch_goes_on_when_the_gateway_comes_back() {
    let place = Place::new();
    let port = place.file("line");
    let drive = simulate(&port);
    let _reserved = reserved(&port);
    let gateway = gateway(&place, &port);
    gateway.wait_for_drive();
    let mut watch = begin(
        "watch",
        gateway.address,
        "1",
        &["0x0211", "--every", "20ms", "--all", "--json"],
    );
    let value = |line: &str| {
        serde_json::from_str::<Value>(line)
            .ok()
            .filter(|value| value["raw"] == 3)
            .map(|_| ())
    };
    watch.wait_for("a value", value);
    drop(drive);
    watch.wait_for("that it fails", |line| {
        line.contains("trying again").then_some(())
    });
    let before = watch.text().lines().count();
    let _drive = simulate(&port);
    until("values come again", PATIENCE, || {
        (watch
            .text()
            .lines()
            .skip(before)
            .any(|it| value(it).is_some()))
        .then_some(())
    });
    watch.interrupt();
    assert_eq!(watch.end_within(Duration::from_secs(2)).code(), Some(0));
}

/// Typed from the map: status bits and the one for a drive that answers, alarm bits, run command, lease, seconds left, reason.
const STATUS: u16 = 1;
const ONLINE: u16 = 1;
const ALARMS: u16 = 17;
const RUN: u16 = 256;
const LEASE: u16 = 258;
const LEFT: u16 = 18;
const REASON: u16 = 261;

/// States in word 2.
const STOPPED: u16 = 1;
const OFFLINE: u16 = 5;
const RUNS: u16 = 6;

/// A unit with the words from status to alarms, and with `more`.
fn shows(status: u16, state: u16, alarms: u16, more: &[(u16, u16)]) -> StandIn {
    let mut words: Vec<_> = (STATUS..=ALARMS).map(|word| (word, 0)).collect();
    words.extend([(STATUS, status), (STATUS + 1, state), (ALARMS, alarms)]);
    words.extend(more);
    StandIn::new(&words)
}

#[test]
fn who_starts_a_drive_renews_its_lease_and_stops_it_at_the_end() {
    for signal in ["TERM", "INT", "HUP"] {
        let unit = shows(ONLINE, STOPPED, 0, &[(RUN, 0), (LEFT, 1), (REASON, 0)]);
        let mut write = begin("write", unit.address, "101", &["run", "forward"]);
        write.wait_for("that it stays", |line| {
            line.contains("the lease is renewed").then_some(())
        });
        until("three renewals", PATIENCE, || {
            (unit
                .written()
                .iter()
                .filter(|it| **it == (LEASE, 1))
                .count()
                >= 3)
                .then_some(())
        });
        write.signal(signal);
        assert_eq!(
            write.end_within(Duration::from_secs(2)).code(),
            Some(0),
            "{}",
            write.text()
        );
        assert!(
            write.text().contains("the stop is confirmed"),
            "{}",
            write.text()
        );
        let written = unit.written();
        assert_eq!(
            (written[0], written[written.len() - 1]),
            ((RUN, 1), (RUN, 0)),
            "{signal}: {written:?}"
        );
    }
}

#[test]
fn who_starts_a_drive_once_is_warned() {
    let unit = shows(ONLINE, STOPPED, 0, &[(RUN, 0), (LEFT, 30), (REASON, 0)]);
    let output = ask("write", unit.address, "101", &["run", "reverse", "--once"]);
    assert_eq!(output.status.code(), Some(0));
    assert!(
        failure(&output).1.contains("fail-safe"),
        "{}",
        failure(&output).1
    );
    assert_eq!(unit.written(), [(RUN, 2)]);
    assert!(
        ask("write", unit.address, "101", &["frequency", "42.5"])
            .status
            .success()
    );
    assert!(
        ask("write", unit.address, "101", &["run", "stop"])
            .status
            .success()
    );
    assert_eq!(unit.written()[1..], [(257, 4250), (RUN, 0)]);
}

#[test]
fn a_stop_without_effect_is_no_success() {
    const PENDING: u16 = 1 << 6;
    for (status, state, alarms, words) in [
        (ONLINE | PENDING, RUNS, 1, "the drive shows no effect"),
        (PENDING, OFFLINE, 1, "the drive no longer answers"),
        (ONLINE, RUNS, 0, "has been ordered to run again"),
    ] {
        let unit = shows(status, state, alarms, &[(RUN, 0), (REASON, 0)]);
        let stop = ask("write", unit.address, "101", &["run", "stop"]);
        assert_fails(
            &stop,
            1,
            &["NOT CONFIRMED", words, "may still run: go to the drive"],
        );
    }
}

#[test]
fn a_drive_that_another_party_stopped_is_let_go() {
    let unit = StandIn::new(&[(RUN, 0), (LEFT, 30), (REASON, 0)]);
    let mut write = begin("write", unit.address, "101", &["run", "forward"]);
    write.wait_for("that it stays", |line| {
        line.contains("the lease is renewed").then_some(())
    });
    unit.set(REASON, 29);
    unit.set(RUN, 0);
    assert_eq!(
        write.end_within(PATIENCE).code(),
        Some(1),
        "{}",
        write.text()
    );
    assert!(
        write.text().contains("cancelled by a stop"),
        "{}",
        write.text()
    );
    assert!(
        !unit.written().contains(&(RUN, 0)),
        "it is not ours to stop any more"
    );
}

#[test]
fn a_start_that_is_refused_says_the_gateways_reason() {
    let unit = StandIn::new(&[(RUN, 0), (LEFT, 0), (REASON, 12)]);
    unit.refuse(RUN, 6);
    let output = ask("write", unit.address, "101", &["run", "forward"]);
    assert_fails(
        &output,
        1,
        &[
            "run forward",
            "exception 06",
            "the start is inhibited",
            "start_inhibited",
        ],
    );
}

#[test]
fn a_start_of_which_nobody_knows_what_became_is_stopped() {
    let unit = StandIn::new(&[(RUN, 0)]);
    unit.refuse(RUN, 0x0B);
    let output = ask("write", unit.address, "101", &["run", "forward"]);
    assert_fails(
        &output,
        1,
        &["exception 0B", "so it is stopped", "NOT ACKNOWLEDGED"],
    );
}

#[test]
fn health_is_0_only_when_the_gateway_is_ready_and_its_drives_were_read() {
    let place = Place::new();
    let (address, state) = served(&place.file(""));
    let (socket, url) = (place.file("vfd-gateway.sock"), format!("http://{address}"));
    let by_socket = ["health", "--socket", socket.to_str().unwrap()];
    for args in [by_socket, ["health", "--url", &url]] {
        let line = |standby| LineReport {
            state: LineState::Up,
            standby,
            ..LineReport::default()
        };
        state.shared.load().lines[0].set_report(line(None));
        assert_fails(&vfd_gateway(&args), 1, &["nothing was ever read of pump-1"]);
        // Another gateway reads the drives of a line that this one only listens to.
        state.shared.load().lines[0].set_report(line(Some(HEARS)));
        let output = vfd_gateway(&args);
        assert_eq!(output.status.code(), Some(0), "{}", failure(&output).1);
        for line in [
            "gateway plant-a: ",
            "line hall-1: up",
            "drive pump-1 (hyundai-n700 on hall-1): unknown, unknown",
        ] {
            assert!(out(&output).contains(line), "no {line} in {}", out(&output));
        }
        state.shared.load().lines[0].set_report(LineReport::default());
        assert_fails(&vfd_gateway(&args), 1, &["not ready"]);
    }
    let output = vfd_gateway(&[&by_socket[..], &["--json"]].concat());
    let json: Value = serde_json::from_str(&out(&output)).unwrap();
    assert_eq!(
        (&json["ready"], &json["lines"][0]["state"]),
        (&json!(false), &json!("down"))
    );
}

#[test]
fn health_says_why_it_has_no_answer() {
    let place = Place::new();
    let socket = place.file("nothing.sock");
    let socket = socket.to_str().unwrap();
    assert_fails(
        &vfd_gateway(&["health", "--socket", socket]),
        1,
        &[socket, "No such file"],
    );
    drop(std::os::unix::net::UnixListener::bind(socket).unwrap());
    assert_fails(
        &vfd_gateway(&["health", "--socket", socket]),
        1,
        &[socket, "refused"],
    );
    assert_fails(
        &vfd_gateway(&["health", "--url", "http://127.0.0.1:1"]),
        1,
        &["127.0.0.1:1", "refused"],
    );
    assert_fails(
        &vfd_gateway(&["health", "--url", "https://127.0.0.1"]),
        2,
        &["http://127.0.0.1:8080"],
    );
    let unit = StandIn::new(&[]);
    let url = format!("http://{}", unit.address);
    assert_fails(
        &vfd_gateway(&["health", "--url", &url]),
        1,
        &["gateway at 127.0.0.1"],
    );
}

/// The HTTP side of a gateway whose line is played by the test, on a socket in `directory` and on TCP.
fn served(directory: &Path) -> (SocketAddr, Arc<HttpState>) {
    served_from(directory, "")
}

/// The same with `more` keys of the line.
pub fn served_from(directory: &Path, more: &str) -> (SocketAddr, Arc<HttpState>) {
    let text = "[standby]\nhalf = \"a\"\npartner = \"b\"\n[[line]]\nname = \"hall-1\"\nport = \"/dev/null\"\n\n[[line.drive]]\nname = \"pump-1\"\n\
                model = \"hyundai-n700\"\nstation = 1\n\n[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n";
    let text = text.replacen("[[line]]", &format!("[[line]]\n{more}"), 1);
    let catalog = vendors::catalog();
    let shared = Arc::new(build::shared(&config::load(&text, &catalog).unwrap()));
    let state = Arc::new(HttpState {
        journal: None,
        trends: None,
        configuration: None,
        socket: None,
        gateway: "plant-a".to_owned(),
        shared: shared.into(),
        modbus: Arc::default(),
        mqtt: None::<Arc<_>>.into(),
        sparkplug: None::<Arc<_>>.into(),
        started: clock::now(),
        started_at: WallTime { unix_ms: 0 },
    });
    let (served, directory) = (Arc::clone(&state), directory.to_owned());
    let (say, said) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .unwrap();
        LocalSet::new().block_on(&runtime, async {
            let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
            let socket = OwnSocket::open(&directory).unwrap();
            say.send(listener.local_addr().unwrap()).unwrap();
            let side = Arc::new(LocalSide::new(served.shared.clone(), None));
            let documents = http::RouteDocuments::new(Arc::clone(&served));
            let control = Arc::new(HttpControl::new(
                Arc::clone(&side),
                documents.live.moments().clone(),
                ClientRequirements::default(),
                None,
            ));
            tokio::join!(
                http::serve(listener, documents.clone(), control),
                socket.serve(documents, side)
            );
        });
    });
    (said.recv_timeout(PATIENCE).unwrap(), state)
}
