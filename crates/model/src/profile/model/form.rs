//! How the words of a register form its value, where that is more than one word divided by a scale.

use crate::domain::address::Address;
use crate::domain::frequency::Hertz;

/// The order of the two words of a 32-bit value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WordOrder {
    /// The word at the lower address is the high one.
    HighFirst,
    /// The word at the lower address is the low one.
    LowFirst,
}

impl WordOrder {
    /// The number in two words, in the order of their addresses.
    #[must_use]
    pub fn number(self, [first, second]: [u16; 2]) -> u32 {
        let (high, low) = match self {
            Self::HighFirst => (first, second),
            Self::LowFirst => (second, first),
        };
        u32::from(high) << 16 | u32::from(low)
    }

    /// The two words that hold `number`, in the order of their addresses.
    #[must_use]
    pub const fn words(self, number: u32) -> [u16; 2] {
        let (high, low) = ((number >> 16) as u16, (number & 0xFFFF) as u16);
        match self {
            Self::HighFirst => [high, low],
            Self::LowFirst => [low, high],
        }
    }

    /// The word used in model files.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::HighFirst => "high-first",
            Self::LowFirst => "low-first",
        }
    }
}

/// How the words of a register form a number, and the number a value. The default is a plain word.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberForm {
    /// The order of its two words; `None` if it has one.
    pub pair: Option<WordOrder>,
    /// The contiguous bits of the word that hold the number. All, if it has two words.
    pub mask: u16,
    /// The bits of the word that hold a power of ten; 0 if none do.
    pub exponent_mask: u16,
    /// Units per `scale` steps: value = raw x per / scale. Never 0.
    pub per: u32,
    /// The number is a fraction of this.
    pub full_scale: Option<FullScale>,
    /// The steps per unit are in another register.
    pub scale_by: Option<ScaleBy>,
    /// Further words that are added.
    pub plus: Vec<AddendWord>,
    /// The sign is the direction in which the motor turns.
    pub sign_is_direction: bool,
}

impl Default for NumberForm {
    fn default() -> Self {
        Self {
            pair: None,
            mask: u16::MAX,
            exponent_mask: 0,
            per: 1,
            full_scale: None,
            scale_by: None,
            plus: Vec::new(),
            sign_is_direction: false,
        }
    }
}

impl NumberForm {
    /// Number of words.
    #[must_use]
    pub const fn words(&self) -> u16 {
        if self.pair.is_some() { 2 } else { 1 }
    }

    /// Whether the number is the whole of one word.
    #[must_use]
    pub const fn is_one_word(&self) -> bool {
        self.pair.is_none() && self.mask == u16::MAX && self.exponent_mask == 0
    }

    /// Whether the value is one word divided by the register's scale.
    #[must_use]
    #[inline]
    pub const fn is_plain(&self) -> bool {
        self.is_one_word()
            && self.per == 1
            && self.full_scale.is_none()
            && self.scale_by.is_none()
            && self.plus.is_empty()
    }

    /// The addresses of other registers without which the number means nothing.
    pub fn bases(&self) -> impl Iterator<Item = Address> + '_ {
        let of_scale = self.full_scale.iter().flat_map(|scale| {
            let of = match &scale.of {
                FractionWhole::Register(basis) => Some(basis.address),
                FractionWhole::Configured | FractionWhole::Fixed(_) => None,
            };
            of.into_iter()
                .chain(scale.from.as_ref().map(|basis| basis.address))
        });
        of_scale.chain(self.scale_by.as_ref().map(|by| by.address))
    }
}

/// A number that is a fraction of a full scale: value = from + raw / steps x (of - from).
#[derive(Clone, Debug, PartialEq)]
pub struct FullScale {
    /// The number that stands for the whole. Never 0.
    pub steps: u32,
    /// What the value is a fraction of; `steps` stands for it.
    pub of: FractionWhole,
    /// The value of 0; `None` for 0.
    pub from: Option<BasisRegister>,
    /// The drive's own parameter that holds the whole, where a person types it into the configuration.
    pub parameter: Option<String>,
}

/// What a fraction is a fraction of.
#[derive(Clone, Debug, PartialEq)]
pub enum FractionWhole {
    /// The value of a register of the drive.
    Register(BasisRegister),
    /// A key of the drive's configuration, which has not been applied yet.
    Configured,
    /// The value of that key.
    Fixed(Hertz),
}

/// A register of one word whose value another register needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BasisRegister {
    /// Where it is.
    pub address: Address,
    /// Its mask.
    pub mask: u16,
    /// Whether its number is in two's complement.
    pub signed: bool,
    /// Its steps.
    pub scale: u32,
    /// Units per `scale` steps.
    pub per: u32,
}

/// A register that holds the number of decimals, or the unit, of another one.
#[derive(Clone, Debug, PartialEq)]
pub struct ScaleBy {
    /// Where it is.
    pub address: Address,
    /// Its bits that count.
    pub mask: u16,
    /// Steps per unit, by the masked and shifted word.
    pub steps: Vec<(u16, u32)>,
}

/// A word that is added to a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AddendWord {
    /// Where it is.
    pub address: Address,
    /// Its steps.
    pub scale: u32,
    /// Units per `scale` steps.
    pub per: u32,
}
