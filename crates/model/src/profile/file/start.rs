//! `[[run.start]]` and `take_back` of `[run]`: a start in several words.

use super::facts::{FactFile, FactReader, Origin, fact, filled_with, optional};
use crate::profile::model::{StartCondition, StartStep, StartWords};
use crate::profile::register::{RegisterFile, address_of};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey, RequiredKey, TableReader};
use std::time::Duration;

/// The longest wait for the effect of one word.
const WITHIN_MAX: Duration = Duration::from_secs(10);

/// A start in several words, as written.
#[derive(Default)]
pub(in crate::profile) struct StartFile {
    pub steps: Vec<StartStepFile>,
    pub take_back: Option<FactFile<u16>>,
}

/// One of `[[run.start]]`
pub(in crate::profile) struct StartStepFile {
    pub location: KeyLocation,
    pub write: RequiredKey<u16>,
    /// Absent: only time must pass.
    pub until: OptionalKey<UntilFile>,
    pub at_least: OptionalKey<Duration>,
    pub within: OptionalKey<Duration>,
    origin: Option<Origin>,
}

/// `until`
pub(in crate::profile) struct UntilFile {
    pub register: RequiredKey<String>,
    pub mask: OptionalKey<u16>,
    pub values: RequiredKey<Vec<LocatedValue<u16>>>,
}

impl StartFile {
    pub(super) fn read(facts: &FactReader<'_>, reader: &mut TableReader<'_, '_>) -> Self {
        let steps = reader.tables("start").into_iter();
        Self {
            steps: steps
                .map(|section| StartStepFile::read(facts, reader.open(section)))
                .collect(),
            take_back: facts.optional_value(reader, "take_back", &ValueKind::number(0..=u16::MAX)),
        }
    }

    /// The words that are written beside the orders.
    pub fn words(&self) -> impl Iterator<Item = &LocatedValue<u16>> {
        let steps = self.steps.iter().filter_map(|step| step.write.as_ref());
        steps.chain(self.take_back.iter().filter_map(|fact| fact.value.as_ref()))
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<StartWords> {
        let steps = self.steps.iter().map(|step| step.ready(registers));
        Some(StartWords {
            steps: steps.collect::<Option<_>>()?,
            take_back: optional(self.take_back.as_ref())?,
        })
    }
}

impl StartStepFile {
    fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let word = ValueKind::number(0..=u16::MAX);
        let step = Self {
            location: reader.location().clone(),
            write: reader.required("write", &word),
            until: match reader.table("until") {
                OptionalKey::Absent => OptionalKey::Absent,
                OptionalKey::Invalid => OptionalKey::Invalid,
                OptionalKey::Valid(section) => {
                    let location = section.location;
                    let value = UntilFile::read(reader.open(section.value));
                    OptionalKey::Valid(LocatedValue { value, location })
                }
            },
            at_least: reader.optional(
                "at_least",
                &ValueKind::duration(Duration::ZERO..=WITHIN_MAX),
            ),
            within: reader.optional(
                "within",
                &ValueKind::duration(Duration::from_millis(1)..=WITHIN_MAX),
            ),
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        step
    }

    fn ready(&self, registers: &[RegisterFile]) -> Option<StartStep> {
        let until = match &self.until {
            OptionalKey::Absent => None,
            OptionalKey::Invalid => return None,
            OptionalKey::Valid(until) => {
                Some(until.value.ready(self.within.valid()?.value, registers)?)
            }
        };
        Some(StartStep {
            write: fact(self.write.as_ref()?.value, self.origin.as_ref())?,
            until,
            at_least: self.at_least.or(Duration::ZERO)?,
        })
    }
}

impl UntilFile {
    fn read(mut reader: TableReader<'_, '_>) -> Self {
        let word = ValueKind::number(0..=u16::MAX);
        let until = Self {
            register: reader.required("register", &ValueKind::text()),
            mask: reader.optional("mask", &ValueKind::number(1..=u16::MAX)),
            values: reader
                .required_list("values", &word)
                .and_then(|values| filled_with(values, &word, reader.problems())),
        };
        reader.finish();
        until
    }

    fn ready(&self, within: Duration, registers: &[RegisterFile]) -> Option<StartCondition> {
        Some(StartCondition {
            address: address_of(&self.register.as_ref()?.value, registers)?,
            mask: self.mask.or(u16::MAX)?,
            values: self
                .values
                .as_ref()?
                .value
                .iter()
                .map(|word| word.value)
                .collect(),
            within,
        })
    }
}
