//! Where a model shows its trips: what indicates a trip, and the registers of its record.

use crate::domain::address::Address;
use crate::profile::model::{Flag, Model, Register, Role, StatusFlag};

/// What indicates a trip, the most reliable first.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Source {
    /// A flag of a status register is set as long as the trip is active.
    Flag(StatusFlag),
    /// A register holds the number of the present trip, 0 for none.
    Code(Field),
    /// A register counts trips.
    Count(Address),
}

/// Where a number is: a word, or some of its bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Field {
    pub address: Address,
    mask: u16,
}

impl Field {
    const fn of(register: &Register) -> Self {
        Self { address: register.address, mask: register.form.mask }
    }

    /// The number in `word`.
    pub fn code_in(self, word: u16) -> u16 {
        (word & self.mask).checked_shr(self.mask.trailing_zeros()).unwrap_or(0)
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

impl Source {
    /// What a reading tells whose registers hold what `word` says; nothing if it does not cover this source.
    pub fn seen(&self, word: impl Fn(Address) -> Option<u16>) -> Option<TripReading> {
        match self {
            Self::Flag(flag) => word(flag.address).map(|word| TripReading::Held(flag.holds(word))),
            Self::Code(field) => word(field.address).map(|word| TripReading::Held(field.code_in(word) != 0)),
            Self::Count(register) => word(*register).map(TripReading::Counted),
        }
    }
}

/// Where one model shows its trips.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Places {
    pub source: Source,
    /// First registers and numbers of words of the newest record, one read each.
    pub record: Vec<(Address, u16)>,
    /// The register of the record that holds the vendor's number.
    pub cause: Option<Field>,
}

impl Places {
    /// `None` if the model shows no trips.
    pub fn of(model: &Model) -> Option<Self> {
        let address = |role| model.register_for(role).map(|register| register.address);
        let flag = model.status_flag(Flag::Tripped).cloned().map(Source::Flag);
        let field = |role| model.register_for(role).map(Field::of);
        let code = || field(Role::TripCode).map(Source::Code);
        let source = flag.or_else(code).or_else(|| address(Role::TripCount).map(Source::Count))?;
        let cause = field(Role::TripCode).or_else(|| field(Role::TripCause));
        Some(Self { source, record: record(model), cause })
    }
}

/// The registers of the newest record in as few reads as the model allows.
fn record(model: &Model) -> Vec<(Address, u16)> {
    let code = if model.register_for(Role::TripCode).is_some() { Role::TripCode } else { Role::TripCause };
    let roles = [code, Role::TripFrequency, Role::TripCurrent, Role::TripDcLinkVoltage];
    let is_part = |register: &&Register| register.role.is_some_and(|role| roles.contains(&role));
    let mut reads: Vec<(Address, u16)> = Vec::new();
    for register in model.registers.iter().filter(is_part).filter(|register| register.access.can_read()) {
        match reads.last_mut() {
            // Another field of the same word.
            Some((first, count)) if register.address.offset_from(*first).is_some_and(|offset| offset < *count) => {}
            Some((first, count))
                if first.checked_add(*count) == Some(register.address) && *count < model.words_in_one_read(*first) =>
            {
                *count += 1;
            }
            _ => reads.push((register.address, 1)),
        }
    }
    reads
}
