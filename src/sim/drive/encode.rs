//! Values as words, and words as values, where a register is more than one word with a scale.

use super::SimDrive;
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::profile::model::{AddendWord, BasisRegister, FractionWhole, FullScale, Register};

/// Millionths in a unit of measure.
const MICRO: i128 = 1_000_000;

impl SimDrive {
    /// The word that a read shows at `address` where registers share it, have two words or are added to another one;
    /// `None` where it is one register with one word.
    pub(super) fn shared_word(&self, at: MonoTime, address: Address) -> Option<u16> {
        let registers = self
            .model
            .registers
            .iter()
            .enumerate()
            .filter(|(_, register)| register.access.can_read());
        let mut shared = None;
        for (index, register) in registers.filter(|(_, register)| !register.form.is_plain()) {
            let part = register
                .form
                .plus
                .iter()
                .position(|part| part.address == address);
            let place = address
                .offset_from(register.address)
                .filter(|place| *place < register.form.words());
            let word = match (place, part) {
                (Some(place), _) => self.words(at, index)[usize::from(place)],
                // A part that is a register of its own shows its own word.
                (None, Some(part)) if self.model.readable_at(address).is_none() => {
                    self.parts(at, index).1[part]
                }
                (None, _) => continue,
            };
            shared = Some(shared.unwrap_or(0) | word);
        }
        shared
    }

    /// The words of the register at `index`.
    fn words(&self, at: MonoTime, index: usize) -> [u16; 2] {
        let register = &self.model.registers[index];
        let number = self.parts(at, index).0;
        let number = if register.signed {
            number
        } else {
            number.abs()
        };
        match register.form.pair {
            Some(order) => order.words((number & 0xFFFF_FFFF) as u32),
            None => [mantissa_and_exponent(register, number), 0],
        }
    }

    /// The number in the register at `index` before its exponent, and the words that are added to it.
    fn parts(&self, at: MonoTime, index: usize) -> (i128, Vec<u16>) {
        let register = &self.model.registers[index];
        let Some(micro) = self.measured(at, register) else {
            if register.form.pair.is_some() {
                let bits = register.role.and_then(|role| self.bits(role));
                return (
                    bits.unwrap_or_else(|| self.memory.number(index)).into(),
                    Vec::new(),
                );
            }
            return (
                self.held(at, index).into(),
                vec![0; register.form.plus.len()],
            );
        };
        let mut left = i128::from(micro);
        let mut words = vec![0; register.form.plus.len()];
        let mut coarse: Vec<_> = register.form.plus.iter().enumerate().collect();
        coarse.sort_by_key(|(_, part)| std::cmp::Reverse(size(part)));
        for (place, part) in coarse {
            let word = (left / size(part)).clamp(0, i128::from(u16::MAX));
            left -= word * size(part);
            words[place] = (word & 0xFFFF) as u16;
        }
        (self.number_of(register, left), words)
    }

    /// `micro` millionths of its unit as `register` counts.
    fn number_of(&self, register: &Register, micro: i128) -> i128 {
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
            FractionWhole::Configured => i128::from(self.options.max_frequency_hz) * MICRO,
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

/// The size of one step of a part, in millionths.
fn size(part: &AddendWord) -> i128 {
    (MICRO * i128::from(part.per) / i128::from(part.scale.max(1))).max(1)
}

/// `number` in the bits of its field, with the power of ten that it needs.
fn mantissa_and_exponent(register: &Register, number: i128) -> u16 {
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
