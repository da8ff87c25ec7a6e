//! Where each order is written, and what is written beside it: its register, the direction, the word that clears a reset.

use super::Fact;
use crate::domain::address::Address;
use std::time::Duration;

/// What a run command orders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum OrderKind {
    /// Decelerate and stop.
    Stop,
    /// Run forward.
    Forward,
    /// Run in reverse.
    Reverse,
    /// Cut the output off.
    Coast,
    /// Reset a trip.
    Reset,
    /// Hand control back to panel and terminals.
    Release,
}

impl OrderKind {
    /// All of them, in the order in which a word is looked up.
    pub const ALL: [Self; 6] = [
        Self::Stop,
        Self::Forward,
        Self::Reverse,
        Self::Coast,
        Self::Reset,
        Self::Release,
    ];

    /// The word used in model files and tables.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Forward => "forward",
            Self::Reverse => "reverse",
            Self::Coast => "coast",
            Self::Reset => "reset",
            Self::Release => "release",
        }
    }
}

/// What a model says about the places of its orders. Empty: every order is one word in the register for run commands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OrderPlaces {
    /// The orders that are written to a register of their own.
    pub registers: Vec<(OrderKind, Address)>,
    /// The word that clears the reset's register after a reset. `None`: nothing has to be cleared there, or the stop that
    /// ends the sequence clears it.
    pub clear: Option<u16>,
    /// The direction, if it is written to a register of its own before the run word.
    pub direction: Option<Fact<DirectionWords>>,
    /// Reverse is ordered by a setpoint below 0 beside the word for forward.
    pub by_sign: bool,
    /// Forbidden words of other registers than that for run commands.
    pub never: Vec<(Address, Fact<u16>)>,
}

/// How the direction is given before the run word.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DirectionWords {
    /// The register.
    pub address: Address,
    /// The word for forward.
    pub forward: u16,
    /// The word for reverse, if the model supports it.
    pub reverse: Option<u16>,
}

/// One word of a reset as its sequence has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResetStep {
    /// The reset's own register, if the word is written there.
    pub address: Option<Address>,
    /// The word.
    pub value: u16,
    /// How long nothing is written after it.
    pub wait: Duration,
}

/// One write of a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResetWrite {
    /// The register.
    pub address: Address,
    /// The word.
    pub value: u16,
    /// The word resets. All other words stop the motor or clear the reset.
    pub resets: bool,
    /// How long nothing is written after it.
    pub wait: Duration,
}
