//! Serial masters: their link, and the time that they leave for an answer.

use super::file::{ConfigFile, SerialFile};
use super::link;
use super::lists;
use super::port;
use super::ready::{ListenerSettings, PortAddress, SerialMasterSettings};
use crate::domain::link::{DirectionControl, Framing, LinkSettings};
use crate::domain::problem::Problem;
use crate::north::modbus::serial;
use crate::toml_file::values::duration_text;
use std::collections::BTreeSet;
use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

/// The ready serial masters; `served` has the indices of the lines that each reaches. `None`: see `problems`.
pub(super) fn settle<'s>(
    file: &ConfigFile,
    served: impl Iterator<Item = &'s BTreeSet<usize>>,
    problems: &mut Vec<Problem>,
) -> Option<Vec<SerialMasterSettings>> {
    let ready: Vec<_> = file
        .serial
        .iter()
        .zip(served)
        .map(|(serial, lines)| one(serial, lines, problems))
        .collect();
    ready.into_iter().collect()
}

fn one(
    serial: &SerialFile,
    lines: &BTreeSet<usize>,
    problems: &mut Vec<Problem>,
) -> Option<SerialMasterSettings> {
    if let Some(port) = &serial.port
        && !port.value.is_serial_line()
    {
        let right =
            "its serial device or `tcp://`; Modbus TCP clients connect to a `[[modbus_tcp]]`";
        port.refuse(
            "a serial master cannot be reached over Modbus TCP",
            right,
            problems,
        );
        return None;
    }
    may_stop(serial, problems);
    may_renew(serial, problems);
    let framing = serial.framing();
    if !link::rtu_has_bytes(&serial.data_bits, framing, problems) {
        return None;
    }
    let is_tcp =
        matches!(&serial.port, Some(port) if matches!(port.value, PortAddress::Tcp { .. }));
    // Only a serial line has a direction that is turned from here.
    if is_tcp && let Some(direction) = serial.direction.valid() {
        let what = format!("has no effect: {}", port::TURNED_ELSEWHERE);
        direction.warn(what, "leave it out", problems);
    }
    let link = LinkSettings {
        baud: serial.baud.as_ref()?.value,
        data_bits: serial.data_bits()?,
        parity: serial.parity.as_ref()?.value,
        stop_bits: serial.stop_bits()?,
    };
    if !leaves_time(serial, link, framing?, problems) {
        return None;
    }
    let direction = match (is_tcp, serial.direction()?) {
        (true, _) => DirectionControl::Adapter,
        (false, direction) => direction,
    };
    serial.settings(link, direction, serving(serial, lines)?)
}

/// Who may start must be allowed to stop.
fn may_stop(serial: &SerialFile, problems: &mut Vec<Problem>) {
    if serial.allow_write.valid_as(&true).is_some()
        && let Some(stop) = serial.allow_stop.valid_as(&false)
    {
        let what = "a master that may start must be allowed to stop";
        stop.refuse(what, "true, or leave it out", problems);
    }
}

/// Only who may write has a lease to renew.
fn may_renew(serial: &SerialFile, problems: &mut Vec<Problem>) {
    if let Some(renew) = serial.reads_renew.valid_as(&true)
        && serial.allow_write() == Some(false)
    {
        let what = "has no effect: the master may not write, so there is no lease to renew";
        renew.warn(what, "`allow_write = true`, or leave it out", problems);
    }
}

/// Whether the time that is left for an answer is long enough on such a link; if not, see `problems`.
fn leaves_time(
    serial: &SerialFile,
    link: LinkSettings,
    framing: Framing,
    problems: &mut Vec<Problem>,
) -> bool {
    let Some(answer_within) = serial.answer_within() else {
        return false;
    };
    let least = serial::least_answer_within(link, framing);
    if answer_within >= least {
        return true;
    }
    let missing = serial.location.missing("answer_within");
    let location = serial.answer_within.location().unwrap_or(&missing);
    let what = format!(
        "{} is too short at {link}: the silence before an exception and the exception itself take longer",
        duration_text(answer_within)
    );
    let rounded = u64::try_from(least.as_millis()).unwrap_or(u64::MAX);
    let rounded = Duration::from_millis(rounded.saturating_add(1));
    let right = format!("at least \"{}\"", duration_text(rounded));
    location.refuse(what, right, problems);
    false
}

/// What the master is served, as by a listener without limits on connections, whose one client has priority.
fn serving(serial: &SerialFile, lines: &BTreeSet<usize>) -> Option<ListenerSettings> {
    let rights = serial.as_listener();
    let write = lists::values(&rights.write)?;
    Some(ListenerSettings {
        listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 0)),
        allow: None,
        lines: serial
            .lines
            .settle(|_names| Some(lines.iter().copied().collect()))?,
        stop: lists::some_values(&rights.stop)?,
        reads_renew: serial.reads_renew()?,
        cached: serial.cached()?,
        units: lists::some_values(&serial.units)?,
        connections_max: None,
        priority: write.clone(),
        write,
        idle_timeout: None,
        keep_alive: None,
        tls: None,
    })
}
