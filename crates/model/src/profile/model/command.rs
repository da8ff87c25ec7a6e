//! How a model is commanded: run commands, writes, and the settings it needs to obey the bus.

use super::{
    Confidence, Fact, Model, OrderKind, OrderPlaces, RegisterRole, ResetStep, RunForm, StartWords,
    StateText, ZeroWord,
};
use crate::domain::address::Address;
use crate::domain::control::{BusFunctions, ControlAction};
use crate::domain::link::Interface;

/// Bits of an order to run, beside those that run the motor, and what a stop does with them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StopBits {
    /// The stop has them as the last order to run had them.
    pub keeps: u16,
    /// The stop changes them, as its documents have it.
    pub drops: u16,
}

/// How run commands are given: words written to one register, or to those in `places`.
#[derive(Clone, Debug, PartialEq)]
pub struct RunCommand {
    /// How the words are built.
    pub form: RunForm,
    /// Decelerate and stop.
    pub stop: Fact<u16>,
    /// What it does with the other bits of an order to run.
    pub stop_bits: StopBits,
    /// Run forward.
    pub forward: Fact<u16>,
    /// Run reverse, if the model supports it.
    pub reverse: Option<Fact<u16>>,
    /// Cut the output off so that the motor coasts, if the model supports it.
    pub coast: Option<Fact<u16>>,
    /// Reset a trip.
    pub reset: Option<Fact<u16>>,
    /// Hand control back to panel and terminals, if the model supports it.
    pub release: Option<Fact<u16>>,
    /// The words written in turn to reset a trip: a stop first, then `reset` and stops only; with bits, a stop last,
    /// which clears the reset bit. Empty if the model has no reset, or writes it to another register than the stop.
    pub reset_sequence: Vec<ResetStep>,
    /// Words that are never written, whatever a client asks for: the drive's reaction to them is unknown.
    pub never: Vec<Fact<u16>>,
    /// What the drive does with an all-zero word, if the file says it beside the commands.
    pub zero: Option<Fact<ZeroWord>>,
    /// What is not written to the register for run commands, and what is written beside an order.
    pub places: OrderPlaces,
    /// The words before the run word.
    pub start: StartWords,
    /// The states of the drive's own state machine, in the vendor's words. One register shows them all.
    pub states: Vec<StateText>,
}

impl RunCommand {
    /// The words of `reset_sequence`.
    #[must_use]
    pub fn reset_words(&self) -> Vec<u16> {
        self.reset_sequence.iter().map(|step| step.value).collect()
    }

    /// The word of the order `kind`; `None` if the model lacks it.
    #[must_use]
    pub const fn word(&self, kind: OrderKind) -> Option<&Fact<u16>> {
        match kind {
            OrderKind::Stop => Some(&self.stop),
            OrderKind::Forward => Some(&self.forward),
            OrderKind::Reverse => self.reverse.as_ref(),
            OrderKind::Coast => self.coast.as_ref(),
            OrderKind::Reset => self.reset.as_ref(),
            OrderKind::Release => self.release.as_ref(),
        }
    }

    /// The word of the order `kind`, to be changed; `None` if the model lacks it.
    pub(in crate::profile) const fn word_mut(&mut self, kind: OrderKind) -> Option<&mut Fact<u16>> {
        match kind {
            OrderKind::Stop => Some(&mut self.stop),
            OrderKind::Forward => Some(&mut self.forward),
            OrderKind::Reverse => self.reverse.as_mut(),
            OrderKind::Coast => self.coast.as_mut(),
            OrderKind::Reset => self.reset.as_mut(),
            OrderKind::Release => self.release.as_mut(),
        }
    }

    /// The word for `action`; `None` if the model lacks it, or if the action is not a single word.
    #[must_use]
    pub const fn action(&self, action: ControlAction) -> Option<&Fact<u16>> {
        match action {
            ControlAction::Basic => None,
            ControlAction::Reverse => self.reverse.as_ref(),
            ControlAction::Coast => self.coast.as_ref(),
            ControlAction::Reset => self.reset.as_ref(),
            ControlAction::Release => self.release.as_ref(),
        }
    }

    /// Whether `action` may be ordered: the model has it, and it is proven or one of `accepted`.
    #[must_use]
    pub fn may(&self, action: ControlAction, accepted: &[ControlAction]) -> bool {
        self.action(action)
            .is_some_and(|fact| fact.confidence.is_proven() || accepted.contains(&action))
    }

    /// The unproven actions of the model, each with its fact.
    pub fn unproven(&self) -> impl Iterator<Item = (ControlAction, &Fact<u16>)> {
        let all = ControlAction::ALL
            .iter()
            .filter_map(|action| Some((*action, self.action(*action)?)));
        all.filter(|(_, fact)| !fact.confidence.is_proven())
    }
}

/// A second source of a fact, whose document is independent of the first one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SecondSource {
    /// The fact, as the file calls it: `run.stop`, `register.run_command`.
    pub key: String,
    /// Document and place.
    pub source: String,
}

