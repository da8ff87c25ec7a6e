//! Adapters are unplugged, programs are told to end, ports are taken.

use super::mosquitto::free_port;
use super::outsiders::mbpoll;
use super::raw::Raw;
use super::rig::{
    Place, gateway, only_demo, reserved, simulate, start, start_before_a_reader_that_leaves,
};
use super::started::{PATIENCE, until};
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::time::Duration;

/// Exception 0A: the line is down.
const DOWN: Result<Vec<u16>, u8> = Err(0x0A);

#[test]
fn an_unplugged_adapter_is_0a_within_a_second_and_back_within_two() {
    let place = Place::new();
    let port = place.file("line");
    let gateway = gateway(&place, &port);
    let mut client = Raw::connect(gateway.address);
    assert_eq!(client.read(0x0211, 1), DOWN, "never plugged in");
    for _ in 0..2 {
        let mut drive = simulate(&port);
        let there = || Some(client.read(0x0211, 1)).filter(Result::is_ok);
        assert_eq!(
            until("plugged in", Duration::from_secs(2), there),
            Ok(vec![3])
        );
        drive.terminate();
        assert!(drive.end_within(PATIENCE).success());
        let down = until("unplugged", Duration::from_secs(1), || {
            Some(client.read(0x0211, 1)).filter(|it| *it == DOWN)
        });
        assert_eq!(down, DOWN);
    }
}

#[test]
fn a_simulator_that_was_killed_is_replaced_under_the_same_name() {
    let place = Place::new();
    let port = place.file("line");
    let killed = simulate(&port);
    let _reserved = reserved(&port);
    let gateway = gateway(&place, &port);
    gateway.wait_for_drive();
    drop(killed);
    assert!(
        port.symlink_metadata().is_ok(),
        "the link of one that was killed stays"
    );
    let _drive = simulate(&port);
    let mut client = Raw::connect(gateway.address);
    let back = until("the drive is back", Duration::from_secs(2), || {
        client.read(0x0211, 1).ok()
    });
    assert_eq!(back, [3]);
}

#[test]
fn sigterm_and_ctrl_c_end_the_gateway_cleanly() {
    for interrupt in [false, true] {
        let place = Place::new();
        let port = place.file("line");
        let _drive = simulate(&port);
        let mut gateway = gateway(&place, &port);
        gateway.wait_for_drive();
        // A client that stays connected must not hold it up.
        let mut client = Raw::connect(gateway.address);
        assert_eq!(client.read(0x0211, 1), Ok(vec![3]));
        if interrupt {
            gateway.program.interrupt();
        } else {
            gateway.program.terminate();
        }
        let status = gateway.program.end_within(Duration::from_secs(2));
        assert_eq!(status.code(), Some(0), "{}", gateway.program.text());
    }
}

#[test]
fn a_program_that_is_asked_to_exit_at_once_ends_cleanly_too() {
    // Each time the signal comes as early as it can be sent: right behind the first sign of life.
    for _ in 0..10 {
        let place = Place::new();
        let mut gateway = gateway(&place, &place.file("nothing"));
        gateway.program.terminate();
        assert_eq!(
            gateway.program.end_within(Duration::from_secs(2)).code(),
            Some(0),
            "run"
        );
        let link = place.file("line");
        let mut drive = simulate(&link);
        drive.terminate();
        assert_eq!(
            drive.end_within(Duration::from_secs(2)).code(),
            Some(0),
            "simulate"
        );
        assert!(
            link.symlink_metadata().is_err(),
            "the link is gone with the simulator"
        );
    }
}

#[test]
fn run_says_that_its_port_is_taken_and_fails() {
    let place = Place::new();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let text = format!(
        "[[line]]\nname = \"test\"\nport = \"{}\"\n\n[[line.drive]]\nname = \"pump-1\"\nmodel = \"hyundai-n700\"\n\
         station = 1\n\n[[modbus_tcp]]\nlisten = \"{address}\"\n",
        place.file("line").display()
    );
    let file = place.write("gateway.toml", &text);
    let mut program = start(&["run", "-c", file.to_str().unwrap()]);
    assert_eq!(program.end_within(PATIENCE).code(), Some(1));
    program.wait_for("which address it cannot have", |line| {
        line.contains(&address.to_string()).then_some(())
    });
}

#[test]
fn the_demo_says_that_its_port_is_taken_and_takes_another() {
    let _alone = only_demo();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let mut demo = start(&[
        "demo",
        "--port",
        &address.port().to_string(),
        "--http-port",
        "0",
    ]);
    demo.wait_for("that the port is taken", |line| {
        line.contains(&format!("{address} is taken")).then_some(())
    });
    let other: SocketAddr = demo.wait_for("where it listens instead", |line| {
        line.strip_prefix("Modbus TCP ")?
            .split(": ")
            .next()?
            .parse()
            .ok()
    });
    assert_ne!(other, address);
    let values = until("the drive answers", PATIENCE, || {
        Some(mbpoll(other, &["-t", "4", "-r", "529", "-c", "1"]).values)
            .filter(|values| !values.is_empty())
    });
    assert_eq!(values, [3]);
    demo.interrupt();
    assert_eq!(demo.end_within(Duration::from_secs(2)).code(), Some(0));
}

#[test]
fn a_demo_whose_reader_has_gone_goes_on_and_ends_when_it_is_reported_to() {
    let _alone = only_demo();
    let free = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
    let (mut demo, _) = start_before_a_reader_that_leaves(&[
        "demo",
        "--port",
        &free.port().to_string(),
        "--http-port",
        "0",
    ]);
    // Every exchange on the line is a log line that nobody takes.
    let values = until("the drive answers", PATIENCE, || {
        Some(mbpoll(free, &["-t", "4", "-r", "529", "-c", "1"]).values)
            .filter(|values| !values.is_empty())
    });
    assert_eq!(values, [3]);
    demo.terminate();
    assert_eq!(demo.end_within(Duration::from_secs(2)).code(), Some(0));
}
