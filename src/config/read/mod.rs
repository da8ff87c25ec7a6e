//! Reads the TOML from the outer tables to the inner ones, each value with its location.

mod control;
mod mqtt;
mod network;
mod serial;
mod tables;

use super::file::{ConfigFile, DriveFile, GatewayFile, JournalFile, LineFile, StandbyFile};
use super::ready::{LineSilence, PortAddress};
use super::words::{DIRECTION_CONTROLS, REMOVALS, of_removal};
use super::{keys, port};
use crate::domain::ids::{Name, Station, UnitId};
use crate::domain::problem::Problem;
use crate::domain::standby::RANK_MAX;
use crate::profile::register::{RegisterFile, extra_register};
use crate::toml_file::values::ValueKind;
use crate::toml_file::words::{ECHO_POLICIES, FRAMINGS, INTERFACES, PARITIES};
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader, document};
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Duration;
use tables::{absolute_path, each, inner, refuse_not_served, turned};

const BAUD: RangeInclusive<u32> = 300..=4_000_000;
const SILENCE: RangeInclusive<Duration> = Duration::ZERO..=Duration::from_secs(1);
const REQUEST_GAP: RangeInclusive<Duration> = Duration::ZERO..=Duration::from_secs(10);
const REPLY_TIMEOUT: RangeInclusive<Duration> = Duration::from_millis(1)..=Duration::from_secs(60);
const MAX_LATENESS: RangeInclusive<Duration> = Duration::from_millis(10)..=Duration::from_secs(60);
const STATUS_AGE: RangeInclusive<Duration> = Duration::from_millis(100)..=Duration::from_secs(3600);
/// Longest name of a gateway in its pair.
const HALF_CHARS: usize = 16;
const TAKE_OVER: RangeInclusive<Duration> = Duration::from_secs(1)..=Duration::from_secs(600);
/// Range of a dead band: no register has finer steps or larger values.
const DEAD_BAND: RangeInclusive<f64> = 0.000_001..=100_000.0;
/// Range of decimals; no register has more.
const DECIMALS: RangeInclusive<u8> = 0..=9;
/// A rated current in A or voltage in V.
const RATED: RangeInclusive<f64> = 0.001..=100_000.0;
const JOURNAL_BYTES: RangeInclusive<u64> = 1_000_000..=16_000_000_000;
const POLL: RangeInclusive<Duration> = Duration::from_millis(10)..=Duration::from_secs(3600);

/// The configuration as written; `None` if `text` is not TOML, which is reported in `problems`.
pub(super) fn read(text: &str, problems: &mut Vec<Problem>) -> Option<ConfigFile> {
    let document = document(text, problems)?;
    let mut reader = TableReader::new(document.section(), problems);
    refuse_not_served(&mut reader, keys::ConfigSection::Root);
    let gateway = match inner(&mut reader, "gateway", read_gateway) {
        OptionalKey::Valid(gateway) => gateway.value,
        OptionalKey::Absent => GatewayFile::LEFT_OUT,
        OptionalKey::Invalid => GatewayFile {
            model_dirs: OptionalKey::Invalid,
            ..GatewayFile::LEFT_OUT
        },
    };
    let file = ConfigFile {
        gateway,
        journal: inner(&mut reader, "journal", read_journal),
        standby: inner(&mut reader, "standby", read_standby),
        lines: each(&mut reader, "line", read_line),
        mqtt: inner(&mut reader, "mqtt", mqtt::read_mqtt),
        listeners: each(&mut reader, "modbus_tcp", network::read_listener),
        serial: each(&mut reader, "modbus_rtu", serial::read_serial),
        http: inner(&mut reader, "http", network::read_http),
    };
    // A gateway that is set up in the page begins without a line.
    if file.lines.is_empty() && !file.http.valid().is_some_and(|http| http.value.sets_up()) {
        let problem = reader
            .location()
            .missing("line")
            .problem("there is no line");
        reader.problems().push(
            problem.right("`[[line]]` with `name`, `port` and at least one `[[line.drive]]`"),
        );
    }
    reader.finish();
    Some(file)
}

fn read_gateway(mut reader: TableReader<'_, '_>) -> GatewayFile {
    refuse_not_served(&mut reader, keys::ConfigSection::Gateway);
    let gateway = GatewayFile {
        name: reader.optional("name", &name_kind()),
        data_dir: reader.optional("data_dir", &absolute_path()),
        model_dirs: reader.list("model_dirs", &absolute_path()),
        on_removal: reader.optional("on_removal", &ValueKind::choice(&REMOVALS, of_removal)),
    };
    reader.finish();
    gateway
}

