//! `read`, `write` and `watch` straight on a port, without a gateway: by name, behind the same guard, and the motor is
//! stopped at the end.

use super::rig::{self, Place, program, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::path::Path;
use std::process::{Output, Stdio};
use std::time::Duration;
use vfd_gateway::daemon::host::pty::Pty;

/// A drive at station 2 whose port is reached as `link`.
fn simulate(link: &Path) -> Started {
    let args = [
        "simulate",
        "--model",
        "hyundai-n700",
        "--station",
        "2",
        "--strict",
        "--link",
        link.to_str().unwrap(),
    ];
    let drive = start(&args);
    drive.wait_for("that it plays", |line| {
        line.contains("station 2").then_some(())
    });
    drive
}

fn on_port<'a>(command: &'a str, port: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
    let args = [
        command,
        "--port",
        port.to_str().unwrap(),
        "--model",
        "hyundai-n700",
        "--station",
        "2",
    ];
    [&args, more].concat()
}

fn run(command: &str, port: &Path, more: &[&str]) -> Output {
    vfd_gateway(&on_port(command, port, more))
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&[&output.stdout[..], &output.stderr].concat()).into_owned()
}

/// The output frequency in hertz, as the drive says it.
fn output_frequency(port: &Path) -> f64 {
    let output = run("read", port, &["output_frequency", "--json"]);
    let json: Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", said(&output)));
    json["values"][0]["value"].as_f64().unwrap()
}

#[test]
fn registers_are_read_and_written_by_name_or_code() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    let read = |register: &str| {
        let output = run("read", &port, &[register]);
        assert_eq!(output.status.code(), Some(0), "{}", said(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    assert!(read("F007").contains("10.0 s"));
    assert!(read("0x0211").contains("communication (3)"));
    let all = run("read", &port, &["--json"]);
    let all: Value = serde_json::from_slice(&all.stdout).unwrap();
    assert_eq!(all["station"], 2);
    assert!(all["values"].as_array().unwrap().len() > 3, "{all}");
    let written = run("write", &port, &["F007", "55"]);
    assert_eq!(written.status.code(), Some(0), "{}", said(&written));
    assert!(read("acceleration_time").contains("5.5 s"));
    for (args, code, words) in [
        (vec!["F010", "2"], 2, "frequency_source"),
        (vec!["run_command", "1"], 2, "use `run` or `frequency`"),
        (vec!["run", "forward"], 2, "--limits"),
    ] {
        let output = run("write", &port, &args);
        assert_eq!(
            output.status.code(),
            Some(code),
            "{args:?}: {}",
            said(&output)
        );
        assert!(said(&output).contains(words), "{args:?}: {}", said(&output));
    }
    let slip = run("read", &port, &["F07"]);
    assert_eq!(slip.status.code(), Some(2));
    assert!(said(&slip).contains("did you mean"), "{}", said(&slip));
}

#[test]
fn who_makes_a_motor_run_stays_and_stops_it() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    // A motor that is still on its way down when somebody looks, however long that takes.
    let deceleration = |tenths: &str| {
        let written = run("write", &port, &["F008", tenths]);
        assert_eq!(written.status.code(), Some(0), "{}", said(&written));
    };
    deceleration("3000");
    let args = on_port(
        "write",
        &port,
        &["run", "forward", "--limits", "5-50", "--frequency", "20"],
    );
    let mut commander = start(&args);
    commander.wait_for("that it runs", |line| {
        line.contains("until Ctrl-C").then_some(())
    });
    assert!(
        commander.text().contains("only the drive's own watchdog"),
        "{}",
        commander.text()
    );
    let busy = run("read", &port, &["output_frequency"]);
    assert!(
        said(&busy).contains(&format!("process {}", commander.id())),
        "{}",
        said(&busy)
    );
    std::thread::sleep(Duration::from_secs(2));
    commander.interrupt();
    commander.wait_for("that the stop is told", |line| {
        line.contains("the stop is confirmed").then_some(())
    });
    assert_eq!(
        commander.end_within(PATIENCE).code(),
        Some(0),
        "{}",
        commander.text()
    );
    assert!(output_frequency(&port) > 0.0, "it had been running");
    deceleration("10");
    until("the motor stands still", PATIENCE, || {
        (output_frequency(&port) < 0.01).then_some(())
    });
    let beyond = run("write", &port, &["frequency", "51", "--limits", "5-50"]);
    assert_eq!(beyond.status.code(), Some(1), "{}", said(&beyond));
}

#[test]
fn the_terminal_is_given_back_as_it_was() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    let terminal = Pty::new().unwrap();
    let slave = rig::terminal(terminal.path());
    let mut command = program();
    command.args(on_port("watch", &port, &["--every", "200ms"]));
    command
        .stdin(Stdio::null())
        .stdout(slave)
        .stderr(Stdio::null());
    let mut child = command.spawn().unwrap();
    let mut shown = Vec::new();
    let look = |shown: &mut Vec<u8>| {
        let mut buffer = [0; 4096];
        while let Ok(bytes @ 1..) = rustix::io::read(terminal.master(), &mut buffer) {
            shown.extend_from_slice(&buffer[..bytes]);
        }
    };
    until("the table is drawn twice", PATIENCE, || {
        look(&mut shown);
        let text = String::from_utf8_lossy(&shown);
        (text.matches("output_frequency").count() >= 2 && text.contains("station 2")).then_some(())
    });
    let id = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(id, rustix::process::Signal::INT).unwrap();
    let end = until("it ends", PATIENCE, || child.try_wait().unwrap());
    look(&mut shown);
    let text = String::from_utf8_lossy(&shown);
    assert_eq!(end.code(), Some(0), "{text}");
    assert!(
        text.starts_with("\x1b[?1049h\x1b[?25l") && text.ends_with("\x1b[?25h\x1b[?1049l"),
        "{text:?}"
    );
}

/// The sockets of the process `id` that are of TCP or UDP.
fn network_sockets(id: u32) -> usize {
    let files = std::fs::read_dir(format!("/proc/{id}/fd")).unwrap();
    let links = files.filter_map(|file| std::fs::read_link(file.unwrap().path()).ok());
    let inode = |link: &Path| {
        Some(
            link.to_str()?
                .strip_prefix("socket:[")?
                .strip_suffix(']')?
                .to_owned(),
        )
    };
    let sockets: Vec<_> = links.filter_map(|link| inode(&link)).collect();
    let tables = ["tcp", "tcp6", "udp", "udp6"]
        .map(|table| std::fs::read_to_string(format!("/proc/{id}/net/{table}")));
    let rows: Vec<_> = tables.into_iter().flatten().collect();
    let is_in = |socket: &&String| {
        rows.iter()
            .flat_map(|rows| rows.lines())
            .any(|row| row.split_whitespace().nth(9) == Some(socket.as_str()))
    };
    sockets.iter().filter(is_in).count()
}

#[test]
fn a_command_on_a_port_opens_no_network_socket() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    let args = on_port(
        "write",
        &port,
        &["run", "forward", "--limits", "5-50", "--frequency", "20"],
    );
    let commander = start(&args);
    commander.wait_for("that it runs", |line| {
        line.contains("until Ctrl-C").then_some(())
    });
    assert_eq!(network_sockets(commander.id()), 0);
    let listening = start(&[
        "simulate",
        "--model",
        "hyundai-n700",
        "--tcp",
        "127.0.0.1:0",
    ]);
    listening.wait_for("that it plays", |line| {
        line.contains("station").then_some(())
    });
    assert_eq!(
        network_sockets(listening.id()),
        1,
        "one that listens is seen"
    );
}
