//! The tables of the HTTP listener: `[http]`, `[[http.users]]` and `[http.tls]`.

use super::super::lists;
use super::super::ready::{HashSource, HttpSettings, HttpTls, PageViewers, UserSettings};
use super::super::words::{ROLES, VIEWERS, of_viewers};
use super::kinds::{ListKey, absolute_path, address, choice, commander_name, flag, name};
use super::listener::allow;
use crate::domain::ids::{CommanderName, Name};
use crate::north::operator::rights::{UserRights, UserRole};
use crate::toml_file::declare::{declare_table, list, optional, required, table, tables};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{OptionalKey, RequiredKey};
use ipnet::IpNet;
use std::net::SocketAddr;
use std::path::PathBuf;

declare_table! {
    /// `[http]`
    HttpFile is "[http]" at location {
        /// Where the page, /metrics, /healthz and /readyz are served.
        listen: RequiredKey<SocketAddr> = required(address("8080")) => listen;
        /// Who may connect and see everything.
        allow: OptionalKey<Vec<IpNet>> = allow(),
            without "all clients, which are on this host: required unless the address is loopback" => allow;
        /// Additional host names for the gateway in browsers, without a port. IP addresses are always accepted.
        hosts: ListKey<String> = list(ValueKind::text()).listed_as("list of host names"),
            without "none but the host's own and `localhost`";
        /// Who sees the drives on the page and below `/api/v1/`: every client in `allow`, or users who have signed in.
        /// `/healthz`, `/readyz` and `/metrics` stay open to `allow`.
        view: OptionalKey<PageViewers> = choice(&VIEWERS, of_viewers), default "anyone" => view;
        /// Users with the role "setup" find drives and add lines in the page, which changes this file.
        setup: OptionalKey<bool> = flag(), default false => setup;
        /// Who may sign in and command. Requires `tls` unless the address is loopback.
        users: Vec<HttpUserFile> = tables(HttpUserFile::read),
            without "none: no commands from the page";
        /// HTTPS instead of HTTP.
        tls: OptionalKey<HttpTlsFile> = table(HttpTlsFile::read),
            without "none: connections are not encrypted";
    } fills HttpSettings with |file, hosts: Vec<String>, users: Vec<UserSettings>, tls: Option<HttpTls>| {
        hosts, users, tls,
    }
}

declare_table! {
    /// One `[[http.users]]`.
    HttpUserFile is "[[http.users]]" at location {
        /// The name of the user, also in the audit.
        name: RequiredKey<CommanderName> = required(commander_name()) => name;
        /// The password as `vfd-gateway password` prints it.
        password_hash: OptionalKey<String> = optional(ValueKind::text().listed_as("argon2id hash")),
            without "`password_hash_file`";
        /// The file with this text. One of the two is required.
        password_hash_file: OptionalKey<PathBuf> = optional(absolute_path()),
            without "`password_hash`";
        /// What the user may do: look; command drives; everything that a plant in service needs, as saving diagnostics; or, with
        /// `setup = true`, change the configuration as well.
        role: OptionalKey<UserRole> = choice(&ROLES, UserRole::meaning), default "maintain";
        /// The groups whose drives the user may command. A stop works for all drives.
        groups: ListKey<Name> = list(name()).listed_as("list of groups of drives"), without "all drives";
    } fills UserSettings with |file, hash: HashSource| {
        rights: UserRights {
            role: file.role()?,
            groups: lists::some_values(&file.groups)?.map(|groups| groups.into_iter().collect()),
        },
        hash,
    }
}

declare_table! {
    /// `[http.tls]`
    HttpTlsFile is "[http.tls]" {
        /// The certificate of the gateway, with its intermediate certificates.
        cert_file: RequiredKey<PathBuf> = required(absolute_path()) => cert_file;
        /// The key of that certificate.
        key_file: RequiredKey<PathBuf> = required(absolute_path()) => key_file;
    } fills HttpTls with |file| {}
}

impl HttpFile {
    /// Whether the configuration is changed in the page.
    pub fn sets_up(&self) -> bool {
        self.setup.valid_as(&true).is_some()
    }
}
