//! `[quirks]`: named switches, each a fact.

use super::facts::{FactFile, FactReader, given};
use super::kinds::{mask, time};
use crate::profile::model::{DriveQuirks, RamAlias};
use crate::toml_file::declare::{declare_table, optional, required};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{OptionalKey, RequiredKey};
use std::time::Duration;

declare_table! {
    /// Deviations that registers cannot express. The list is closed.
    QuirksFile is "[quirks]" with facts: &FactReader<'_> {
        /// The last two places of an address count in decimal digits: 0x0010 follows 0x0009.
        decimal_numbers: Option<FactFile<()>> = facts.switch(), without "no";
        /// Current and voltage are in per cent of rated values, which the configuration of the drive states.
        percent_of_rated: Option<FactFile<()>> = facts.switch(), without "no";
        /// The setpoint that the drive holds is not reliable: it is written before each RUN.
        setpoint_before_run: Option<FactFile<()>> = facts.switch(), without "no";
        /// An address with this bit set is the stored twin of the same register: written, never read.
        stored_alias_bit: Option<FactFile<u8>> = facts.optional_value(ValueKind::number(8..=15)),
            without "none";
        /// A stored register has another address by which it is written in RAM. A setpoint goes there; `params` and `enable`
        /// write the register itself, native clients what they are allowed by `write`. Used only if proven.
        ram_alias: Option<FactFile<AliasFile>> = facts.optional_parts(AliasFile::keys), without "none";
        /// How long the drive ignores requests after it was switched on.
        deaf_after_power_up: Option<FactFile<Duration>> = facts.optional_value(time()),
            without "not known";
        /// How long the drive ignores requests after a reset.
        deaf_after_reset: Option<FactFile<Duration>> = facts.optional_value(time()),
            without "not known";
        /// A pause that the drive needs before each request.
        pause_before_request: Option<FactFile<Duration>> = facts.optional_value(time()),
            without "none";
    }
}

declare_table! {
    /// `ram_alias`
    AliasFile is "quirks.ram_alias" {
        /// The bits of an address that tell the register from its form in RAM.
        mask: RequiredKey<u16> = required(mask());
        /// These bits of a register that has such a form.
        from: RequiredKey<u16> = required(ValueKind::address());
        /// These bits of its form in RAM, at which no other register is.
        to: RequiredKey<u16> = required(ValueKind::address());
        /// Whether the form in RAM can be read as well.
        readable: OptionalKey<bool> = optional(ValueKind::flag()), or false;
    }
}

impl AliasFile {
    /// `None` if any part is unusable.
    pub fn ready(&self) -> Option<RamAlias> {
        Some(RamAlias {
            mask: self.mask.as_ref()?.value,
            from: self.from.as_ref()?.value,
            to: self.to.as_ref()?.value,
            is_readable: self.readable()?,
        })
    }
}

impl QuirksFile {
    /// `None` if any part is unusable.
    pub(super) fn ready(&self) -> Option<DriveQuirks> {
        Some(DriveQuirks {
            decimal_numbers: given(&self.decimal_numbers)?,
            percent_of_rated: given(&self.percent_of_rated)?,
            setpoint_before_run: given(&self.setpoint_before_run)?,
            stored_alias_bit: given(&self.stored_alias_bit)?,
            ram_alias: match &self.ram_alias {
                None => None,
                Some(alias) => Some(alias.and_then(AliasFile::ready)?),
            },
            deaf_after_power_up: given(&self.deaf_after_power_up)?,
            deaf_after_reset: given(&self.deaf_after_reset)?,
            pause_before_request: given(&self.pause_before_request)?,
        })
    }
}
