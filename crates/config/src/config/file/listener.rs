//! The tables of a Modbus TCP listener: `[[modbus_tcp]]` and `[modbus_tcp.tls]`.

use super::super::lists;
use super::super::ready::{ListenerSettings, ListenerTls};
use super::super::words::{ROLE_RIGHTS, RoleRight, of_right};
use super::kinds::{ListKey, absolute_path, address, flag, hours, network, unit};
use crate::domain::command::Rights;
use crate::domain::ids::UnitId;
use crate::north::modbus::{ClientSlots, ConnectionLimits};
use crate::toml_file::declare::{
    KeyForm, RefusedKey, declare_table, list, optional, required, table,
};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader};
use ipnet::IpNet;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

declare_table! {
    /// One `[[modbus_tcp]]`.
    ListenerFile is "[[modbus_tcp]]" at location, refuses LEASE {
        /// Where clients connect.
        listen: RequiredKey<SocketAddr> = required(address("1502")) => listen;
        /// Who may connect.
        allow: OptionalKey<Vec<IpNet>> = allow(),
            without "all clients, which are on this host: required unless the address is loopback" => allow;
        /// The lines whose drives this listener serves.
        lines: ListKey<String> = list(ValueKind::text()).listed_as("list of line names"),
            without "all lines";
        /// Who may command and write, if the drive allows it.
        write: ListKey<IpNet> = list(network()).listed_as("list of networks inside `allow`"),
            without "[]: no client; with `tls` every client that may connect, according to its role";
        /// Who may stop. It must include every network in `write`.
        stop: ListKey<IpNet> = list(network()).listed_as("list of networks inside `allow`"),
            without "`write`";
        /// Whether reads renew the lease of the client that controls a drive.
        reads_renew: OptionalKey<bool> = flag(), default false => reads_renew;
        /// Whether a native read of polled registers may be answered from memory, with words of one reply that are no older than
        /// their poll period and than the last order for the drive.
        cached: OptionalKey<bool> = flag(), default false => cached;
        /// The units that this listener serves, native or uniform. 255, the gateway itself, is always served.
        units: ListKey<UnitId> = list(unit()).listed_as("list of units of its drives"),
            without "all of its lines";
        /// Maximum number of clients, without those with `priority`. One more replaces the client that was idle longest.
        connections_max: OptionalKey<usize> = optional(connections()),
            without "10,240 for all listeners, or fewer if the limit of open files is lower" => connections_max;
        /// Clients whose connections are never closed for others, and for which some connections are reserved.
        priority: ListKey<IpNet> = list(network()).listed_as("list of networks inside `allow`"),
            without "[]: no client";
        /// A connection without a request is closed after this time.
        idle_timeout: OptionalKey<Duration> = optional(idle_timeout()),
            constant ConnectionLimits::IDLE_TIMEOUT;
        /// Interval of TCP keep-alive probes on an idle connection. A vanished client is noticed within twice that.
        keep_alive: OptionalKey<Duration> = optional(keep_alive()), default "60s";
        /// Modbus Security: TLS with certificates on both sides. A client without a valid certificate is refused.
        tls: OptionalKey<ListenerTlsFile> = table(ListenerTlsFile::read),
            without "none: connections are not encrypted";
    } fills ListenerSettings with |
        file, lines: Option<Vec<usize>>, write: Vec<IpNet>, tls: Option<ListenerTls>
    | {
        stop: lists::some_values(&file.stop)?,
        units: lists::some_values(&file.units)?,
        priority: lists::values(&file.priority)?,
        idle_timeout: Some(file.idle_timeout()?).filter(|time| !time.is_zero()),
        keep_alive: Some(file.keep_alive()?).filter(|time| !time.is_zero()),
        lines, write, tls,
    }
}

