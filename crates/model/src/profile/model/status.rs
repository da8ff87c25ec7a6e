//! Status, trips, exceptions, quirks, and the exchanges that rule out late replies.

use super::{Confidence, Fact};
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
    /// The drive cannot do it at the moment.
    Busy,
    /// The drive is locked against it.
    Locked,
    /// The drive does not do it while a trip holds.
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

/// A rule for the RAM form of a stored register: its address with other bits under a mask. The value is the same; written
/// there, it acts at once and is lost with the power.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RamAlias {
    /// The bits that tell both forms apart.
    pub mask: u16,
    /// The bits under the mask in addresses of stored registers that have a RAM form.
    pub from: u16,
    /// The bits under the mask in addresses of the RAM form.
    pub to: u16,
    /// Whether the form can be read as well.
    pub is_readable: bool,
}

impl RamAlias {
    /// The RAM form of the register at `number`; `None` if it has none.
    #[must_use]
    pub const fn form_of(self, number: u16) -> Option<u16> {
        if number & self.mask == self.from {
            Some(number & !self.mask | self.to)
        } else {
            None
        }
    }

    /// The register whose RAM form is at `number`; `None` if none can be there.
    #[must_use]
    pub const fn register_of(self, number: u16) -> Option<u16> {
        if number & self.mask == self.to {
            Some(number & !self.mask | self.from)
        } else {
            None
        }
    }
}
