//! Where a model shows its trips: what indicates a trip, and the registers of its record.

use crate::domain::address::Address;
use crate::profile::model::{IndicatedState, Model, Register, RegisterRole, StatusFlag, WordOrder};
use crate::profile::value::{code_under, codes_of_bits};

/// What indicates a trip, the most reliable first.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum TripSource {
    /// A flag of a status register is set as long as the trip is active.
    Flag(StatusFlag),
    /// A register holds the number of the present trip, or the bits of the present trips; 0 for none.
    Code(TripField),
    /// A register counts trips.
    Count(Address),
}

/// Where a number is: a word, some of its bits, or two words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TripField {
    pub address: Address,
    mask: u16,
    pair: Option<WordOrder>,
}

impl TripField {
    const fn of(register: &Register) -> Self {
        Self {
            address: register.address,
            mask: register.form.mask,
            pair: register.form.pair,
        }
    }

    /// The number, or the bits, of which `word` knows the words.
    pub fn code(self, word: impl Fn(Address) -> Option<u16>) -> Option<u32> {
        let first = word(self.address)?;
        match self.pair {
            Some(order) => Some(order.number([first, word(self.address.checked_add(1)?)?])),
            None => Some(code_under(first, self.mask).into()),
        }
    }
}

/// What a reading says about trips.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TripReading {
    /// Whether one is active.
    Held(bool),
    /// How many there were.
    Counted(u16),
}

impl TripSource {
    /// What a reading tells whose registers hold what `word` says; nothing if it does not cover this source.
    pub fn seen(&self, word: impl Fn(Address) -> Option<u16>) -> Option<TripReading> {
        match self {
            Self::Flag(flag) => flag.reads(word(flag.address)?).map(TripReading::Held),
            Self::Code(field) => field.code(word).map(|code| TripReading::Held(code != 0)),
            Self::Count(register) => word(*register).map(TripReading::Counted),
        }
    }
}

/// Where one model shows its trips.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TripPlaces {
    pub source: TripSource,
    /// First registers and numbers of words of the newest record, one read each.
    pub record: Vec<(Address, u16)>,
    /// The register of the record that holds the vendor's number, or the bits.
    pub cause: Option<TripField>,
    /// The cause is a word of bits, one for each trip.
    pub is_bits: bool,
}

impl TripPlaces {
    /// `None` if the model shows no trips.
    pub fn of(model: &Model) -> Option<Self> {
        let address = |role| model.register_for(role).map(|register| register.address);
        let flag = model
            .status_flag(IndicatedState::Tripped)
            .cloned()
            .map(TripSource::Flag);
        let field = |role| model.register_for(role).map(TripField::of);
        let code = || {
            field(RegisterRole::TripCode)
                .or_else(|| field(RegisterRole::TripBits))
                .map(TripSource::Code)
        };
        let source = flag
            .or_else(code)
            .or_else(|| address(RegisterRole::TripCount).map(TripSource::Count))?;
        let bits = field(RegisterRole::TripBits);
        let cause = field(RegisterRole::TripCode)
            .or(bits)
            .or_else(|| field(RegisterRole::TripCause));
        Some(Self {
            source,
            record: record(model),
            cause,
            is_bits: cause.is_some() && cause == bits,
        })
    }

    /// The number of the trip that `cause` shows: of bits, the number of the lowest + 1. `None` if it shows none.
    pub fn code(&self, cause: u32) -> Option<u16> {
        if self.is_bits {
            codes_of_bits(cause).next()
        } else {
            u16::try_from(cause).ok().filter(|code| *code != 0)
        }
    }

    /// Whether `cause` shows a trip that `known` does not.
    pub const fn is_another(&self, cause: u32, known: u32) -> bool {
        if self.is_bits {
            cause & !known != 0
        } else {
            cause != known
        }
    }
}

/// The registers of the newest record in as few reads as the model allows.
fn record(model: &Model) -> Vec<(Address, u16)> {
    let causes = [RegisterRole::TripCode, RegisterRole::TripBits];
    let code = causes
        .into_iter()
        .find(|role| model.register_for(*role).is_some())
        .unwrap_or(RegisterRole::TripCause);
    let roles = [
        code,
        RegisterRole::TripFrequency,
        RegisterRole::TripCurrent,
        RegisterRole::TripDcLinkVoltage,
    ];
    let is_part = |register: &&Register| register.role.is_some_and(|role| roles.contains(&role));
    let mut reads: Vec<(Address, u16)> = Vec::new();
    for register in model
        .registers
        .iter()
        .filter(is_part)
        .filter(|register| register.access.can_read())
    {
        match reads.last_mut() {
            // Another field of the same word.
            Some((first, count))
                if register
                    .address
                    .offset_from(*first)
                    .is_some_and(|offset| offset < *count) => {}
            Some((first, count))
                if first.checked_add(*count) == Some(register.address)
                    && *count + register.form.words() <= model.words_in_one_read(*first) =>
            {
                *count += register.form.words();
            }
            _ => reads.push((register.address, register.form.words())),
        }
    }
    reads
}
