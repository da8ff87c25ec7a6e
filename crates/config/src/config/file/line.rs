//! The table of a line: `[[line]]`.

use super::super::ready::{DriveSettings, LineSettings, LineSilence, PortAddress};
use super::super::words::DIRECTION_CONTROLS;
use super::drive::DriveFile;
use super::kinds::{baud, flag, hours, ms, name, port, reply_timeout, seconds, time, title};
use crate::domain::ids::Name;
use crate::domain::link::{DirectionControl, EchoPolicy, Framing, Interface, LinkSettings, Parity};
use crate::domain::standby::StandbyPair;
use crate::north::titles::PartTitle;
use crate::toml_file::declare::{KeyForm, declare_table, each, in_tests, optional, required};
use crate::toml_file::values::ValueKind;
use crate::toml_file::words::{ECHO_POLICIES, FRAMINGS, INTERFACES, PARITIES};
use crate::toml_file::{OptionalKey, RequiredKey, TableReader};
use std::time::Duration;

in_tests! {
    const FACTORY: &str = "the factory setting that the models of the line share, if there is one";
}

declare_table! {
    /// One `[[line]]`.
    LineFile is "[[line]]" at location {
        /// The name of the line; unique among the lines.
        name: RequiredKey<Name> = required(name()) => name;
        /// What people call the line.
        title: OptionalKey<PartTitle> = optional(title()), without "the name";
        /// The serial device (preferably by id), a pseudo-terminal, a serial device server that forwards the frames, or a Modbus
        /// TCP server: a drive with an Ethernet port, or a converter before drives.
        port: RequiredKey<PortAddress> = required(port().listed_as(
            "absolute path, \"tcp://host:port\", or \"modbus-tcp://host[:502]\""
        )) => port;
        /// Speed; every drive of the line must be set to it.
        baud: OptionalKey<u32> = optional(baud()), without FACTORY;
        /// Data bits of a character; 8 with RTU framing.
        data_bits: OptionalKey<u8> = optional(ValueKind::number(7..=8)),
            without "8; with ASCII framing the factory setting";
        /// Parity bit of a character.
        parity: OptionalKey<Parity> = optional(ValueKind::one_of(&PARITIES)), without FACTORY;
        /// Stop bits of a character.
        stop_bits: OptionalKey<u8> = optional(ValueKind::number(1..=2)), without FACTORY;
        /// The framing of the line. Every model on the line must support it.
        framing: OptionalKey<Framing> = optional(ValueKind::one_of(&FRAMINGS)), default "rtu";
        /// The physical interface. RS-232 carries exactly one drive.
        interface: OptionalKey<Interface> = optional(ValueKind::one_of(&INTERFACES)), default "rs485";
        /// What to do if the adapter echoes what is sent: take the line down, or strip the echo.
        echo: OptionalKey<EchoPolicy> = optional(ValueKind::one_of(&ECHO_POLICIES)),
            default "refuse" => echo;
        /// What switches the direction of an RS-485 adapter: the adapter, its driver (TIOCSRS485), or the gateway with RTS.
        direction as "rs485": OptionalKey<DirectionControl> =
            optional(ValueKind::one_of(&DIRECTION_CONTROLS)), default "adapter";
        /// Whether to ask the driver to deliver received bytes at once, if it can.
        low_latency: OptionalKey<bool> = flag(), default true => low_latency;
        /// Silence between frames. It may be shorter than the models need only on a pseudo-terminal or `tcp://`.
        silence: OptionalKey<LineSilence> = optional(silence()), default "auto" => silence;
        /// Minimum time between the end of one exchange and the next request.
        min_request_gap: OptionalKey<Duration> = time(Duration::ZERO..=seconds(10)),
            default "0ms" => min_request_gap;
        /// Maximum wait for a reply, for drives without a setting of their own.
        reply_timeout: OptionalKey<Option<Duration>> = optional(reply_timeout()),
            default "auto" => reply_timeout;
        /// Maximum age of the fast values if the drives are polled more often than the line can carry. A line that would exceed
        /// it is refused.
        max_status_age: OptionalKey<Duration> = time(ms(100)..=hours(1)), default "5s" => max_status_age;
        /// Whether the other gateway of `[standby]` is on the same RS-485 line. Then one of the two sends, and the other one only
        /// listens and takes over when the line is silent.
        standby: OptionalKey<bool> = flag(), default false;
        /// One drive each.
        drives as "drive": Vec<DriveFile> = drives();
    } fills LineSettings with |
        file, link: LinkSettings, framing: Framing, interface: Interface, direction: DirectionControl,
        standby: Option<StandbyPair>, drives: Vec<DriveSettings>
    | { link, framing, interface, direction, standby, drives, }
}

impl LineFile {
    /// The line's label in messages: its name, or its location if it has none.
    pub fn label(&self) -> String {
        match &self.name {
            Some(name) => format!("line `{}`", name.value),
            None => format!("the line at {}", self.location.key),
        }
    }
}

fn silence() -> ValueKind<'static, LineSilence> {
    ValueKind::duration(Duration::ZERO..=seconds(1))
        .or_word("auto")
        .map(|fixed| fixed.map_or(LineSilence::Auto, LineSilence::Fixed))
}

fn drives() -> KeyForm<'static, Vec<DriveFile>> {
    KeyForm::new(
        "tables, at least one",
        |reader: &mut TableReader<'_, '_>, key| {
            let drives = each(reader, key, DriveFile::read);
            if drives.is_empty() {
                let missing = reader.location().missing(key);
                let right = "`[[line.drive]]` with `name`, `model` and `station`";
                missing.refuse("the line has no drive", right, reader.problems());
            }
            drives
        },
    )
}
