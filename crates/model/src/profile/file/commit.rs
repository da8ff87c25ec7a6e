//! `[commit]`: the words by which a drive takes over or stores what was written to its parameters.

use super::facts::{FactReader, Origin, fact};
use super::kinds::word;
use crate::profile::model::{CommitEffect, CommitWord, CommitWords, Fact};
use crate::profile::register::{RegisterFile, address_of};
use crate::toml_file::declare::{declare_table, optional, required, table};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{OptionalKey, RequiredKey};

declare_table! {
    /// The words by which the drive takes over or stores what was written to its parameters, where it does not do so by itself.
    /// Each is written by the gateway alone, to a register with `back_door`, and never with a setpoint or a run command. How long
    /// the drive hears nothing afterwards is `deaf_after` of the register. A word that is not proven is never sent.
    CommitFile is "[commit]" with facts: &FactReader<'_> {
        /// Parameters act only after this word. It follows every write of one.
        apply: OptionalKey<CommitWordFile> = table(|reader| CommitWordFile::read(facts, reader)),
            without "written parameters act at once";
        /// Parameters outlast the drive's power only after this word, which applies them too. It follows `enable`, `watchdog`
        /// and, once, all of `params restore`; native writes only with `store = true` in `[line.drive.native]`. It wears out a
        /// memory: `stored_write_interval` holds for it.
        store: OptionalKey<CommitWordFile> = table(|reader| CommitWordFile::read(facts, reader)),
            without "written parameters are stored by their `memory`";
    }
}

declare_table! {
    /// `apply` or `store` of `[commit]`.
    CommitWordFile is "commit.apply" at location with facts: &FactReader<'_> {
        /// The name of its register.
        register: RequiredKey<String> = required(ValueKind::text());
        /// The word.
        value: RequiredKey<u16> = required(word());
        /// While the motor may turn, neither the word nor the changes before it are sent.
        at_standstill: OptionalKey<bool> = optional(ValueKind::flag()), or false, without "no";
        origin: Option<Origin> = facts.sources();
    }
}

impl CommitFile {
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
    fn ready(&self, effect: CommitEffect, registers: &[RegisterFile]) -> Option<Fact<CommitWord>> {
        let word = CommitWord {
            address: address_of(&self.register.as_ref()?.value, registers)?,
            effect,
            value: self.value.as_ref()?.value,
            at_standstill: self.at_standstill()?,
        };
        fact(word, self.origin.as_ref())
    }
}
