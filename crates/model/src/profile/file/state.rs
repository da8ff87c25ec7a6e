//! `[[run.state]]`: the states of the drive's own state machine, each in the vendor's words.

use super::facts::{FactReader, Origin};
use crate::profile::model::StateText;
use crate::profile::register::{RegisterFile, address_of};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{OptionalKey, RequiredKey, TableReader};

/// One of `[[run.state]]`
pub(in crate::profile) struct StateFile {
    pub register: RequiredKey<String>,
    pub mask: OptionalKey<u16>,
    pub value: RequiredKey<u16>,
    text: RequiredKey<String>,
    origin: Option<Origin>,
}

impl StateFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let state = Self {
            register: reader.required("register", &ValueKind::text()),
            mask: reader.optional("mask", &ValueKind::number(1..=u16::MAX)),
            value: reader.required("value", &ValueKind::number(0..=u16::MAX)),
            text: reader.required("text", &ValueKind::text()),
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        state
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<StateText> {
        let (confidence, source) = self.origin.clone()?;
        Some(StateText {
            address: address_of(&self.register.as_ref()?.value, registers)?,
            mask: self.mask.or(u16::MAX)?,
            value: self.value.as_ref()?.value,
            text: self.text.as_ref()?.value.clone(),
            confidence,
            source,
        })
    }
}
