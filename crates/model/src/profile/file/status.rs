//! `[[status]]`, `[[trip]]` and `[[exception]]`: status flags, and the texts of trips and exceptions.

use super::ModelFile;
use super::facts::{FactFile, FactReader, Origin, given};
use super::kinds::{filled_list, mask, values_of, word};
use crate::domain::address::Address;
use crate::profile::model::{
    ClearWords, CodeText, ExceptionKind, IndicatedState, MaskedWord, StatusFlag,
};
use crate::profile::register::address_of;
use crate::profile::words::{EXCEPTION_KINDS, FLAGS};
use crate::toml_file::declare::{KeyForm, declare_table, list, optional, required};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey};

declare_table! {
    /// States that a register shows. Rows are distinguished by `flag`.
    StatusFile is "[[status]]" with facts: &FactReader<'_> {
        /// The state.
        flag: RequiredKey<IndicatedState> = required(ValueKind::one_of(&FLAGS));
        /// The name of the register, which is polled.
        register: RequiredKey<String> = required(ValueKind::text());
        /// The bits that count.
        mask: OptionalKey<u16> = optional(mask()), or u16::MAX, without "the whole word";
        /// The masked words with which the state holds.
        values: RequiredKey<Vec<LocatedValue<u16>>> = filled_list(word());
        /// Masked words with which it does not hold, beside the `values` of the other states of the same bits, the `values` of
        /// the register and `[[run.state]]`. Of a single bit, and of `ready`, `bus-run` and `bus-frequency`, all other words
        /// count as such. A word that is named nowhere proves nothing: it ends no stop and clears no trip.
        clear: OptionalKey<Vec<LocatedValue<u16>>> = list(word());
        /// A document says that it does not hold with any other word.
        others_clear: Option<FactFile<()>> = facts.switch(), without "no";
        origin: Option<Origin> = facts.sources();
    }
}

declare_table! {
    /// The vendor's texts for trips. `code` for a register with role `trip-code` or `trip-cause`, `bit` for one with role
    /// `trip-bits`. Rows are distinguished by `code` or `bit`.
    CodeFile is "[[trip]]" at location with facts: &FactReader<'_> {
        /// Its bit, 0 for the lowest; up to 31 where the register has two words.
        bit: OptionalKey<u16> = optional(ValueKind::number(0..=LAST_BIT));
        /// Its number.
        code after bit: RequiredKey<u16> = code(bit), without "required without `bit`";
        /// Its meaning.
        text: RequiredKey<String> = required(ValueKind::text());
        origin: Option<Origin> = facts.sources();
    }
}

declare_table! {
    /// The vendor's texts for exception codes. Rows are distinguished by `code`.
    ExceptionFile is "[[exception]]" with facts: &FactReader<'_> {
        /// What the drive means by it. A write is never tried again for it.
        kind: OptionalKey<ExceptionKind> = optional(ValueKind::one_of(&EXCEPTION_KINDS)),
            without "a refusal";
        /// The code.
        code: RequiredKey<u16> = required(ValueKind::number(1..=255));
        /// Its meaning.
        text: RequiredKey<String> = required(ValueKind::text());
        origin: Option<Origin> = facts.sources();
    }
}

/// The number of a trip or a warning, or of its bit and 1 more. One that has a bit has no `code`.
fn code(bit: &OptionalKey<u16>) -> KeyForm<'_, RequiredKey<u16>> {
    KeyForm::of(word(), move |reader, key, kind| {
        if matches!(bit, OptionalKey::Absent) {
            return reader.required(key, kind);
        }
        if let OptionalKey::Valid(code) = reader.optional(key, kind) {
            let problem = code.location.problem("has a bit already");
            reader
                .problems()
                .push(problem.right("either `bit` or `code`"));
        }
        let bit = bit.valid()?;
        Some(LocatedValue {
            value: bit.value + 1,
            location: bit.location.clone(),
        })
    })
}