/// A fact that stop, forward or the setpoint depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BasicFact<'m> {
    /// What it is.
    pub what: &'static str,
    /// How sure it is.
    pub confidence: Confidence,
    /// Where it comes from.
    pub source: &'m str,
    /// A second, independent source.
    pub also: Option<&'m str>,
}

impl BasicFact<'_> {
    /// What it is and how well it is known: `stop (third-party)`, `stop (third-party, two independent sources)`.
    #[must_use]
    pub fn described(&self) -> String {
        let second = if self.also.is_some() {
            ", two independent sources"
        } else {
            ""
        };
        format!("{} ({}{second})", self.what, self.confidence.keyword())
    }
}

/// How writes behave.
#[derive(Clone, Debug, PartialEq)]
pub struct WriteRules {
    /// What a refused write looks like.
    pub refused: Fact<RefusedWrite>,
    /// Registers that function 10 hex may write together. `None`: each is written by itself.
    pub block: Option<BlockWrite>,
}

/// What a refused write looks like on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RefusedWrite {
    /// An exception reply.
    Exception,
    /// A normal reply that carries the value the drive kept.
    KeepsOldValue,
    /// An exception reply; a normal one may carry the old value although the new one was taken.
    EchoMayBeOld,
}

/// Registers that may be written together.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockWrite {
    /// First register of the block.
    pub address: Address,
    /// Number of registers from `address` that one write may cover.
    pub count: Fact<u16>,
}

/// One setting that the drive needs before it obeys the bus.
#[derive(Clone, Debug, PartialEq)]
pub struct SetupItem {
    /// The vendor's code or the switch.
    pub what: String,
    /// The setting and its required value, in words.
    pub text: String,
    /// The register, if it is readable and writable over the bus. `None`: it is set at the drive itself.
    pub address: Option<Address>,
    /// The bits of the word that count; all of them unless the file names some.
    pub mask: u16,
    /// The acceptable masked words; the first one is written if all bits count. Empty without a register.
    pub values: Fact<Vec<u16>>,
    /// The orders that are refused while the register holds another word.
    pub needed_for: Vec<NeededFor>,
    /// The only interface that it applies to. `None`: all.
    pub interface: Option<Interface>,
}

impl SetupItem {
    /// Whether `word` in its register is right.
    #[must_use]
    pub fn is_right(&self, word: u16) -> bool {
        self.values.value.contains(&(word & self.mask))
    }

    /// Whether it concerns a drive of `model` of which `bus` comes over the bus: who gives a wired function is no concern.
    #[must_use]
    pub fn concerns(&self, model: &Model, bus: BusFunctions) -> bool {
        let role = self
            .address
            .and_then(|address| model.register_at(address)?.role);
        match role {
            Some(RegisterRole::RunSource) => bus.has_run(),
            Some(RegisterRole::FrequencySource) => bus.has_frequency(),
            _ => true,
        }
    }

    /// The word that is written to make it right; `None` if it can be set at the drive only, because it has no register
    /// or shares one with other settings.
    #[must_use]
    pub fn written(&self) -> Option<u16> {
        let is_whole = self.address.is_some() && self.mask == u16::MAX;
        is_whole.then(|| self.values.value.first().copied())?
    }
}

/// An order that rests on a setting of the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum NeededFor {
    /// RUN in either direction.
    Run,
    /// RUN in reverse.
    Reverse,
    /// A setpoint.
    Setpoint,
}

/// How a drive tells what it is.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelIdentity {
    /// The register.
    pub address: Address,
    /// The bits that count.
    pub mask: u16,
    /// The masked words of drives of this model.
    pub values: Fact<Vec<u16>>,
    /// Masked words of other drives, with their names.
    pub others: Vec<(u16, String)>,
}

impl ModelIdentity {
    /// Whether `word` is that of a drive of this model.
    #[must_use]
    pub fn is_right(&self, word: u16) -> bool {
        self.values.value.contains(&(word & self.mask))
    }

    /// What a drive with `word` seems to be; `None` if the model does not know it.
    #[must_use]
    pub fn other(&self, word: u16) -> Option<&str> {
        self.others
            .iter()
            .find(|(other, _)| *other == word & self.mask)
            .map(|(_, name)| name.as_str())
    }
}

/// The drive's own watchdog for its communication.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelWatchdog {
    /// The register that holds its time.
    pub time: Address,
    /// The word in `time` that switches the watchdog off.
    pub off: Fact<u16>,
    /// The register that holds the drive's reaction to a time-out, if there is one.
    pub action: Option<Address>,
    /// If a single decimal digit of that register holds the reaction, the place value of the digit: 1, 10, 100 or 1000.
    /// Otherwise the whole word holds it.
    pub action_digit: Option<u16>,
    /// The words of `action` that keep the motor running.
    pub keeps_running: Vec<u16>,
    /// The words of `action` that stop the motor. All other words are unknown.
    pub stops: Vec<u16>,
}
