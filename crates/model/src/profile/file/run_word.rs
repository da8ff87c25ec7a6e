//! `[[run.bit]]` and `[[run.field]]`: what the bits of run commands mean.

use super::facts::{FactReader, Origin, fact};
use crate::profile::model::{BitMeaning, BitSense, RunBit, RunField};
use crate::profile::register::words_of;
use crate::profile::words::BIT_MEANINGS;
use crate::toml_file::values::ValueKind;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey, RequiredKey, TableReader};

/// The word for a value of a field that does nothing.
const NOTHING: &str = "nothing";

/// One of `[[run.bit]]`
pub(in crate::profile) struct BitFile {
    pub location: KeyLocation,
    pub bit: RequiredKey<u8>,
    pub meaning: RequiredKey<BitMeaning>,
    /// The value of the bit with which the meaning holds; 1 if it is left out.
    pub when: OptionalKey<u8>,
    origin: Option<Origin>,
}

/// One of `[[run.field]]`
pub(in crate::profile) struct FieldFile {
    pub location: KeyLocation,
    pub mask: RequiredKey<u16>,
    /// The known values, each with its meaning, in order; `None` if the table is unusable.
    pub values: Option<Vec<(u16, LocatedValue<Option<BitMeaning>>)>>,
    origin: Option<Origin>,
}

impl BitFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let bit = Self {
            location: reader.location().clone(),
            bit: reader.required("bit", &ValueKind::number(0..=15_u8)),
            meaning: reader.required("meaning", &ValueKind::one_of(&BIT_MEANINGS)),
            when: reader.optional("when", &ValueKind::number(0..=1_u8)),
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        bit
    }

    /// What it means; `None` if any part of that is unusable.
    pub fn sense(&self) -> Option<BitSense> {
        let is_inverted = self.when.or(1)? == 0;
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
            is_inverted: self.when.or(1)? == 0,
        })
    }
}

impl FieldFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let field = Self {
            location: reader.location().clone(),
            mask: reader.required("mask", &ValueKind::number(1..=u16::MAX)),
            values: values(&mut reader),
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        field
    }

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

/// The table `values`, in order of the values.
fn values(
    reader: &mut TableReader<'_, '_>,
) -> Option<Vec<(u16, LocatedValue<Option<BitMeaning>>)>> {
    let section = reader.required_table("values")?;
    let location = section.location.clone();
    let inner = reader.open(section);
    let count = inner.len();
    let all = inner.all(&ValueKind::one_of(&BIT_MEANINGS).or_word(NOTHING));
    if count == 0 {
        reader.problems().push(
            location
                .problem("is empty")
                .right("the meaning of each value"),
        );
        return None;
    }
    // A value that cannot be used is reported already: all words with it would seem wrong as well.
    Some(words_of(all, reader.problems())).filter(|values| values.len() == count)
}
