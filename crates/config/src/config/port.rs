//! The port of a line: the keys that apply to each kind of port.

use super::file::LineFile;
use super::ready::PortAddress;
use crate::domain::link::Interface;
use crate::domain::problem::Problem;
use crate::toml_file::KeyLocation;

/// Why the direction of an adapter at a serial device server is not switched from here.
pub(super) const TURNED_ELSEWHERE: &str =
    "the direction is turned by the serial device server, not from here";

/// Reports the keys of `line` that have no effect with its port or its interface.
pub(super) fn check(line: &LineFile, problems: &mut Vec<Problem>) {
    if is_modbus_tcp(line) {
        return without_characters(line, problems);
    }
    if let (Some(rs485), Some(why)) = (line.direction.location(), why_not_turned(line)) {
        leave_out(rs485, why, problems);
    }
    if let Some(low_latency) = line.low_latency.location()
        && is_tcp(line)
    {
        let why = "a network connection has no driver whose latency could be set";
        leave_out(low_latency, why, problems);
    }
}

/// Reports the keys of a Modbus TCP `line` that are about a serial line, or about what such a line cannot tell apart.
fn without_characters(line: &LineFile, problems: &mut Vec<Problem>) {
    if let Some(framing) = line.framing.valid() {
        let what = "Modbus TCP has frames of its own, which are neither RTU nor ASCII";
        let right = "leave it out; or `tcp://` where a serial device server passes the frames of a line on as they are";
        framing.refuse(what, right, problems);
    }
    if let Some(rs232) = line.interface.valid_as(&Interface::Rs232) {
        let what = "a Modbus TCP connection is no RS-232";
        rs232.refuse(what, "leave it out", problems);
    }
    let rs485 = line.interface.valid_as(&Interface::Rs485);
    let of_a_serial_line = [
        rs485.map(|it| &it.location),
        line.baud.location(),
        line.data_bits.location(),
        line.parity.location(),
        line.stop_bits.location(),
        line.echo.location(),
        line.direction.location(),
        line.low_latency.location(),
        line.silence.location(),
    ];
    for location in of_a_serial_line.into_iter().flatten() {
        let why = "it is about a serial line, and Modbus TCP has none on this side";
        leave_out(location, why, problems);
    }
    for drive in &line.drives {
        if let Some(max_lateness) = drive.max_lateness.location() {
            let why = "over Modbus TCP each reply carries the number of its request";
            leave_out(max_lateness, why, problems);
        }
    }
}

fn leave_out(location: &KeyLocation, why: &str, problems: &mut Vec<Problem>) {
    location.warn(format!("has no effect: {why}"), "leave it out", problems);
}

/// Why the direction of an adapter is not switched on this side of `line`; `None` if it may be.
pub(super) fn why_not_turned(line: &LineFile) -> Option<&'static str> {
    if is_modbus_tcp(line) {
        return Some("Modbus TCP has no direction");
    }
    if is_tcp(line) {
        return Some(TURNED_ELSEWHERE);
    }
    let rs232 = line.interface.valid_as(&Interface::Rs232);
    rs232.map(|_| "RS-232 has a wire for each direction, and nothing to turn")
}

fn is_tcp(line: &LineFile) -> bool {
    matches!(&line.port, Some(port) if matches!(port.value, PortAddress::Tcp { .. }))
}

/// Whether the port of `line` is known to be Modbus TCP.
pub(super) fn is_modbus_tcp(line: &LineFile) -> bool {
    matches!(&line.port, Some(port) if !port.value.is_serial_line())
}
