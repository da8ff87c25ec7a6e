//! The tables of serial masters: `[[modbus_rtu]]`.

use super::super::file::{ListenerFile, SerialFile};
use super::super::keys::ConfigSection;
use super::super::words::DIRECTION_CONTROLS;
use super::network::read_units;
use super::tables::refuse_not_served;
use crate::domain::ids::{CommanderName, Name};
use crate::toml_file::values::ValueKind;
use crate::toml_file::words::{FRAMINGS, PARITIES};
use crate::toml_file::{LocatedValue, OptionalKey, TableReader};
use ipnet::{IpNet, Ipv4Net};
use std::net::Ipv4Addr;
use std::ops::RangeInclusive;
use std::time::Duration;

const ANSWER_WITHIN: RangeInclusive<Duration> = Duration::from_millis(20)..=Duration::from_secs(5);
/// The one client of a serial port, in the words of a listener: it needs no address, and comes from this host.
const HERE: IpNet = IpNet::V4(Ipv4Net::new_assert(Ipv4Addr::LOCALHOST, 32));

/// One `[[modbus_rtu]]`.
pub(super) fn read_serial(mut reader: TableReader<'_, '_>) -> SerialFile {
    refuse_not_served(&mut reader, ConfigSection::ModbusRtu);
    let right = format!("1 to {} {}", CommanderName::MAX_CHARS, Name::RULE);
    let name = reader.required("name", &ValueKind::parsed(right, CommanderName::new));
    let port = super::read_port(&mut reader);
    let baud = reader.required("baud", &ValueKind::number(super::BAUD));
    let data_bits = reader.optional("data_bits", &ValueKind::number(7..=8));
    let parity = reader.required("parity", &ValueKind::one_of(&PARITIES));
    let stop_bits = reader.optional("stop_bits", &ValueKind::number(1..=2));
    let framing = reader.optional("framing", &ValueKind::one_of(&FRAMINGS));
    let direction = reader.optional("rs485", &ValueKind::one_of(&DIRECTION_CONTROLS));
    let low_latency = reader.optional("low_latency", &ValueKind::flag());
    let lines = reader.list("lines", &ValueKind::text());
    let units = read_units(&mut reader);
    let allow_write = reader.optional("allow_write", &ValueKind::flag());
    let allow_stop = reader.optional("allow_stop", &ValueKind::flag());
    let reads_renew = reader.optional("reads_renew", &ValueKind::flag());
    let cached = reader.optional("cached", &ValueKind::flag());
    let answer_within = reader.optional("answer_within", &ValueKind::duration(ANSWER_WITHIN));
    let serving = ListenerFile {
        location: reader.location().clone(),
        listen: None,
        allow: OptionalKey::Absent,
        lines,
        write: as_networks(&allow_write),
        stop: as_networks(&allow_stop),
        reads_renew,
        cached,
        units,
        connections_max: OptionalKey::Absent,
        priority: OptionalKey::Absent,
        idle_timeout: OptionalKey::Absent,
        keep_alive: OptionalKey::Absent,
        tls: OptionalKey::Absent,
    };
    let location = reader.location().clone();
    reader.finish();
    SerialFile {
        location,
        name,
        port,
        baud,
        data_bits,
        parity,
        stop_bits,
        framing,
        direction,
        low_latency,
        allow_write,
        allow_stop,
        answer_within,
        serving,
    }
}

/// A right of the one client as a list of networks.
fn as_networks(given: &OptionalKey<bool>) -> OptionalKey<Vec<LocatedValue<IpNet>>> {
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
