//! Parameters that act, or outlast the power, only after a word of their own.

use super::denied::RequestObjection;
use crate::domain::address::Address;
use crate::profile::model::{CommitEffect, Model, Register};

/// What `value` in the register at `address` does, if that is there to take over or store parameters.
pub(super) fn effect_of(
    model: &Model,
    address: Address,
    value: u16,
    is_ordered_to_run: bool,
) -> Result<Option<CommitEffect>, RequestObjection> {
    let mut here = model
        .commit
        .all()
        .filter(|word| word.value.address == address)
        .peekable();
    if here.peek().is_none() {
        return Ok(None);
    }
    let word = here
        .map(|fact| &fact.value)
        .find(|word| word.value == value)
        .ok_or(RequestObjection::Value)?;
    if word.at_standstill && is_ordered_to_run {
        return Err(RequestObjection::NotNow);
    }
    Ok(Some(word.effect))
}

/// Whether what was written to `register` waits for a word before it acts.
pub(super) fn is_waited_for(model: &Model, register: &Register) -> bool {
    model.commit.apply.is_some() && is_committed(register)
}

/// Whether a word takes over or stores what was written to `register`.
pub(super) fn is_committed(register: &Register) -> bool {
    register.access.can_read() && register.parameter_kind().is_written()
}
