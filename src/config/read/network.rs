//! The tables of listeners: `[[modbus_tcp]]` and `[http]`.

use super::super::file::{
    HttpFile, HttpTlsFile, HttpUserFile, ListenerFile, ListenerTlsFile, RoleFile,
};
use super::super::keys::ConfigSection;
use super::super::ready_http::PageViewers;
use super::super::words::{ROLE_RIGHTS, ROLES, RoleRight, VIEWERS};
use super::tables::{absolute_path, each, inner, refuse_not_served, turned};
use crate::domain::ids::{CommanderName, Name, UnitId};
use crate::domain::problem::Problem;
use crate::north::modbus::ClientSlots;
use crate::north::operator::rights::UserRole;
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader};
use ipnet::IpNet;
use std::net::{IpAddr, SocketAddr};
use std::ops::RangeInclusive;
use std::time::Duration;

const CONNECTIONS: RangeInclusive<u32> = 1..=ClientSlots::MOST as u32;
const IDLE_TIMEOUT: RangeInclusive<Duration> = Duration::ZERO..=Duration::from_secs(24 * 3600);
const KEEP_ALIVE: RangeInclusive<Duration> = Duration::ZERO..=Duration::from_secs(2 * 3600);

/// One `[[modbus_tcp]]`.
pub(super) fn read_listener(mut reader: TableReader<'_, '_>) -> ListenerFile {
    refuse_not_served(&mut reader, ConfigSection::ModbusTcp);
    let listener = ListenerFile {
        location: reader.location().clone(),
        listen: reader.required("listen", &address("1502")),
        allow: read_allow(&mut reader),
        lines: reader.list("lines", &ValueKind::text()),
        write: read_networks(&mut reader, "write"),
        stop: read_networks(&mut reader, "stop"),
        reads_renew: reader.optional("reads_renew", &ValueKind::flag()),
        cached: reader.optional("cached", &ValueKind::flag()),
        units: read_units(&mut reader),
        connections_max: reader.optional("connections_max", &ValueKind::number(CONNECTIONS)),
        priority: read_networks(&mut reader, "priority"),
        idle_timeout: reader.optional("idle_timeout", &ValueKind::duration(IDLE_TIMEOUT)),
        keep_alive: reader.optional("keep_alive", &ValueKind::duration(KEEP_ALIVE)),
        tls: inner(&mut reader, "tls", read_tls),
    };
    reader.finish();
    listener
}

/// `[modbus_tcp.tls]`
fn read_tls(mut reader: TableReader<'_, '_>) -> ListenerTlsFile {
    refuse_not_served(&mut reader, ConfigSection::ModbusTls);
    let tls = ListenerTlsFile {
        cert_file: reader.required("cert_file", &absolute_path()),
        key_file: reader.required("key_file", &absolute_path()),
        client_ca_file: reader.required("client_ca_file", &absolute_path()),
        roles: read_roles(&mut reader),
    };
    reader.finish();
    tls
}

fn read_roles(reader: &mut TableReader<'_, '_>) -> RequiredKey<Vec<RoleFile>> {
    let section = reader.required_table("roles")?;
    let location = section.location.clone();
    let roles = reader
        .open(section)
        .all_lists(&ValueKind::choice(&ROLE_RIGHTS, RoleRight::meaning))
        .into_iter();
    Some(LocatedValue {
        value: roles
            .map(|(name, rights)| RoleFile { name, rights })
            .collect(),
        location,
    })
}

/// `[http]`
pub(super) fn read_http(mut reader: TableReader<'_, '_>) -> HttpFile {
    refuse_not_served(&mut reader, ConfigSection::Http);
    let http = HttpFile {
        location: reader.location().clone(),
        listen: reader.required("listen", &address("8080")),
        allow: read_allow(&mut reader),
        hosts: reader.list("hosts", &ValueKind::text()),
        view: reader.optional("view", &ValueKind::choice(&VIEWERS, PageViewers::meaning)),
        setup: reader.optional("setup", &ValueKind::flag()),
        users: each(&mut reader, "users", read_user),
        tls: inner(&mut reader, "tls", read_http_tls),
    };
    reader.finish();
    http
}

