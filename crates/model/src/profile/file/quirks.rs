//! `[quirks]`: named switches, each a fact.

use super::facts::{FactFile, FactReader, optional, whole};
use super::link::time;
use crate::profile::model::{DriveQuirks, RamAlias};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{OptionalKey, RequiredKey, TableReader};
use std::time::Duration;

/// `[quirks]`
#[derive(Default)]
pub(in crate::profile) struct QuirksFile {
    pub decimal_numbers: Option<FactFile<()>>,
    pub percent_of_rated: Option<FactFile<()>>,
    setpoint_before_run: Option<FactFile<()>>,
    pub stored_alias_bit: Option<FactFile<u8>>,
    pub ram_alias: Option<FactFile<AliasFile>>,
    deaf_after_power_up: Option<FactFile<Duration>>,
    deaf_after_reset: Option<FactFile<Duration>>,
    pause_before_request: Option<FactFile<Duration>>,
}

/// `ram_alias`
pub(in crate::profile) struct AliasFile {
    pub mask: RequiredKey<u16>,
    pub from: RequiredKey<u16>,
    pub to: RequiredKey<u16>,
    readable: OptionalKey<bool>,
}

impl AliasFile {
    fn read(reader: &mut TableReader<'_, '_>) -> Self {
        Self {
            mask: reader.required("mask", &ValueKind::number(1..=u16::MAX)),
            from: reader.required("from", &ValueKind::address()),
            to: reader.required("to", &ValueKind::address()),
            readable: reader.optional("readable", &ValueKind::flag()),
        }
    }

    /// `None` if any part is unusable.
    pub fn ready(&self) -> Option<RamAlias> {
        Some(RamAlias {
            mask: self.mask.as_ref()?.value,
            from: self.from.as_ref()?.value,
            to: self.to.as_ref()?.value,
            is_readable: self.readable.or(false)?,
        })
    }
}

impl QuirksFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let time = time();
        let quirks = Self {
            decimal_numbers: facts.switch(&mut reader, "decimal_numbers"),
            percent_of_rated: facts.switch(&mut reader, "percent_of_rated"),
            setpoint_before_run: facts.switch(&mut reader, "setpoint_before_run"),
            stored_alias_bit: facts.optional_value(
                &mut reader,
                "stored_alias_bit",
                &ValueKind::number(8..=15_u8),
            ),
            ram_alias: facts.optional(&mut reader, "ram_alias", |reader| {
                whole(reader, AliasFile::read)
            }),
            deaf_after_power_up: facts.optional_value(&mut reader, "deaf_after_power_up", &time),
            deaf_after_reset: facts.optional_value(&mut reader, "deaf_after_reset", &time),
            pause_before_request: facts.optional_value(&mut reader, "pause_before_request", &time),
        };
        reader.finish();
        quirks
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self) -> Option<DriveQuirks> {
        Some(DriveQuirks {
            decimal_numbers: optional(self.decimal_numbers.as_ref())?,
            percent_of_rated: optional(self.percent_of_rated.as_ref())?,
            setpoint_before_run: optional(self.setpoint_before_run.as_ref())?,
            stored_alias_bit: optional(self.stored_alias_bit.as_ref())?,
            ram_alias: match &self.ram_alias {
                None => None,
                Some(alias) => Some(alias.and_then(AliasFile::ready)?),
            },
            deaf_after_power_up: optional(self.deaf_after_power_up.as_ref())?,
            deaf_after_reset: optional(self.deaf_after_reset.as_ref())?,
            pause_before_request: optional(self.pause_before_request.as_ref())?,
        })
    }
}
