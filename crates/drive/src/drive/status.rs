//! The status flags of a drive, kept from one reading to the next.

use super::output::OutputRegister;
use super::view::StatusView;
use crate::domain::address::Address;
use crate::profile::model::{IndicatedState, Model, StatusFlag};

/// Most undocumented words that are reported for one drive: a register that holds anything is no status.
const UNDOCUMENTED_MAX: usize = 16;

/// A word of a status register that no document names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UndocumentedState {
    /// The register.
    pub address: Address,
    /// What it holds.
    pub word: u16,
}

/// The flags of one drive as last read.
#[derive(Clone, Debug, Default)]
pub struct StatusWatch {
    flags: Vec<(StatusFlag, Option<bool>)>,
    /// The last word read that no document names, as long as its register holds one.
    undocumented: Option<UndocumentedState>,
    /// The undocumented words that were reported.
    reported: Vec<UndocumentedState>,
    /// The output whose sign is the direction, and whether it shows reverse; only without a flag for that.
    sign: Option<(OutputRegister, Option<bool>)>,
}

impl StatusWatch {
    /// The watch of a drive of `model`, with all flags unknown. It has none on a model without status registers.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        let sign = match OutputRegister::of(model) {
            Some(output) if model.status_flag(IndicatedState::Reverse).is_none() => {
                Some((output, None))
            }
            _ => None,
        };
        Self {
            flags: model
                .status
                .iter()
                .map(|flag| (flag.clone(), None))
                .collect(),
            sign,
            ..Self::default()
        }
    }

    /// Takes the words that a read from `address` on has brought. Returns whether they show the motor ordered to run;
    /// nothing if they do not tell. A word that no document names tells nothing: what it was before is not known any more.
    pub fn take(&mut self, address: Address, words: &[u16]) -> Option<bool> {
        if let Some((output, sign)) = &mut self.sign
            && let Some(seen) = output.is_reverse(address, words)
        {
            *sign = seen;
        }
        let mut running = None;
        let mut undocumented = None;
        for (flag, value) in &mut self.flags {
            if let Some(word) = flag.address.word_in(address, words) {
                *value = flag.reads(word);
                running = if flag.flag == IndicatedState::Running {
                    *value
                } else {
                    running
                };
                if value.is_none() {
                    undocumented = Some(UndocumentedState {
                        address: flag.address,
                        word,
                    });
                }
            }
        }
        let was_read = |known: &UndocumentedState| known.address.word_in(address, words).is_some();
        if undocumented.is_some() || self.undocumented.as_ref().is_some_and(was_read) {
            self.undocumented = undocumented;
        }
        running
    }

    /// The word that a status register holds and no document names.
    #[must_use]
    pub const fn undocumented(&self) -> Option<UndocumentedState> {
        self.undocumented
    }

    /// The word that a status register holds and no document names, returned once for each word.
    pub fn take_undocumented(&mut self) -> Option<UndocumentedState> {
        let state = self
            .undocumented
            .filter(|state| !self.reported.contains(state))?;
        (self.reported.len() < UNDOCUMENTED_MAX).then(|| {
            self.reported.push(state);
            state
        })
    }

    /// Discards everything: the drive is offline.
    pub fn forget(&mut self) {
        self.flags.iter_mut().for_each(|(_, value)| *value = None);
        self.undocumented = None;
        if let Some((_, value)) = &mut self.sign {
            *value = None;
        }
    }

    /// Whether `flag` is set; `None` if the model has no such flag or it has not been read yet.
    #[must_use]
    pub fn get(&self, flag: IndicatedState) -> Option<bool> {
        if let Some((_, value)) = self.flags.iter().find(|(it, _)| it.flag == flag) {
            return *value;
        }
        match self.sign {
            Some((_, value)) if flag == IndicatedState::Reverse => value,
            _ => None,
        }
    }

    /// Whether the drive shows its motor as ordered to run. It does not while it ramps down.
    #[must_use]
    pub fn is_running(&self) -> Option<bool> {
        self.get(IndicatedState::Running)
    }

    /// The flags shown besides run state and trips.
    #[must_use]
    pub fn view(&self) -> StatusView {
        StatusView {
            bus_run: self.get(IndicatedState::BusRun),
            bus_frequency: self.get(IndicatedState::BusFrequency),
            alarm: self.get(IndicatedState::Alarm),
            ready: self.get(IndicatedState::Ready),
            undocumented: self.undocumented,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vendors::testing::{model, with_status};

    #[test]
    fn a_flag_is_known_once_its_register_was_read() {
        let mut watch = StatusWatch::new(&with_status());
        assert_eq!(watch.get(IndicatedState::Running), None);
        assert_eq!(watch.take(0x2100_u16.into(), &[0b0101, 7]), Some(true));
        assert_eq!(
            (
                watch.get(IndicatedState::Running),
                watch.get(IndicatedState::Reverse)
            ),
            (Some(true), Some(false))
        );
        watch.take(0x20FF_u16.into(), &[0, 0b1010]);
        assert_eq!(
            (
                watch.get(IndicatedState::Reverse),
                watch.get(IndicatedState::Tripped)
            ),
            (Some(true), Some(true))
        );
        assert_eq!(watch.take(0x2101_u16.into(), &[0]), None);
        assert_eq!(
            watch.get(IndicatedState::Tripped),
            Some(true),
            "another register"
        );
        watch.forget();
        assert_eq!(watch.get(IndicatedState::Running), None);
    }

    #[test]
    fn a_model_without_such_flags_tells_nothing() {
        let mut watch = StatusWatch::new(&model());
        watch.take(0x0000_u16.into(), &[0xFFFF; 16]);
        assert_eq!(watch.get(IndicatedState::Running), None);
    }
}
