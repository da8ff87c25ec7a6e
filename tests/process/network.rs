//! A line behind a serial device server: ser2net, one that says nothing, one that is not there.

use super::mosquitto::free_port;
use super::outsiders::ser2net;
use super::raw::Raw;
use super::rig::{Gateway, Place, fields, gateway, simulate, start};
use super::started::{PATIENCE, Started, until};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A register that only a client reads.
const F010: u16 = 0x0211;
/// Output frequency.
const OUTPUT: u16 = 0x0101;
/// The uniform unit of the drive, its registers for run and setpoint.
const UNIFORM: u8 = 101;

/// A gateway that may command the drive on the line at `port`.
fn commanding(place: &Place, port: &str) -> Gateway {
    let text = format!(
        "[[line]]\nname = \"test\"\nport = \"{port}\"\n[[line.drive]]\nname = \"pump-1\"\nmodel = \"hyundai-n700\"\n\
         station = 1\n[line.drive.control]\nfrom = [\"modbus-tcp\"]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\n\
         on_commander_lost = \"stop\"\nlost_after = \"1min\"\non_shutdown = \"stop\"\n[[modbus_tcp]]\n\
         listen = \"127.0.0.1:0\"\nwrite = [\"127.0.0.1/32\"]\n"
    );
    let file = place.write("gateway.toml", &text);
    let program = start(&["run", "-c", file.to_str().unwrap()]);
    let address = program.wait_for("where it listens", |line| {
        let fields = fields(line)?;
        (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
    });
    Gateway { program, address }
}

/// Reads, a command, and ser2net gone and back.
#[test]
fn a_line_behind_ser2net_is_read_commanded_lost_and_found_again() {
    let place = Place::new();
    let (line, port) = (place.file("line"), free_port());
    let _drive = simulate(&line);
    let mut server = ser2net(&place.file("ser2net.yaml"), port, &line);
    let gateway = commanding(&place, &format!("tcp://127.0.0.1:{port}"));
    gateway.wait_for_drive();
    let mut client = Raw::connect(gateway.address);
    assert_eq!(client.read(F010, 1), Ok(vec![3]));
    for (register, word) in [(256, 0), (257, 3000), (256, 1)] {
        until("the order is taken", PATIENCE, || {
            client.write(UNIFORM, register, word).ok()
        });
    }
    until("the motor turns", PATIENCE, || {
        client.read(OUTPUT, 1).ok().filter(|words| words[0] > 200)
    });

    server.kill();
    until("the line is down", Duration::from_secs(1), || {
        (client.read(F010, 1) == Err(0x0A)).then_some(())
    });
    // Long enough that the waits between attempts have grown.
    std::thread::sleep(Duration::from_secs(2));
    let _server = ser2net(&place.file("ser2net.yaml"), port, &line);
    let words = until("the drive is back", Duration::from_secs(1), || {
        client.read(F010, 1).ok()
    });
    assert_eq!(words, [3]);
    assert_eq!(
        told(&gateway.program, "line down"),
        1,
        "{}",
        gateway.program.text()
    );
    assert_eq!(
        told(&gateway.program, "cannot open the port; retrying"),
        1,
        "{}",
        gateway.program.text()
    );
    until("the stop is taken", PATIENCE, || {
        client.write(UNIFORM, 256, 0).ok()
    });
    until("the motor stands", PATIENCE, || {
        client.read(OUTPUT, 1).ok().filter(|words| words[0] == 0)
    });
}

#[test]
fn a_simulator_on_a_tcp_port_is_read_without_anything_between() {
    let place = Place::new();
    let drive = start(&[
        "simulate",
        "--model",
        "hyundai-n700",
        "--tcp",
        "127.0.0.1:0",
    ]);
    let port = drive.wait_for("where it listens", |line| {
        let (_, rest) = line.split_once(" on tcp://")?;
        Some(PathBuf::from(format!("tcp://{}", rest.split(',').next()?)))
    });
    let gateway = gateway(&place, &port);
    gateway.wait_for_drive();
    assert_eq!(Raw::connect(gateway.address).read(F010, 1), Ok(vec![3]));
}

#[test]
fn a_peer_that_accepts_and_says_nothing_is_a_silent_drive() {
    let place = Place::new();
    let peer = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut gateway = gateway(
        &place,
        Path::new(&format!("tcp://{}", peer.local_addr().unwrap())),
    );
    let silent = peer.accept().unwrap().0;
    let mut client = Raw::connect(gateway.address);
    // The system accepts the connection before the gateway knows that its line is up.
    let read = || Some(client.read(F010, 1)).filter(|answer| *answer != Err(0x0A));
    assert_eq!(
        until("the line is up", PATIENCE, read),
        Err(0x0B),
        "no reply"
    );
    gateway.program.terminate();
    assert_eq!(
        gateway.program.end_within(Duration::from_secs(2)).code(),
        Some(0)
    );
    drop(silent);
}

#[test]
fn a_peer_that_closes_at_once_is_reported_once() {
    let place = Place::new();
    let peer = TcpListener::bind("127.0.0.1:0").unwrap();
    let gateway = gateway(
        &place,
        Path::new(&format!("tcp://{}", peer.local_addr().unwrap())),
    );
    // One after the other: as a server does whose line somebody else has.
    let attempts = 8;
    for _ in 0..attempts {
        drop(peer.accept().unwrap());
    }
    // At its end all of the log is written.
    let mut program = gateway.program;
    program.terminate();
    assert_eq!(
        program.end_within(PATIENCE).code(),
        Some(0),
        "{}",
        program.text()
    );
    assert_eq!(told(&program, "line down"), 1, "{}", program.text());
    assert_eq!(told(&program, "line up"), 1, "{}", program.text());
}

#[test]
fn nobody_waits_for_a_peer_that_refuses_or_is_not_there() {
    let refusing = format!("tcp://127.0.0.1:{}", free_port());
    // An address that is kept for documents: nobody has it.
    for port in [
        refusing.as_str(),
        "tcp://192.0.2.1:4001",
        "tcp://no-such-host.invalid:4001",
    ] {
        let place = Place::new();
        let mut gateway = gateway(&place, Path::new(port));
        let mut client = Raw::connect(gateway.address);
        for _ in 0..20 {
            assert_eq!(client.read(F010, 1), Err(0x0A), "{port}");
        }
        until("it is told", PATIENCE, || {
            (told(&gateway.program, "cannot open the port; retrying") == 1).then_some(())
        });
        gateway.program.terminate();
        assert_eq!(
            gateway.program.end_within(Duration::from_secs(2)).code(),
            Some(0),
            "{port}"
        );
    }
}

/// How often the log has said `wanted`.
fn told(program: &Started, wanted: &str) -> usize {
    program
        .find_all(|line| fields(line).filter(|fields| fields["message"] == wanted))
        .len()
}
