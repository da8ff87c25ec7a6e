//! The value of a register, worked out from the words of the drive. This is the only place that knows how.

use super::model::{AddendWord, BasisRegister, FractionWhole, FullScale, Register};
use super::scale::{Decimal, ScaledValue, digits_of};
use crate::domain::address::Address;
use crate::domain::frequency::Hertz;

/// Decimals of a fraction of a full scale: thousandths, as frequencies have them.
const FRACTION_DIGITS: u8 = 3;
/// Most decimals of any other value.
const DIGITS_MAX: u8 = 4;

/// An exact fraction with a denominator above 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ratio {
    numerator: i128,
    denominator: i128,
}

impl Ratio {
    /// `None` without a denominator above 0.
    #[must_use]
    pub const fn new(numerator: i128, denominator: i128) -> Option<Self> {
        if denominator > 0 {
            Some(Self {
                numerator,
                denominator,
            })
        } else {
            None
        }
    }

    const fn plus(self, other: Self) -> Option<Self> {
        let Some(left) = self.numerator.checked_mul(other.denominator) else {
            return None;
        };
        let Some(right) = other.numerator.checked_mul(self.denominator) else {
            return None;
        };
        let Some(numerator) = left.checked_add(right) else {
            return None;
        };
        let Some(denominator) = self.denominator.checked_mul(other.denominator) else {
            return None;
        };
        Self::new(numerator, denominator)
    }

    const fn minus(self, other: Self) -> Option<Self> {
        self.plus(Self {
            numerator: -other.numerator,
            denominator: other.denominator,
        })
    }

    const fn times(self, other: Self) -> Option<Self> {
        let Some(numerator) = self.numerator.checked_mul(other.numerator) else {
            return None;
        };
        let Some(denominator) = self.denominator.checked_mul(other.denominator) else {
            return None;
        };
        Self::new(numerator, denominator)
    }

    /// Divided by another; `None` unless that is above 0.
    const fn over(self, other: Self) -> Option<Self> {
        if other.numerator <= 0 {
            return None;
        }
        self.times(Self {
            numerator: other.denominator,
            denominator: other.numerator,
        })
    }

    fn of_hertz(hertz: Hertz) -> Self {
        Self {
            numerator: hertz.millihertz().into(),
            denominator: 1000,
        }
    }

    fn floor(self) -> Option<i64> {
        i64::try_from(self.numerator.div_euclid(self.denominator)).ok()
    }

    fn ceiling(self) -> Option<i64> {
        i64::try_from(-(-self.numerator).div_euclid(self.denominator)).ok()
    }

    fn nearest(self) -> Option<i64> {
        let twice = self
            .numerator
            .checked_mul(2)?
            .checked_add(self.denominator)?;
        i64::try_from(twice.div_euclid(self.denominator.checked_mul(2)?)).ok()
    }

    const fn is_below(self, other: Self) -> bool {
        self.numerator * other.denominator < other.numerator * self.denominator
    }

    /// Rounded to decimals; a value other than 0 is never shown as 0.
    fn to_digits(self, digits: u8) -> Option<Decimal> {
        let common = gcd(
            self.numerator.unsigned_abs(),
            self.denominator.unsigned_abs(),
        );
        let common = i128::try_from(common).ok()?.max(1);
        let numerator = i64::try_from(self.numerator / common).ok()?;
        Some(Decimal::nearest(
            numerator,
            i64::try_from(self.denominator / common).ok()?,
            digits,
        ))
    }

    /// The frequency, to the nearest thousandth; `None` below 0.
    fn to_hertz(self) -> Option<Hertz> {
        if self.numerator < 0 {
            return None;
        }
        let twice = self
            .numerator
            .checked_mul(2000)?
            .checked_add(self.denominator)?;
        let milli = twice.checked_div(self.denominator.checked_mul(2)?)?;
        u32::try_from(milli).ok().map(Hertz::from_millihertz)
    }
}

const fn gcd(a: u128, b: u128) -> u128 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// The bits of `word` under `mask`, shifted down.
#[must_use]
pub fn code_under(word: u16, mask: u16) -> u16 {
    (word & mask)
        .checked_shr(mask.trailing_zeros())
        .unwrap_or(0)
}

