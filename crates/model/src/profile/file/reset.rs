//! `reset_sequence` of `[run]`: the words of a reset, each alone or in a table that says more.

use super::kinds::{ms, seconds, word};
use crate::profile::model::ResetStep;
use crate::profile::register::{RegisterFile, address_of};
use crate::toml_file::declare::{KeyForm, declare_table, optional, required};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader, TomlEntry};
use std::time::Duration;

/// The longest pause after one word.
const WAIT_MAX: Duration = seconds(10);

declare_table! {
    /// One word of `reset_sequence`.
    ResetStepFile is "run.reset_sequence" {
        /// The name of the reset's own register, for `reset` and `clear`; `clear` is then the last word.
        register: OptionalKey<String> = optional(ValueKind::text()), without "the one for run commands";
        /// The word.
        value: RequiredKey<u16> = required(word());
        /// How long nothing is written after the word; at most 20 s together. A stop does not wait, and nothing of the reset
        /// follows it but what clears the word.
        wait: OptionalKey<Duration> = optional(ValueKind::duration(ms(1)..=WAIT_MAX)),
            or Duration::ZERO, without "none";
    }
}

/// The words, each alone or in a table that says more.
pub(super) fn sequence() -> KeyForm<'static, OptionalKey<Vec<ResetStepFile>>> {
    let kind = word();
    let right = format!("a list, each {}, or a table", kind.right());
    let form = KeyForm::of(kind, |reader, key, kind| {
        match reader.values_or_tables(key, kind) {
            OptionalKey::Absent => OptionalKey::Absent,
            OptionalKey::Invalid => OptionalKey::Invalid,
            OptionalKey::Valid(LocatedValue { value, location }) => {
                let step = |entry| ResetStepFile::of(reader, entry);
                OptionalKey::Valid(LocatedValue {
                    value: value.into_iter().map(step).collect(),
                    location,
                })
            }
        }
    });
    form.right(right)
}

/// `None` if any part is unusable.
pub(super) fn ready(
    sequence: &OptionalKey<Vec<ResetStepFile>>,
    registers: &[RegisterFile],
) -> Option<Vec<ResetStep>> {
    match sequence {
        OptionalKey::Absent => Some(Vec::new()),
        OptionalKey::Invalid => None,
        OptionalKey::Valid(steps) => steps
            .value
            .iter()
            .map(|step| step.ready(registers))
            .collect(),
    }
}

impl ResetStepFile {
    fn of<'a>(reader: &mut TableReader<'a, '_>, entry: TomlEntry<'a, u16>) -> Self {
        match entry {
            TomlEntry::Value(word) => Self {
                value: Some(word),
                ..Self::default()
            },
            TomlEntry::Table(section) => Self::read(reader.open(section)),
        }
    }

    fn ready(&self, registers: &[RegisterFile]) -> Option<ResetStep> {
        let address = match &self.register {
            OptionalKey::Absent => None,
            OptionalKey::Invalid => return None,
            OptionalKey::Valid(name) => Some(address_of(&name.value, registers)?),
        };
        Some(ResetStep {
            address,
            value: self.value.as_ref()?.value,
            wait: self.wait()?,
        })
    }
}
