//! What a line is reached through, and the keys that go with it.

use super::*;
use crate::domain::link::DirectionControl;

/// The line of `MINIMAL` at `port`, with `keys`.
fn line_at(port: &str, keys: &str) -> String {
    with(
        MINIMAL,
        "port = \"/dev/ttyUSB0\"",
        &format!("port = \"{port}\"\n{keys}"),
    )
}

#[test]
fn a_port_that_is_none_is_reported_with_what_would_be_right() {
    let right = "an absolute path, as \"/dev/serial/by-id/...\" or \"/dev/ttyUSB0\", or a serial device server, as \
                 \"tcp://10.0.0.7:4001\", or Modbus TCP, as \"modbus-tcp://10.0.0.7\"";
    only(
        &line_at("ttyUSB0", ""),
        &format!("line[0].port: `ttyUSB0` is not an absolute path; {right}"),
    );
    let http = "line[0].port: a line over `http://` is not served";
    only(
        &line_at("http://10.0.0.7:4001", ""),
        &format!("{http}; {right}"),
    );
    only(
        &line_at("tcp://10.0.0.7", ""),
        "line[0].port: `tcp://10.0.0.7` has no port, and there is no default one; the port that \
         the serial device server listens on, as \"tcp://10.0.0.7:4001\"",
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
    let port = PortAddress::Tcp {
        host: "hall.example".to_owned(),
        port: 4002,
    };
    assert_eq!(config.lines[1].port, port);
}

#[test]
fn a_network_may_be_late_and_a_drive_may_say_otherwise() {
    let lateness = |port: &str, keys: &str| {
        let text = with(
            &line_at(port, ""),
            "station = 1",
            &format!("station = 1\n{keys}"),
        );
        good(&text).lines[0].drives[0].max_lateness
    };
    let model = good(MINIMAL).lines[0].drives[0]
        .model
        .timing
        .max_lateness
        .value;
    assert!(model < Duration::from_secs(3));
    assert_eq!(lateness("/dev/ttyUSB0", ""), model);
    assert_eq!(lateness("tcp://10.0.0.7:4001", ""), Duration::from_secs(3));
    assert_eq!(
        lateness("tcp://10.0.0.7:4001", "max_lateness = '700ms'"),
        Duration::from_millis(700)
    );
}

#[test]
fn a_model_that_may_be_later_than_a_network_stays_so() {
    let acme = include_str!("../../../../../tests/golden/config/acme-one.toml");
    let (before, after) = acme.split_once("max_lateness = { value = ").unwrap();
    let slow = format!(
        "{before}max_lateness = {{ value = \"9s\", {}",
        after.split_once(", ").unwrap().1
    );
    let catalog = Catalog::from_texts([("acme-one.toml", slow.as_str())]).unwrap();
    let text = with(
        &line_at("tcp://10.0.0.7:4001", ""),
        "hyundai-n700",
        "acme-one",
    );
    let config = load(&text, &catalog).unwrap_or_else(|problems| panic!("{problems:?}"));
    assert_eq!(
        config.lines[0].drives[0].max_lateness,
        Duration::from_secs(9)
    );
}

#[test]
fn who_turns_the_direction_is_the_adapter_unless_it_is_said() {
    let settled = |keys: &str| {
        let line = &good(&line_at("/dev/ttyS1", keys)).lines[0];
        (line.direction, line.low_latency)
    };
    assert_eq!(settled(""), (DirectionControl::Adapter, true));
    assert_eq!(
        settled("rs485 = 'adapter'\nlow_latency = false"),
        (DirectionControl::Adapter, false)
    );
    assert_eq!(
        settled("rs485 = 'kernel'"),
        (DirectionControl::Kernel, true)
    );
    assert_eq!(
        settled("rs485 = 'rts'\nlow_latency = true"),
        (DirectionControl::Rts, true)
    );
    only(
        &line_at("/dev/ttyS1", "rs485 = 'driver'"),
        "line[0].rs485: `driver` is not an allowed value; one of \"adapter\", \"kernel\", \"rts\"",
    );
}

#[test]
fn keys_of_a_device_do_not_go_with_what_has_none() {
    assert_eq!(
        problems(&line_at(
            "tcp://10.0.0.7:4001",
            "rs485 = 'kernel'\nlow_latency = true"
        )),
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

/// A Modbus TCP line with `keys` and one drive with `drive_keys`.
fn modbus_tcp(keys: &str, station: u16, drive_keys: &str) -> String {
    let text = line_at("modbus-tcp://10.0.0.7", keys);
    with(
        &text,
        "station = 1",
        &format!("station = {station}\n{drive_keys}"),
    )
}

#[test]
fn a_modbus_tcp_line_needs_nothing_of_a_serial_line() {
    for id in vendors::catalog().ids() {
        let text = with(
            &modbus_tcp("", 1, "full_scale_hz = 50.0"),
            "hyundai-n700",
            id,
        );
        let config = load(&text, &vendors::catalog()).or_else(|_| {
            load(
                &text.replace("full_scale_hz = 50.0", ""),
                &vendors::catalog(),
            )
        });
        let line = config
            .unwrap_or_else(|problems| panic!("{id}: {problems:?}"))
            .lines
            .remove(0);
        assert_eq!(
            (line.framing, line.port.to_string()),
            (Framing::Mbap, "modbus-tcp://10.0.0.7:502".to_owned())
        );
        let (timing, needs_virtual) = crate::config::line_plan::timing(&line);
        assert!(!timing.paced && !needs_virtual, "{id}");
    }
}

#[test]
fn the_same_server_stands_once_with_or_without_its_port() {
    let text = with(TWO_LINES, "/dev/ttyUSB0", "modbus-tcp://Press.example");
    only(
        &with(&text, "/dev/ttyUSB1", "modbus-tcp://press.example:502"),
        "line[1].port: the port modbus-tcp://press.example:502 is taken by line[0].port; a different port; drives on one \
         bus belong to one line",
    );
    good(&with(
        &text,
        "/dev/ttyUSB1",
        "modbus-tcp://press.example:503",
    ));
    only(
        &with(&text, "/dev/ttyUSB1", "tcp://press.example:502"),
        "line[1].port: the port tcp://press.example:502 is taken by line[0].port; a different port; drives on one bus \
         belong to one line",
    );
}

#[test]
fn keys_of_a_serial_line_do_not_go_with_modbus_tcp() {
    let serial = "line[0].KEY: has no effect: it is about a serial line, and Modbus TCP has none on this side; leave it out";
    for (key, value) in [
        ("interface", "'rs485'"),
        ("baud", "9600"),
        ("data_bits", "8"),
        ("parity", "'none'"),
        ("stop_bits", "1"),
        ("echo", "'strip'"),
        ("rs485", "'rts'"),
        ("low_latency", "false"),
        ("silence", "'0ms'"),
    ] {
        let text = modbus_tcp(&format!("{key} = {value}"), 1, "");
        assert_eq!(problems(&text), [serial.replace("KEY", key)]);
    }
    for keys in ["min_request_gap = '5ms'", "reply_timeout = '2s'"] {
        good(&modbus_tcp(keys, 1, ""));
    }
    assert_eq!(
        problems(&modbus_tcp("", 1, "max_lateness = '1s'")),
        [
            "line[0].drive[0].max_lateness: has no effect: over Modbus TCP each reply carries the number of its request; leave it \
          out"
        ]
    );
    only(
        &modbus_tcp("framing = 'rtu'", 1, ""),
        "line[0].framing: Modbus TCP has frames of its own, which are neither RTU nor ASCII; leave it out; or `tcp://` where a \
         serial device server passes the frames of a line on as they are",
    );
    only(
        &modbus_tcp("interface = 'rs232'", 1, ""),
        "line[0].interface: a Modbus TCP connection is no RS-232; leave it out",
    );
}

#[test]
fn a_unit_may_be_the_device_itself() {
    for station in [1, 200, 247] {
        let config = good(&modbus_tcp("", station, "uniform_unit = 99"));
        assert_eq!(u16::from(config.lines[0].drives[0].station.0), station);
    }
    for station in [0, 255] {
        let config = good(&modbus_tcp("", station, "unit = 3"));
        assert_eq!(u16::from(config.lines[0].drives[0].station.0), station);
        only(
            &modbus_tcp("", station, ""),
            &format!(
                "line[0].drive[0].unit: `unit` is left out, and station {station} is no unit of a listener; unit = 1, which is free"
            ),
        );
    }
    only(
        &modbus_tcp("", 250, "unit = 3"),
        "line[0].drive[0].station: the unit 250 is reserved; 0 to 247, or 255, as the drive or the converter is set",
    );
}

#[test]
fn a_serial_master_is_not_reached_over_modbus_tcp() {
    let master = "[[modbus_rtu]]\nname = 'plc'\nport = 'modbus-tcp://10.0.0.9'\nbaud = 9600\nparity = 'none'\n";
    let reported = problems(&format!("{MINIMAL}\n{master}"));
    assert!(
        reported[0]
            .starts_with("modbus_rtu[0].port: a serial master cannot be reached over Modbus TCP"),
        "{reported:?}"
    );
}
