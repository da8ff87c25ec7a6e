//! `[[setup]]`, `[identity]` and `[watchdog]`: required drive settings, how the drive tells what it is, and how it
//! monitors its communication.

use super::facts::{FactReader, Origin, fact, filled_with};
use crate::domain::link::Interface;
use crate::profile::model::{ModelIdentity, ModelWatchdog, NeededFor, SetupItem};
use crate::profile::register::{RegisterFile, address_of, meanings};
use crate::profile::words::NEEDED_FOR;
use crate::toml_file::values::ValueKind;
use crate::toml_file::words::INTERFACES;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey, RequiredKey, TableReader};

/// One of `[[setup]]`
pub(in crate::profile) struct SetupFile {
    pub location: KeyLocation,
    what: RequiredKey<String>,
    text: RequiredKey<String>,
    pub register: OptionalKey<String>,
    pub mask: OptionalKey<u16>,
    pub values: OptionalKey<Vec<LocatedValue<u16>>>,
    pub needed_for: OptionalKey<Vec<LocatedValue<NeededFor>>>,
    pub interface: OptionalKey<Interface>,
    origin: Option<Origin>,
}

impl SetupFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let word = ValueKind::number(0..=u16::MAX);
        let setup = Self {
            location: reader.location().clone(),
            what: reader.required("what", &ValueKind::text()),
            text: reader.required("text", &ValueKind::text()),
            register: reader.optional("register", &ValueKind::text()),
            mask: reader.optional("mask", &ValueKind::number(1..=u16::MAX)),
            values: match reader.list("values", &word) {
                OptionalKey::Valid(list) => filled_with(list, &word, reader.problems())
                    .map_or(OptionalKey::Invalid, OptionalKey::Valid),
                other => other,
            },
            needed_for: reader.list("needed_for", &ValueKind::one_of(&NEEDED_FOR)),
            interface: reader.optional("interface", &ValueKind::one_of(&INTERFACES)),
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        setup
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<SetupItem> {
        let values = self.values.clone().optional()?.unwrap_or_default();
        Some(SetupItem {
            what: self.what.as_ref()?.value.clone(),
            text: self.text.as_ref()?.value.clone(),
            address: match self.register.clone().optional()? {
                None => None,
                Some(name) => Some(address_of(&name, registers)?),
            },
            mask: self.mask.or(u16::MAX)?,
            values: fact(
                values.into_iter().map(|word| word.value).collect(),
                self.origin.as_ref(),
            )?,
            needed_for: match &self.needed_for {
                OptionalKey::Absent => Vec::new(),
                OptionalKey::Invalid => return None,
                OptionalKey::Valid(needs) => needs.value.iter().map(|need| need.value).collect(),
            },
            interface: self.interface.clone().optional()?,
        })
    }
}

/// The words of a list: `Some(None)` if it is left out, `None` if it is unusable.
fn words_of(list: &OptionalKey<Vec<LocatedValue<u16>>>) -> Option<Option<Vec<u16>>> {
    match list {
        OptionalKey::Absent => Some(None),
        OptionalKey::Invalid => None,
        OptionalKey::Valid(words) => {
            Some(Some(words.value.iter().map(|word| word.value).collect()))
        }
    }
}

/// `[identity]`
pub(in crate::profile) struct IdentityFile {
    pub register: RequiredKey<String>,
    pub mask: OptionalKey<u16>,
    pub values: RequiredKey<Vec<LocatedValue<u16>>>,
    others: Vec<(u16, String)>,
    origin: Option<Origin>,
}

impl IdentityFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let word = ValueKind::number(0..=u16::MAX);
        let identity = Self {
            register: reader.required("register", &ValueKind::text()),
            mask: reader.optional("mask", &ValueKind::number(1..=u16::MAX)),
            values: reader
                .required_list("values", &word)
                .and_then(|values| filled_with(values, &word, reader.problems())),
            others: meanings(&mut reader, "others"),
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        identity
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<ModelIdentity> {
        let values = self
            .values
            .as_ref()?
            .value
            .iter()
            .map(|word| word.value)
            .collect();
        Some(ModelIdentity {
            address: address_of(&self.register.as_ref()?.value, registers)?,
            mask: self.mask.or(u16::MAX)?,
            values: fact(values, self.origin.as_ref())?,
            others: self.others.clone(),
        })
    }
}

/// `[watchdog]`
pub(in crate::profile) struct WatchdogFile {
    pub register: RequiredKey<String>,
    off: RequiredKey<u16>,
    pub action: OptionalKey<String>,
    pub action_digit: OptionalKey<u16>,
    pub keeps_running: OptionalKey<Vec<LocatedValue<u16>>>,
    pub stops: OptionalKey<Vec<LocatedValue<u16>>>,
    origin: Option<Origin>,
}

impl WatchdogFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let watchdog = Self {
            register: reader.required("register", &ValueKind::text()),
            off: reader.required("off", &ValueKind::number(0..=u16::MAX)),
            action: reader.optional("action", &ValueKind::text()),
            action_digit: reader.optional("action_digit", &ValueKind::number(1..=1000)),
            keeps_running: reader.list("keeps_running", &ValueKind::number(0..=u16::MAX)),
            stops: reader.list("stops", &ValueKind::number(0..=u16::MAX)),
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        watchdog
    }

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
            keeps_running: words_of(&self.keeps_running)?.unwrap_or_default(),
            stops: match words_of(&self.stops)? {
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
        let runs_on = words_of(&self.keeps_running).flatten().unwrap_or_default();
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
