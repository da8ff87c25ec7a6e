//! The configuration as written: each value with its location, before the rules between keys.
//!
//! Each table is declared in one place, by `declare_table`: its keys with their types, valid values, defaults and purposes.

mod control;
mod drive;
mod http;
mod kinds;
mod line;
mod listener;
mod mqtt;
#[cfg(test)]
pub(super) mod reference;
mod serial;

pub(super) use control::{
    ControlFile, LimitsFile, MqttDefaults, NativeFile, SetpointLimits, on_gateway_lost,
};
pub(super) use drive::{DriveFile, DriveUnits, LineDefaults};
pub(super) use http::{HttpFile, HttpTlsFile, HttpUserFile};
pub(super) use kinds::{ListKey, RegisterValues};
pub(super) use line::LineFile;
pub(super) use listener::{ListenerFile, ListenerTlsFile, RoleFile};
pub(super) use mqtt::{HomeAssistantFile, MqttFile, SparkplugFile};
pub(super) use serial::SerialFile;

use super::ready::{GatewaySettings, JournalSettings, RemovalRule};
use super::words::{REMOVALS, of_removal};
use crate::domain::ids::Name;
use crate::domain::problem::Problem;
use crate::domain::standby::{RANK_MAX, StandbyPair};
use crate::north::titles::PartTitle;
use crate::toml_file::declare::{declare_table, each, list, optional, required};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{OptionalKey, RequiredKey, TableReader, document};
use kinds::{absolute_path, choice, minutes, name, seconds, title};
use std::path::PathBuf;
use std::time::Duration;

/// A configuration file.
#[derive(Debug)]
pub(super) struct ConfigFile {
    pub gateway: GatewayFile,
    pub journal: OptionalKey<JournalFile>,
    pub standby: OptionalKey<StandbyFile>,
    pub groups: Vec<GroupFile>,
    pub lines: Vec<LineFile>,
    pub mqtt: OptionalKey<MqttFile>,
    pub listeners: Vec<ListenerFile>,
    pub serial: Vec<SerialFile>,
    pub http: OptionalKey<HttpFile>,
    /// What the serial masters are served, in the words of a listener.
    served_masters: Vec<ListenerFile>,
}

declare_table! {
    /// `[gateway]`
    GatewayFile is "[gateway]" {
        /// The name of the gateway in messages and topics.
        name: OptionalKey<Name> = optional(name()), without "the host's name" => name;
        /// What people call the gateway.
        title: OptionalKey<PartTitle> = optional(title()), without "the name";
        /// The directory for the journal, the remembered state and the local command socket. If it is missing, `run` creates it
        /// in a directory of its own user; elsewhere the gateway says how to create it, and controls without it.
        data_dir: OptionalKey<PathBuf> = optional(absolute_path()), without "none" => data_dir;
        /// Directories with your own models (`*.toml`).
        model_dirs: ListKey<PathBuf> = list(absolute_path()).listed_as("list of absolute paths"),
            without "none";
        /// What a reload does if it would remove a drive that runs or is under control, or restart its line: refuse the reload,
        /// or stop the drive first.
        on_removal: OptionalKey<RemovalRule> = choice(&REMOVALS, of_removal),
            default "refuse" => on_removal;
    } fills GatewaySettings with |file| {}
}

declare_table! {
    /// One `[[group]]`.
    GroupFile is "[[group]]" {
        /// The name of a group of drives; unique among the groups.
        name: RequiredKey<Name> = required(name());
        /// What people call the group.
        title: RequiredKey<PartTitle> = required(title());
    }
}

declare_table! {
    /// `[journal]`
    JournalFile is "[journal]" {
        /// Maximum size of the journal file. When it is full, the oldest rows are deleted, trips last.
        max_size: OptionalKey<u64> = optional(size_in_bytes()), default "64MB" => max_bytes;
    } fills JournalSettings with |file| {}
}

declare_table! {
    /// `[standby]`
    StandbyFile is "[standby]" at location {
        /// The name of this gateway in the pair.
        half: RequiredKey<Name> = required(half()) => half;
        /// The name of the other gateway, for refusals and displays.
        partner: RequiredKey<Name> = required(half()) => partner;
        /// By how many half seconds later than rank 0 it takes a line over. The gateways of a line must have different ranks.
        rank: OptionalKey<u8> = optional(ValueKind::number(0..=RANK_MAX)), default 0 => rank;
        /// Silence of the line after which rank 0 takes it over; at least what the line needs, which `check` prints. It should be
        /// the same on both gateways.
        take_over_after: OptionalKey<Option<Duration>> = optional(take_over_after()),
            default "auto" => take_over_after;
    } fills StandbyPair with |file| {}
}

