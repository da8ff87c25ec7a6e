//! `[run]`: the registers of orders that are not written to the one for run commands, and the direction.

use super::facts::{FactFile, FactReader, Origin, fact};
use super::kinds::{mask, word};
use super::run::RunFile;
use crate::domain::address::Address;
use crate::profile::model::{
    Confidence, DirectionWords, Fact, FactPart, OrderKind, OrderPlaces, Register, RegisterRole,
    RunCommand, StopBits,
};
use crate::profile::register::{RegisterFile, address_of};
use crate::toml_file::declare::{declare_table, only, optional, required};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey};

/// Values of `reverse_by`.
pub(super) const REVERSE_BY: [(&str, ()); 1] = [("sign", ())];

declare_table! {
    /// An order: its word, and where that is written.
    OrderFile is "run.stop" with kind: OrderKind {
        /// The word.
        value: RequiredKey<u16> = required(word());
        /// The name of the register that takes the word, if it has one of its own.
        register: OptionalKey<String> = optional(ValueKind::text()), without "the one for run commands";
        /// The word that is written to the reset's own register after the reset, whatever comes between.
        clear: OptionalKey<u16> = only(kind == OrderKind::Reset, optional(word())),
            without "nothing is cleared";
        /// With `form = "bits"`: bits, as the direction, that the stop has as the last order to run had them. Without an order,
        /// or a direction that the drive shows, they are those of `value`.
        keep: OptionalKey<u16> = only(kind == OrderKind::Stop, optional(mask())), or 0, without "none";
        /// With `form = "bits"`: bits, as the direction, that the stop changes although they do not run the motor, because the
        /// documents show that word. The key has no effect on what is sent.
        drop: OptionalKey<u16> = only(kind == OrderKind::Stop, optional(mask())), or 0, without "none";
    }
}

declare_table! {
    /// `direction`
    DirectionFile is "run.direction" {
        /// The name of that register, which is writable and takes nothing else.
        register: RequiredKey<String> = required(ValueKind::text());
        /// The word for forward.
        forward: RequiredKey<u16> = required(word());
        /// The word for reverse.
        reverse: OptionalKey<u16> = optional(word()), without "no such order";
    }
}

declare_table! {
    /// One of `[[run.never]]`
    NeverFile is "run.never" with facts: &FactReader<'_> {
        /// The name of another register that takes orders, if it is forbidden there.
        register: OptionalKey<String> = optional(ValueKind::text()), without "the one for run commands";
        /// The word.
        value: RequiredKey<u16> = required(word());
        origin: Option<Origin> = facts.sources();
    }
}

impl FactFile<OrderFile> {
    /// Its word.
    pub fn word(&self) -> Option<&LocatedValue<u16>> {
        self.value.as_ref()?.value.value.as_ref()
    }

    /// The order; `None` if any part is unusable.
    pub(super) fn order(&self) -> Option<Fact<u16>> {
        self.and_then(|order| {
            order.register.clone().optional()?;
            order.clear.clone().optional()?;
            order.keep()?;
            order.drop()?;
            Some(order.value.as_ref()?.value)
        })
    }
}

impl NeverFile {
    /// The word; `None` if any part is unusable.
    fn fact(&self) -> Option<Fact<u16>> {
        fact(self.value.as_ref()?.value, self.origin.as_ref())
    }
}

impl RunFile {
    /// The order `kind`; `None` if the model does not have it.
    pub fn order(&self, kind: OrderKind) -> Option<&FactFile<OrderFile>> {
        match kind {
            OrderKind::Stop => Some(&self.stop),
            OrderKind::Forward => Some(&self.forward),
            OrderKind::Reverse => self.reverse.as_ref(),
            OrderKind::Coast => self.coast.as_ref(),
            OrderKind::Reset => self.reset.as_ref(),
            OrderKind::Release => self.release.as_ref(),
        }
    }

    /// The usable word of the order `kind`.
    pub fn word(&self, kind: OrderKind) -> Option<&LocatedValue<u16>> {
        self.order(kind)?.word()
    }

    /// The register that the order `kind` names.
    pub fn named(&self, kind: OrderKind) -> Option<&LocatedValue<String>> {
        self.order(kind)?.value.as_ref()?.value.register.valid()
    }

    /// The orders that name a register.
    fn named_orders(&self) -> impl Iterator<Item = (OrderKind, &LocatedValue<String>)> {
        OrderKind::ALL
            .into_iter()
            .filter_map(|kind| Some((kind, self.named(kind)?)))
    }

    /// The word that clears the register of the reset.
    pub fn clear(&self) -> Option<&LocatedValue<u16>> {
        let reset = self.order(OrderKind::Reset)?;
        reset.value.as_ref()?.value.clear.valid()
    }

