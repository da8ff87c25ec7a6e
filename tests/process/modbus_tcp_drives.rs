//! Drives behind Modbus TCP: servers of pymodbus and libmodbus, straight and over a way that cuts, resets, delays, doubles
//! and swaps.

use super::meddler::{Meddler, Way};
use super::mosquitto::free_port;
use super::outsiders::{libmodbus_drive, pymodbus_vendor_at};
use super::raw::Raw;
use super::rig::{Gateway, Place, assert_says, fields, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use std::net::{SocketAddr, TcpListener};
use std::time::Duration;

/// The uniform unit of the drive, its registers for run and setpoint, its words for run state and output frequency.
const UNIFORM: u8 = 101;
const RUN: u16 = 256;
const SETPOINT: u16 = 257;
const RUN_STATE: u16 = 2;
const OUTPUT: u16 = 4;
const STOPPED: u16 = 1;
const FORWARD: u16 = 2;
/// Where the libmodbus drive begins to hold addresses.
const OWN_FROM: u16 = 0x0220;
/// Its run register.
const N700_RUN: u16 = 0x0002;
/// The reply time-out of the gateway's line.
const REPLY_TIMEOUT: Duration = Duration::from_millis(150);

/// A gateway that may command the drive of `model` at `server`.
fn commanding(place: &Place, server: SocketAddr, model: &str, keys: &str) -> Gateway {
    let text = format!(
        "[[line]]\nname = \"press\"\nport = \"modbus-tcp://{server}\"\nreply_timeout = \"{}ms\"\n[[line.drive]]\n\
         name = \"pump-1\"\nmodel = \"{model}\"\nstation = 1\npoll = \"50ms\"\n[line.drive.control]\n\
         from = [\"modbus-tcp\"]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\non_commander_lost = \"stop\"\n\
         lost_after = \"1min\"\non_shutdown = \"stop\"\n{keys}[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n\
         write = [\"127.0.0.1/32\"]\n",
        REPLY_TIMEOUT.as_millis(),
    );
    let file = place.write("gateway.toml", &text);
    assert_says(
        &vfd_gateway(&["check", "-c", file.to_str().unwrap()]),
        0,
        &["Modbus TCP): 1 drive, 1 controlled"],
    );
    let program = start(&["run", "-c", file.to_str().unwrap()]);
    let address = program.wait_for("where it listens", |line| {
        let fields = fields(line)?;
        (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
    });
    Gateway { program, address }
}

fn orders(client: &mut Raw, register: u16, word: u16) {
    until(&format!("{register} = {word} is taken"), PATIENCE, || {
        client.write(UNIFORM, register, word).ok()
    });
}

/// A STOP is taken also while something is still pending, so it is given until the drive stands.
fn stops(client: &mut Raw) {
    until("the stop is taken", PATIENCE, || {
        client.write(UNIFORM, RUN, 0).ok()
    });
    waits_for(client, OUTPUT, |word| word == 0);
    waits_for(client, RUN_STATE, |word| word == STOPPED);
}

fn waits_for(client: &mut Raw, at: u16, is_it: impl Fn(u16) -> bool) {
    let read = |client: &mut Raw| {
        client
            .read_unit(UNIFORM, at, 1)
            .ok()
            .filter(|words| is_it(words[0]))
    };
    until(&format!("word {at} is right"), PATIENCE, || read(client));
}

/// Starts, waits until the motor turns, stops.
fn starts_and_stops(client: &mut Raw) {
    for (register, word) in [(RUN, 0), (SETPOINT, 3000), (RUN, 1)] {
        orders(client, register, word);
    }
    waits_for(client, OUTPUT, |word| word == 3000);
    waits_for(client, RUN_STATE, |word| word == FORWARD);
    stops(client);
}

#[test]
fn a_drive_played_by_pymodbus_is_polled_commanded_and_stopped() {
    let place = Place::new();
    let port = free_port();
    let mut drive = pymodbus_vendor_at("fr500a", port, 1);
    let server = SocketAddr::from(([127, 0, 0, 1], port));
    let gateway = commanding(
        &place,
        server,
        "frecon-fr500a",
        "accept_unverified = [\"basic\"]\n",
    );
    gateway.wait_for_drive();
    let mut client = Raw::connect(gateway.address);
    starts_and_stops(&mut client);
    // F00.23, a register that is not polled.
    assert_eq!(client.read(0x0017, 1), Ok(vec![214]));
    // The server goes and comes back: the same port, another process.
    drive.kill();
    until("the line is down", PATIENCE, || {
        (client.read(0x0017, 1) == Err(0x0A)).then_some(())
    });
    let _drive = pymodbus_vendor_at("fr500a", port, 1);
    until("the drive is back", PATIENCE, || {
        client.read(0x0017, 1).ok()
    });
    starts_and_stops(&mut client);
}

#[test]
fn a_unit_that_the_server_does_not_have_is_no_drive() {
    let place = Place::new();
    let port = free_port();
    let _drive = pymodbus_vendor_at("fr500a", port, 7);
    let server = SocketAddr::from(([127, 0, 0, 1], port));
    let gateway = commanding(
        &place,
        server,
        "frecon-fr500a",
        "accept_unverified = [\"basic\"]\n",
    );
    gateway.program.wait_for("that it is offline", |line| {
        (fields(line)?["message"] == "drive offline").then_some(())
    });
    let mut client = Raw::connect(gateway.address);
    assert!(client.read(0x0017, 1).is_err() && client.write(UNIFORM, RUN, 1).is_err());
}

/// The libmodbus drive, the way to it, and a gateway.
struct Plant {
    gateway: Gateway,
    meddler: Meddler,
    _drive: Started,
    _place: Place,
}

impl Plant {
    fn new() -> Self {
        let place = Place::new();
        let port = free_port();
        let drive = libmodbus_drive(&place.file(""), port);
        let meddler = Meddler::before(port);
        let gateway = commanding(&place, meddler.address, "hyundai-n700", "");
        gateway.wait_for_drive();
        Self {
            gateway,
            meddler,
            _drive: drive,
            _place: place,
        }
    }
}

#[test]
fn a_drive_played_by_libmodbus_is_polled_commanded_and_stopped() {
    let plant = Plant::new();
    let mut client = Raw::connect(plant.gateway.address);
    starts_and_stops(&mut client);
    let words: Vec<u16> = (OWN_FROM..OWN_FROM + 8).collect();
    assert_eq!(client.read(OWN_FROM, 8), Ok(words));
    assert_eq!(
        plant
            .meddler
            .written(N700_RUN)
            .iter()
            .filter(|word| **word == 1)
            .count(),
        1
    );
    assert_eq!(plant.meddler.most_connections(), 1);
}

/// Reads until `answers` were right, one register after the other, and wants never a wrong one.
fn no_value_is_wrong(client: &mut Raw, what: Way, answers: usize) {
    let (mut right, mut asked) = (0, 0_u16);
    until(
        &format!("{answers} answers are right: {what:?}"),
        PATIENCE * 4,
        || {
            let address = OWN_FROM + asked % 100;
            asked = asked.wrapping_add(1);
            if let Ok(words) = client.read(address, 1) {
                assert_eq!(words, [address], "{what:?}: another register's value");
                right += 1;
            }
            (right >= answers).then_some(())
        },
    );
}

#[test]
fn nothing_that_happens_on_the_way_gives_a_wrong_value_or_a_second_run() {
    let plant = Plant::new();
    let mut client = Raw::connect(plant.gateway.address);
    let late = Way::Late(REPLY_TIMEOUT + Duration::from_millis(40));
    for (way, answers) in [
        (Way::Twice, 200),
        (Way::Swapped, 100),
        (Way::CutBehind, 60),
        (Way::ResetBefore, 60),
        (Way::Straight, 100),
    ] {
        plant.meddler.goes(way);
        no_value_is_wrong(&mut client, way, answers);
        // What was commanded is done once, or told not to be done; a stop arrives in any case.
        until("control is taken", PATIENCE, || {
            client.write(UNIFORM, RUN, 0).ok()
        });
        waits_for(&mut client, RUN_STATE, |word| word == STOPPED);
        until("the setpoint is taken", PATIENCE, || {
            client.write(UNIFORM, SETPOINT, 3000).ok()
        });
        let before = plant
            .meddler
            .written(N700_RUN)
            .iter()
            .filter(|word| **word == 1)
            .count();
        let _ = client.write(UNIFORM, RUN, 1);
        no_value_is_wrong(&mut client, way, 30);
        let runs = plant
            .meddler
            .written(N700_RUN)
            .iter()
            .filter(|word| **word == 1)
            .count()
            - before;
        assert!(runs <= 1, "{way:?}: run was sent {runs} times");
        stops(&mut client);
    }
    // Every answer comes after its time-out: none is taken for another, so no read has an answer.
    plant.meddler.goes(late);
    for n in 0..20 {
        let address = OWN_FROM + n;
        match client.read(address, 1) {
            Ok(words) => assert_eq!(words, [address]),
            Err(code) => assert!(matches!(code, 0x0A | 0x0B), "{code:02X}"),
        }
    }
    plant.meddler.goes(Way::Straight);
    no_value_is_wrong(&mut client, Way::Straight, 100);
    assert_eq!(
        plant.meddler.most_connections(),
        1,
        "the old connection is closed before a new one is opened"
    );
}

#[test]
fn a_server_that_closes_after_each_reply_is_no_lost_line() {
    let plant = Plant::new();
    plant.meddler.goes(Way::ClosedBehind);
    let mut client = Raw::connect(plant.gateway.address);
    no_value_is_wrong(&mut client, Way::ClosedBehind, 100);
    starts_and_stops(&mut client);
    no_value_is_wrong(&mut client, Way::ClosedBehind, 100);
    let said = plant.gateway.program.text();
    let times = |part: &str| said.matches(part).count();
    assert_eq!(
        (times("line down"), times("drive offline")),
        (0, 0),
        "{said}"
    );
    assert_eq!(
        times("server closes the connection after each reply"),
        1,
        "{said}"
    );
    assert_eq!(
        plant
            .meddler
            .written(N700_RUN)
            .iter()
            .filter(|word| **word == 1)
            .count(),
        1
    );
    assert_eq!(
        plant.meddler.most_connections(),
        1,
        "the old connection is closed before a new one is opened"
    );
}

#[test]
fn a_server_that_closes_after_each_reply_and_is_slow_to_accept_is_no_lost_line() {
    let plant = Plant::new();
    plant.meddler.goes(Way::ClosedBehind);
    let said = || plant.gateway.program.text();
    until("it is known", PATIENCE, || {
        said()
            .contains("server closes the connection after each reply")
            .then_some(())
    });
    plant.meddler.loses_first_packets();
    let before = plant.meddler.requests().len();
    std::thread::sleep(Duration::from_secs(8));
    let exchanges = plant.meddler.requests().len() - before;
    assert!((3..100).contains(&exchanges), "one a second: {exchanges}");
    let times = |part: &str| said().matches(part).count();
    assert_eq!(
        (times("line down"), times("drive offline")),
        (0, 0),
        "{}",
        said()
    );
}

#[test]
fn a_stop_that_is_given_while_answers_are_swallowed_arrives_and_is_confirmed_later() {
    let plant = Plant::new();
    let mut client = Raw::connect(plant.gateway.address);
    for (register, word) in [(RUN, 0), (SETPOINT, 3000), (RUN, 1)] {
        orders(&mut client, register, word);
    }
    waits_for(&mut client, OUTPUT, |word| word == 3000);
    plant.meddler.goes(Way::Swallowed);
    let stops = || {
        plant
            .meddler
            .written(N700_RUN)
            .iter()
            .filter(|word| **word == 0)
            .count()
    };
    let before = stops();
    let mut stopping = Raw::connect(plant.gateway.address);
    let _ = stopping.write(UNIFORM, RUN, 0);
    until("the stop is sent", PATIENCE, || {
        (stops() > before).then_some(())
    });
    // The peer takes all and says nothing: after a while it is connected to again.
    let is_mute = |line: &str| {
        fields(line)?["message"]
            .as_str()
            .filter(|it| it.starts_with("reopening"))
            .map(|_| ())
    };
    plant
        .gateway
        .program
        .wait_for("that the port is reopened", is_mute);
    plant.meddler.goes(Way::Straight);
    until("one connection stands", PATIENCE, || {
        (plant.meddler.connections() == 1).then_some(())
    });
    waits_for(&mut client, OUTPUT, |word| word == 0);
    waits_for(&mut client, RUN_STATE, |word| word == STOPPED);
    let runs = plant
        .meddler
        .written(N700_RUN)
        .iter()
        .filter(|word| **word == 1)
        .count();
    assert_eq!((runs, plant.meddler.most_connections()), (1, 1));
}

#[test]
fn a_server_that_speaks_something_else_is_named() {
    let place = Place::new();
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = server.local_addr().unwrap();
    std::thread::spawn(move || {
        use std::io::{Read, Write};
        for mut client in server.incoming().map_while(Result::ok) {
            let _ = client.read(&mut [0; 64]);
            let _ = client.write_all(b"HTTP/1.1 400 Bad Request\r\n\r\n");
            let _ = client.read(&mut [0; 64]);
        }
    });
    let gateway = commanding(&place, address, "hyundai-n700", "");
    let named = |line: &str| {
        let fields = fields(line)?;
        fields["fault"]
            .as_str()
            .filter(|fault| fault.contains("not a Modbus TCP message"))
            .map(|_| ())
    };
    gateway.program.wait_for("what is wrong", named);
    let mut client = Raw::connect(gateway.address);
    until("a read is refused", PATIENCE, || {
        client.read(OWN_FROM, 1).err()
    });
}

#[test]
fn a_simulated_drive_is_reached_by_a_gateway_and_by_a_tool() {
    let place = Place::new();
    let args = [
        "simulate",
        "--model",
        "hyundai-n700",
        "--framing",
        "modbus-tcp",
        "--tcp",
        "127.0.0.1:0",
    ];
    let drive = start(&args);
    let server: SocketAddr = drive.wait_for("where it listens", |line| {
        let (_, rest) = line.split_once(" on modbus-tcp://")?;
        rest.split(',').next()?.parse().ok()
    });
    let port = format!("modbus-tcp://{server}");
    let read = vfd_gateway(&[
        "read",
        "--port",
        &port,
        "--model",
        "hyundai-n700",
        "--station",
        "1",
        "0x0211",
    ]);
    assert_says(&read, 0, &["3"]);
    let gateway = commanding(&place, server, "hyundai-n700", "");
    gateway.wait_for_drive();
    starts_and_stops(&mut Raw::connect(gateway.address));
    for args in [&["scan", "--port", &port][..], &["init", "--port", &port]] {
        assert_says(
            &vfd_gateway(args),
            2,
            &["drives can be searched only on serial lines"],
        );
    }
}
