//! How a model is commanded: run commands, writes, and what has to be set on the drive before it obeys.

use super::{Confidence, Fact, FactPart, Model, Role};
use crate::domain::control::ControlAction;
use crate::domain::link::Interface;

/// How run commands are given: one register that takes words.
#[derive(Clone, Debug, PartialEq)]
pub struct RunCommand {
    /// How the words are built.
    pub form: RunForm,
    /// Decelerate and stop.
    pub stop: Fact<u16>,
    /// Run forward.
    pub forward: Fact<u16>,
    /// Run reverse, where the model has it.
    pub reverse: Option<Fact<u16>>,
    /// Cut the output off so that the motor coasts, where the model has it.
    pub coast: Option<Fact<u16>>,
    /// Reset a trip.
    pub reset: Option<Fact<u16>>,
    /// Hand control back to panel and terminals, where the model has it.
    pub release: Option<Fact<u16>>,
    /// The words that are written one after the other to reset a trip: `reset` among them, a stop first, no order to
    /// run, and with bits a stop last so that the reset bit is taken back. Empty where the model has no reset.
    pub reset_sequence: Vec<u16>,
    /// Words that must never be written, whoever asks: the drive's answer to them is not known.
    pub never: Vec<Fact<u16>>,
}

impl RunCommand {
    /// The word for `action`, where the model has it; none for what is several words.
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
        self.action(action).is_some_and(|fact| fact.confidence.is_proven() || accepted.contains(&action))
    }

    /// The actions that the model has and does not prove, with what is known of them.
    pub fn unproven(&self) -> impl Iterator<Item = (ControlAction, &Fact<u16>)> {
        let all = ControlAction::ALL.iter().filter_map(|action| Some((*action, self.action(*action)?)));
        all.filter(|(_, fact)| !fact.confidence.is_proven())
    }
}

/// One of the facts on which stop, forward and the setpoint rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Basic<'m> {
    /// What it is.
    pub what: &'static str,
    /// How sure it is.
    pub confidence: Confidence,
    /// Where it comes from.
    pub source: &'m str,
}

impl Model {
    /// What of stop, forward and the setpoint is not proven: words, and the registers that take them. A drive of such a
    /// model takes orders only where [`ControlAction::Basic`] is accepted.
    #[must_use]
    pub fn unproven_basics(&self) -> Vec<Basic<'_>> {
        let Some(run) = &self.run else { return Vec::new() };
        let mut basics = vec![
            Basic { what: "stop", confidence: run.stop.confidence, source: &run.stop.source },
            Basic { what: "forward", confidence: run.forward.confidence, source: &run.forward.source },
        ];
        let registers = [
            ("the run command's register", Role::RunCommand),
            ("the frequency command's register", Role::FrequencyCommand),
        ];
        for (what, role) in registers {
            let Some(register) = self.register_for(role) else { continue };
            let is_inferred = register.not_stated.contains(&FactPart::Writing);
            let confidence = if is_inferred { Confidence::Inferred } else { register.confidence };
            basics.push(Basic { what, confidence: confidence.max(register.confidence), source: &register.source });
        }
        basics.retain(|basic| !basic.confidence.is_proven());
        basics
    }

    /// Whether a drive of this model takes orders at all, with `accepted` of what is unproven.
    #[must_use]
    pub fn may_be_ordered(&self, accepted: &[ControlAction]) -> bool {
        accepted.contains(&ControlAction::Basic) || self.unproven_basics().is_empty()
    }
}

/// How the words of run commands are built.
#[derive(Clone, Debug, PartialEq)]
pub enum RunForm {
    /// Each word is one command.
    Values,
    /// Each bit has a meaning of its own.
    Bits {
        /// What the bits mean, in order, none twice.
        bits: Vec<RunBit>,
        /// Bits that stand in every command but release: with them the drive obeys the bus whatever its own settings
        /// say, so that even a stop takes control. 0 where the model has none.
        priority: u16,
    },
}

/// One bit of a run command.
#[derive(Clone, Debug, PartialEq)]
pub struct RunBit {
    /// Its number, 0 for the lowest.
    pub bit: Fact<u8>,
    /// What it means when it is set.
    pub meaning: BitMeaning,
}

/// What a bit of a run command means when it is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BitMeaning {
    /// Run; without it the motor is ramped down.
    Run,
    /// The direction is reverse; without it forward.
    Reverse,
    /// Run forward.
    RunForward,
    /// Run in reverse.
    RunReverse,
    /// Reset a trip.
    Reset,
    /// Coast.
    Coast,
    /// The drive trips.
    Trip,
    /// Jog.
    Jog,
    /// Run commands are taken from the bus whatever the drive's settings say.
    BusRun,
    /// The frequency is taken from the bus whatever the drive's settings say.
    BusFrequency,
    /// Something that the gateway never orders.
    Other,
}

/// How writes behave.
#[derive(Clone, Debug, PartialEq)]
pub struct WriteRules {
    /// What a refused write looks like.
    pub refused: Fact<RefusedWrite>,
    /// Registers that may be written together by function 10 hex; nothing: each by 06.
    pub block: Option<BlockWrite>,
}

/// What a refused write looks like on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RefusedWrite {
    /// An exception reply.
    Exception,
    /// A normal reply that carries the value the drive kept.
    KeepsOldValue,
}

/// Registers that may be written together.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockWrite {
    /// First register of the block.
    pub address: u16,
    /// Number of registers from there on that one write may cover.
    pub count: Fact<u16>,
}

/// One thing that has to be set on the drive before it obeys the bus, in the order in which it is set.
#[derive(Clone, Debug, PartialEq)]
pub struct SetupItem {
    /// The vendor's code or the switch.
    pub what: String,
    /// What it is and what it has to be, in words.
    pub text: String,
    /// The register, where it can be read and written over the bus; nothing: only at the drive itself.
    pub address: Option<u16>,
    /// The words that are right; the first one is what is written. Empty where there is no register.
    pub values: Fact<Vec<u16>>,
    /// It concerns lines of this interface only; nothing: all.
    pub interface: Option<Interface>,
}

/// The drive's own watchdog over its communication.
#[derive(Clone, Debug, PartialEq)]
pub struct Watchdog {
    /// The register that holds its time.
    pub time: u16,
    /// The word there that switches it off.
    pub off: Fact<u16>,
    /// The register that holds what the drive does when the time is up, where there is one.
    pub action: Option<u16>,
    /// Where one decimal digit of that register says it, what that digit counts: 1, 10, 100 or 1000. Otherwise the whole
    /// word does.
    pub action_digit: Option<u16>,
    /// The words there with which the motor runs on.
    pub keeps_running: Vec<u16>,
    /// Those with which the drive stops it. Every other word is unknown.
    pub stops: Vec<u16>,
}
