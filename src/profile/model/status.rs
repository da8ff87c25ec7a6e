//! Status, trips, exceptions, quirks, and the exchanges that rule out late replies.

use super::{Confidence, Fact, Model, RamAlias, Register, RegisterRole};
use crate::domain::address::Address;
use std::time::Duration;

/// A state that a status register can indicate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum IndicatedState {
    /// The output is active or ordered to be.
    Running,
    /// The direction is reverse.
    Reverse,
    /// The drive ramps down to standstill.
    Stopping,
    /// A trip is active.
    Tripped,
    /// An alarm is active; the drive keeps running.
    Alarm,
    /// The drive would obey a run order.
    Ready,
    /// Run commands are taken from the bus.
    BusRun,
    /// The frequency is taken from the bus.
    BusFrequency,
}

impl IndicatedState {
    /// Whether it only ever permits an order: a word that no document names then permits nothing, and is as good as clear.
    #[must_use]
    pub const fn is_permission(self) -> bool {
        matches!(self, Self::Ready | Self::BusRun | Self::BusFrequency)
    }
}

/// The location of a flag: it is set if the masked word is one of the values.
#[derive(Clone, Debug, PartialEq)]
pub struct StatusFlag {
    /// The state that it indicates.
    pub flag: IndicatedState,
    /// The register, which is polled.
    pub address: Address,
    /// The relevant bits.
    pub mask: u16,
    /// The masked words for which it is set.
    pub values: Vec<u16>,
    /// The words for which it is not set.
    pub clear: ClearWords,
    /// Where the file says that it is not set for any other word: how sure that is.
    pub others_clear: Option<Fact<()>>,
    /// Confidence.
    pub confidence: Confidence,
    /// Document and place.
    pub source: String,
}

impl StatusFlag {
    /// Whether `word` in its register is one that sets the flag.
    #[must_use]
    pub fn holds(&self, word: u16) -> bool {
        self.values.contains(&(word & self.mask))
    }

    /// Whether the flag is set if its register holds `word`; `None` for a word that no document names: it proves nothing.
    #[must_use]
    pub fn reads(&self, word: u16) -> Option<bool> {
        if self.holds(word) {
            Some(true)
        } else {
            self.clear.names(word).then_some(false)
        }
    }
}

/// The words of which a document says that a flag is not set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ClearWords {
    /// Every word that does not set it.
    Others,
    /// Every word that matches one of these.
    Named(Vec<MaskedWord>),
}

impl ClearWords {
    /// Whether `word` is one of them, unless it sets the flag.
    #[must_use]
    pub fn names(&self, word: u16) -> bool {
        match self {
            Self::Others => true,
            Self::Named(known) => known.iter().any(|known| word & known.mask == known.value),
        }
    }
}

/// Every word that has this value under the mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaskedWord {
    /// The relevant bits.
    pub mask: u16,
    /// The masked word.
    pub value: u16,
}

/// A trip or an exception: its number and the vendor's text.
#[derive(Clone, Debug, PartialEq)]
pub struct CodeText {
    /// The number. On a model whose trips are bits, the number of the bit + 1.
    pub code: u16,
    /// Its meaning; only a hint unless the confidence is proven.
    pub text: String,
    /// Confidence.
    pub confidence: Confidence,
    /// Document and place.
    pub source: String,
}

impl CodeText {
    /// The text, marked if it is unproven.
    #[must_use]
    pub fn marked(&self) -> String {
        if self.confidence.is_proven() {
            self.text.clone()
        } else {
            format!("{} ({})", self.text, self.confidence.keyword())
        }
    }
}

/// A state of the drive's own state machine: its register holds it if the masked word is the value.
#[derive(Clone, Debug, PartialEq)]
pub struct StateText {
    /// The register, which is polled.
    pub address: Address,
    /// The relevant bits.
    pub mask: u16,
    /// The masked word.
    pub value: u16,
    /// The vendor's words for it.
    pub text: String,
    /// Confidence.
    pub confidence: Confidence,
    /// Document and place.
    pub source: String,
}

