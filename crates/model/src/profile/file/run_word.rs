//! `[[run.bit]]` and `[[run.field]]`: what the bits of run commands mean.

use super::facts::{FactReader, Origin, fact};
use super::kinds::mask;
use crate::profile::model::{BitMeaning, BitSense, RunBit, RunField};
use crate::profile::register::words_of;
use crate::profile::words::BIT_MEANINGS;
use crate::toml_file::declare::{KeyForm, declare_table, optional, required};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey};

/// The word for a value of a field that does nothing.
const NOTHING: &str = "nothing";

declare_table! {
    /// With `form = "bits"`: every bit that a command uses. A word with a bit that is not listed is refused. A word is as sure as
    /// its own `confidence` says: an example that shows several bits proves their sum only, so a word that you compose of single
    /// bits is `inferred` unless the manual prints it. Rows are distinguished by `bit`.
    BitFile is "[[run.bit]]" at location with facts: &FactReader<'_> {
        /// Its number, 0 for the lowest.
        bit: RequiredKey<u8> = required(ValueKind::number(0..=15));
        /// What it means while it holds.
        meaning: RequiredKey<BitMeaning> = required(ValueKind::one_of(&BIT_MEANINGS));
        /// The value of the bit with which the meaning holds: 0 for an enable with `meaning = "coast"`.
        when: OptionalKey<u8> = optional(ValueKind::number(0..=1)), or 1;
        origin: Option<Origin> = facts.sources();
    }
}

declare_table! {
    /// With `form = "bits"`: neighbouring bits that mean something together. A value that is not listed is never ordered. Rows are
    /// distinguished by `mask`.
    FieldFile is "[[run.field]]" at location with facts: &FactReader<'_> {
        /// The bits, as `0x0030`.
        mask: RequiredKey<u16> = required(mask());
        /// The meaning of each value, shifted down and in decimal: `{ "0" = "nothing", "1" = "forward" }`. It names 0.
        /// `"nothing"` is a word of fields only.
        values: Option<FieldValues> = values();
        origin: Option<Origin> = facts.sources();
    }
}

/// The known values, each with its meaning, in order.
pub type FieldValues = Vec<(u16, LocatedValue<Option<BitMeaning>>)>;

impl BitFile {
    /// What it means; `None` if any part of that is unusable.
    pub fn sense(&self) -> Option<BitSense> {
        let is_inverted = self.when()? == 0;
        Some(BitSense::of_bit(
            self.bit.as_ref()?.value,
            is_inverted,
            self.meaning.as_ref()?.value,
        ))
    }

    pub(super) fn ready(&self) -> Option<RunBit> {
        let bit = fact(self.bit.as_ref()?.value, self.origin.as_ref())?;
        Some(RunBit {
            bit,
            meaning: self.meaning.as_ref()?.value,
            is_inverted: self.when()? == 0,
        })
    }
}

impl FieldFile {
    /// What its values mean; empty if its mask or values are unusable.
    pub fn senses(&self) -> impl Iterator<Item = BitSense> {
        let known = self.mask.as_ref().zip(self.values.as_ref());
        known.into_iter().flat_map(|(mask, values)| {
            values.iter().filter_map(|(value, meaning)| {
                Some(BitSense::of_field(mask.value, *value, meaning.value?))
            })
        })
    }

    pub(super) fn ready(&self) -> Option<RunField> {
        let values = self
            .values
            .as_ref()?
            .iter()
            .map(|(value, meaning)| (*value, meaning.value))
            .collect();
        Some(RunField {
            mask: fact(self.mask.as_ref()?.value, self.origin.as_ref())?,
            values,
        })
    }
}

/// The table `values`; `None` if it is unusable.
fn values() -> KeyForm<'static, Option<FieldValues>> {
    let kind = ValueKind::one_of(&BIT_MEANINGS).or_word(NOTHING);
    let right = format!("a table, each {}", kind.right());
    let form = KeyForm::of(kind, |reader, key, kind| {
        let section = reader.required_table(key)?;
        let location = section.location.clone();
        let inner = reader.open(section);
        let count = inner.len();
        let all = inner.all(kind);
        if count == 0 {
            let problem = location.problem("is empty");
            reader
                .problems()
                .push(problem.right("the meaning of each value"));
            return None;
        }
        // A value that cannot be used is reported already: all words with it would seem wrong as well.
        Some(words_of(all, reader.problems())).filter(|values| values.len() == count)
    });
    form.right(right).needed()
}