fn read_journal(mut reader: TableReader<'_, '_>) -> JournalFile {
    refuse_not_served(&mut reader, keys::ConfigSection::Journal);
    let size = ValueKind::parsed("a size from \"1MB\" to \"16GB\"", size_bytes);
    let journal = JournalFile {
        location: reader.location().clone(),
        max_size: reader.optional("max_size", &size),
    };
    reader.finish();
    journal
}

fn read_standby(mut reader: TableReader<'_, '_>) -> StandbyFile {
    refuse_not_served(&mut reader, keys::ConfigSection::Standby);
    let standby = StandbyFile {
        location: reader.location().clone(),
        half: reader.required("half", &half_kind()),
        partner: reader.required("partner", &half_kind()),
        rank: reader.optional("rank", &ValueKind::number(0..=RANK_MAX)),
        take_over_after: reader.optional(
            "take_over_after",
            &ValueKind::duration(TAKE_OVER).or_word("auto"),
        ),
    };
    reader.finish();
    standby
}

/// A size with its unit, in bytes, if it is valid for a journal.
fn size_bytes(text: &str) -> Option<u64> {
    let (number, unit) = text.split_at(text.find(|c: char| !c.is_ascii_digit())?);
    let unit = match unit {
        "MB" => 1_000_000,
        "GB" => 1_000_000_000,
        _ => return None,
    };
    let bytes = number.parse::<u64>().ok()?.checked_mul(unit)?;
    JOURNAL_BYTES.contains(&bytes).then_some(bytes)
}

/// The directories of `text` that hold models; empty if it is not TOML, or if one of them is invalid.
pub(super) fn model_dirs(text: &str) -> Vec<LocatedValue<PathBuf>> {
    match gateway(text) {
        Some(GatewayFile {
            model_dirs: OptionalKey::Valid(dirs),
            ..
        }) => dirs.value,
        _ => Vec::new(),
    }
}

/// The data directory of `text`; `None` if it is not TOML, or names none or an invalid one.
pub(super) fn data_dir(text: &str) -> Option<PathBuf> {
    gateway(text)?.data_dir.valid().map(|dir| dir.value.clone())
}

/// The section of `text` about the gateway itself.
fn gateway(text: &str) -> Option<GatewayFile> {
    let mut problems = Vec::new();
    let document = document(text, &mut problems)?;
    let mut reader = TableReader::new(document.section(), &mut problems);
    match inner(&mut reader, "gateway", read_gateway) {
        OptionalKey::Valid(gateway) => Some(gateway.value),
        _ => None,
    }
}

fn read_line(mut reader: TableReader<'_, '_>) -> LineFile {
    refuse_not_served(&mut reader, keys::ConfigSection::Line);
    let line = LineFile {
        location: reader.location().clone(),
        name: reader.required("name", &name_kind()),
        port: read_port(&mut reader),
        baud: reader.optional("baud", &ValueKind::number(BAUD)),
        data_bits: reader.optional("data_bits", &ValueKind::number(7..=8)),
        parity: reader.optional("parity", &ValueKind::one_of(&PARITIES)),
        stop_bits: reader.optional("stop_bits", &ValueKind::number(1..=2)),
        framing: reader.optional("framing", &ValueKind::one_of(&FRAMINGS)),
        interface: reader.optional("interface", &ValueKind::one_of(&INTERFACES)),
        echo: reader.optional("echo", &ValueKind::one_of(&ECHO_POLICIES)),
        direction: reader.optional("rs485", &ValueKind::one_of(&DIRECTION_CONTROLS)),
        low_latency: reader.optional("low_latency", &ValueKind::flag()),
        silence: read_silence(&mut reader),
        min_request_gap: reader.optional("min_request_gap", &ValueKind::duration(REQUEST_GAP)),
        reply_timeout: reader.optional(
            "reply_timeout",
            &ValueKind::duration(REPLY_TIMEOUT).or_word("auto"),
        ),
        max_status_age: reader.optional("max_status_age", &ValueKind::duration(STATUS_AGE)),
        standby: reader.optional("standby", &ValueKind::flag()),
        drives: each(&mut reader, "drive", read_drive),
    };
    if line.drives.is_empty() {
        let problem = line
            .location
            .missing("drive")
            .problem("the line has no drive");
        reader
            .problems()
            .push(problem.right("`[[line.drive]]` with `name`, `model` and `station`"));
    }
    reader.finish();
    line
}

