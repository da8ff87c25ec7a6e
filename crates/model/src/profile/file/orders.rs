//! `[run]`: the registers of orders that are not written to the one for run commands, and the direction.

use super::facts::{FactFile, FactReader, whole};
use crate::domain::address::Address;
use crate::profile::model::{
    Confidence, DirectionWords, Fact, FactPart, OrderKind, OrderPlaces, Register, RegisterRole,
    RunCommand, StopBits,
};
use crate::profile::register::{RegisterFile, address_of};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader};

/// Values of `reverse_by`.
const REVERSE_BY: [(&str, ()); 1] = [("sign", ())];

/// What `[run]` says about the places of its orders.
#[derive(Default)]
pub(in crate::profile) struct PlacesFile {
    /// The orders that name a register.
    pub registers: Vec<(OrderKind, LocatedValue<String>)>,
    /// A register or `clear` was unusable.
    is_damaged: bool,
    pub clear: Option<LocatedValue<u16>>,
    /// Bits of the last order to run that the stop keeps.
    pub keep: Option<LocatedValue<u16>>,
    /// Bits of it that the stop changes.
    pub drop: Option<LocatedValue<u16>>,
    pub direction: Option<FactFile<DirectionFile>>,
    pub reverse_by: Option<FactFile<()>>,
    /// The forbidden words, each with its register, if it names one.
    pub never: Vec<(FactFile<u16>, OptionalKey<String>)>,
}

/// `direction`
pub(in crate::profile) struct DirectionFile {
    pub register: RequiredKey<String>,
    pub forward: RequiredKey<u16>,
    pub reverse: OptionalKey<u16>,
}

impl PlacesFile {
    /// The order `kind`, which may name its register.
    pub(super) fn order(
        &mut self,
        facts: &FactReader<'_>,
        reader: &mut TableReader<'_, '_>,
        kind: OrderKind,
    ) -> FactFile<u16> {
        facts.needed(reader, kind.keyword(), |reader| self.parts(reader, kind))
    }

    /// The order `kind`, which may name its register; `None` if the model does not have it.
    pub(super) fn optional_order(
        &mut self,
        facts: &FactReader<'_>,
        reader: &mut TableReader<'_, '_>,
        kind: OrderKind,
    ) -> Option<FactFile<u16>> {
        facts.optional(reader, kind.keyword(), |reader| self.parts(reader, kind))
    }

    fn parts(&mut self, reader: &mut TableReader<'_, '_>, kind: OrderKind) -> RequiredKey<u16> {
        let word = ValueKind::number(0..=u16::MAX);
        let value = reader.required("value", &word);
        match reader.optional("register", &ValueKind::text()) {
            OptionalKey::Absent => {}
            OptionalKey::Invalid => self.is_damaged = true,
            OptionalKey::Valid(name) => self.registers.push((kind, name)),
        }
        if kind == OrderKind::Reset {
            self.clear = self.word(reader, "clear", &word);
        }
        if kind == OrderKind::Stop {
            let bits = ValueKind::number(1..=u16::MAX);
            self.keep = self.word(reader, "keep", &bits);
            self.drop = self.word(reader, "drop", &bits);
        }
        value
    }

    fn word(
        &mut self,
        reader: &mut TableReader<'_, '_>,
        key: &'static str,
        kind: &ValueKind<u16>,
    ) -> Option<LocatedValue<u16>> {
        match reader.optional(key, kind) {
            OptionalKey::Absent => None,
            OptionalKey::Invalid => {
                self.is_damaged = true;
                None
            }
            OptionalKey::Valid(word) => Some(word),
        }
    }

    /// What the stop does with the bits of an order to run.
    pub(super) fn stop_bits(&self) -> StopBits {
        let bits = |written: &Option<LocatedValue<u16>>| {
            written.as_ref().map_or(0, |written| written.value)
        };
        StopBits {
            keeps: bits(&self.keep),
            drops: bits(&self.drop),
        }
    }

    /// `direction`, `reverse_by` and `never`.
    pub(super) fn read_rest(&mut self, facts: &FactReader<'_>, reader: &mut TableReader<'_, '_>) {
        let word = ValueKind::number(0..=u16::MAX);
        self.direction = facts.optional(reader, "direction", |reader| {
            whole(reader, |reader| DirectionFile {
                register: reader.required("register", &ValueKind::text()),
                forward: reader.required("forward", &word),
                reverse: reader.optional("reverse", &word),
            })
        });
        self.reverse_by =
            facts.optional_value(reader, "reverse_by", &ValueKind::one_of(&REVERSE_BY));
        for section in reader.tables("never") {
            let mut register = OptionalKey::Absent;
            let never = facts.fact(reader.open(section), |reader| {
                register = reader.optional("register", &ValueKind::text());
                reader.required("value", &word)
            });
            self.never.push((never, register));
        }
    }

    /// The register that the order `kind` names.
    pub fn named(&self, kind: OrderKind) -> Option<&LocatedValue<String>> {
        self.registers
            .iter()
            .find(|(of, _)| *of == kind)
            .map(|(_, name)| name)
    }

    /// Every register that is named, for whatever it is written.
    pub fn names(&self) -> impl Iterator<Item = &LocatedValue<String>> {
        let direction = self
            .direction
            .iter()
            .filter_map(|fact| fact.value.as_ref()?.value.register.as_ref());
        let never = self.never.iter().filter_map(|(_, name)| name.valid());
        self.registers
            .iter()
            .map(|(_, name)| name)
            .chain(direction)
            .chain(never)
    }

    /// The reverse order of a model that writes the direction first, or turns by the sign of the setpoint: the word for
    /// forward, as sure as both.
    pub(super) fn reverse(&self, forward: &Fact<u16>) -> Option<Fact<u16>> {
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
        let is_own = |(_, name): &&(_, OptionalKey<String>)| matches!(name, OptionalKey::Absent);
        self.never
            .iter()
            .filter(is_own)
            .map(|(fact, _)| fact.ready())
            .collect()
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<OrderPlaces> {
        if self.is_damaged {
            return None;
        }
        let own = self
            .registers
            .iter()
            .map(|(kind, name)| Some((*kind, address_of(&name.value, registers)?)));
        let never = self.never.iter().filter(|(_, name)| name.valid().is_some());
        let never = never.map(|(fact, name)| {
            Some((address_of(&name.valid()?.value, registers)?, fact.ready()?))
        });
        Some(OrderPlaces {
            registers: own.collect::<Option<_>>()?,
            clear: self.clear.as_ref().map(|clear| clear.value),
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