declare_table! {
    /// `[modbus_tcp.tls]`
    ListenerTlsFile is "[modbus_tcp.tls]" {
        /// The certificate of the gateway, with its intermediate certificates.
        cert_file: RequiredKey<PathBuf> = required(absolute_path()) => cert_file;
        /// The key of that certificate.
        key_file: RequiredKey<PathBuf> = required(absolute_path()) => key_file;
        /// The certificate authorities of the clients. Other clients are refused.
        client_ca_file: RequiredKey<PathBuf> = required(absolute_path()) => client_ca_file;
        /// What each role may do besides reading. A role that is not listed may do nothing but read. "" is the role of
        /// certificates without one.
        roles: RequiredKey<Vec<RoleFile>> = roles();
    } fills ListenerTls with |file| {
        roles: file.roles.as_ref()?.value.iter().map(|role| (role.name.clone(), role.settled())).collect(),
    }
}

const LEASE: &[RefusedKey] = &[RefusedKey {
    name: "lease",
    what: None,
    instead: "leave it out; leases of Modbus TCP are explicit: commands and `renew` keep them, and reads with `reads_renew`",
}];

/// A role and its rights.
#[derive(Clone, Debug)]
pub struct RoleFile {
    pub name: String,
    pub rights: LocatedValue<Vec<LocatedValue<RoleRight>>>,
}

impl RoleFile {
    /// Whether the role has `right`.
    pub fn has(&self, right: RoleRight) -> bool {
        lists::has(&self.rights.value, &right)
    }

    fn settled(&self) -> Rights {
        Rights {
            write: self.has(RoleRight::Write),
            stop: self.has(RoleRight::Stop),
        }
    }
}

impl ListenerFile {
    /// The listener's label in messages: its address, or its location if it has none, as a serial master.
    pub fn label(&self) -> String {
        match &self.listen {
            Some(listen) => format!("the listener {}", listen.value),
            None => format!("the listener at {}", self.location.key),
        }
    }
}

fn connections() -> ValueKind<'static, usize> {
    ValueKind::number(1..=ClientSlots::MOST as u32).map(|most| most as usize)
}

/// `listen` refuses times above 0 and below 1 s.
fn idle_timeout() -> ValueKind<'static, Duration> {
    ValueKind::duration(Duration::ZERO..=hours(24))
        .listed_as("\"1s\" to \"24h\", or \"0s\" for none")
}

/// `listen` refuses times above 0 and below 1 s.
fn keep_alive() -> ValueKind<'static, Duration> {
    ValueKind::duration(Duration::ZERO..=hours(2))
        .listed_as("\"1s\" to \"2h\", whole seconds, or \"0s\" for none")
}

fn roles() -> KeyForm<'static, RequiredKey<Vec<RoleFile>>> {
    KeyForm::new("table: role = list of \"write\", \"stop\"", read_roles)
}

fn read_roles(reader: &mut TableReader<'_, '_>, key: &'static str) -> RequiredKey<Vec<RoleFile>> {
    let section = reader.required_table(key)?;
    let location = section.location.clone();
    let roles = reader
        .open(section)
        .all_lists(&ValueKind::choice(&ROLE_RIGHTS, of_right))
        .into_iter();
    Some(LocatedValue {
        value: roles
            .map(|(name, rights)| RoleFile { name, rights })
            .collect(),
        location,
    })
}

/// The networks from which clients may connect: at least one.
pub fn allow() -> KeyForm<'static, OptionalKey<Vec<IpNet>>> {
    KeyForm::new("list of networks", read_allow)
}

fn read_allow(reader: &mut TableReader<'_, '_>, key: &'static str) -> OptionalKey<Vec<IpNet>> {
    let list = match reader.list(key, &network()) {
        OptionalKey::Absent => return OptionalKey::Absent,
        OptionalKey::Invalid => return OptionalKey::Invalid,
        OptionalKey::Valid(list) => list,
    };
    if list.value.is_empty() {
        let right = "networks as \"10.0.0.0/24\", or no listener at all";
        list.refuse("an empty list allows no client", right, reader.problems());
        return OptionalKey::Invalid;
    }
    let networks = list.value.into_iter().map(|network| network.value);
    OptionalKey::Valid(LocatedValue {
        value: networks.collect(),
        location: list.location,
    })
}
