//! Frequencies in exact decimal steps, so that a limit or a setpoint never depends on binary rounding.

use std::fmt;

/// How far a number may be from a step and still be that step: programs count in binary fractions, and a sum of tenths is a
/// little beside them. A millionth of 0.01 Hz, the finest step of any drive.
const NOISE_HZ: f64 = 1e-8;

/// A frequency in thousandths of a hertz, 0 to 4,294,967.295 Hz. No drive has steps finer than hundredths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Hertz {
    milli: u32,
}

/// Why a value is not a frequency.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoFrequency {
    /// Not a number, or infinite.
    #[error("not a number")]
    NotANumber,
    /// Below zero or above the range of [`Hertz`].
    #[error("out of range")]
    OutOfRange,
    /// Finer than a thousandth of a hertz.
    #[error("finer than 0.001 Hz")]
    TooFine,
}

impl Hertz {
    /// Standstill.
    pub const ZERO: Self = Self { milli: 0 };

    /// The frequency of `milli` thousandths of a hertz.
    #[must_use]
    pub const fn from_millihertz(milli: u32) -> Self {
        Self { milli }
    }

    /// The frequency of `centi` hundredths of a hertz, as the uniform registers carry it.
    #[must_use]
    pub const fn from_centihertz(centi: u16) -> Self {
        Self {
            milli: centi as u32 * 10,
        }
    }

    /// Thousandths of a hertz.
    #[must_use]
    pub const fn millihertz(self) -> u32 {
        self.milli
    }

    /// Hundredths of a hertz, if it is a whole number of them that fits into a register.
    #[must_use]
    pub fn centihertz(self) -> Option<u16> {
        if self.milli.is_multiple_of(10) {
            u16::try_from(self.milli / 10).ok()
        } else {
            None
        }
    }

    /// The frequency that `hertz` is, but for the noise of binary fractions.
    ///
    /// # Errors
    /// [`NoFrequency`] if the value lies between thousandths: it is neither rounded nor clamped.
    pub fn from_f64(hertz: f64) -> Result<Self, NoFrequency> {
        if !hertz.is_finite() {
            return Err(NoFrequency::NotANumber);
        }
        let milli = (hertz * 1000.0).round();
        if !(0.0..=f64::from(u32::MAX)).contains(&milli) || hertz < -NOISE_HZ {
            return Err(NoFrequency::OutOfRange);
        }
        let frequency = Self {
            milli: milli as u32,
        };
        if (frequency.as_f64() - hertz).abs() <= NOISE_HZ {
            Ok(frequency)
        } else {
            Err(NoFrequency::TooFine)
        }
    }

    /// Parses a frequency in decimal, such as `42.5`.
    ///
    /// # Errors
    /// [`NoFrequency`]. A comma, a unit or an exponent is not accepted, except one below zero, as programs write what a sum
    /// has left of 0.
    pub fn parse(text: &str) -> Result<Self, NoFrequency> {
        Self::from_f64(decimal(text).ok_or(NoFrequency::NotANumber)?)
    }

    /// Twice as much.
    #[must_use]
    pub const fn doubled(self) -> Self {
        Self {
            milli: self.milli.saturating_mul(2),
        }
    }

    /// In hertz, as the nearest binary number.
    #[must_use]
    pub fn as_f64(self) -> f64 {
        f64::from(self.milli) / 1000.0
    }

    /// The raw word for a register of `scale` steps per hertz. `None` if the frequency lies between two steps or does
    /// not fit into the word.
    #[must_use]
    pub fn to_word(self, scale: u32) -> Option<u16> {
        u16::try_from(self.to_steps(scale)?).ok()
    }

    /// The raw number for a register of two words with `scale` steps per hertz. `None` if the frequency lies between
    /// two steps or does not fit.
    #[must_use]
    pub fn to_steps(self, scale: u32) -> Option<u32> {
        let steps = u64::from(self.milli) * u64::from(scale);
        if steps.is_multiple_of(1000) {
            u32::try_from(steps / 1000).ok()
        } else {
            None
        }
    }