impl StateText {
    /// Mask, value and text without the source, with the text marked if it is unproven.
    #[must_use]
    pub fn masked(&self) -> MaskedText {
        let Self {
            mask,
            value,
            text,
            confidence,
            ..
        } = self;
        let text = if confidence.is_proven() {
            text.clone()
        } else {
            format!("{text} ({})", confidence.keyword())
        };
        MaskedText {
            mask: *mask,
            value: *value,
            text,
        }
    }
}

impl Model {
    /// Whether run state, standstill or trips are read at `address`: without it stops and trips are seen later, or not.
    #[must_use]
    pub fn is_essential(&self, address: Address) -> bool {
        let output = self
            .register_for(RegisterRole::OutputFrequency)
            .map(|register| register.address);
        let trips = self.trip_register().map(|register| register.address);
        let mut flags = self
            .status
            .iter()
            .filter(|flag| !flag.flag.is_permission())
            .map(|flag| flag.address);
        output == Some(address) || trips == Some(address) || flags.any(|flag| flag == address)
    }

    /// The register that shows the states of the drive's own state machine.
    #[must_use]
    pub fn state_register(&self) -> Option<&Register> {
        self.registers
            .iter()
            .find(|register| !register.states.is_empty())
    }

    /// The vendor's words for the state that `word` of that register shows, marked if they are unproven; `None` if the model
    /// does not know it.
    #[must_use]
    pub fn drive_state(&self, word: u16) -> Option<String> {
        let states = &self.state_register()?.states;
        states
            .iter()
            .find(|state| word & state.mask == state.value)
            .map(|state| state.text.clone())
    }
}

/// A text for every word that has this value under the mask.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaskedText {
    /// The relevant bits.
    pub mask: u16,
    /// The masked word.
    pub value: u16,
    /// The text.
    pub text: String,
}

/// What the drive means by an exception.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ExceptionKind {
    /// It cannot do it at the moment.
    Busy,
    /// It is locked against it.
    Locked,
    /// It does not do it while a trip holds.
    InTrip,
    /// The request reached it damaged.
    DamagedFrame,
}

impl ExceptionKind {
    /// The word used in model files.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Busy => "busy",
            Self::Locked => "locked",
            Self::InTrip => "in-trip",
            Self::DamagedFrame => "damaged-frame",
        }
    }
}

/// An exchange whose reply cannot be mistaken for a late one. Once it succeeds, no late reply can follow.
#[derive(Clone, Debug, PartialEq)]
pub enum Barrier {
    /// A read whose word count differs from that of every unanswered read. It covers readable registers only.
    Read(BarrierRead),
    /// The loop test, function 08, with fresh data. Only if nothing on the line echoes requests.
    Loop(Fact<()>),
    /// A request of this function, which the drive does not serve and refuses with exception 01.
    Refused(Fact<u8>),
}

/// A read that may serve as a barrier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BarrierRead {
    /// First register.
    pub address: Address,
    /// Number of words.
    pub count: u16,
}

/// Named deviations of some drives. The list is closed: the core implements each one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DriveQuirks {
    /// The last two places of addresses are decimal digits: 0xFE10 follows 0xFE09.
    pub decimal_numbers: Option<Fact<()>>,
    /// Current and voltage are in percent of the drive's rated values, which the configuration must state.
    pub percent_of_rated: Option<Fact<()>>,
    /// The setpoint held by the drive is unreliable: each RUN is preceded by a write of the setpoint.
    pub setpoint_before_run: Option<Fact<()>>,
    /// An address with this bit set is the stored twin of the same register: writable, never readable.
    pub stored_alias_bit: Option<Fact<u8>>,
    /// A stored register has another address by which it is written in RAM.
    pub ram_alias: Option<Fact<RamAlias>>,
    /// The drive ignores requests for this long after power-up.
    pub deaf_after_power_up: Option<Fact<Duration>>,
    /// The drive ignores requests for this long after a reset.
    pub deaf_after_reset: Option<Fact<Duration>>,
    /// The drive needs this pause before each request.
    pub pause_before_request: Option<Fact<Duration>>,
}