/// The bits of `word` under `mask` as a number, shifted down: in two's complement if `signed`.
#[must_use]
pub fn field(word: u16, mask: u16, signed: bool) -> i64 {
    let bits = mask.count_ones();
    let number = i64::from(code_under(word, mask));
    let is_negative = signed && bits > 0 && number >> (bits - 1) & 1 == 1;
    if is_negative {
        number - (1 << bits)
    } else {
        number
    }
}

/// The codes of the bits that are set in `bits`, the lowest first: the number of each bit + 1.
pub fn codes_of_bits(bits: u32) -> impl Iterator<Item = u16> {
    (0..32_u16)
        .filter(move |bit| bits >> bit & 1 == 1)
        .map(|bit| bit + 1)
}

impl Register {
    /// The number that its words hold, before scaling; `None` unless `word` knows all of them.
    #[must_use]
    pub fn number(&self, word: impl Fn(Address) -> Option<u16>) -> Option<i64> {
        let first = word(self.address)?;
        let Some(order) = self.form.pair else {
            return Some(self.number_in(first));
        };
        let second = word(self.address.checked_add(1)?)?;
        let number = order.number([first, second]);
        Some(if self.signed {
            number.cast_signed().into()
        } else {
            number.into()
        })
    }

    /// The number that `word` holds in a register of one word.
    #[must_use]
    pub fn number_in(&self, word: u16) -> i64 {
        field(word, self.form.mask, self.signed)
    }

    /// The code that `word` holds: a field of it, or all of it.
    #[must_use]
    pub fn code_in(&self, word: u16) -> u16 {
        code_under(word, self.form.mask)
    }

    /// The code or the bits that its words hold: both words, one, or a field of it. `None` unless `word` knows all of
    /// them.
    #[must_use]
    pub fn code(&self, word: impl Fn(Address) -> Option<u16>) -> Option<u32> {
        let first = word(self.address)?;
        match self.form.pair {
            Some(order) => Some(order.number([first, word(self.address.checked_add(1)?)?])),
            None => Some(self.code_in(first).into()),
        }
    }

    /// Its value, from the words that `word` knows; `None` if one that it needs is not known, or another register
    /// holds what the model gives no meaning.
    #[must_use]
    pub fn value(&self, word: impl Fn(Address) -> Option<u16>) -> Option<ScaledValue> {
        if self.form.is_plain() {
            return Some(self.plain_value(word(self.address)?));
        }
        let number = self.number(&word)?.checked_mul(self.power(&word)?)?;
        let number = if self.form.sign_is_direction {
            number.abs()
        } else {
            number
        };
        if self.form.per == 1
            && self.form.full_scale.is_none()
            && self.form.scale_by.is_none()
            && !self.has_parts()
        {
            return Some(ScaledValue::new(number, self.scale));
        }
        let steps = match &self.form.scale_by {
            None => self.scale,
            Some(by) => {
                let seen = field(word(by.address)?, by.mask, false);
                by.steps
                    .iter()
                    .find(|(code, _)| i64::from(*code) == seen)?
                    .1
            }
        };
        let mut value = match &self.form.full_scale {
            None => Ratio::new(i128::from(number) * i128::from(self.form.per), steps.into())?,
            Some(scale) => scale.value_of(number, &word)?,
        };
        for part in &self.form.plus {
            value = value.plus(part.value(word(part.address)?)?)?;
        }
        Some(ScaledValue::of_decimal(value.to_digits(self.digits())?))
    }

    /// What `word` means in a register whose form is plain: it depends on nothing else, and always has a value.
    #[must_use]
    pub fn plain_value(&self, word: u16) -> ScaledValue {
        let number = self.number_in(word);
        ScaledValue::new(
            if self.form.sign_is_direction {
                number.abs()
            } else {
                number
            },
            self.scale,
        )
    }

    /// Whether each frequency that it can hold is a whole number of its steps, so that none is ever rounded.
    #[must_use]
    pub const fn is_exact(&self) -> bool {
        self.form.per == 1 && self.form.full_scale.is_none()
    }

