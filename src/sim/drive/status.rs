//! Status words: the bits and codes for the state of a drive.

use super::SimDrive;
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::profile::model::{ClearWords, IndicatedState, MaskedWord, StatusFlag};

/// From the weakest to the strongest: if two share bits, the later one is shown.
const FLAGS: [IndicatedState; 8] = [
    IndicatedState::Ready,
    IndicatedState::BusRun,
    IndicatedState::BusFrequency,
    IndicatedState::Reverse,
    IndicatedState::Running,
    IndicatedState::Alarm,
    IndicatedState::Stopping,
    IndicatedState::Tripped,
];

impl SimDrive {
    /// The word of the status register at `address`; `None` if it has no flag. Bits that no flag names are
    /// those of `other`.
    pub(super) fn status_word(&self, at: MonoTime, address: Address, other: u16) -> Option<u16> {
        let flags = |flag| {
            self.model
                .status
                .iter()
                .find(move |it| it.address == address && it.flag == flag)
        };
        let here: Vec<_> = FLAGS.into_iter().filter_map(flags).collect();
        let named = here.iter().fold(0, |mask, it| mask | it.mask);
        let told: Vec<_> = here
            .iter()
            .map(|it| (*it, self.is_so(at, it.flag)))
            .collect();
        let word = told
            .iter()
            .filter(|(_, is_so)| *is_so)
            .fold(other & !named, |word, (it, _)| shown(word, it));
        let hidden = |word, it: &(&StatusFlag, bool)| {
            if it.1 {
                word
            } else {
                hidden(word, it.0, &told)
            }
        };
        (!here.is_empty()).then(|| self.with_readiness(at, address, told.iter().fold(word, hidden)))
    }

    /// Whether `flag` is set at `at`.
    fn is_so(&self, at: MonoTime, flag: IndicatedState) -> bool {
        let output = self.motor.output(at);
        let direction = self.control.direction * self.setpoint_sign();
        match flag {
            IndicatedState::Running => self.shows_running(at),
            IndicatedState::Reverse => output < 0 || (output == 0 && direction < 0),
            IndicatedState::Stopping => output != 0 && direction == 0,
            IndicatedState::Tripped => self.tripped,
            IndicatedState::Alarm => self.alarm,
            IndicatedState::Ready => !self.tripped,
            IndicatedState::BusRun => self.is_run_from_bus(),
            IndicatedState::BusFrequency => self.is_frequency_from_bus(),
        }
    }
}

/// `word` with `flag` set.
fn shown(word: u16, flag: &StatusFlag) -> u16 {
    if flag.holds(word) {
        return word;
    }
    (word & !flag.mask) | flag.values.first().copied().unwrap_or_default()
}

/// `word` with `flag` cleared, by a word that documents name, or by the smallest change of a bit, so that the set flags are
/// unchanged.
fn hidden(word: u16, flag: &StatusFlag, told: &[(&StatusFlag, bool)]) -> u16 {
    let is_clear = |word: u16| flag.reads(word) == Some(false);
    if is_clear(word) {
        return word;
    }
    let bits = (0..16)
        .map(|bit| 1 << bit)
        .filter(|bit| flag.mask & bit != 0);
    let named: &[MaskedWord] = match &flag.clear {
        ClearWords::Others => &[],
        ClearWords::Named(named) => named.as_slice(),
    };
    let named = named.iter().map(|it| (word & !it.mask) | it.value);
    let others: Vec<_> = std::iter::once(word & !flag.mask)
        .chain(bits.map(|bit| word ^ bit))
        .chain(named)
        .collect();
    let agrees = |word: u16, (it, is_so): &(&StatusFlag, bool)| it.reads(word) == Some(*is_so);
    let keeps = |word: u16| {
        told.iter()
            .filter(|(_, is_so)| *is_so)
            .all(|(it, _)| it.holds(word))
    };
    let all_agree = others
        .iter()
        .find(|word| told.iter().all(|it| agrees(**word, it)));
    let is_right = || others.iter().find(|word| is_clear(**word) && keeps(**word));
    all_agree.or_else(is_right).copied().unwrap_or(word)
}