impl ConfigFile {
    /// Reads `text`, and reports every mistake of a table; `None` if it is not TOML, which is reported.
    pub fn read(text: &str, problems: &mut Vec<Problem>) -> Option<Self> {
        let document = document(text, problems)?;
        let mut reader = TableReader::new(document.section(), problems);
        let gateway = match reader.inner("gateway", GatewayFile::read) {
            OptionalKey::Valid(gateway) => gateway.value,
            OptionalKey::Absent => GatewayFile::default(),
            OptionalKey::Invalid => GatewayFile {
                model_dirs: OptionalKey::Invalid,
                ..GatewayFile::default()
            },
        };
        let journal = reader.inner("journal", JournalFile::read);
        let standby = reader.inner("standby", StandbyFile::read);
        let groups = each(&mut reader, "group", GroupFile::read);
        let lines = each(&mut reader, "line", LineFile::read);
        let mqtt = reader.inner("mqtt", MqttFile::read);
        let listeners = each(&mut reader, "modbus_tcp", ListenerFile::read);
        let serial = each(&mut reader, "modbus_rtu", SerialFile::read);
        let http = reader.inner("http", HttpFile::read);
        // A gateway that is set up in the page begins without a line.
        if lines.is_empty() && !http.valid().is_some_and(|http| http.value.sets_up()) {
            let missing = reader.location().missing("line");
            let right = "`[[line]]` with `name`, `port` and at least one `[[line.drive]]`";
            missing.refuse("there is no line", right, reader.problems());
        }
        reader.finish();
        Some(Self {
            gateway,
            journal,
            standby,
            groups,
            lines,
            mqtt,
            listeners,
            served_masters: serial.iter().map(SerialFile::as_listener).collect(),
            serial,
            http,
        })
    }

    /// All drives, line by line.
    pub fn drives(&self) -> impl Iterator<Item = &DriveFile> {
        self.lines.iter().flat_map(|line| &line.drives)
    }

    /// The control sections of all drives.
    pub fn controls(&self) -> impl Iterator<Item = &ControlFile> {
        self.drives()
            .filter_map(|drive| drive.control.valid())
            .map(|control| &control.value)
    }

    /// Everything that serves units to Modbus clients: first the listeners, then the serial masters.
    pub fn units_servers(&self) -> Vec<&ListenerFile> {
        self.listeners.iter().chain(&self.served_masters).collect()
    }
}

/// The section of `text` about the gateway itself; `None` if it is not TOML, has none, or it is no table.
pub(super) fn gateway(text: &str) -> Option<GatewayFile> {
    let mut problems = Vec::new();
    let document = document(text, &mut problems)?;
    let mut reader = TableReader::new(document.section(), &mut problems);
    match reader.inner("gateway", GatewayFile::read) {
        OptionalKey::Valid(gateway) => Some(gateway.value),
        _ => None,
    }
}

/// A size with its unit.
fn size_in_bytes() -> ValueKind<'static, u64> {
    let bytes = |text: &str| {
        let (number, unit) = text.split_at(text.find(|c: char| !c.is_ascii_digit())?);
        let unit = match unit {
            "MB" => 1_000_000,
            "GB" => 1_000_000_000,
            _ => return None,
        };
        let bytes = number.parse::<u64>().ok()?.checked_mul(unit)?;
        (1_000_000..=16_000_000_000)
            .contains(&bytes)
            .then_some(bytes)
    };
    ValueKind::parsed("a size from \"1MB\" to \"16GB\"", bytes).listed_as("\"1MB\" to \"16GB\"")
}

/// The name of a gateway in its pair. It is a part of client identifiers, which are short.
fn half() -> ValueKind<'static, Name> {
    const MOST: usize = 16;
    let right = format!("1 to {MOST} {}", Name::RULE);
    ValueKind::parsed(right, |text| {
        if text.len() <= MOST {
            Name::new(text)
        } else {
            None
        }
    })
    .listed_as(format!("name of up to {MOST} characters"))
}

fn take_over_after() -> ValueKind<'static, Option<Duration>> {
    ValueKind::duration(seconds(1)..=minutes(10)).or_word("auto")
}
