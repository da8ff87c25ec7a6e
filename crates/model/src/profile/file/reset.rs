//! `reset_sequence` of `[run]`: the words of a reset, each alone or in a table that says more.

use crate::profile::model::ResetStep;
use crate::profile::register::{RegisterFile, address_of};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader, TomlEntry};
use std::time::Duration;

/// The longest pause after one word.
const WAIT_MAX: Duration = Duration::from_secs(10);

/// One word of `reset_sequence`.
pub(in crate::profile) struct ResetStepFile {
    pub register: OptionalKey<String>,
    pub value: RequiredKey<u16>,
    pub wait: OptionalKey<Duration>,
}

pub(super) fn read(reader: &mut TableReader<'_, '_>) -> OptionalKey<Vec<ResetStepFile>> {
    match reader.values_or_tables("reset_sequence", &ValueKind::number(0..=u16::MAX)) {
        OptionalKey::Absent => OptionalKey::Absent,
        OptionalKey::Invalid => OptionalKey::Invalid,
        OptionalKey::Valid(LocatedValue {
            value: entries,
            location,
        }) => {
            let value = entries
                .into_iter()
                .map(|entry| ResetStepFile::read(reader, entry))
                .collect();
            OptionalKey::Valid(LocatedValue { value, location })
        }
    }
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
    fn read<'a>(reader: &mut TableReader<'a, '_>, entry: TomlEntry<'a, u16>) -> Self {
        match entry {
            TomlEntry::Value(word) => Self {
                register: OptionalKey::Absent,
                value: Some(word),
                wait: OptionalKey::Absent,
            },
            TomlEntry::Table(section) => {
                let mut reader = reader.open(section);
                let step = Self {
                    register: reader.optional("register", &ValueKind::text()),
                    value: reader.required("value", &ValueKind::number(0..=u16::MAX)),
                    wait: reader.optional(
                        "wait",
                        &ValueKind::duration(Duration::from_millis(1)..=WAIT_MAX),
                    ),
                };
                reader.finish();
                step
            }
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
            wait: self.wait.or(Duration::ZERO)?,
        })
    }
}
