//! The table of a serial master: `[[modbus_rtu]]`.

use super::super::ready::{ListenerSettings, PortAddress, SerialMasterSettings};
use super::super::words::DIRECTION_CONTROLS;
use super::kinds::{ListKey, baud, commander_name, flag, ms, port, seconds, time, unit};
use super::listener::ListenerFile;
use crate::domain::ids::{CommanderName, UnitId};
use crate::domain::link::{DirectionControl, Framing, LinkSettings, Parity};
use crate::toml_file::declare::{declare_table, list, optional, required};
use crate::toml_file::values::ValueKind;
use crate::toml_file::words::{FRAMINGS, PARITIES};
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey};
use ipnet::{IpNet, Ipv4Net};
use std::net::Ipv4Addr;
use std::time::Duration;

declare_table! {
    /// One `[[modbus_rtu]]`.
    SerialFile is "[[modbus_rtu]]" at location {
        /// The name of the serial master as the owner of control, in messages and in the audit.
        name: RequiredKey<CommanderName> = required(commander_name()) => name;
        /// The port at which the master is connected; no line and no other master may use it.
        port: RequiredKey<PortAddress> =
            required(port().listed_as("absolute path, or \"tcp://host:port\"")) => port;
        /// Speed, as set at the master.
        baud: RequiredKey<u32> = required(baud());
        /// Data bits of a character; 8 with RTU framing.
        data_bits: OptionalKey<u8> = optional(ValueKind::number(7..=8)), default 8;
        /// Parity bit of a character.
        parity: RequiredKey<Parity> = required(ValueKind::one_of(&PARITIES));
        /// Stop bits of a character.
        stop_bits: OptionalKey<u8> = optional(ValueKind::number(1..=2)), default 1;
        /// The framing that the master uses.
        framing: OptionalKey<Framing> = optional(ValueKind::one_of(&FRAMINGS)), default "rtu" => framing;
        /// What switches the direction of an RS-485 adapter, as for a line.
        direction as "rs485": OptionalKey<DirectionControl> =
            optional(ValueKind::one_of(&DIRECTION_CONTROLS)), default "adapter";
        /// Whether to ask the driver to deliver received bytes at once, if it can.
        low_latency: OptionalKey<bool> = flag(), default true => low_latency;
        /// The lines whose drives this master reaches.
        lines: ListKey<String> = list(ValueKind::text()).listed_as("list of line names"),
            without "all lines";
        /// The units that answer here, native or uniform. Any other unit gets no answer, because it may belong to another slave
        /// on the bus. 255, the gateway itself, always answers.
        units: ListKey<UnitId> = list(unit()).listed_as("list of units of its drives"),
            without "all of its lines";
        /// Whether the master may command and write, if the drive allows it with "modbus-tcp" in `from`.
        allow_write: OptionalKey<bool> = flag(), default false;
        /// Whether the master may stop. It must be true if `allow_write` is.
        allow_stop: OptionalKey<bool> = flag(), without "`allow_write`";
        /// Whether reads renew the lease of the master on the drive that it controls.
        reads_renew: OptionalKey<bool> = flag(), default false;
        /// Whether a native read of polled registers may be answered from memory, as for Modbus TCP.
        cached: OptionalKey<bool> = flag(), default false;
        /// Time from the end of a request within which an exception has been sent if the drive has not answered: 06 to a read, 0B
        /// to a write. Set it below the time-out of the master.
        answer_within: OptionalKey<Duration> = time(ms(20)..=seconds(5)), default "100ms" => answer_within;
    } fills SerialMasterSettings with |
        file, link: LinkSettings, direction: DirectionControl, serving: ListenerSettings
    | { link, direction, serving, }
}

/// The one client of a serial port, in the words of a listener: it needs no address, and comes from this host.
const HERE: IpNet = IpNet::V4(Ipv4Net::new_assert(Ipv4Addr::LOCALHOST, 32));

impl SerialFile {
    /// What it serves, in the words of a listener whose one client is this host, for rules that both have. Each key is named, so
    /// that a new one of a listener is decided on here.
    pub fn as_listener(&self) -> ListenerFile {
        ListenerFile {
            location: self.location.clone(),
            listen: None,
            allow: OptionalKey::Absent,
            lines: self.lines.clone(),
            write: as_networks(&self.allow_write),
            stop: as_networks(&self.allow_stop),
            reads_renew: self.reads_renew.clone(),
            cached: self.cached.clone(),
            units: self.units.clone(),
            connections_max: OptionalKey::Absent,
            priority: OptionalKey::Absent,
            idle_timeout: OptionalKey::Absent,
            keep_alive: OptionalKey::Absent,
            tls: OptionalKey::Absent,
        }
    }
}

/// A right of the one client as a list of networks.
fn as_networks(given: &OptionalKey<bool>) -> ListKey<IpNet> {
    match given {
        OptionalKey::Absent => OptionalKey::Absent,
        OptionalKey::Invalid => OptionalKey::Invalid,
        OptionalKey::Valid(LocatedValue { value, location }) => {
            let here = value.then(|| LocatedValue {
                value: HERE,
                location: location.clone(),
            });
            OptionalKey::Valid(LocatedValue {
                value: here.into_iter().collect(),
                location: location.clone(),
            })
        }
    }
}