impl StatusFile {
    /// `None` if any part is unusable.
    pub fn ready(&self, file: &ModelFile) -> Option<StatusFlag> {
        let (confidence, source) = self.origin.clone()?;
        let flag = self.flag.as_ref()?.value;
        let address = address_of(&self.register.as_ref()?.value, &file.registers)?;
        let mask = self.mask()?;
        let is_one_bit = mask.is_power_of_two() || address.table().is_of_bits();
        let others_clear = given(&self.others_clear)?;
        let others_are_clear = is_one_bit || flag.is_permission() || others_clear.is_some();
        let clear = if others_are_clear {
            ClearWords::Others
        } else {
            ClearWords::Named(named_words(file, address, mask))
        };
        let values = values_of(&self.values.as_ref()?.value);
        Some(StatusFlag {
            flag,
            address,
            mask,
            values,
            clear,
            others_clear,
            confidence,
            source,
        })
    }

    /// The words that it names, under its mask; none if it is about another field than the one under `mask` at `address`.
    fn words_of(
        &self,
        file: &ModelFile,
        address: Address,
        mask: u16,
    ) -> impl Iterator<Item = u16> + '_ {
        let is_there = self
            .register
            .as_ref()
            .and_then(|it| address_of(&it.value, &file.registers))
            == Some(address);
        let lists = if is_there && self.mask() == Some(mask) {
            [self.values.as_ref(), self.clear.valid()]
        } else {
            [None, None]
        };
        let words = lists.into_iter().flatten().flat_map(|list| &list.value);
        words.map(|word| word.value)
    }
}

/// The words of the field under `mask` at `address` that the file names: as values of its flags or as clear ones, as
/// meanings of its register, and as states of the drive.
fn named_words(file: &ModelFile, address: Address, mask: u16) -> Vec<MaskedWord> {
    let of_flags = file
        .status
        .iter()
        .flat_map(|it| it.words_of(file, address, mask));
    let of_flags = of_flags.map(|value| MaskedWord { mask, value });
    let here = file
        .registers
        .iter()
        .filter(|it| it.place().is_some_and(|place| place.value == address));
    let of_register = here.filter_map(|register| {
        let field = register
            .form
            .mask
            .valid()
            .map_or(u16::MAX, |mask| mask.value);
        // The meanings of a whole word say nothing about a part of it.
        (mask & field == field).then(|| {
            register.meaning_words().map(move |code| MaskedWord {
                mask: field,
                value: code.checked_shl(field.trailing_zeros()).unwrap_or_default() & field,
            })
        })
    });
    let states = file.run.valid().map_or(&[][..], |run| &run.value.states);
    let of_states = states
        .iter()
        .filter_map(|state| state.ready(&file.registers));
    let of_states = of_states.filter(|state| state.address == address);
    let of_states = of_states.map(|state| MaskedWord {
        mask: state.mask,
        value: state.value,
    });
    of_flags
        .chain(of_register.flatten())
        .chain(of_states)
        .collect()
}

/// The highest bit of two words.
const LAST_BIT: u16 = 31;

impl CodeFile {
    /// Whether it is declared by its bit.
    pub const fn is_bit(&self) -> bool {
        !matches!(self.bit, OptionalKey::Absent)
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self) -> Option<CodeText> {
        code_text(self.code.as_ref(), self.text.as_ref(), self.origin.as_ref())
    }
}

impl ExceptionFile {
    /// What the drive means by it, with its code; `None` if it is not stated.
    pub(super) fn ready_kind(&self) -> Option<(u8, ExceptionKind)> {
        Some((
            u8::try_from(self.code.as_ref()?.value).ok()?,
            self.kind.valid()?.value,
        ))
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self) -> Option<CodeText> {
        code_text(self.code.as_ref(), self.text.as_ref(), self.origin.as_ref())
    }
}

fn code_text(
    code: Option<&LocatedValue<u16>>,
    text: Option<&LocatedValue<String>>,
    origin: Option<&Origin>,
) -> Option<CodeText> {
    let (confidence, source) = origin?.clone();
    Some(CodeText {
        code: code?.value,
        text: text?.value.clone(),
        confidence,
        source,
    })
}
