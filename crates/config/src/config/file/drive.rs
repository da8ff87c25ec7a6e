//! The table of a drive: `[[line.drive]]`. Its inner tables for commands and writes are in [`super::control`].

use super::super::ready::DriveSettings;
use super::control::{ControlFile, NativeFile};
use super::kinds::{
    RegisterValues, hours, minutes, ms, name, of_registers, reply_timeout, time, title, unit,
};
use super::mqtt::heartbeat;
use crate::domain::control::ControlSettings;
use crate::domain::ids::{Name, Station, UnitId};
use crate::domain::link::Framing;
use crate::drive::description::{DriveRatings, PointSettings};
use crate::north::titles::PartTitle;
use crate::profile::model::Model;
use crate::profile::register::{RegisterFile, extra_register};
use crate::toml_file::declare::{KeyForm, RefusedKey, declare_table, optional, required, table};
use crate::toml_file::values::{ValueKind, WrongValue};
use crate::toml_file::{OptionalKey, RequiredKey, TableReader};
use std::sync::Arc;
use std::time::Duration;

declare_table! {
    /// One `[[line.drive]]`.
    DriveFile is "[[line.drive]]" at location, refuses NOT_SERVED {
        /// The name of the drive; unique in the gateway.
        name: RequiredKey<Name> = required(name()) => name;
        /// What people call the drive, or what it moves.
        title: OptionalKey<PartTitle> = optional(title()), without "the name";
        /// The drive model.
        model: RequiredKey<String> = required(ValueKind::text().listed_as("identifier of a model"));
        /// The station number set on the drive, on `modbus-tcp://` its unit; unique on the line.
        station: RequiredKey<Station> = required(station()) => station;
        /// The unit at which Modbus TCP clients reach the drive's own registers.
        unit: OptionalKey<UnitId> = optional(unit()),
            without "the station, where a listener serves one line only";
        /// The unit at which they reach the uniform registers, the same for all models.
        uniform_unit: OptionalKey<UnitId> = optional(unit()), without "`unit` + 100";
        /// The group in which the page shows the drive, across lines: a machine or a hall.
        group: OptionalKey<Name> = optional(name()), without "none" => group;
        /// Period of the fast polls. Slow polls have four times that period.
        poll: OptionalKey<Duration> = time(ms(10)..=hours(1)), default "500ms" => poll;
        /// Maximum wait for a reply of this drive.
        reply_timeout: OptionalKey<Option<Duration>> = optional(reply_timeout()), without "the line's";
        /// How long after a time-out a late reply may still arrive. Without effect on `modbus-tcp://`.
        max_lateness: OptionalKey<Duration> = time(ms(10)..=minutes(1)),
            without "the model's; on `tcp://` at least \"3s\"";
        /// Rated current, for models that report the current as a percentage of it.
        rated_current as "rated_current_a": OptionalKey<u32> = optional(thousandths("A")),
            without "shown in per cent";
        /// Rated voltage, for models that report the voltage as a percentage of it.
        rated_voltage as "rated_voltage_v": OptionalKey<u32> = optional(thousandths("V")),
            without "shown in per cent";
        /// The frequency of which setpoint and output frequency are fractions, as set at the drive, for models that cannot read
        /// it.
        full_scale as "full_scale_hz": OptionalKey<u32> = optional(thousandths("Hz")),
            without "none: required where the model says so";
        /// Registers that the model does not list, declared by the operator.
        registers as "register": Vec<RegisterFile> = registers(), without "none";
        /// Smaller changes, in the register's unit, are not published over MQTT before the heartbeat.
        dead_bands: RegisterValues<f64> = of_registers(dead_band()), without "none";
        /// Interval after which an unchanged value is published again, on its own topic.
        heartbeats: RegisterValues<Duration> = of_registers(heartbeat()),
            without "`heartbeat` of `[mqtt]`";
        /// Decimals of the values published over MQTT. Values are rounded, but never to zero.
        decimals: RegisterValues<u8> = of_registers(decimals()),
            without "all that the register has";
        /// Who may command the drive, which commands, and what happens when the commander vanishes.
        control: OptionalKey<ControlFile> = table(ControlFile::read),
            without "read-only from everywhere";
        /// Native registers that may be written; needs `control`.
        native: OptionalKey<NativeFile> = table(NativeFile::read), without "none";
    } fills DriveSettings with |
        file, model: Arc<Model>, units: DriveUnits, line: &LineDefaults,
        control: Option<Arc<ControlSettings>>, ratings: DriveRatings, points: PointSettings
    | {
        unit: units.native?,
        uniform_unit: units.uniform?,
        reply_timeout: file.reply_timeout.or(line.reply_timeout)?,
        max_lateness: file.max_lateness.or(model.timing.max_lateness.value.max(line.max_lateness))?,
        model, control, ratings, points,
    }
}

