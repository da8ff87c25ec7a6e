//! `[[run.start]]`: a start in several words.

use super::facts::{FactReader, Origin, fact};
use super::kinds::{filled_list, mask, ms, seconds, values_of, word};
use crate::profile::model::{StartCondition, StartStep};
use crate::profile::register::{RegisterFile, address_of};
use crate::toml_file::declare::{declare_table, optional, required, table};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey};
use std::time::Duration;

/// The longest wait for the effect of one word.
const WITHIN_MAX: Duration = seconds(10);

declare_table! {
    /// The words that are written, in order, before the run word, to the same register. A drive that shows `running` gets the run
    /// word only; one that already shows what the last of them must bring about, as while its motor still ramps down, gets the run
    /// word only as well, or the last of them and the run word where the last is `stop`.
    StartStepFile is "[[run.start]]" at location with facts: &FactReader<'_> {
        /// The word. It neither runs nor resets.
        write: RequiredKey<u16> = required(word());
        /// What the drive must show before the next word.
        until: OptionalKey<UntilFile> = table(UntilFile::read), without "only time must pass";
        /// How long after the write the register is read at the earliest; without `until`, when the next word follows. Where the
        /// last word has no `until`, all of them are `stop`: they go out while the motor may still ramp down.
        at_least: OptionalKey<Duration> = optional(ValueKind::duration(Duration::ZERO..=WITHIN_MAX)),
            or Duration::ZERO, without "`\"0s\"`, required without `until`";
        /// How long the drive may take. If it takes longer, the start is taken back and has failed.
        within: OptionalKey<Duration> = optional(ValueKind::duration(ms(1)..=WITHIN_MAX)),
            without "required with `until`";
        origin: Option<Origin> = facts.sources();
    }
}

declare_table! {
    /// `until`
    UntilFile is "run.start.until" {
        /// The name of the readable register that shows it.
        register: RequiredKey<String> = required(ValueKind::text());
        /// The bits that count.
        mask: OptionalKey<u16> = optional(mask()), or u16::MAX, without "the whole word";
        /// The masked words, one of which it must hold.
        values: RequiredKey<Vec<LocatedValue<u16>>> = filled_list(word());
    }
}

impl StartStepFile {
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<StartStep> {
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
            at_least: self.at_least()?,
        })
    }
}

impl UntilFile {
    fn ready(&self, within: Duration, registers: &[RegisterFile]) -> Option<StartCondition> {
        Some(StartCondition {
            address: address_of(&self.register.as_ref()?.value, registers)?,
            mask: self.mask()?,
            values: values_of(&self.values.as_ref()?.value),
            within,
        })
    }
}
