//! `[[status]]`, `[[trip]]` and `[[exception]]`: status flags, and the texts of trips and exceptions.

use super::facts::{Facts, Origin, filled_with};
use crate::profile::model::{CodeText, ExceptionKind, Flag, StatusFlag};
use crate::profile::register::{RegisterFile, address_of};
use crate::profile::words::{EXCEPTION_KINDS, FLAGS};
use crate::toml_file::values::Kind;
use crate::toml_file::{Location, OptionalKey, Reader, RequiredKey, Spanned};
use std::ops::RangeInclusive;

/// One of `[[status]]`
pub(in crate::profile) struct StatusFile {
    pub flag: RequiredKey<Flag>,
    pub register: RequiredKey<String>,
    pub mask: OptionalKey<u16>,
    pub values: RequiredKey<Vec<Spanned<u16>>>,
    origin: Option<Origin>,
}

impl StatusFile {
    pub(super) fn read(facts: &Facts<'_>, mut reader: Reader<'_, '_>) -> Self {
        let word = Kind::number(0..=u16::MAX);
        let status = Self {
            flag: reader.required("flag", &Kind::one_of(&FLAGS)),
            register: reader.required("register", &Kind::text()),
            mask: reader.optional("mask", &Kind::number(1..=u16::MAX)),
            values: reader
                .required_list("values", &word)
                .and_then(|values| filled_with(values, &word, reader.problems())),
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        status
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<StatusFlag> {
        let (confidence, source) = self.origin.clone()?;
        Some(StatusFlag {
            flag: self.flag.as_ref()?.value,
            address: address_of(&self.register.as_ref()?.value, registers)?,
            mask: self.mask.or(u16::MAX)?,
            values: self.values.as_ref()?.value.iter().map(|word| word.value).collect(),
            confidence,
            source,
        })
    }
}

/// The highest bit of two words.
const LAST_BIT: u16 = 31;

/// One of `[[trip]]`, `[[warning]]` or `[[exception]]`
pub(in crate::profile) struct CodeFile {
    pub location: Location,
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
    pub(super) fn read_exception(facts: &Facts<'_>, mut reader: Reader<'_, '_>) -> Self {
        let kind = reader.optional("kind", &Kind::one_of(&EXCEPTION_KINDS));
        Self { kind, ..Self::read(facts, 1..=255, reader) }
    }

    /// What the drive means by it, with its code; `None` if it is not stated.
    pub(super) fn ready_kind(&self) -> Option<(u8, ExceptionKind)> {
        Some((u8::try_from(self.code.as_ref()?.value).ok()?, self.kind.valid()?.value))
    }

    /// An exception, or a trip that has a number, with a code of `codes`.
    pub(super) fn read(facts: &Facts<'_>, codes: RangeInclusive<u16>, mut reader: Reader<'_, '_>) -> Self {
        let code = Self {
            location: reader.location().clone(),
            code: reader.required("code", &Kind::number(codes)),
            is_bit: false,
            text: reader.required("text", &Kind::text()),
            kind: OptionalKey::Absent,
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        code
    }

    /// A trip or a warning: either its `code` or its `bit`.
    pub(super) fn read_code_or_bit(facts: &Facts<'_>, mut reader: Reader<'_, '_>) -> Self {
        let bit = reader.optional("bit", &Kind::number(0..=LAST_BIT));
        let is_bit = !matches!(bit, OptionalKey::Absent);
        if !is_bit {
            return Self::read(facts, 0..=u16::MAX, reader);
        }
        if let OptionalKey::Valid(code) = reader.optional("code", &Kind::number(0..=u16::MAX)) {
            let problem = code.location.problem("has a bit already");
            reader.problems().push(problem.right("either `bit` or `code`"));
        }
        let code = Self {
            location: reader.location().clone(),
            code: bit.valid().map(|bit| Spanned { value: bit.value + 1, location: bit.location.clone() }),
            is_bit,
            text: reader.required("text", &Kind::text()),
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
        Some(CodeText { code, text: self.text.as_ref()?.value.clone(), confidence, source })
    }
}
