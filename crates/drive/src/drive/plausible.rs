//! Whether a drive is one of its model, by what each of them shows: only then are its registers where the model has them. It
//! is looked at when the drive has come into sight, before anything else of it is believed.

use crate::domain::address::Address;
use crate::profile::model::{Model, Register};

/// What was seen of the registers with a range of what is plausible.
#[derive(Clone, Debug)]
pub struct RangePlausibility {
    /// Each register with whether its last reading was in its range.
    registers: Vec<(Register, Option<bool>)>,
    /// All registers have been in their ranges since the drive has come into sight.
    holds: bool,
}

/// What a reading changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlausibilityVerdict {
    /// The drive is one of its model.
    Holds,
    /// The drive is not one of its model: this register held this word.
    Fails(Address, u16),
}

impl RangePlausibility {
    /// The plausibility of a drive of `model` of which nothing was read; it holds if the model asks for nothing.
    #[must_use]
    pub fn of(model: &Model) -> Self {
        let asked = model
            .registers
            .iter()
            .filter(|register| register.plausible.is_some());
        let registers: Vec<_> = asked.map(|register| (register.clone(), None)).collect();
        Self {
            holds: registers.is_empty(),
            registers,
        }
    }

    /// Whether the drive is believed.
    #[must_use]
    pub const fn holds(&self) -> bool {
        self.holds
    }

    /// Takes the words that were read from `first` on. `None` if they change nothing.
    pub fn take(&mut self, first: Address, words: &[u16]) -> Option<PlausibilityVerdict> {
        if self.holds {
            return None;
        }
        let mut failed = None;
        for (register, seen) in &mut self.registers {
            let Some(word) = register.address.word_in(first, words) else {
                continue;
            };
            let number = register.number_in(word);
            let is_in = register.plausible.as_ref().is_some_and(|range| {
                (i64::from(*range.start())..=i64::from(*range.end())).contains(&number)
            });
            if !is_in && *seen != Some(false) {
                failed = Some(PlausibilityVerdict::Fails(register.address, word));
            }
            *seen = Some(is_in);
        }
        self.holds = self.registers.iter().all(|(_, seen)| *seen == Some(true));
        if self.holds {
            Some(PlausibilityVerdict::Holds)
        } else {
            failed
        }
    }

    /// The drive is out of sight: it may be another one when it is back.
    pub fn forget(&mut self) {
        self.registers.iter_mut().for_each(|(_, seen)| *seen = None);
        self.holds = self.registers.is_empty();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vendors::testing::model;

    /// Two registers of the test model, with ranges.
    fn asked() -> (RangePlausibility, [Address; 2]) {
        let mut model = model();
        let readable: Vec<_> = model
            .registers
            .iter_mut()
            .filter(|it| it.access.can_read())
            .take(2)
            .collect();
        let places: Vec<_> = readable.iter().map(|it| it.address).collect();
        for register in readable {
            register.signed = false;
            register.plausible = Some(150..=900);
        }
        (RangePlausibility::of(&model), [places[0], places[1]])
    }

    #[test]
    fn all_registers_must_have_been_in_their_ranges_and_then_it_holds_until_the_drive_is_away() {
        let (mut it, [first, second]) = asked();
        assert!(!it.holds());
        assert_eq!(
            it.take(first, &[540]),
            None,
            "the other one was not read yet"
        );
        assert_eq!(
            it.take(second, &[0]),
            Some(PlausibilityVerdict::Fails(second, 0))
        );
        assert_eq!(it.take(second, &[0]), None, "it is reported once");
        assert_eq!(it.take(second, &[150]), Some(PlausibilityVerdict::Holds));
        assert_eq!(
            (it.take(first, &[0]), it.holds()),
            (None, true),
            "the supply may go later"
        );
        it.forget();
        assert!(!it.holds());
        assert!(RangePlausibility::of(&model()).holds(), "nothing is asked");
    }
}