fn read_drive(mut reader: TableReader<'_, '_>) -> DriveFile {
    refuse_not_served(&mut reader, keys::ConfigSection::Drive);
    let drive = DriveFile {
        location: reader.location().clone(),
        name: reader.required("name", &name_kind()),
        model: reader.required("model", &ValueKind::text()),
        station: read_station(&mut reader),
        unit: read_unit(&mut reader, "unit"),
        uniform_unit: read_unit(&mut reader, "uniform_unit"),
        group: reader.optional("group", &name_kind()),
        poll: reader.optional("poll", &ValueKind::duration(POLL)),
        reply_timeout: reader.optional(
            "reply_timeout",
            &ValueKind::duration(REPLY_TIMEOUT).or_word("auto"),
        ),
        max_lateness: reader.optional("max_lateness", &ValueKind::duration(MAX_LATENESS)),
        rated_current: read_rated(&mut reader, "rated_current_a"),
        rated_voltage: read_rated(&mut reader, "rated_voltage_v"),
        full_scale: read_rated(&mut reader, "full_scale_hz"),
        registers: read_registers(&mut reader),
        dead_bands: inner(&mut reader, "dead_bands", |reader| {
            reader.all(&ValueKind::decimal(DEAD_BAND))
        }),
        heartbeats: inner(&mut reader, "heartbeats", |reader| {
            reader.all(&ValueKind::duration(mqtt::HEARTBEAT))
        }),
        decimals: inner(&mut reader, "decimals", |reader| {
            reader.all(&ValueKind::number(DECIMALS))
        }),
        control: inner(&mut reader, "control", control::read_control),
        native: inner(&mut reader, "native", control::read_native),
    };
    reader.finish();
    drive
}

fn read_registers(reader: &mut TableReader<'_, '_>) -> Vec<RegisterFile> {
    let sections = reader.tables("register");
    sections
        .into_iter()
        .map(|section| extra_register(section, reader.problems()))
        .collect()
}

fn name_kind() -> ValueKind<'static, Name> {
    let right = format!("1 to {} {}", Name::MAX_CHARS, Name::RULE);
    ValueKind::parsed(right, Name::new)
}

/// The name of a gateway in its pair. It is a part of client identifiers, which are short.
fn half_kind() -> ValueKind<'static, Name> {
    let right = format!("1 to {HALF_CHARS} {}", Name::RULE);
    ValueKind::parsed(right, |text| {
        if text.len() <= HALF_CHARS {
            Name::new(text)
        } else {
            None
        }
    })
}

fn read_silence(reader: &mut TableReader<'_, '_>) -> OptionalKey<LineSilence> {
    let silence = reader.optional("silence", &ValueKind::duration(SILENCE).or_word("auto"));
    turned(silence, |fixed| {
        Some(fixed.map_or(LineSilence::Auto, LineSilence::Fixed))
    })
}

fn read_station(reader: &mut TableReader<'_, '_>) -> RequiredKey<Station> {
    let LocatedValue { value, location } =
        reader.required("station", &ValueKind::number(0..=u8::MAX))?;
    Some(LocatedValue {
        value: Station(value),
        location,
    })
}

fn read_unit(reader: &mut TableReader<'_, '_>, key: &'static str) -> OptionalKey<UnitId> {
    turned(
        reader.optional(key, &ValueKind::number(UnitId::MIN..=UnitId::MAX)),
        UnitId::new,
    )
}

/// A rated value in thousandths.
fn read_rated(reader: &mut TableReader<'_, '_>, key: &'static str) -> OptionalKey<u32> {
    let LocatedValue { value, location } = match reader.optional(key, &ValueKind::decimal(RATED)) {
        OptionalKey::Absent => return OptionalKey::Absent,
        OptionalKey::Invalid => return OptionalKey::Invalid,
        OptionalKey::Valid(written) => written,
    };
    let thousandths = (value * 1000.0).round();
    if thousandths / 1000.0 != value {
        reader.problems().push(
            location
                .problem(format!("{value} is finer than 0.001"))
                .right("at most three decimals"),
        );
        return OptionalKey::Invalid;
    }
    OptionalKey::Valid(LocatedValue {
        value: thousandths as u32,
        location,
    })
}

fn read_port(reader: &mut TableReader<'_, '_>) -> RequiredKey<PortAddress> {
    let written = reader.required("port", &ValueKind::text())?;
    match port::parse(&written.value) {
        Ok(value) => Some(LocatedValue {
            value,
            location: written.location,
        }),
        Err((what, right)) => {
            reader
                .problems()
                .push(written.location.problem(what).right(right));
            None
        }
    }
}
