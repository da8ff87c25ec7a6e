//! What a stop does with the bits of an order to run that do not run the motor: a stop changes nothing but the running.

use super::{BitMeaning, RunCommand, RunField, RunForm};
use crate::domain::command::Direction;

impl RunCommand {
    /// The word that stops a motor that was last ordered to run in direction `after`.
    #[must_use]
    pub fn stop_word(&self, after: Option<Direction>) -> u16 {
        let run = match after {
            Some(Direction::Forward) => Some(&self.forward),
            Some(Direction::Reverse) => self.reverse.as_ref(),
            None => None,
        };
        let keeps = self.stop_bits.keeps;
        run.map_or(self.stop.value, |run| {
            self.stop.value & !keeps | run.value & keeps
        })
    }

    /// Whether `word` is a stop, after whatever order.
    #[must_use]
    pub(super) fn is_stop(&self, word: u16) -> bool {
        [None, Some(Direction::Forward), Some(Direction::Reverse)]
            .iter()
            .any(|after| self.stop_word(*after) == word)
    }

    /// The bits beside those that run the motor that a stop changes after an order to run in direction `after`, although
    /// the file does not say so. Where each word is one command, its bits say nothing.
    #[must_use]
    pub fn changed_by_stop(&self, after: Direction) -> u16 {
        let RunForm::Bits { bits, fields, .. } = &self.form else {
            return 0;
        };
        let Some(run) = (match after {
            Direction::Forward => Some(&self.forward),
            Direction::Reverse => self.reverse.as_ref(),
        }) else {
            return 0;
        };
        let stop = self.stop_word(Some(after));
        let changed = (run.value ^ stop) & !self.stop_bits.drops;
        let runs = |meaning: BitMeaning| meaning.turns() || meaning == BitMeaning::Stop;
        let of_bits = bits
            .iter()
            .filter(|bit| !runs(bit.meaning))
            .map(|bit| 1_u16 << (bit.bit.value & 15));
        // A field that says nothing changes nothing.
        let says_else = |field: &&RunField| {
            let mask = field.mask.value;
            let said = field
                .values
                .iter()
                .find(|(value, _)| value << mask.trailing_zeros() & mask == stop & mask);
            said.and_then(|(_, meaning)| *meaning)
                .is_some_and(|meaning| !runs(meaning))
        };
        let of_fields = fields
            .iter()
            .filter(says_else)
            .map(|field| field.mask.value);
        changed & of_bits.chain(of_fields).fold(0, |all, bits| all | bits)
    }
}