    /// Every register that is named, for whatever it is written.
    pub fn names(&self) -> impl Iterator<Item = &LocatedValue<String>> {
        let direction = self
            .direction
            .iter()
            .filter_map(|fact| fact.value.as_ref()?.value.register.as_ref());
        let never = self.never.iter().filter_map(|never| never.register.valid());
        self.named_orders()
            .map(|(_, name)| name)
            .chain(direction)
            .chain(never)
    }

    /// What the stop does with the bits of an order to run; `None` if that is unusable.
    pub(super) fn stop_bits(&self) -> Option<StopBits> {
        let stop = &self.stop.value.as_ref()?.value;
        Some(StopBits {
            keeps: stop.keep()?,
            drops: stop.drop()?,
        })
    }

    /// The reverse order of a model that writes the direction first, or turns by the sign of the setpoint: the word for
    /// forward, as sure as both.
    pub(super) fn reverse_by_place(&self, forward: &Fact<u16>) -> Option<Fact<u16>> {
        let (confidence, source) = match (&self.direction, &self.reverse_by) {
            (Some(direction), _) => {
                direction.value.as_ref()?.value.reverse.valid()?;
                direction.origin.clone()?
            }
            (None, by_sign) => by_sign.as_ref()?.origin.clone()?,
        };
        Some(Fact {
            value: forward.value,
            confidence: confidence.max(forward.confidence),
            source,
        })
    }

    /// The forbidden words of the register for run commands; `None` if one is unusable.
    pub(super) fn own_never(&self) -> Option<Vec<Fact<u16>>> {
        let all = self.never.iter();
        all.filter(|never| matches!(never.register, OptionalKey::Absent))
            .map(NeverFile::fact)
            .collect()
    }

    /// Where its orders are written; `None` if any part is unusable.
    pub(super) fn places(&self, registers: &[RegisterFile]) -> Option<OrderPlaces> {
        let own = self
            .named_orders()
            .map(|(kind, name)| Some((kind, address_of(&name.value, registers)?)));
        let elsewhere = self.never.iter().filter_map(|never| {
            let name = never.register.valid()?;
            Some((name, never))
        });
        let never = elsewhere
            .map(|(name, never)| Some((address_of(&name.value, registers)?, never.fact()?)));
        Some(OrderPlaces {
            registers: own.collect::<Option<_>>()?,
            clear: self.clear().map(|clear| clear.value),
            direction: match &self.direction {
                None => None,
                Some(direction) => Some(direction.and_then(|it| it.ready(registers))?),
            },
            by_sign: match &self.reverse_by {
                None => false,
                Some(fact) => fact.ready().map(|_| true)?,
            },
            never: never.collect::<Option<_>>()?,
        })
    }
}

impl DirectionFile {
    fn ready(&self, registers: &[RegisterFile]) -> Option<DirectionWords> {
        Some(DirectionWords {
            address: address_of(&self.register.as_ref()?.value, registers)?,
            forward: self.forward.as_ref()?.value,
            reverse: self.reverse.clone().optional()?,
        })
    }
}

/// Guards the registers that orders name, and makes no order surer than the register that it is written to.
pub(super) fn bind(run: &mut RunCommand, registers: &mut [Register]) {
    let places = run.places.clone();
    if places.by_sign
        && let Some(command) = registers
            .iter()
            .find(|it| it.role == Some(RegisterRole::FrequencyCommand))
    {
        let is_stated = command
            .not_stated
            .iter()
            .all(|part| !matches!(part, FactPart::Sign | FactPart::Writing));
        let sureness = if is_stated {
            command.confidence
        } else {
            command.confidence.max(Confidence::Inferred)
        };
        run.reverse
            .iter_mut()
            .for_each(|fact| fact.confidence = fact.confidence.max(sureness));
    }
    let mut written = |address: Address| {
        let register = registers
            .iter_mut()
            .find(|it| it.address == address && it.access.can_write())?;
        register.role = register.role.or(Some(RegisterRole::Order));
        let is_inferred = register.not_stated.contains(&FactPart::Writing);
        Some(if is_inferred {
            register.confidence.max(Confidence::Inferred)
        } else {
            register.confidence
        })
    };
    for (kind, address) in &places.registers {
        let sureness = written(*address);
        if let (Some(sureness), Some(fact)) = (sureness, run.word_mut(*kind)) {
            fact.confidence = fact.confidence.max(sureness);
        }
    }
    if let Some(direction) = &mut run.places.direction {
        let sureness = written(direction.value.address).unwrap_or(direction.confidence);
        direction.confidence = direction.confidence.max(sureness);
        let least = direction.confidence;
        run.reverse
            .iter_mut()
            .for_each(|fact| fact.confidence = fact.confidence.max(least));
    }
    for (address, _) in &places.never {
        written(*address);
    }
}