/// One `[[http.users]]`.
fn read_user(mut reader: TableReader<'_, '_>) -> HttpUserFile {
    refuse_not_served(&mut reader, ConfigSection::HttpUser);
    let right = format!("1 to {} {}", CommanderName::MAX_CHARS, Name::RULE);
    let user = HttpUserFile {
        location: reader.location().clone(),
        name: reader.required("name", &ValueKind::parsed(right, CommanderName::new)),
        password_hash: reader.optional("password_hash", &ValueKind::text()),
        password_hash_file: reader.optional("password_hash_file", &absolute_path()),
        role: reader.optional("role", &ValueKind::choice(&ROLES, UserRole::meaning)),
        groups: reader.list("groups", &super::name_kind()),
    };
    reader.finish();
    user
}

/// `[http.tls]`
fn read_http_tls(mut reader: TableReader<'_, '_>) -> HttpTlsFile {
    refuse_not_served(&mut reader, ConfigSection::HttpTls);
    let tls = HttpTlsFile {
        cert_file: reader.required("cert_file", &absolute_path()),
        key_file: reader.required("key_file", &absolute_path()),
    };
    reader.finish();
    tls
}

/// An address with a port; `port` is used in the examples.
fn address(port: &str) -> ValueKind<'static, SocketAddr> {
    let right = format!("an address with a port: \"127.0.0.1:{port}\", \"[::1]:{port}\"");
    ValueKind::parsed(right, |text| text.parse().ok())
}

fn read_allow(reader: &mut TableReader<'_, '_>) -> OptionalKey<Vec<IpNet>> {
    let list = match read_networks(reader, "allow") {
        OptionalKey::Absent => return OptionalKey::Absent,
        OptionalKey::Invalid => return OptionalKey::Invalid,
        OptionalKey::Valid(list) => list,
    };
    if list.value.is_empty() {
        let problem = list.location.problem("an empty list allows no client");
        reader
            .problems()
            .push(problem.right("networks as \"10.0.0.0/24\", or no listener at all"));
        return OptionalKey::Invalid;
    }
    let value = list
        .value
        .into_iter()
        .map(|network| network.value)
        .collect();
    OptionalKey::Valid(LocatedValue {
        value,
        location: list.location,
    })
}

/// Every number of this kind is a valid unit.
pub(super) fn read_units(
    reader: &mut TableReader<'_, '_>,
) -> OptionalKey<Vec<LocatedValue<UnitId>>> {
    turned(
        reader.list("units", &ValueKind::number(UnitId::MIN..=UnitId::MAX)),
        |units| {
            let unit = |it: LocatedValue<u8>| {
                Some(LocatedValue {
                    value: UnitId::new(it.value)?,
                    location: it.location,
                })
            };
            units.into_iter().map(unit).collect()
        },
    )
}

/// The list of networks `key`; one invalid network makes it unusable.
fn read_networks(
    reader: &mut TableReader<'_, '_>,
    key: &'static str,
) -> OptionalKey<Vec<LocatedValue<IpNet>>> {
    let list = match reader.list(key, &ValueKind::text()) {
        OptionalKey::Absent => return OptionalKey::Absent,
        OptionalKey::Invalid => return OptionalKey::Invalid,
        OptionalKey::Valid(list) => list,
    };
    let networks: Vec<_> = list
        .value
        .into_iter()
        .map(|it| network(it, reader.problems()))
        .collect();
    match networks.into_iter().collect() {
        Some(value) => OptionalKey::Valid(LocatedValue {
            value,
            location: list.location,
        }),
        None => OptionalKey::Invalid,
    }
}

/// A network in the notation address/bits. Host bits must be zero, because otherwise it may mean the network or
/// the single host.
fn network(
    written: LocatedValue<String>,
    problems: &mut Vec<Problem>,
) -> Option<LocatedValue<IpNet>> {
    let LocatedValue {
        value: text,
        location,
    } = written;
    let (what, right) = match (text.parse::<IpNet>(), text.parse::<IpAddr>()) {
        (Ok(network), _) if network.trunc() == network => {
            return Some(LocatedValue {
                value: network,
                location,
            });
        }
        (Ok(network), _) => {
            let host = IpNet::from(network.addr());
            (
                "is a host inside a network",
                format!(
                    "\"{}\" for the network, \"{host}\" for the host",
                    network.trunc()
                ),
            )
        }
        (_, Ok(host)) => (
            "has no length",
            format!("\"{}\" for this one host", IpNet::from(host)),
        ),
        _ => (
            "is no network",
            "an address and its length: \"10.0.0.0/24\", \"fd00::/64\"".to_owned(),
        ),
    };
    problems.push(location.problem(format!("`{text}` {what}")).right(right));
    None
}
