//! The configuration as it is written: each value with its place, nothing filled in, nothing compared.

use super::ready::Silence;
use crate::domain::ids::{Name, Station, UnitId};
use crate::domain::link::{Framing, Interface, Parity};
use crate::profile::reader::{Given, Needed, Place, Written};
use crate::profile::register::RegisterFile;
use ipnet::IpNet;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// The whole file.
#[derive(Debug)]
pub(super) struct File {
    pub name: Given<Name>,
    pub lines: Vec<LineFile>,
    pub listeners: Vec<ListenerFile>,
}

/// One `[[line]]`.
#[derive(Debug)]
pub(super) struct LineFile {
    pub place: Place,
    pub name: Needed<Name>,
    pub port: Needed<PathBuf>,
    pub baud: Given<u32>,
    pub data_bits: Given<u8>,
    pub parity: Given<Parity>,
    pub stop_bits: Given<u8>,
    pub framing: Given<Framing>,
    pub interface: Given<Interface>,
    pub silence: Given<Silence>,
    pub min_request_gap: Given<Duration>,
    pub reply_timeout: Given<Option<Duration>>,
    pub drives: Vec<DriveFile>,
}

/// One `[[line.drive]]`.
#[derive(Debug)]
pub(super) struct DriveFile {
    pub place: Place,
    pub name: Needed<Name>,
    pub model: Needed<String>,
    pub station: Needed<Station>,
    pub unit: Given<UnitId>,
    pub poll: Given<Duration>,
    pub reply_timeout: Given<Option<Duration>>,
    pub max_lateness: Given<Duration>,
    pub registers: Vec<RegisterFile>,
}

impl DriveFile {
    /// The drive as a message calls it: by its name, or by its place while it has none.
    pub fn label(&self) -> String {
        match &self.name {
            Some(name) => format!("drive `{}`", name.value),
            None => format!("the drive at {}", self.place.key),
        }
    }
}

/// One `[[modbus_tcp]]`.
#[derive(Debug)]
pub(super) struct ListenerFile {
    pub place: Place,
    pub listen: Needed<SocketAddr>,
    pub allow: Given<Vec<IpNet>>,
    pub lines: Given<Vec<Written<String>>>,
}

impl ListenerFile {
    /// The listener as a message calls it: by its address, or by its place while it has none.
    pub fn label(&self) -> String {
        match &self.listen {
            Some(listen) => format!("the listener {}", listen.value),
            None => format!("the listener at {}", self.place.key),
        }
    }
}