    /// The frequency that `word` means in this register of one word, to the nearest thousandth; `None` for one below 0,
    /// or if the full scale is not known.
    #[must_use]
    pub fn frequency(&self, word: u16, known: impl Fn(Address) -> Option<u16>) -> Option<Hertz> {
        self.magnitude(self.number_in(word), known)
    }

    /// The frequency of a number; `None` below 0, or if the full scale is not known.
    #[must_use]
    pub fn magnitude(&self, number: i64, known: impl Fn(Address) -> Option<u16>) -> Option<Hertz> {
        self.exact(number, known)?.to_hertz()
    }

    /// The word that orders `frequency`. It is rounded to the nearest step where a register has other steps than
    /// decimal ones, but never across an end of `limits` that the frequency itself keeps. `None` if there is no such word,
    /// or the full scale is not known.
    #[must_use]
    pub fn word_of(
        &self,
        frequency: Hertz,
        limits: (Hertz, Hertz),
        known: impl Fn(Address) -> Option<u16>,
    ) -> Option<u16> {
        if self.is_exact() {
            return frequency
                .to_word(self.scale)
                .filter(|word| !self.signed || i16::try_from(*word).is_ok());
        }
        let (least, most) = (Ratio::of_hertz(limits.0), Ratio::of_hertz(limits.1));
        let wanted = Ratio::of_hertz(frequency);
        let number = self.number_of(wanted, &known)?;
        let is_inside = |number: i64| {
            let exact = self.exact(number, &known)?;
            let is_below = exact.is_below(least) && !wanted.is_below(least);
            let is_above = most.is_below(exact) && !most.is_below(wanted);
            Some(!is_below && !is_above)
        };
        let nearest = number.nearest()?;
        let candidates = [nearest, number.floor()?, number.floor()?.checked_add(1)?];
        let inside = candidates
            .into_iter()
            .find(|number| is_inside(*number) == Some(true))?;
        self.holds(inside)
    }

    /// The two words that order `frequency` in a register of two words, in the order of their addresses. `None` if it lies
    /// between two steps, or the register is a word or a fraction.
    #[must_use]
    pub fn pair_of(&self, frequency: Hertz) -> Option<[u16; 2]> {
        if !self.is_exact() {
            return None;
        }
        let order = self.form.pair?;
        let number = frequency
            .to_steps(self.scale)
            .filter(|number| !self.signed || number.cast_signed() >= 0)?;
        Some(order.words(number))
    }

    /// The lowest and the highest word that mean a frequency within `limits`; `None` if there is none, or the full scale is
    /// not known.
    #[must_use]
    pub fn words_within(
        &self,
        limits: (Hertz, Hertz),
        known: impl Fn(Address) -> Option<u16>,
    ) -> Option<(u16, u16)> {
        let most_number = if self.signed {
            i64::from(i16::MAX)
        } else {
            i64::from(u16::MAX)
        };
        let least = self
            .number_of(Ratio::of_hertz(limits.0), &known)?
            .ceiling()?
            .max(0);
        let most = self
            .number_of(Ratio::of_hertz(limits.1), &known)?
            .floor()?
            .min(most_number);
        Some((u16::try_from(least).ok()?, u16::try_from(most).ok()?))
    }

    /// The words next to the exact place of what `word` means in `other`: where a drive shows a setting that it was given
    /// with other steps.
    #[must_use]
    pub fn words_like(
        &self,
        other: &Self,
        word: u16,
        known: impl Fn(Address) -> Option<u16>,
    ) -> Vec<u16> {
        let exact = other.exact(other.number_in(word), &known);
        let number = exact.and_then(|exact| self.number_of(exact, &known));
        let floor = number.and_then(Ratio::floor);
        let ceiling = number.and_then(Ratio::ceiling);
        let mut words: Vec<u16> = [floor, ceiling]
            .into_iter()
            .flatten()
            .filter_map(|it| u16::try_from(it).ok())
            .collect();
        words.dedup();
        words
    }

