//! Parameters that act, or outlast the power, only after a word of their own.

use super::SimDrive;
use super::denied::RequestObjection;
use super::memory::MemoryAddress;
use crate::domain::time::MonoTime;
use crate::profile::model::{CommitEffect, Register};

impl SimDrive {
    /// Executes `value` in the register at `place` if it is there to take over or store parameters, and tells whether it is.
    pub(super) fn take_commit(
        &mut self,
        at: MonoTime,
        place: MemoryAddress,
        value: u16,
    ) -> Result<bool, RequestObjection> {
        let address = self.model.registers[place.index].address;
        let mut here = self
            .model
            .commit
            .all()
            .filter(|word| word.value.address == address)
            .peekable();
        if here.peek().is_none() {
            return Ok(false);
        }
        let word = here
            .map(|fact| &fact.value)
            .find(|word| word.value == value)
            .ok_or(RequestObjection::Value)?;
        if word.at_standstill && self.control.direction != 0 {
            return Err(RequestObjection::NotNow);
        }
        let effect = word.effect;
        for index in 0..self.model.registers.len() {
            if self.memory.apply(index) {
                self.follow_register(at, index);
            }
            if effect == CommitEffect::Store && Self::is_committed(&self.model.registers[index]) {
                self.memory.store(index);
            }
        }
        Ok(true)
    }

    /// Whether what was written to `register` waits for a word before it acts.
    pub(super) fn waits_for_commit(&self, register: &Register) -> bool {
        self.model.commit.apply.is_some() && Self::is_committed(register)
    }

    fn is_committed(register: &Register) -> bool {
        register.access.can_read() && register.parameter_kind().is_written()
    }
}
