//! What a line is reached through, and the keys that go with it.

use super::*;
use crate::domain::link::DirectionControl;

/// The line of `MINIMAL` at `port`, with `keys`.
fn line_at(port: &str, keys: &str) -> String {
    with(MINIMAL, "port = \"/dev/ttyUSB0\"", &format!("port = \"{port}\"\n{keys}"))
}

#[test]
fn a_port_that_is_none_is_reported_with_what_would_be_right() {
    let right = "an absolute path, as \"/dev/serial/by-id/...\" or \"/dev/ttyUSB0\", or a serial device server, as \
                 \"tcp://10.0.0.7:4001\"";
    only(&line_at("ttyUSB0", ""), &format!("line[0].port: `ttyUSB0` is not an absolute path; {right}"));
    let http = "line[0].port: a line over `http://` is not served";
    only(&line_at("http://10.0.0.7:4001", ""), &format!("{http}; {right}"));
    only(
        &line_at("tcp://10.0.0.7", ""),
        "line[0].port: `tcp://10.0.0.7` names no port, and there is no usual one; the port that the serial device server \
         listens on, as \"tcp://10.0.0.7:4001\"",
    );
}

#[test]
fn a_serial_device_server_stands_once() {
    let text = with(TWO_LINES, "/dev/ttyUSB0", "tcp://Hall.example:4001");
    only(
        &with(&text, "/dev/ttyUSB1", "tcp://hall.example:4001"),
        "line[1].port: the port tcp://hall.example:4001 is taken by line[0].port; a different port; drives on one bus \
         belong to one line",
    );
    let config = good(&with(&text, "/dev/ttyUSB1", "tcp://hall.example:4002"));
    let port = PortAddress::Tcp { host: "hall.example".to_owned(), port: 4002 };
    assert_eq!(config.lines[1].port, port);
}

#[test]
fn a_network_may_be_late_and_a_drive_may_say_otherwise() {
    let lateness = |port: &str, keys: &str| {
        let text = with(&line_at(port, ""), "station = 1", &format!("station = 1\n{keys}"));
        good(&text).lines[0].drives[0].max_lateness
    };
    let model = good(MINIMAL).lines[0].drives[0].model.timing.max_lateness.value;
    assert!(model < Duration::from_secs(3));
    assert_eq!(lateness("/dev/ttyUSB0", ""), model);
    assert_eq!(lateness("tcp://10.0.0.7:4001", ""), Duration::from_secs(3));
    assert_eq!(lateness("tcp://10.0.0.7:4001", "max_lateness = '700ms'"), Duration::from_millis(700));
}

#[test]
fn a_model_that_may_be_later_than_a_network_stays_so() {
    let acme = include_str!("../../../tests/golden/config/acme-one.toml");
    let (before, after) = acme.split_once("max_lateness = { value = ").unwrap();
    let slow = format!("{before}max_lateness = {{ value = \"9s\", {}", after.split_once(", ").unwrap().1);
    let catalog = Catalog::from_texts([("acme-one.toml", slow.as_str())]).unwrap();
    let text = with(&line_at("tcp://10.0.0.7:4001", ""), "hyundai-n700", "acme-one");
    let config = load(&text, &catalog).unwrap_or_else(|problems| panic!("{problems:?}"));
    assert_eq!(config.lines[0].drives[0].max_lateness, Duration::from_secs(9));
}

#[test]
fn who_turns_the_direction_is_the_adapter_unless_it_is_said() {
    let settled = |keys: &str| {
        let line = &good(&line_at("/dev/ttyS1", keys)).lines[0];
        (line.direction, line.low_latency)
    };
    assert_eq!(settled(""), (DirectionControl::Adapter, true));
    assert_eq!(settled("rs485 = 'adapter'\nlow_latency = false"), (DirectionControl::Adapter, false));
    assert_eq!(settled("rs485 = 'kernel'"), (DirectionControl::Kernel, true));
    assert_eq!(settled("rs485 = 'rts'\nlow_latency = true"), (DirectionControl::Rts, true));
    only(
        &line_at("/dev/ttyS1", "rs485 = 'driver'"),
        "line[0].rs485: `driver` is not an allowed value; one of \"adapter\", \"kernel\", \"rts\"",
    );
}

#[test]
fn keys_of_a_device_do_not_go_with_what_has_none() {
    assert_eq!(
        problems(&line_at("tcp://10.0.0.7:4001", "rs485 = 'kernel'\nlow_latency = true")),
        [
            "line[0].rs485: has no effect: the direction is turned by the serial device server, not from here; leave it out",
            "line[0].low_latency: has no effect: a network connection has no driver whose latency could be set; leave it out",
        ]
    );
    only(
        &line_at("/dev/ttyS1", "interface = 'rs232'\nrs485 = 'rts'"),
        "line[0].rs485: has no effect: RS-232 has a wire for each direction, and nothing to turn; leave it out",
    );
}
