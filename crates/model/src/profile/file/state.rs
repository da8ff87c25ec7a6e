//! `[[run.state]]`: the states of the drive's own state machine, each in the vendor's words.

use super::facts::{FactReader, Origin};
use super::kinds::{mask, word};
use crate::profile::model::StateText;
use crate::profile::register::{RegisterFile, address_of};
use crate::toml_file::declare::{declare_table, optional, required};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{OptionalKey, RequiredKey};

declare_table! {
    /// The states of the drive's own state machine in the vendor's words, as `not ready` or `switched on`. They are only shown: in
    /// `drive_state` of the `state` over MQTT and of `/api/v1`, and beside the word on the page, by `read` and by `watch`. A word
    /// that is none of them has no text.
    StateFile is "[[run.state]]" with facts: &FactReader<'_> {
        /// The name of the polled register that shows all of them.
        register: RequiredKey<String> = required(ValueKind::text());
        /// The bits that count.
        mask: OptionalKey<u16> = optional(mask()), or u16::MAX, without "the whole word";
        /// The masked word.
        value: RequiredKey<u16> = required(word());
        /// The vendor's words for the state.
        text: RequiredKey<String> = required(ValueKind::text());
        origin: Option<Origin> = facts.sources();
    }
}

impl StateFile {
    /// `None` if any part is unusable.
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<StateText> {
        let (confidence, source) = self.origin.clone()?;
        Some(StateText {
            address: address_of(&self.register.as_ref()?.value, registers)?,
            mask: self.mask()?,
            value: self.value.as_ref()?.value,
            text: self.text.as_ref()?.value.clone(),
            confidence,
            source,
        })
    }
}
