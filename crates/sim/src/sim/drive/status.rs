//! Status words: the bits and codes for the state of a drive.

use crate::profile::model::{ClearWords, IndicatedState, MaskedWord, StatusFlag};

/// From the weakest to the strongest: if two share bits, the later one is shown.
pub(super) const FLAGS: [IndicatedState; 8] = [
    IndicatedState::Ready,
    IndicatedState::BusRun,
    IndicatedState::BusFrequency,
    IndicatedState::Reverse,
    IndicatedState::Running,
    IndicatedState::Alarm,
    IndicatedState::Stopping,
    IndicatedState::Tripped,
];

/// The word of a status register with `flags`, in the order of [`FLAGS`], and whether each is set; `None`
/// without a flag. Bits that no flag names are those of `other`.
pub(super) fn word_of_flags(flags: &[(&StatusFlag, bool)], other: u16) -> Option<u16> {
    let named = flags.iter().fold(0, |mask, (it, _)| mask | it.mask);
    let word = flags
        .iter()
        .filter(|(_, is_so)| *is_so)
        .fold(other & !named, |word, (it, _)| shown(word, it));
    let hidden = |word, it: &(&StatusFlag, bool)| {
        if it.1 {
            word
        } else {
            hidden(word, it.0, flags)
        }
    };
    (!flags.is_empty()).then(|| flags.iter().fold(word, hidden))
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
fn hidden(word: u16, flag: &StatusFlag, flags: &[(&StatusFlag, bool)]) -> u16 {
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
        flags
            .iter()
            .filter(|(_, is_so)| *is_so)
            .all(|(it, _)| it.holds(word))
    };
    let all_agree = others
        .iter()
        .find(|word| flags.iter().all(|it| agrees(**word, it)));
    let is_right = || others.iter().find(|word| is_clear(**word) && keeps(**word));
    all_agree.or_else(is_right).copied().unwrap_or(word)
}
