//! Orders in registers of their own: the direction, a reset that has to be cleared, a stop beside the run word.

use super::SimDrive;
use super::command::{MotorMotion, has_priority, run_order_in};
use super::denied::RequestObjection;
use super::memory::{MemoryAddress, index_of};
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::profile::model::{Model, OrderKind, RegisterRole};
use std::sync::Arc;

impl SimDrive {
    /// Takes `word` in a register of orders.
    pub(super) fn take_order(
        &mut self,
        at: MonoTime,
        place: MemoryAddress,
        word: u16,
    ) -> Result<(), RequestObjection> {
        let model = Arc::clone(&self.model);
        let register = &model.registers[place.index];
        let address = register.address;
        let Some(run) = model.run.as_ref() else {
            return Err(RequestObjection::Value);
        };
        let is_own = register.role == Some(RegisterRole::RunCommand);
        let is_forbidden = run.never.iter().any(|never| is_own && never.value == word)
            || run
                .places
                .never
                .iter()
                .any(|(register, never)| *register == address && never.value == word);
        if is_forbidden {
            self.report.forbidden_words += 1;
            return Err(RequestObjection::Value);
        }
        if self.model.order_address(OrderKind::Reset) == Some(address) {
            self.end_reset();
        }
        if self.model.direction_at(address).is_some() {
            return self.take_direction(at, place, word);
        }
        let is_of_reset = self.is_of_reset(address);
        if is_of_reset && run.places.clear == Some(word) {
            self.take(place, word);
            self.control.reset_stands = false;
            return Ok(());
        }
        let wished = run_order_in(&self.model, address, word);
        let motion = wished.map(|wish| wish.motion);
        if is_own
            && self.is_source_at_bus(RegisterRole::RunSource)
            && self.take_start(at, place, word, motion)
        {
            return Ok(());
        }
        let mut wish = wished.ok_or(RequestObjection::Value)?;
        if wish.is_ignored {
            return Ok(());
        }
        if let MotorMotion::Run(direction) = &mut wish.motion {
            *direction *= self.given_direction();
        }
        if wish.is_one_command {
            // Only a word of bits can give them up.
            wish.bus_run = self.control.bus_run;
            wish.bus_frequency = self.control.bus_frequency;
        }
        let needs_sources = !has_priority(run) && !wish.release;
        let has_sources = self.is_source_at_bus(RegisterRole::RunSource)
            && self.is_source_at_bus(RegisterRole::FrequencySource);
        if (needs_sources && !has_sources)
            || (self.wanted_direction(wish.motion) != 0 && self.tripped)
        {
            return Err(RequestObjection::NotNow);
        }
        let stood = is_of_reset && self.control.reset_stands;
        self.control.reset_stands |= is_of_reset && run_clears(&self.model);
        // The effect of the word may change the register.
        self.take(place, word);
        if stood {
            // It is set already: a drive acts on the change.
            self.report.resets_held += 1;
            return Ok(());
        }
        self.obey_word(at, wish);
        Ok(())
    }

    /// The direction of the next run word; a motor that runs follows at once.
    fn take_direction(
        &mut self,
        at: MonoTime,
        place: MemoryAddress,
        word: u16,
    ) -> Result<(), RequestObjection> {
        let words = self
            .model
            .direction_at(self.model.registers[place.index].address);
        if !words.is_some_and(|words| word == words.forward || Some(word) == words.reverse) {
            return Err(RequestObjection::Value);
        }
        self.take(place, word);
        let sign = self.given_direction();
        if self.control.direction != 0 && self.is_run_from_bus() && self.control.direction != sign {
            self.run(at, sign, false);
        }
        Ok(())
    }

    /// 1, or -1 if the register of the direction holds the word for reverse.
    fn given_direction(&self) -> i64 {
        let words = self
            .model
            .run
            .as_ref()
            .and_then(|run| run.places.direction.as_ref());
        let Some(words) = words.map(|fact| &fact.value) else {
            return 1;
        };
        let held = index_of(&self.model, words.address).map(|index| self.memory.word(index));
        if held.is_some() && held == words.reverse {
            -1
        } else {
            1
        }
    }

    /// Whether the register at `address` takes nothing but the reset.
    fn is_of_reset(&self, address: Address) -> bool {
        let mut kinds = self.model.orders_at(address).map(|(kind, _)| kind);
        kinds.next() == Some(OrderKind::Reset) && kinds.next().is_none()
    }
}

/// Whether the drive leaves the reset word in its register.
fn run_clears(model: &Model) -> bool {
    model
        .run
        .as_ref()
        .is_some_and(|run| run.places.clear.is_some())
}
