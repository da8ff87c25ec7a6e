//! Conversion between raw words of a register and values in its unit, exact in decimal.

use super::model::{Model, Register, RegisterRole};
use std::fmt;

/// A value as the drive holds it: `raw / scale`, kept as two integers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ScaledValue {
    raw: i64,
    scale: u32,
}

impl ScaledValue {
    /// `raw / scale`.
    #[must_use]
    pub const fn new(raw: i64, scale: u32) -> Self {
        Self { raw, scale }
    }

    /// The number in `decimal` with as many decimals, at most nine.
    #[must_use]
    pub(super) fn of_decimal(decimal: Decimal) -> Self {
        Self {
            raw: decimal.steps,
            scale: 10_u32.saturating_pow(decimal.digits.min(9).into()),
        }
    }

    /// The value that `word` represents in `register`, which has one word and needs no other.
    #[must_use]
    pub fn from_word(word: u16, register: &Register) -> Self {
        Self {
            raw: register.number_in(word),
            scale: register.scale,
        }
    }

    /// Numerator and denominator.
    #[must_use]
    pub const fn fraction(self) -> (i64, i64) {
        (self.raw, self.scale as i64)
    }

    /// The value rounded to this many decimals.
    #[must_use]
    pub fn to_digits(self, digits: u8) -> Decimal {
        Decimal::nearest(self.raw, self.scale.into(), digits)
    }

    /// The value in the register's unit, as the nearest `f64`.
    #[must_use]
    pub fn value(self) -> f64 {
        self.raw as f64 / f64::from(self.scale)
    }
}

impl fmt::Display for ScaledValue {
    /// Prints as many decimals as the scale has zeros (raw 6000 of scale 100 is `60.00`); for other scales, as
    /// many as the value needs.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let decimals = self.scale.ilog10();
        if 10_u32.pow(decimals) != self.scale {
            return write!(f, "{}", self.value());
        }
        let whole = self.raw.unsigned_abs() / u64::from(self.scale);
        let part = self.raw.unsigned_abs() % u64::from(self.scale);
        let sign = if self.raw < 0 { "-" } else { "" };
        if decimals == 0 {
            return write!(f, "{sign}{whole}");
        }
        write!(f, "{sign}{whole}.{part:0width$}", width = decimals as usize)
    }
}

/// A number with a fixed count of decimals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Decimal {
    steps: i64,
    digits: u8,
}

impl Decimal {
    /// `steps` of the last of this many decimals.
    #[must_use]
    pub const fn new(steps: i64, digits: u8) -> Self {
        Self { steps, digits }
    }

    /// `numerator / denominator`, rounded to this many decimals; `denominator` must be above 0. A nonzero value is never
    /// rounded to zero: a slowly turning motor must not appear to stand still.
    #[must_use]
    pub fn nearest(numerator: i64, denominator: i64, digits: u8) -> Self {
        let numerator = i128::from(numerator) * 10_i128.pow(digits.into());
        let denominator = i128::from(denominator);
        let away = (numerator.abs() * 2 + denominator) / (denominator * 2);
        let steps = numerator.signum() * away.max(numerator.abs().min(1));
        Self {
            steps: i64::try_from(steps).unwrap_or(if steps < 0 { i64::MIN } else { i64::MAX }),
            digits,
        }
    }

    /// The number, as the nearest `f64`.
    #[must_use]
    pub fn value(self) -> f64 {
        self.steps as f64 / 10_f64.powi(self.digits.into())
    }

    /// The number without its decimals.
    #[must_use]
    pub fn whole(self) -> i64 {
        self.steps / 10_i64.saturating_pow(self.digits.into()).max(1)
    }
}

impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.steps < 0 { "-" } else { "" };
        let size = self.steps.unsigned_abs();
        let one = 10_u64.saturating_pow(self.digits.into());
        match self.digits {
            0 => write!(f, "{sign}{size}"),
            digits => write!(
                f,
                "{sign}{}.{:0width$}",
                size / one,
                size % one,
                width = digits.into()
            ),
        }
    }
}

