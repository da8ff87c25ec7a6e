//! What a model shows of itself: status, trips, exceptions, quirks, and how late replies are told apart.

use super::{Confidence, Fact};
use std::time::Duration;

/// What a status register can tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Flag {
    /// The output is active or ordered to be.
    Running,
    /// The direction is reverse.
    Reverse,
    /// The drive ramps down to standstill.
    Stopping,
    /// A trip holds.
    Tripped,
    /// Something is not as it should be, and the drive goes on.
    Alarm,
    /// The drive would run if it were ordered to.
    Ready,
    /// Run commands are taken from the bus.
    BusRun,
    /// The frequency is taken from the bus.
    BusFrequency,
}

/// Where a flag stands: it holds when the masked word is one of the values.
#[derive(Clone, Debug, PartialEq)]
pub struct StatusFlag {
    /// What it tells.
    pub flag: Flag,
    /// The register, which is polled.
    pub address: u16,
    /// The bits that count.
    pub mask: u16,
    /// The masked words with which it holds.
    pub values: Vec<u16>,
    /// How sure that is.
    pub confidence: Confidence,
    /// Document and place.
    pub source: String,
}

impl StatusFlag {
    /// Whether the flag holds with `word` in its register.
    #[must_use]
    pub fn holds(&self, word: u16) -> bool {
        self.values.contains(&(word & self.mask))
    }
}

/// A number with the vendor's words for it: a trip or an exception.
#[derive(Clone, Debug, PartialEq)]
pub struct CodeText {
    /// The number.
    pub code: u16,
    /// What it means. A hint only where the confidence is not proven.
    pub text: String,
    /// How sure that is.
    pub confidence: Confidence,
    /// Document and place.
    pub source: String,
}

/// An exchange whose right answer no late reply can be mistaken for: after it none can follow.
#[derive(Clone, Debug, PartialEq)]
pub enum Barrier {
    /// A read whose word count differs from every missing one. It lies within what is documented as readable.
    Read(BarrierRead),
    /// The loop test, function 08, with fresh data. Only where nothing on the line echoes what is sent.
    Loop(Fact<()>),
    /// A request of this function, which the drive does not serve and refuses with exception 01.
    Refused(Fact<u8>),
}

/// A read that may serve as a barrier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BarrierRead {
    /// First register.
    pub address: u16,
    /// Number of words.
    pub count: u16,
}

/// Named switches for what some drives do differently. The list is closed: each is built once, in the core.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Quirks {
    /// Addresses are read as decimal digits in their last two places: 0xFE10 follows 0xFE09.
    pub decimal_numbers: Option<Fact<()>>,
    /// Current and voltage are in per cent of the drive's rated values, which the configuration has to state.
    pub percent_of_rated: Option<Fact<()>>,
    /// What the drive holds as its setpoint cannot be relied on: each RUN is preceded by a write of the setpoint.
    pub setpoint_before_run: Option<Fact<()>>,
    /// The same register with this bit of its address set is its stored twin: written, never read.
    pub stored_alias_bit: Option<Fact<u8>>,
    /// The drive hears nothing for this long after power-up.
    pub deaf_after_power_up: Option<Fact<Duration>>,
    /// The drive hears nothing for this long after a reset.
    pub deaf_after_reset: Option<Fact<Duration>>,
    /// The drive needs this pause before each request.
    pub pause_before_request: Option<Fact<Duration>>,
}
