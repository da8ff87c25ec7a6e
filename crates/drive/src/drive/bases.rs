//! What the setpoint and the output frequency of a drive are fractions of, as the drive has shown it since it came back.

use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::profile::model::{Model, Register, RegisterRole};
use std::time::Duration;

/// The words of the registers on which the frequencies of one drive depend.
#[derive(Clone, Debug, Default)]
pub struct FrequencyBases {
    known: Vec<(Address, Option<KnownBasis>)>,
    /// The age from which they are stale; `None` for never.
    limit: Option<Duration>,
}

/// What a register on which frequencies depend held last.
#[derive(Clone, Copy, Debug)]
struct KnownBasis {
    word: u16,
    at: MonoTime,
    /// No other word was read since the drive came back, or this one was read again.
    is_settled: bool,
}

impl FrequencyBases {
    /// The bases of a drive of `model`, none of which is known. There are none on most models.
    #[must_use]
    pub fn of(model: &Model) -> Self {
        let output = model.register_for(RegisterRole::OutputFrequency);
        let registers = [
            model.register_for(RegisterRole::FrequencyCommand),
            model.setting_register(),
            output,
        ];
        let mut addresses: Vec<_> = registers
            .into_iter()
            .flatten()
            .flat_map(|it| it.form.bases())
            .collect();
        addresses.sort_unstable();
        addresses.dedup();
        Self {
            known: addresses
                .into_iter()
                .map(|address| (address, None))
                .collect(),
            limit: None,
        }
    }

    /// Takes the words that a read from `first` on brought. Returns the first register that holds another word than before.
    pub fn take(&mut self, first: Address, words: &[u16], at: MonoTime) -> Option<Address> {
        let mut changed = None;
        for (address, known) in &mut self.known {
            let Some(word) = address.word_in(first, words) else {
                continue;
            };
            let is_settled = known.is_none_or(|last| last.word == word);
            *known = Some(KnownBasis {
                word,
                at,
                is_settled,
            });
            changed = changed.or((!is_settled).then_some(*address));
        }
        changed
    }

    /// Sets the age from which they are stale.
    pub const fn stale_after(&mut self, limit: Duration) {
        self.limit = Some(limit);
    }

    /// Discards everything: the drive is offline.
    pub fn forget(&mut self) {
        self.known.iter_mut().for_each(|(_, known)| *known = None);
    }

    /// The last word of the register at `address`; `None` if it is not known.
    #[must_use]
    pub fn word(&self, address: Address) -> Option<u16> {
        self.find(address).map(|known| known.word)
    }

    /// Whether all that `register` depends on is known at `now`, not stale, and not in the course of a change.
    #[must_use]
    pub fn are_sure(&self, register: &Register, now: MonoTime) -> bool {
        let is_sure = |known: KnownBasis| {
            known.is_settled && self.limit.is_none_or(|limit| now.since(known.at) < limit)
        };
        register
            .form
            .bases()
            .all(|address| self.find(address).is_some_and(is_sure))
    }

    fn find(&self, address: Address) -> Option<KnownBasis> {
        self.known.iter().find(|(it, _)| *it == address)?.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_is_believed_when_it_was_read_twice() {
        let address = Address::holding(0x0010);
        let mut bases = FrequencyBases {
            known: vec![(address, None)],
            limit: None,
        };
        let at = MonoTime::from_millis;
        let settled =
            |bases: &FrequencyBases| bases.find(address).is_some_and(|known| known.is_settled);
        assert_eq!((bases.word(address), settled(&bases)), (None, false));
        assert_eq!(bases.take(0x000F_u16.into(), &[1, 5000], at(1)), None);
        assert_eq!((bases.word(address), settled(&bases)), (Some(5000), true));
        assert_eq!(bases.take(address, &[6000], at(2)), Some(address));
        assert!(!settled(&bases), "it may be misread");
        assert_eq!(bases.take(address, &[6000], at(3)), None);
        assert!(settled(&bases));
        bases.forget();
        assert_eq!(bases.word(address), None);
    }
}