/// How far a number may be from a step and still be that step.
const NOISE_STEPS: f64 = 1e-6;

/// Decimals of a value of `scale` steps per unit. If `scale` is not a power of ten, a value may need any number of
/// decimals; the result is then a sensible maximum.
#[must_use]
pub fn digits_of(scale: u32) -> u8 {
    const MOST: u8 = 4;
    let digits = scale.checked_ilog10().unwrap_or(0);
    if 10_u32.pow(digits) == scale {
        u8::try_from(digits).unwrap_or(MOST)
    } else {
        MOST
    }
}

/// The step of the setpoint of drives of `model`, in hertz; `None` where that is no decimal fraction, or there is none.
#[must_use]
pub fn setpoint_step(model: &Model) -> Option<Decimal> {
    let register = model
        .register_for(RegisterRole::FrequencyCommand)
        .filter(|register| register.is_exact())?;
    Some(Decimal::nearest(
        1,
        register.scale.into(),
        digits_of(register.scale),
    ))
}

/// Why a value has no raw word.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoWord {
    /// Not a number, or infinite.
    #[error("not a number")]
    NotANumber,
    /// Outside the range of the register's word.
    #[error("outside {least} to {most}")]
    OutOfRange {
        /// The least value that the word can hold.
        least: ScaledValue,
        /// The greatest value that the word can hold.
        most: ScaledValue,
    },
    /// Between two steps of the register.
    #[error("finer than the register's steps of 1/{scale}")]
    BetweenSteps {
        /// Steps per unit.
        scale: u32,
    },
}

/// The raw word for `value`, in the unit of `register`. Nothing is rounded or clamped: the value must be a step of the
/// register, but for the noise of binary fractions.
///
/// # Errors
/// The word cannot hold the value.
pub fn to_raw(value: f64, register: &Register) -> Result<u16, NoWord> {
    // In two's complement, the low word of a negative number is its register word.
    steps(value, register.scale, register.signed).map(|raw| (raw & 0xFFFF) as u16)
}

/// The number that the two words of `register` hold for `value`, in its unit. Nothing is rounded or clamped, as in
/// [`to_raw`].
///
/// # Errors
/// The words cannot hold the value.
pub fn to_both(value: f64, register: &Register) -> Result<u32, NoWord> {
    let ends = if register.signed {
        (i32::MIN.into(), i32::MAX.into())
    } else {
        (0, u32::MAX.into())
    };
    steps_within(value, register.scale, ends).map(|raw| (raw & 0xFFFF_FFFF) as u32)
}

/// Like [`to_raw`], but returns the number before encoding and needs no [`Register`].
pub(super) fn steps(value: f64, scale: u32, signed: bool) -> Result<i32, NoWord> {
    let ends = if signed {
        (i16::MIN.into(), i16::MAX.into())
    } else {
        (0, u16::MAX.into())
    };
    steps_within(value, scale, ends).map(|raw| raw as i32)
}

