//! The register that shows the output frequency, as the gateway watches it: a magnitude in steps, and a sign.

use super::bases::FrequencyBases;
use crate::domain::address::Address;
use crate::domain::frequency::Hertz;
use crate::profile::model::{FactPart, Model, Register, RegisterRole};

/// Steps per hertz in which an output of two words is watched.
const PAIR_SCALE: u32 = 100;

/// What a drive is believed to reach whose model states no range: spindle drives come to this.
const RANGE_UNSTATED: Hertz = Hertz::from_millihertz(1_000_000);

/// The register of the output frequency.
#[derive(Clone, Debug)]
pub struct OutputRegister {
    register: Register,
    range: Hertz,
}

impl OutputRegister {
    /// The output frequency register of `model`, if it has one.
    #[must_use]
    pub fn of(model: &Model) -> Option<Self> {
        let command = model
            .register_for(RegisterRole::FrequencyCommand)
            .filter(|it| it.is_exact());
        let range =
            command.and_then(|it| it.magnitude((*it.range.as_ref()?.end()).into(), |_| None));
        let range = range.unwrap_or(RANGE_UNSTATED);
        model
            .register_for(RegisterRole::OutputFrequency)
            .cloned()
            .map(|register| {
                // What its steps are, another register says.
                let is_known = register.form.scale_by.is_none();
                Self {
                    register,
                    range: if is_known {
                        range
                    } else {
                        Hertz::from_millihertz(u32::MAX)
                    },
                }
            })
    }

    /// Where it is.
    #[must_use]
    pub const fn address(&self) -> Address {
        self.register.address
    }

    /// The highest frequency that the drive can be set to, as far as its model states it.
    #[must_use]
    pub const fn range(&self) -> Hertz {
        self.range
    }

    /// The magnitude that `words`, read from `first` on, show; 0 only for 0. `None` if they do not cover it.
    #[must_use]
    pub fn steps(&self, first: Address, words: &[u16]) -> Option<u16> {
        let number = self.number(first, words)?.unsigned_abs();
        let steps = match self.register.form.pair {
            Some(_) => (number * u64::from(PAIR_SCALE * self.register.form.per))
                .div_ceil(self.register.scale.into()),
            None => number,
        };
        Some(u16::try_from(steps).unwrap_or(u16::MAX))
    }

    /// Whether `words`, read from `first` on, show reverse, if the sign does so and the motor turns. Where the
    /// documents state no sign, a number above 0 may be a magnitude and shows no direction.
    #[must_use]
    pub fn is_reverse(&self, first: Address, words: &[u16]) -> Option<Option<bool>> {
        let number = self.number(first, words)?;
        let is_stated = !self.register.not_stated.contains(&FactPart::Sign);
        let is_shown =
            self.register.form.sign_is_direction && (number < 0 || (number > 0 && is_stated));
        Some(is_shown.then_some(number < 0))
    }

    /// The steps of a hertz.
    #[must_use]
    pub fn steps_per_hertz(&self, bases: &FrequencyBases) -> u32 {
        if self.register.form.pair.is_some() {
            return PAIR_SCALE;
        }
        if self.register.is_exact() {
            return self.register.scale;
        }
        // Without its full scale, a hundredth of it is taken for a hertz: more is noticed rather than less.
        let fraction = self
            .register
            .form
            .full_scale
            .as_ref()
            .map(|scale| scale.steps / 100);
        let hertz = Hertz::from_millihertz(1000);
        let of_hertz = self
            .register
            .words_within((Hertz::ZERO, hertz), |address| bases.word(address));
        of_hertz
            .map(|(_, steps)| steps.into())
            .or(fraction)
            .unwrap_or(self.register.scale)
            .max(1)
    }

    /// The frequency of a magnitude; `None` if its full scale is not known.
    #[must_use]
    pub fn frequency(&self, steps: u16, bases: &FrequencyBases) -> Option<Hertz> {
        if self.register.form.pair.is_some() {
            return Some(Hertz::from_word(steps, PAIR_SCALE));
        }
        if self.register.is_exact() {
            return Some(Hertz::from_word(steps, self.register.scale));
        }
        self.register
            .magnitude(steps.into(), |address| bases.word(address))
    }

    fn number(&self, first: Address, words: &[u16]) -> Option<i64> {
        self.register
            .number(|address| address.word_in(first, words))
    }
}
