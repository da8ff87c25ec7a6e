//! A start in several words: each is written once the drive shows the effect of the one before.

use super::{Fact, Model};
use crate::domain::address::Address;
use std::time::Duration;

/// The words that are written, in order, before the run word. Empty: the run word alone starts the motor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Start {
    /// The words.
    pub steps: Vec<StartStep>,
    /// The word that takes back a start that the drive does not follow. `None`: the stop word.
    pub take_back: Option<Fact<u16>>,
}

/// One word of a start, and what the drive must show before the next.
#[derive(Clone, Debug, PartialEq)]
pub struct StartStep {
    /// The word, written to the register of the run word.
    pub write: Fact<u16>,
    /// The register that shows its effect.
    pub address: Address,
    /// The bits that count.
    pub mask: u16,
    /// The masked words, one of which it must hold.
    pub values: Vec<u16>,
    /// How long after the write it is read at the earliest.
    pub at_least: Duration,
    /// How long the drive may take to show it.
    pub within: Duration,
}

impl Model {
    /// The steps before the run word.
    #[must_use]
    pub fn start_steps(&self) -> &[StartStep] {
        self.run.as_ref().map_or(&[], |run| &run.start.steps)
    }

    /// The word that takes back a start; `None` if the model starts by the run word alone.
    #[must_use]
    pub fn start_take_back(&self) -> Option<u16> {
        let run = self.run.as_ref().filter(|run| !run.start.steps.is_empty())?;
        Some(run.start.take_back.as_ref().unwrap_or(&run.stop).value)
    }

    /// The longest time that the drive may take to follow the steps before the run word.
    #[must_use]
    pub fn start_waits(&self) -> Duration {
        self.start_steps().iter().map(|step| step.at_least + step.within).sum()
    }
}
