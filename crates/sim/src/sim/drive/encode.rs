//! Values as numbers, and numbers as values, where a register has more than a scale.

use super::memory::SimMemory;
use crate::domain::address::Address;
use crate::profile::model::{AddendWord, BasisRegister, FractionWhole, FullScale, Model, Register};

/// Millionths in a unit of measure.
const MICRO: i128 = 1_000_000;

/// What the numbers in registers mean, which other registers may decide.
#[derive(Clone, Copy)]
pub(super) struct RegisterScales<'a> {
    model: &'a Model,
    memory: &'a SimMemory,
    max_frequency_hz: u16,
}

impl<'a> RegisterScales<'a> {
    pub(super) const fn new(
        model: &'a Model,
        memory: &'a SimMemory,
        max_frequency_hz: u16,
    ) -> Self {
        Self {
            model,
            memory,
            max_frequency_hz,
        }
    }

    /// `micro` millionths of its unit as `register` counts.
    pub(super) fn number_of(&self, register: &Register, micro: i128) -> i128 {
        if let Some(scale) = &register.form.full_scale {
            let (from, of) = self.ends(scale);
            return nearest((micro - from) * i128::from(scale.steps), (of - from).max(1));
        }
        let steps = match &register.form.scale_by {
            Some(by) => {
                let word = self.memory_at(by.address, by.mask);
                by.steps
                    .iter()
                    .find(|(code, _)| *code == word)
                    .map_or(1, |(_, steps)| *steps)
            }
            None => register.scale,
        };
        nearest(
            micro * i128::from(steps),
            MICRO * i128::from(register.form.per),
        )
    }

    /// The value in millionths that `word` means in `register`, which is one word.
    pub(super) fn micro_of(&self, register: &Register, word: u16) -> i64 {
        let number = if register.signed {
            i128::from(word.cast_signed())
        } else {
            i128::from(word)
        };
        self.micro_of_number(register, number)
    }

    /// The value in millionths that `number` means in `register`.
    pub(super) fn micro_of_number(&self, register: &Register, number: i128) -> i64 {
        let micro = match &register.form.full_scale {
            Some(scale) => {
                let (from, of) = self.ends(scale);
                from + number * (of - from) / i128::from(scale.steps)
            }
            None => {
                number * MICRO * i128::from(register.form.per) / i128::from(register.scale.max(1))
            }
        };
        i64::try_from(micro).unwrap_or(i64::MAX)
    }

    /// The ends of a full scale in millionths.
    fn ends(&self, scale: &FullScale) -> (i128, i128) {
        let value = |basis: &BasisRegister| {
            let word = self.memory_at(basis.address, basis.mask);
            i128::from(word) * MICRO * i128::from(basis.per) / i128::from(basis.scale.max(1))
        };
        let of = match &scale.of {
            FractionWhole::Register(basis) => value(basis),
            FractionWhole::Fixed(hertz) => i128::from(hertz.millihertz()) * 1_000,
            FractionWhole::Configured => i128::from(self.max_frequency_hz) * MICRO,
        };
        (scale.from.as_ref().map_or(0, value), of)
    }

    /// The field `mask` of what the register at `address` holds.
    fn memory_at(&self, address: Address, mask: u16) -> u16 {
        let index = self
            .model
            .registers
            .iter()
            .position(|it| it.address == address && it.form.mask == mask);
        index.map_or(0, |index| self.memory.word(index))
    }
}

/// `micro` millionths in the parts of `register`, the coarsest first: what is left, and the words of the parts.
pub(super) fn split(register: &Register, micro: i64) -> (i128, Vec<u16>) {
    let mut left = i128::from(micro);
    let mut words = vec![0; register.form.plus.len()];
    let mut coarse: Vec<_> = register.form.plus.iter().enumerate().collect();
    coarse.sort_by_key(|(_, part)| std::cmp::Reverse(size(part)));
    for (place, part) in coarse {
        let word = (left / size(part)).clamp(0, i128::from(u16::MAX));
        left -= word * size(part);
        words[place] = (word & 0xFFFF) as u16;
    }
    (left, words)
}

/// The size of one step of a part, in millionths.
fn size(part: &AddendWord) -> i128 {
    (MICRO * i128::from(part.per) / i128::from(part.scale.max(1))).max(1)
}

/// `number` in the bits of its field, with the power of ten that it needs.
pub(super) fn mantissa_and_exponent(register: &Register, number: i128) -> u16 {
    let (mask, exponent_mask) = (register.form.mask, register.form.exponent_mask);
    let most = i128::from(mask >> mask.trailing_zeros());
    let (mut number, mut exponent) = (number, 0_u16);
    while exponent_mask != 0 && number > most {
        number /= 10;
        exponent += 1;
    }
    let field = ((number & most) as u16) << mask.trailing_zeros();
    let power = exponent
        .checked_shl(exponent_mask.trailing_zeros())
        .unwrap_or(0)
        & exponent_mask;
    field | power
}

/// The integer nearest to `numerator / denominator`.
const fn nearest(numerator: i128, denominator: i128) -> i128 {
    (2 * numerator + denominator).div_euclid(2 * denominator)
}
