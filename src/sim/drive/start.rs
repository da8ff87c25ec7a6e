//! A start in several words: the run word turns the motor only after the others, in their order.

use super::SimDrive;
use super::command::MotorMotion;
use super::memory::MemoryAddress;
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::profile::model::{OrderKind, RegisterRole};

/// How far a start has come.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StartReadiness {
    /// Number of words that the drive has followed.
    followed: usize,
    /// When the drive was given the last of the followed words.
    since: MonoTime,
    /// The drive follows none of them, as with an open enable terminal.
    is_held_back: bool,
    /// It shows `running` as long as it is ordered to run, and not while the motor still ramps down.
    pub(super) shows_orders: bool,
}

impl SimDrive {
    /// Holds the drive back: it takes the words of a start but follows none. A drive that is let go obeys the run word that
    /// stands in its register.
    pub fn hold_back(&mut self, at: MonoTime, is_held_back: bool) {
        self.advance(at);
        self.start.is_held_back = is_held_back;
        if is_held_back {
            self.start.followed = 0;
            return;
        }
        let stands = |kind| {
            let (address, fact) = self.model.order(kind)?;
            let held = self.word(address)?;
            (self.powered && !self.tripped && held == fact.value).then_some(())
        };
        if stands(OrderKind::Forward).is_some() {
            self.start.followed = self.model.start_steps().len();
            self.run(at, 1, false);
        } else if stands(OrderKind::Reverse).is_some() {
            self.start.followed = self.model.start_steps().len();
            self.run(at, -1, false);
        }
    }

    /// Shows `running` only while the drive is ordered to run: a motor that ramps down is shown as ready for the run word.
    pub const fn show_orders(&mut self) {
        self.start.shows_orders = true;
    }

    /// Takes `word`, which orders `motion`, if it belongs to a start or is a run word that the drive is not ready for; false if
    /// it is an order.
    pub(super) fn take_start(
        &mut self,
        at: MonoTime,
        place: MemoryAddress,
        word: u16,
        motion: Option<MotorMotion>,
    ) -> bool {
        let steps = self.model.start_steps();
        let count = steps.len();
        let step = steps.iter().position(|step| step.write.value == word);
        let is_stop = self
            .model
            .run
            .as_ref()
            .is_some_and(|run| run.stop.value == word);
        let is_taken_back = self.model.start_take_back() == Some(word);
        if count == 0 {
            return false;
        }
        let falls_back = step.is_some_and(|step| step + 1 < self.start.followed);
        match step {
            Some(step)
                if self.start.followed >= step && !self.start.is_held_back && !self.tripped =>
            {
                self.start.followed = step + 1;
                self.start.since = at;
            }
            Some(_) => {}
            None if is_taken_back && !is_stop => self.start.followed = 0,
            None if matches!(motion, Some(MotorMotion::Run(_))) && !self.is_ready(at, place) => {
                self.take(place, word);
                return true;
            }
            None => return false,
        }
        self.take(place, word);
        // An earlier state of the drive is one in which its output is off.
        if falls_back && self.is_run_from_bus() && self.motor.output(at) != 0 {
            self.cut_off(at);
        } else if self.is_run_from_bus()
            && self.control.direction != 0
            && !matches!(motion, Some(MotorMotion::Keep(_)))
        {
            self.run(at, 0, false);
        }
        true
    }

    /// Whether the run word in the register at `place` turns the motor. Where that register itself shows it, what counts is the
    /// word that it holds, no matter who wrote it and when: the drive obeys a change of it.
    fn is_ready(&self, at: MonoTime, place: MemoryAddress) -> bool {
        let steps = self.model.start_steps();
        let address = self.model.registers[place.index].address;
        let by_word = steps
            .last()
            .and_then(|last| last.until.as_ref())
            .filter(|until| until.address == address);
        let Some(until) = by_word else {
            return self.start.followed == steps.len() && self.has_settled(at);
        };
        let is_before_it = self.start.followed + 1 >= steps.len() && !self.start.is_held_back;
        let holds_it = until
            .values
            .contains(&(self.memory.word(place.index) & until.mask));
        self.control.direction != 0 || (is_before_it && holds_it)
    }

    /// Whether the drive has had its time after the last word of the start, if time is all that it needs.
    fn has_settled(&self, at: MonoTime) -> bool {
        let last = self
            .model
            .start_steps()
            .last()
            .filter(|step| step.until.is_none());
        last.is_none_or(|step| {
            self.control.direction != 0 || at.since(self.start.since) >= step.at_least
        })
    }

    /// Whether the drive shows that it runs.
    pub(super) fn shows_running(&self, at: MonoTime) -> bool {
        self.control.direction != 0 || (self.motor.output(at) != 0 && !self.start.shows_orders)
    }

    /// The drive starts from the beginning again.
    pub(super) const fn must_start_again(&mut self) {
        self.start.followed = 0;
    }

    /// `word` of the register at `address` with what the drive shows of a start.
    pub(super) fn with_readiness(&self, at: MonoTime, address: Address, word: u16) -> u16 {
        let last = self
            .start
            .followed
            .checked_sub(1)
            .and_then(|last| self.model.start_steps().get(last));
        let runs = self.shows_running(at);
        let until = last.and_then(|step| step.until.as_ref());
        // The register of run commands shows what was written there.
        let is_own = self
            .model
            .register_for(RegisterRole::RunCommand)
            .is_some_and(|run| run.address == address);
        match until {
            Some(until) if !is_own && until.address == address && !self.tripped && !runs => {
                (word & !until.mask) | until.values.first().copied().unwrap_or_default()
            }
            _ => word,
        }
    }
}
