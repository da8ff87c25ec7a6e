//! `[[status]]`, `[[trip]]` and `[[exception]]`: status flags, and the texts of trips and exceptions.

use super::ModelFile;
use super::facts::{FactFile, FactReader, Origin, filled_with, optional};
use crate::domain::address::Address;
use crate::profile::model::{
    ClearWords, CodeText, ExceptionKind, IndicatedState, MaskedWord, StatusFlag,
};
use crate::profile::register::address_of;
use crate::profile::words::{EXCEPTION_KINDS, FLAGS};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey, RequiredKey, TableReader};
use std::ops::RangeInclusive;

/// One of `[[status]]`
pub(in crate::profile) struct StatusFile {
    pub flag: RequiredKey<IndicatedState>,
    pub register: RequiredKey<String>,
    pub mask: OptionalKey<u16>,
    pub values: RequiredKey<Vec<LocatedValue<u16>>>,
    pub clear: OptionalKey<Vec<LocatedValue<u16>>>,
    pub others_clear: Option<FactFile<()>>,
    origin: Option<Origin>,
}

impl StatusFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let word = ValueKind::number(0..=u16::MAX);
        let status = Self {
            flag: reader.required("flag", &ValueKind::one_of(&FLAGS)),
            register: reader.required("register", &ValueKind::text()),
            mask: reader.optional("mask", &ValueKind::number(1..=u16::MAX)),
            values: reader
                .required_list("values", &word)
                .and_then(|values| filled_with(values, &word, reader.problems())),
            clear: reader.list("clear", &word),
            others_clear: facts.switch(&mut reader, "others_clear"),
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        status
    }

    /// `None` if any part is unusable.
    pub(in crate::profile) fn ready(&self, file: &ModelFile) -> Option<StatusFlag> {
        let (confidence, source) = self.origin.clone()?;
        let flag = self.flag.as_ref()?.value;
        let address = address_of(&self.register.as_ref()?.value, &file.registers)?;
        let mask = self.mask.or(u16::MAX)?;
        let is_one_bit = mask.is_power_of_two() || address.table().is_of_bits();
        let others_clear = optional(self.others_clear.as_ref())?;
        let others_are_clear = is_one_bit || flag.is_permission() || others_clear.is_some();
        let clear = if others_are_clear {
            ClearWords::Others
        } else {
            ClearWords::Named(named_words(file, address, mask))
        };
        let values = self
            .values
            .as_ref()?
            .value
            .iter()
            .map(|word| word.value)
            .collect();
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
        let lists = if is_there && self.mask.or(u16::MAX) == Some(mask) {
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

/// One of `[[trip]]`, `[[warning]]` or `[[exception]]`
pub(in crate::profile) struct CodeFile {
    pub location: KeyLocation,
    /// The number; of a bit, its number + 1.
    pub code: RequiredKey<u16>,
    /// It is declared by its bit.
    pub is_bit: bool,
    text: RequiredKey<String>,
    /// What the drive means by it, if it is an exception.
    pub kind: OptionalKey<ExceptionKind>,
    origin: Option<Origin>,
}

impl CodeFile {
    /// An exception.
    pub(super) fn read_exception(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let kind = reader.optional("kind", &ValueKind::one_of(&EXCEPTION_KINDS));
        Self {
            kind,
            ..Self::read(facts, 1..=255, reader)
        }
    }

    /// What the drive means by it, with its code; `None` if it is not stated.
    pub(super) fn ready_kind(&self) -> Option<(u8, ExceptionKind)> {
        Some((
            u8::try_from(self.code.as_ref()?.value).ok()?,
            self.kind.valid()?.value,
        ))
    }

    /// An exception, or a trip that has a number, with a code of `codes`.
    pub(super) fn read(
        facts: &FactReader<'_>,
        codes: RangeInclusive<u16>,
        mut reader: TableReader<'_, '_>,
    ) -> Self {
        let code = Self {
            location: reader.location().clone(),
            code: reader.required("code", &ValueKind::number(codes)),
            is_bit: false,
            text: reader.required("text", &ValueKind::text()),
            kind: OptionalKey::Absent,
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        code
    }

    /// A trip or a warning: either its `code` or its `bit`.
    pub(super) fn read_code_or_bit(
        facts: &FactReader<'_>,
        mut reader: TableReader<'_, '_>,
    ) -> Self {
        let bit = reader.optional("bit", &ValueKind::number(0..=LAST_BIT));
        let is_bit = !matches!(bit, OptionalKey::Absent);
        if !is_bit {
            return Self::read(facts, 0..=u16::MAX, reader);
        }
        if let OptionalKey::Valid(code) = reader.optional("code", &ValueKind::number(0..=u16::MAX))
        {
            let problem = code.location.problem("has a bit already");
            reader
                .problems()
                .push(problem.right("either `bit` or `code`"));
        }
        let code = Self {
            location: reader.location().clone(),
            code: bit.valid().map(|bit| LocatedValue {
                value: bit.value + 1,
                location: bit.location.clone(),
            }),
            is_bit,
            text: reader.required("text", &ValueKind::text()),
            kind: OptionalKey::Absent,
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        code
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self) -> Option<CodeText> {
        let (confidence, source) = self.origin.clone()?;
        let code = self.code.as_ref()?.value;
        Some(CodeText {
            code,
            text: self.text.as_ref()?.value.clone(),
            confidence,
            source,
        })
    }
}
