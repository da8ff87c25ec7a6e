//! A start in several words: each is written once the drive shows the effect of the one before.

use super::Fact;
use crate::domain::address::Address;
use std::time::Duration;

/// The words that are written, in order, before the run word. Empty: the run word alone starts the motor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StartWords {
    /// The words.
    pub steps: Vec<StartStep>,
    /// The word that takes back a start that the drive does not follow. `None`: the stop word.
    pub take_back: Option<Fact<u16>>,
}

/// One word of a start, and what must come before the next.
#[derive(Clone, Debug, PartialEq)]
pub struct StartStep {
    /// The word, written to the register of the run word.
    pub write: Fact<u16>,
    /// What the drive must show; `None`: only time must pass.
    pub until: Option<StartCondition>,
    /// How long after the write the register is read at the earliest, or the next word follows.
    pub at_least: Duration,
}

/// What the drive shows once it has followed a word of a start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StartCondition {
    /// The register that shows it.
    pub address: Address,
    /// The bits that count.
    pub mask: u16,
    /// The masked words, one of which it must hold.
    pub values: Vec<u16>,
    /// How long the drive may take to show it.
    pub within: Duration,
}

impl StartStep {
    /// The longest time between the word and the next one.
    #[must_use]
    pub fn longest(&self) -> Duration {
        self.at_least
            + self
                .until
                .as_ref()
                .map_or(Duration::ZERO, |until| until.within)
    }
}
