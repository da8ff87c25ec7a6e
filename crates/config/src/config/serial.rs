//! Serial masters: their link, and the time that they leave for an answer.

use super::file::{ConfigFile, SerialFile};
use super::lists;
use super::ready::{ListenerSettings, PortAddress};
use super::ready_serial::SerialMasterSettings;
use crate::domain::link::{DirectionControl, Framing, LinkSettings};
use crate::domain::problem::Problem;
use crate::north::modbus::serial;
use crate::toml_file::OptionalKey;
use crate::toml_file::values::duration_text;
use std::collections::BTreeSet;
use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

/// The ready serial masters; `served` holds the indices of the lines that each reaches. `None`: see `problems`.
pub(super) fn settle(
    file: &ConfigFile,
    served: &[BTreeSet<usize>],
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
    if let Some(port) = serial
        .port
        .as_ref()
        .filter(|port| !port.value.is_serial_line())
    {
        let problem = port
            .location
            .problem("a serial master cannot be reached over Modbus TCP");
        problems.push(problem.right(
            "its serial device or `tcp://`; Modbus TCP clients connect to a `[[modbus_tcp]]`",
        ));
        return None;
    }
    may_stop(serial, problems);
    may_renew(serial, problems);
    let framing = serial.framing();
    if let (OptionalKey::Valid(bits), Some(Framing::Rtu)) = (&serial.data_bits, framing)
        && bits.value != 8
    {
        problems.push(
            bits.location
                .problem("RTU frames need 8 data bits")
                .right("8, or leave it out"),
        );
        return None;
    }
    let is_tcp =
        matches!(&serial.port, Some(port) if matches!(port.value, PortAddress::Tcp { .. }));
    may_turn(serial, is_tcp, problems);
    let link = LinkSettings {
        baud: serial.baud.as_ref()?.value,
        data_bits: serial.data_bits()?,
        parity: serial.parity.as_ref()?.value,
        stop_bits: serial.stop_bits()?,
    };
    let framing = framing?;
    let answer_within = answer_within(serial, link, framing, problems)?;
    let direction = serial.direction()?;
    Some(SerialMasterSettings {
        name: serial.name.as_ref()?.value,
        port: serial.port.as_ref()?.value.clone(),
        link,
        framing,
        direction: if is_tcp {
            DirectionControl::Adapter
        } else {
            direction
        },
        low_latency: serial.low_latency()?,
        answer_within,
        serving: serving(serial, lines)?,
    })
}

/// Who may start must be allowed to stop.
fn may_stop(serial: &SerialFile, problems: &mut Vec<Problem>) {
    if let (OptionalKey::Valid(write), OptionalKey::Valid(stop)) =
        (&serial.allow_write, &serial.allow_stop)
        && write.value
        && !stop.value
    {
        let problem = stop
            .location
            .problem("a master that may start must be allowed to stop");
        problems.push(problem.right("true, or leave it out"));
    }
}

/// Only a serial line has a direction that is turned from here.
fn may_turn(serial: &SerialFile, is_tcp: bool, problems: &mut Vec<Problem>) {
    if is_tcp && let Some(direction) = serial.direction.valid() {
        let what =
            "has no effect: the direction is turned by the serial device server, not from here";
        problems.push(
            direction
                .location
                .problem(what)
                .right("leave it out")
                .warning(),
        );
    }
}

/// Only who may write has a lease to renew.
fn may_renew(serial: &SerialFile, problems: &mut Vec<Problem>) {
    let may_write = !matches!(serial.allow_write(), Some(false));
    if let Some(renew) = serial
        .reads_renew
        .valid()
        .filter(|renew| renew.value && !may_write)
    {
        let what = "has no effect: the master may not write, so there is no lease to renew";
        problems.push(
            renew
                .location
                .problem(what)
                .right("`allow_write = true`, or leave it out")
                .warning(),
        );
    }
}

/// The time that is left for an answer; `None` if it is too short on such a link, see `problems`.
fn answer_within(
    serial: &SerialFile,
    link: LinkSettings,
    framing: Framing,
    problems: &mut Vec<Problem>,
) -> Option<Duration> {
    let answer_within = serial.answer_within()?;
    let least = serial::least_answer_within(link, framing);
    if answer_within < least {
        let location = match &serial.answer_within {
            OptionalKey::Valid(written) => written.location.clone(),
            _ => serial.location.missing("answer_within"),
        };
        let what = format!(
            "{} is too short at {link}: the silence before an exception and the exception itself take longer",
            duration_text(answer_within)
        );
        let rounded = Duration::from_millis(
            u64::try_from(least.as_millis())
                .unwrap_or(u64::MAX)
                .saturating_add(1),
        );
        problems.push(
            location
                .problem(what)
                .right(format!("at least \"{}\"", duration_text(rounded))),
        );
        return None;
    }
    Some(answer_within)
}

fn serving(serial: &SerialFile, lines: &BTreeSet<usize>) -> Option<ListenerSettings> {
    let file = serial.as_listener();
    Some(ListenerSettings {
        listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 0)),
        allow: None,
        lines: file
            .lines
            .clone()
            .optional()?
            .map(|_| lines.iter().copied().collect()),
        write: lists::values(&file.write)?,
        stop: match &file.stop {
            OptionalKey::Absent => None,
            given => Some(lists::values(given)?),
        },
        reads_renew: serial.reads_renew()?,
        cached: serial.cached()?,
        units: match &file.units {
            OptionalKey::Absent => None,
            given => Some(lists::values(given)?),
        },
        connections_max: None,
        priority: lists::values(&file.write)?,
        idle_timeout: None,
        keep_alive: None,
        tls: None,
    })
}