fn steps_within(value: f64, scale: u32, (least, most): (i64, i64)) -> Result<i64, NoWord> {
    if !value.is_finite() {
        return Err(NoWord::NotANumber);
    }
    let steps = value * f64::from(scale);
    let raw = steps.round() as i64;
    if !(least..=most).contains(&raw) {
        return Err(NoWord::OutOfRange {
            least: ScaledValue { raw: least, scale },
            most: ScaledValue { raw: most, scale },
        });
    }
    // Programs count in binary fractions.
    if (steps - raw as f64).abs() > NOISE_STEPS {
        return Err(NoWord::BetweenSteps { scale });
    }
    Ok(raw)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;
    use crate::profile::testing::MODEL;

    fn register(scale: u32, signed: bool) -> Register {
        let mut register = check::model(MODEL).unwrap().registers.remove(0);
        register.scale = scale;
        register.signed = signed;
        register
    }

    #[test]
    fn values_show_the_decimals_of_their_scale() {
        let table = [
            (6000, 100, false, "60.00"),
            (100, 10, false, "10.0"),
            (5, 1000, false, "0.005"),
            (0, 100, false, "0.00"),
            (0xFFFF, 1, false, "65535"),
            (0xFFFF, 100, true, "-0.01"),
            (0x8000, 1, true, "-32768"),
            (3, 4, false, "0.75"),
        ];
        for (word, scale, signed, text) in table {
            assert_eq!(
                ScaledValue::from_word(word, &register(scale, signed)).to_string(),
                text
            );
        }
    }

    #[test]
    fn rounding_goes_to_the_nearest_and_never_to_zero() {
        let table = [
            (4_250, 100, 1, "42.5"),
            (4_254, 100, 1, "42.5"),
            (4_255, 100, 1, "42.6"),
            (-4_255, 100, 1, "-42.6"),
            (4_950, 100, 0, "50"),
            (4, 100, 1, "0.1"),
            (-4, 100, 1, "-0.1"),
            (-1, 100, 0, "-1"),
            (0, 100, 1, "0.0"),
            (995, 100, 1, "10.0"),
            (3, 4, 1, "0.8"),
            (i64::MAX, 1, 0, "9223372036854775807"),
        ];
        for (numerator, denominator, digits, text) in table {
            let decimal = Decimal::nearest(numerator, denominator, digits);
            assert_eq!(decimal.to_string(), text);
            let shown: f64 = text.parse().unwrap();
            assert!(
                (decimal.value() - shown).abs() <= shown.abs() * f64::EPSILON,
                "{text}"
            );
        }
        assert_eq!([1, 10, 100, 1000, 4, 7].map(digits_of), [0, 1, 2, 3, 4, 4]);
    }

    #[test]
    fn with_all_its_digits_a_value_is_what_it_was() {
        for (scale, signed) in [(1, false), (10, true), (100, false), (1000, true)] {
            let register = register(scale, signed);
            for word in 0..=u16::MAX {
                let scaled = ScaledValue::from_word(word, &register);
                let decimal = scaled.to_digits(digits_of(scale));
                assert_eq!(
                    (decimal.to_string(), decimal.value()),
                    (scaled.to_string(), scaled.value())
                );
            }
        }
    }

    #[test]
    fn every_word_comes_back_from_its_own_text() {
        for (scale, signed) in [
            (1, false),
            (10, true),
            (100, false),
            (1000, true),
            (7, false),
        ] {
            let register = register(scale, signed);
            for word in 0..=u16::MAX {
                let text = ScaledValue::from_word(word, &register).to_string();
                assert_eq!(to_raw(text.parse().unwrap(), &register), Ok(word), "{text}");
            }
        }
    }

    #[test]
    fn nothing_is_clamped_or_rounded() {
        let hertz = register(100, false);
        assert_eq!(to_raw(f64::NAN, &hertz), Err(NoWord::NotANumber));
        assert_eq!(to_raw(f64::INFINITY, &hertz), Err(NoWord::NotANumber));
        assert_eq!(
            to_raw(50.005, &hertz),
            Err(NoWord::BetweenSteps { scale: 100 })
        );
        assert_eq!(
            to_raw(655.36, &hertz).unwrap_err().to_string(),
            "outside 0.00 to 655.35"
        );
        assert_eq!(
            to_raw(-0.01, &hertz).unwrap_err().to_string(),
            "outside 0.00 to 655.35"
        );
        assert_eq!(
            to_raw(3276.8, &register(10, true)).unwrap_err().to_string(),
            "outside -3276.8 to 3276.7"
        );
        assert_eq!(to_raw(-0.0, &hertz), Ok(0));
    }
}
