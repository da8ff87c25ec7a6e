//! `[commit]`: the words by which a drive takes over or stores what was written to its parameters.

use super::facts::{FactReader, Origin, fact};
use crate::profile::model::{CommitEffect, CommitWord, CommitWords, Fact};
use crate::profile::register::{RegisterFile, address_of};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{KeyLocation, OptionalKey, RequiredKey, TableReader};

/// `[commit]`
pub(in crate::profile) struct CommitFile {
    pub apply: OptionalKey<CommitWordFile>,
    pub store: OptionalKey<CommitWordFile>,
}

/// `[commit.apply]` or `[commit.store]`
pub(in crate::profile) struct CommitWordFile {
    pub location: KeyLocation,
    pub register: RequiredKey<String>,
    pub value: RequiredKey<u16>,
    at_standstill: OptionalKey<bool>,
    origin: Option<Origin>,
}

impl CommitFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let commit = Self {
            apply: super::given(&mut reader, "apply", facts, CommitWordFile::read),
            store: super::given(&mut reader, "store", facts, CommitWordFile::read),
        };
        reader.finish();
        commit
    }

    /// Its words.
    pub fn words(&self) -> impl Iterator<Item = &CommitWordFile> {
        [&self.apply, &self.store]
            .into_iter()
            .filter_map(|word| word.valid())
            .map(|word| &word.value)
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<CommitWords> {
        Some(CommitWords {
            apply: super::made(&self.apply, |it| it.ready(CommitEffect::Apply, registers))?,
            store: super::made(&self.store, |it| it.ready(CommitEffect::Store, registers))?,
        })
    }
}

impl CommitWordFile {
    fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let word = Self {
            location: reader.location().clone(),
            register: reader.required("register", &ValueKind::text()),
            value: reader.required("value", &ValueKind::number(0..=u16::MAX)),
            at_standstill: reader.optional("at_standstill", &ValueKind::flag()),
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        word
    }

    fn ready(&self, effect: CommitEffect, registers: &[RegisterFile]) -> Option<Fact<CommitWord>> {
        let word = CommitWord {
            address: address_of(&self.register.as_ref()?.value, registers)?,
            effect,
            value: self.value.as_ref()?.value,
            at_standstill: self.at_standstill.or(false)?,
        };
        fact(word, self.origin.as_ref())
    }
}
