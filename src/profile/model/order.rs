//! Where each order is written, and what is written beside it: its register, the direction, the word that clears a reset.

use super::{Fact, Model, OrderedWord, RegisterRole};
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

impl Model {
    /// The register that the order `kind` is written to; `None` if the model cannot be commanded.
    #[must_use]
    pub fn order_address(&self, kind: OrderKind) -> Option<Address> {
        let run = self.run.as_ref()?;
        let own = run
            .places
            .registers
            .iter()
            .find(|(of, _)| *of == kind)
            .map(|(_, address)| *address);
        own.or_else(|| Some(self.register_for(RegisterRole::RunCommand)?.address))
    }

    /// The register and the word of the order `kind`; `None` if the model does not have it.
    #[must_use]
    pub fn order(&self, kind: OrderKind) -> Option<(Address, &Fact<u16>)> {
        Some((self.order_address(kind)?, self.run.as_ref()?.word(kind)?))
    }

    /// The orders that are written to `address`, each with its word. Forward and reverse have the same word where the
    /// direction is written before it.
    pub fn orders_at(&self, address: Address) -> impl Iterator<Item = (OrderKind, &Fact<u16>)> {
        let all = OrderKind::ALL
            .into_iter()
            .filter_map(|kind| Some((kind, self.order(kind)?)));
        all.filter(move |(_, (at, _))| *at == address)
            .map(|(kind, (_, fact))| (kind, fact))
    }

    /// Whether the sign of the setpoint orders the direction: a run word alone says none.
    #[must_use]
    pub fn turns_by_sign(&self) -> bool {
        self.run.as_ref().is_some_and(|run| run.places.by_sign)
    }

    /// The direction words, if the direction is written to `address`.
    #[must_use]
    pub fn direction_at(&self, address: Address) -> Option<&DirectionWords> {
        let direction = &self.run.as_ref()?.places.direction.as_ref()?.value;
        (direction.address == address).then_some(direction)
    }

    /// Whether writing `word` to `address` is the stop or the coast of the model.
    #[must_use]
    pub fn stops_at(&self, address: Address, word: u16) -> bool {
        let stops = |kind| matches!(kind, OrderKind::Stop | OrderKind::Coast);
        let mut orders = self
            .orders_at(address)
            .filter(|(_, fact)| fact.value == word)
            .peekable();
        if orders.peek().is_some() {
            return orders.any(|(kind, _)| stops(kind));
        }
        let Some(run) = &self.run else {
            return false;
        };
        self.takes_run_commands(address)
            && matches!(
                run.order_in(word),
                Some(OrderedWord::Stop | OrderedWord::Coast)
            )
    }

    /// Whether run commands are written to `address`, but for the orders that have a register of their own.
    #[must_use]
    pub fn takes_run_commands(&self, address: Address) -> bool {
        self.register_for(RegisterRole::RunCommand)
            .is_some_and(|register| register.address == address)
    }

    /// The writes of a reset, in order: a stop first. Empty if the model has no reset.
    #[must_use]
    pub fn reset_writes(&self) -> Vec<ResetWrite> {
        let wait = Duration::ZERO;
        let order = |kind, resets| {
            let (address, fact) = self.order(kind)?;
            Some(ResetWrite {
                address,
                value: fact.value,
                resets,
                wait,
            })
        };
        let (Some(stop), Some(reset)) =
            (order(OrderKind::Stop, false), order(OrderKind::Reset, true))
        else {
            return Vec::new();
        };
        let Some(run) = &self.run else {
            return Vec::new();
        };
        if run.reset_sequence.is_empty() {
            if reset.address == stop.address {
                return Vec::new();
            }
            let clear = run.places.clear.map(|value| ResetWrite {
                value,
                resets: false,
                ..reset
            });
            return [stop, reset].into_iter().chain(clear).collect();
        }
        let is_apart = run
            .places
            .registers
            .iter()
            .any(|(kind, _)| *kind == OrderKind::Reset);
        let write = |step: &ResetStep| {
            let is_there = if is_apart {
                step.address == Some(reset.address)
            } else {
                true
            };
            let resets = is_there && step.value == reset.value;
            let address = if resets {
                reset.address
            } else {
                step.address.unwrap_or(stop.address)
            };
            ResetWrite {
                address,
                value: step.value,
                resets,
                wait: step.wait,
            }
        };
        run.reset_sequence.iter().map(write).collect()
    }

    /// The pauses of a reset, all together.
    #[must_use]
    pub fn reset_waits(&self) -> Duration {
        self.reset_writes().iter().map(|write| write.wait).sum()
    }

    /// The write that clears a reset whose word was left in its register; `None` if a reset leaves none there.
    #[must_use]
    pub fn reset_clears(&self) -> Option<ResetWrite> {
        self.reset_writes()
            .last()
            .copied()
            .filter(|last| !last.resets)
    }

    /// Whether a word written to the register of `kind` replaces a reset word that was left standing.
    #[must_use]
    pub fn replaces_reset(&self, kind: OrderKind) -> bool {
        self.order_address(kind) == self.order_address(OrderKind::Reset)
    }
}
