//! How a model is commanded: run commands, writes, and the settings it needs to obey the bus.

use super::{
    Confidence, Fact, FactPart, Model, OrderKind, OrderPlaces, RegisterRole, ResetStep, RunForm,
    StartWords, StateText, ZeroWord,
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

impl Model {
    /// The unproven facts behind stop, forward and the setpoint: words, and their registers. If there are any, a drive of
    /// this model takes orders only if [`ControlAction::Basic`] is accepted.
    #[must_use]
    pub fn unproven_basics(&self) -> Vec<BasicFact<'_>> {
        let mut basics = self.basics();
        basics.retain(|basic| !basic.confidence.is_proven());
        basics
    }

    /// All facts behind stop, forward and the setpoint; none if it takes no orders.
    #[must_use]
    pub fn basics(&self) -> Vec<BasicFact<'_>> {
        let Some(run) = &self.run else {
            return Vec::new();
        };
        let mut basics = Vec::new();
        let mut add = |what: &'static str, key: &str, confidence, source| {
            basics.push(BasicFact {
                what,
                confidence,
                source,
                also: self.second_source(key),
            });
        };
        for (what, key, fact) in [
            ("stop", "run.stop", &run.stop),
            ("forward", "run.forward", &run.forward),
        ] {
            add(what, key, fact.confidence, fact.source.as_str());
        }
        if let Some(direction) = &run.places.direction {
            add(
                "direction",
                "run.direction",
                direction.confidence,
                direction.source.as_str(),
            );
        }
        for step in &run.start.steps {
            add(
                "start",
                "run.start",
                step.write.confidence,
                step.write.source.as_str(),
            );
        }
        if let Some(fact) = &run.start.take_back {
            add(
                "take_back",
                "run.take_back",
                fact.confidence,
                fact.source.as_str(),
            );
        }
        let registers = [
            ("the run command's register", RegisterRole::RunCommand),
            (
                "the frequency command's register",
                RegisterRole::FrequencyCommand,
            ),
        ];
        for (what, role) in registers {
            let Some(register) = self.register_for(role) else {
                continue;
            };
            let is_inferred = register.not_stated.contains(&FactPart::Writing);
            let confidence = if is_inferred {
                Confidence::Inferred
            } else {
                register.confidence
            };
            basics.push(BasicFact {
                what,
                confidence: confidence.max(register.confidence),
                source: &register.source,
                also: self.second_source(&format!("register.{}", register.name)),
            });
        }
        basics
    }

    /// Whether a drive of this model takes orders at all, given the `accepted` unproven actions.
    #[must_use]
    pub fn may_be_ordered(&self, accepted: &[ControlAction]) -> bool {
        accepted.contains(&ControlAction::Basic) || self.unproven_basics().is_empty()
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