    /// `number` as a word, if this register can hold it: at most the whole of a full scale.
    fn holds(&self, number: i64) -> Option<u16> {
        let whole = self
            .form
            .full_scale
            .as_ref()
            .map_or(i64::from(u16::MAX), |scale| scale.steps.into());
        let most = if self.signed {
            i64::from(i16::MAX)
        } else {
            i64::from(u16::MAX)
        };
        u16::try_from(number)
            .ok()
            .filter(|word| i64::from(*word) <= most.min(whole))
    }

    /// The exact value of `number`.
    fn exact(&self, number: i64, known: impl Fn(Address) -> Option<u16>) -> Option<Ratio> {
        match &self.form.full_scale {
            Some(scale) => scale.value_of(number, known),
            None => Ratio::new(
                i128::from(number) * i128::from(self.form.per),
                self.scale.into(),
            ),
        }
    }

    /// The exact number, with its fraction, that means `value`.
    fn number_of(&self, value: Ratio, known: impl Fn(Address) -> Option<u16>) -> Option<Ratio> {
        match &self.form.full_scale {
            Some(scale) => {
                let (from, span) = scale.span(known)?;
                value
                    .minus(from)?
                    .over(span)?
                    .times(Ratio::new(scale.steps.into(), 1)?)
            }
            None => value.times(Ratio::new(self.scale.into(), self.form.per.into())?),
        }
    }

    /// Decimals with which its value is shown.
    #[must_use]
    pub fn digits(&self) -> u8 {
        let of_ratio = |scale: u32, per: u32| match scale.is_multiple_of(per) {
            true => digits_of(scale / per),
            false => (0..DIGITS_MAX)
                .find(|digits| u64::from(per) * 10_u64.pow((*digits).into()) >= scale.into())
                .unwrap_or(DIGITS_MAX),
        };
        if self.form.full_scale.is_some() {
            return FRACTION_DIGITS;
        }
        let own = match &self.form.scale_by {
            Some(by) => by
                .steps
                .iter()
                .map(|(_, steps)| digits_of(*steps))
                .max()
                .unwrap_or(0),
            None => of_ratio(self.scale, self.form.per),
        };
        self.form
            .plus
            .iter()
            .map(|part| of_ratio(part.scale, part.per))
            .fold(own, u8::max)
    }

    fn has_parts(&self) -> bool {
        !self.form.plus.is_empty()
    }

    /// The power of ten that its word holds beside the number.
    fn power(&self, word: impl Fn(Address) -> Option<u16>) -> Option<i64> {
        if self.form.exponent_mask == 0 {
            return Some(1);
        }
        10_i64.checked_pow(
            u32::try_from(field(word(self.address)?, self.form.exponent_mask, false)).ok()?,
        )
    }
}

impl AddendWord {
    fn value(&self, word: u16) -> Option<Ratio> {
        Ratio::new(i128::from(word) * i128::from(self.per), self.scale.into())
    }
}

impl BasisRegister {
    fn value(&self, word: u16) -> Option<Ratio> {
        Ratio::new(
            i128::from(field(word, self.mask, self.signed)) * i128::from(self.per),
            self.scale.into(),
        )
    }
}

impl FullScale {
    /// Where 0 is, and the whole from there on. `None` unless both are known and the whole is above 0.
    fn span(&self, word: impl Fn(Address) -> Option<u16>) -> Option<(Ratio, Ratio)> {
        let of = match &self.of {
            FractionWhole::Register(basis) => basis.value(word(basis.address)?)?,
            FractionWhole::Fixed(hertz) => Ratio::of_hertz(*hertz),
            FractionWhole::Configured => return None,
        };
        let from = match &self.from {
            Some(basis) => basis.value(word(basis.address)?)?,
            None => Ratio::new(0, 1)?,
        };
        let span = of.minus(from)?;
        (span.numerator > 0).then_some((from, span))
    }

    fn value_of(&self, number: i64, word: impl Fn(Address) -> Option<u16>) -> Option<Ratio> {
        let (from, span) = self.span(word)?;
        from.plus(Ratio::new(number.into(), self.steps.into())?.times(span)?)
    }
}