/// The units of one drive; for each `None` there is a problem.
#[derive(Clone, Copy, Debug, Default)]
pub struct DriveUnits {
    /// The unit of its own registers.
    pub native: Option<UnitId>,
    /// The unit of its uniform registers.
    pub uniform: Option<UnitId>,
}

/// Defaults that drives take from their line.
pub struct LineDefaults {
    pub framing: Framing,
    /// Reply time-out for drives without their own.
    pub reply_timeout: Option<Duration>,
    /// Minimum lateness for drives without their own setting.
    pub max_lateness: Duration,
}

const NOT_SERVED: &[RefusedKey] = &[
    RefusedKey {
        name: "interlocks",
        what: None,
        instead: "leave it out; `reverse_below_hz`, `min_start_interval` and `require_watchdog` in `[line.drive.control]` are the interlocks; what must not run together is wired or decided by the commander",
    },
    RefusedKey {
        name: "lease",
        what: None,
        instead: "leave it out; `lease` and `lost_after` are in `[line.drive.control]`",
    },
    RefusedKey {
        name: "max_status_age",
        what: None,
        instead: "leave it out; the planned age of the values follows from `poll`",
    },
];

impl DriveFile {
    /// The drive's label in messages: its name, or its location if it has none.
    pub fn label(&self) -> String {
        match &self.name {
            Some(name) => format!("drive `{}`", name.value),
            None => format!("the drive at {}", self.location.key),
        }
    }
}

fn station() -> ValueKind<'static, Station> {
    ValueKind::number(0..=u8::MAX)
        .map(Station)
        .listed_as("number in the model's range; on `modbus-tcp://` 0 to 247, or 255")
}

/// A rated value, read in thousandths of `unit`.
fn thousandths(unit: &str) -> ValueKind<'static, u32> {
    let kind = ValueKind::decimal(0.001..=100_000.0);
    let notation = format!("{} {unit}", kind.notation());
    kind.and_then(|value| {
        let thousandths = (value * 1000.0).round();
        if thousandths / 1000.0 == value {
            return Ok(thousandths as u32);
        }
        let what = format!("{value} is finer than 0.001");
        Err(WrongValue::from((
            what,
            "at most three decimals".to_owned(),
        )))
    })
    .listed_as(notation)
}

/// No register has finer steps or larger values.
fn dead_band() -> ValueKind<'static, f64> {
    ValueKind::decimal(0.000_001..=100_000.0)
}

/// No register has more decimals.
fn decimals() -> ValueKind<'static, u8> {
    ValueKind::number(0..=9)
}

/// The keys of a register are read, and checked with the model, as those of a model file.
fn registers() -> KeyForm<'static, Vec<RegisterFile>> {
    KeyForm::new("tables", |reader: &mut TableReader<'_, '_>, key| {
        let sections = reader.tables(key);
        sections
            .into_iter()
            .map(|section| extra_register(section, reader.problems()))
            .collect()
    })
}
