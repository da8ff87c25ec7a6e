//! `[[setup]]`, `[identity]` and `[watchdog]`: required drive settings, how the drive tells what it is, and how it
//! monitors its communication.

use super::facts::{FactReader, Origin, fact};
use super::kinds::{filled_list, mask, optional_filled_list, values_of, word};
use crate::domain::link::Interface;
use crate::profile::model::{ModelIdentity, ModelWatchdog, NeededFor, SetupItem};
use crate::profile::register::{RegisterFile, address_of, meanings};
use crate::profile::words::NEEDED_FOR;
use crate::toml_file::declare::{declare_table, list, optional, required};
use crate::toml_file::values::ValueKind;
use crate::toml_file::words::INTERFACES;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey};

declare_table! {
    /// The settings that the drive needs before it obeys the bus, in the order in which they are made. `check --verbose` and
    /// `verify` print them, `enable` makes those that have a register. Rows are distinguished by `what`.
    SetupFile is "[[setup]]" at location with facts: &FactReader<'_> {
        /// The vendor's code, or the switch.
        what: RequiredKey<String> = required(ValueKind::text());
        /// The setting and what it must be, in words.
        text: RequiredKey<String> = required(ValueKind::text());
        /// The name of its register, which is readable and writable.
        register: OptionalKey<String> = optional(ValueKind::text()), without "set at the drive";
        /// The bits that `values` are compared with. A setting with a mask is not written.
        mask: OptionalKey<u16> = optional(mask()), or u16::MAX, without "the whole word";
        /// The words that are right; `enable` writes the first one.
        values: OptionalKey<Vec<LocatedValue<u16>>> = optional_filled_list(word()),
            without "required with `register`";
        /// Orders that have no effect while the register holds another word. It is read before such an order, which is refused
        /// with `precondition` while it differs. A stop is never refused.
        needed_for: OptionalKey<Vec<LocatedValue<NeededFor>>> = list(ValueKind::one_of(&NEEDED_FOR)),
            without "none";
        /// The only interface that it applies to.
        interface: OptionalKey<Interface> = optional(ValueKind::one_of(&INTERFACES)), without "all";
        origin: Option<Origin> = facts.sources();
    }
}

declare_table! {
    /// How a drive tells what it is. A drive that shows something else gets no order but a stop (`other_drive`).
    IdentityFile is "[identity]" with facts: &FactReader<'_> {
        /// The name of the register.
        register: RequiredKey<String> = required(ValueKind::text());
        /// The bits that count.
        mask: OptionalKey<u16> = optional(mask()), or u16::MAX, without "the whole word";
        /// The masked words that drives of this model show.
        values: RequiredKey<Vec<LocatedValue<u16>>> = filled_list(word());
        /// Masked words of other drives in decimal, with the names of these drives: `{ "272" = "Acme Flux 3" }`.
        others: Vec<(u16, String)> = meanings(), without "none";
        origin: Option<Origin> = facts.sources();
    }
}

declare_table! {
    /// The drive's own watchdog: what it does when the bus is silent. `verify`, `require_watchdog` and an alarm rest on it.
    WatchdogFile is "[watchdog]" with facts: &FactReader<'_> {
        /// The name of the register that holds its time.
        register: RequiredKey<String> = required(ValueKind::text());
        /// The word of that register that switches it off.
        off: RequiredKey<u16> = required(word());
        /// The name of the register that holds what the drive does when the time is over.
        action: OptionalKey<String> = optional(ValueKind::text()), without "none";
        /// If one decimal digit of `action` says it: the place of the digit, 1, 10, 100 or 1000.
        action_digit: OptionalKey<u16> = optional(ValueKind::number(1..=1000)), without "the whole word";
        /// The words of `action` with which the motor runs on, reported as `keeps_running`; `[]` if the documents say that there
        /// are none.
        keeps_running: OptionalKey<Vec<LocatedValue<u16>>> = list(word()),
            without "required with `action`";
        /// The words of `action` with which the drive stops the motor. A word in neither list is unknown, and the watchdog is
        /// then never reported as in order.
        stops: OptionalKey<Vec<LocatedValue<u16>>> = list(word()),
            without "all other words in the `values` of `action`";
        origin: Option<Origin> = facts.sources();
    }
}

impl SetupFile {
    /// `None` if any part is unusable.
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<SetupItem> {
        Some(SetupItem {
            what: self.what.as_ref()?.value.clone(),
            text: self.text.as_ref()?.value.clone(),
            address: match self.register.clone().optional()? {
                None => None,
                Some(name) => Some(address_of(&name, registers)?),
            },
            mask: self.mask()?,
            values: fact(
                list_of(&self.values)?.unwrap_or_default(),
                self.origin.as_ref(),
            )?,
            needed_for: list_of(&self.needed_for)?.unwrap_or_default(),
            interface: self.interface.clone().optional()?,
        })
    }
}

/// The values of a list: `Some(None)` if it is left out, `None` if it is unusable.
fn list_of<T: Clone>(list: &OptionalKey<Vec<LocatedValue<T>>>) -> Option<Option<Vec<T>>> {
    match list {
        OptionalKey::Absent => Some(None),
        OptionalKey::Invalid => None,
        OptionalKey::Valid(list) => Some(Some(values_of(&list.value))),
    }
}

impl IdentityFile {
    /// `None` if any part is unusable.
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<ModelIdentity> {
        let values = values_of(&self.values.as_ref()?.value);
        Some(ModelIdentity {
            address: address_of(&self.register.as_ref()?.value, registers)?,
            mask: self.mask()?,
            values: fact(values, self.origin.as_ref())?,
            others: self.others.clone(),
        })
    }
}

impl WatchdogFile {
    /// `None` if any part is unusable.
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<ModelWatchdog> {
        Some(ModelWatchdog {
            time: address_of(&self.register.as_ref()?.value, registers)?,
            off: fact(self.off.as_ref()?.value, self.origin.as_ref())?,
            action: match self.action.clone().optional()? {
                None => None,
                Some(name) => Some(address_of(&name, registers)?),
            },
            action_digit: self.action_digit.clone().optional()?,
            keeps_running: list_of(&self.keeps_running)?.unwrap_or_default(),
            stops: match list_of(&self.stops)? {
                Some(words) => words,
                None => self.words_that_stop(registers),
            },
        })
    }

    /// The reaction's words that stop the motor if `stops` is left out: those that have a meaning and do not keep it
    /// running.
    pub fn words_that_stop(&self, registers: &[RegisterFile]) -> Vec<u16> {
        let OptionalKey::Valid(action) = &self.action else {
            return Vec::new();
        };
        let runs_on = list_of(&self.keeps_running).flatten().unwrap_or_default();
        let is_it =
            |register: &&RegisterFile| register.name().is_some_and(|name| *name == action.value);
        let meanings = registers
            .iter()
            .find(is_it)
            .into_iter()
            .flat_map(RegisterFile::meaning_words);
        meanings.filter(|word| !runs_on.contains(word)).collect()
    }
}