    /// The frequency that `word` means in a register of `scale` steps per hertz, to the nearest thousandth.
    #[must_use]
    pub fn from_word(word: u16, scale: u32) -> Self {
        let milli = (u64::from(word) * 1000 + u64::from(scale) / 2) / u64::from(scale.max(1));
        Self {
            milli: u32::try_from(milli).unwrap_or(u32::MAX),
        }
    }
}

/// The number that `text` is in decimal; an exponent is accepted only below zero, as in `2.8e-17`.
#[must_use]
pub fn decimal(text: &str) -> Option<f64> {
    let (number, exponent) = text
        .split_once(['e', 'E'])
        .map_or((text, None), |(number, rest)| (number, Some(rest)));
    let is_plain = number
        .bytes()
        .all(|byte| byte.is_ascii_digit() || matches!(byte, b'.' | b'-' | b'+'));
    let is_small = exponent.is_none_or(|exponent| exponent.starts_with('-'));
    if is_plain && is_small {
        text.parse().ok()
    } else {
        None
    }
}

impl fmt::Display for Hertz {
    /// In hertz with two decimals, three where they are needed.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let whole = self.milli / 1000;
        let milli = self.milli % 1000;
        if milli.is_multiple_of(10) {
            write!(f, "{whole}.{:02}", milli / 10)
        } else {
            write!(f, "{whole}.{milli:03}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_exact_or_refused() {
        assert_eq!(Hertz::parse("42.5"), Ok(Hertz::from_millihertz(42_500)));
        assert_eq!(Hertz::parse("0"), Ok(Hertz::ZERO));
        assert_eq!(Hertz::parse("50.0005"), Err(NoFrequency::TooFine));
        assert_eq!(Hertz::parse("-1"), Err(NoFrequency::OutOfRange));
        for no_number in ["", "4,5", "NaN", "inf", "1e3", "50 Hz", "0x10", "--1"] {
            assert_eq!(
                Hertz::parse(no_number),
                Err(NoFrequency::NotANumber),
                "{no_number}"
            );
        }
    }

    #[test]
    fn the_noise_of_a_ramp_is_no_step() {
        assert_eq!(
            Hertz::parse("30.000000000000004"),
            Ok(Hertz::from_millihertz(30_000))
        );
        assert_eq!(Hertz::parse("2.7755575615628914e-17"), Ok(Hertz::ZERO));
        assert_eq!(Hertz::from_f64(-2.8e-17), Ok(Hertz::ZERO));
        assert_eq!(Hertz::parse("30.0000001"), Err(NoFrequency::TooFine));
        assert_eq!(Hertz::from_f64(-0.000_001), Err(NoFrequency::OutOfRange));
        for (step, step_milli, steps) in [(0.1, 100, 4_000), (0.01, 10, 40_000), (0.001, 1, 40_000)]
        {
            let mut up = 0.0;
            let mut down = f64::from(steps) * step;
            for count in 0..=steps {
                let expected = Hertz::from_millihertz(count * step_milli);
                assert_eq!(Hertz::from_f64(up), Ok(expected), "{up}");
                assert_eq!(Hertz::parse(&up.to_string()), Ok(expected), "{up}");
                let left = Hertz::from_millihertz((steps - count) * step_milli);
                assert_eq!(Hertz::from_f64(down), Ok(left), "{down}");
                up += step;
                down -= step;
            }
        }
    }

    #[test]
    fn words_are_exact_or_refused() {
        assert_eq!(Hertz::from_millihertz(42_500).to_word(100), Some(4250));
        assert_eq!(
            Hertz::from_millihertz(42_505).to_word(100),
            None,
            "between two steps"
        );
        assert_eq!(
            Hertz::from_millihertz(655_360).to_word(100),
            None,
            "beyond the word"
        );
        for word in [0, 1, 4250, u16::MAX] {
            assert_eq!(Hertz::from_word(word, 100).to_word(100), Some(word));
            assert_eq!(Hertz::from_centihertz(word).centihertz(), Some(word));
        }
    }

    #[test]
    fn is_shown_with_two_decimals_or_three() {
        assert_eq!(Hertz::from_millihertz(42_500).to_string(), "42.50");
        assert_eq!(Hertz::from_millihertz(5).to_string(), "0.005");
    }
}
