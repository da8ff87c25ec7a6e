//! The port of a line: the keys that apply to each kind of port.

use super::file::LineFile;
use super::ready::PortAddress;
use crate::domain::link::Interface;
use crate::domain::problem::Problem;
use crate::toml_file::{KeyLocation, OptionalKey};

/// Reports the keys of `line` that have no effect with its port or its interface.
pub(super) fn check(line: &LineFile, problems: &mut Vec<Problem>) {
    if is_modbus_tcp(line) {
        return without_characters(line, problems);
    }
    let mut leave_out = |location: &KeyLocation, what: &str| {
        problems.push(
            location
                .problem(format!("has no effect: {what}"))
                .right("leave it out")
                .warning(),
        );
    };
    if let (OptionalKey::Valid(rs485), Some(why)) = (&line.direction, why_not_turned(line)) {
        leave_out(&rs485.location, why);
    }
    if let OptionalKey::Valid(low_latency) = &line.low_latency
        && is_tcp(line)
    {
        leave_out(
            &low_latency.location,
            "a network connection has no driver whose latency could be set",
        );
    }
}

/// Reports the keys of a Modbus TCP `line` that are about a serial line, or about what such a line cannot tell apart.
fn without_characters(line: &LineFile, problems: &mut Vec<Problem>) {
    if let Some(framing) = line.framing.valid() {
        let what = "Modbus TCP has frames of its own, which are neither RTU nor ASCII";
        let right = "leave it out; or `tcp://` where a serial device server passes the frames of a line on as they are";
        problems.push(framing.location.problem(what).right(right));
    }
    if let Some(rs232) = line
        .interface
        .valid()
        .filter(|interface| interface.value == Interface::Rs232)
    {
        problems.push(
            rs232
                .location
                .problem("a Modbus TCP connection is no RS-232")
                .right("leave it out"),
        );
    }
    let rs485 = line
        .interface
        .valid()
        .filter(|interface| interface.value == Interface::Rs485);
    let of_a_serial_line = [
        rs485.map(|it| &it.location),
        line.baud.valid().map(|it| &it.location),
        line.data_bits.valid().map(|it| &it.location),
        line.parity.valid().map(|it| &it.location),
        line.stop_bits.valid().map(|it| &it.location),
        line.echo.valid().map(|it| &it.location),
        line.direction.valid().map(|it| &it.location),
        line.low_latency.valid().map(|it| &it.location),
        line.silence.valid().map(|it| &it.location),
    ];
    let mut leave_out = |location: &KeyLocation, what: &str| {
        problems.push(
            location
                .problem(format!("has no effect: {what}"))
                .right("leave it out")
                .warning(),
        );
    };
    for location in of_a_serial_line.into_iter().flatten() {
        leave_out(
            location,
            "it is about a serial line, and Modbus TCP has none on this side",
        );
    }
    for max_lateness in line
        .drives
        .iter()
        .filter_map(|drive| drive.max_lateness.valid())
    {
        leave_out(
            &max_lateness.location,
            "over Modbus TCP each reply carries the number of its request",
        );
    }
}

/// Why the direction of an adapter is not switched on this side of `line`; `None` if it may be.
pub(super) fn why_not_turned(line: &LineFile) -> Option<&'static str> {
    if is_modbus_tcp(line) {
        return Some("Modbus TCP has no direction");
    }
    if is_tcp(line) {
        return Some("the direction is turned by the serial device server, not from here");
    }
    let rs232 = line
        .interface
        .valid()
        .filter(|interface| interface.value == Interface::Rs232);
    rs232.map(|_| "RS-232 has a wire for each direction, and nothing to turn")
}

fn is_tcp(line: &LineFile) -> bool {
    line.port
        .as_ref()
        .is_some_and(|port| matches!(port.value, PortAddress::Tcp { .. }))
}

/// Whether the port of `line` is known to be Modbus TCP.
pub(super) fn is_modbus_tcp(line: &LineFile) -> bool {
    line.port
        .as_ref()
        .is_some_and(|port| !port.value.is_serial_line())
}
