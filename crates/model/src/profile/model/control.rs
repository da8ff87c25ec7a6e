//! Questions to a model about its control: orders, starts, resets, what they rest on, stored parameters, the watchdog.

use super::{
    BasicFact, CommitEffect, CommitWord, Confidence, DirectionWords, Fact, FactPart, Model,
    OrderKind, OrderedWord, RegisterRole, ResetStep, ResetWrite, StartStep,
};
use crate::domain::address::Address;
use crate::domain::control::ControlAction;
use crate::domain::units::UnitOfMeasure;
use std::time::Duration;

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

    /// The second source of the fact `key`.
    #[must_use]
    pub fn second_source(&self, key: &str) -> Option<&str> {
        self.second_sources
            .iter()
            .find(|second| second.key == key)
            .map(|second| second.source.as_str())
    }

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

    /// The steps before the run word.
    #[must_use]
    pub fn start_steps(&self) -> &[StartStep] {
        self.run.as_ref().map_or(&[], |run| &run.start.steps)
    }

    /// The word that takes back a start; `None` if the model starts by the run word alone.
    #[must_use]
    pub fn start_take_back(&self) -> Option<u16> {
        let run = self
            .run
            .as_ref()
            .filter(|run| !run.start.steps.is_empty())?;
        Some(run.start.take_back.as_ref().unwrap_or(&run.stop).value)
    }

    /// The longest time that passes between the first word of a start and the run word.
    #[must_use]
    pub fn start_waits(&self) -> Duration {
        self.start_steps().iter().map(|step| step.longest()).sum()
    }

    /// The word that has this effect; `None` if the model has none or it is unproven, because then it is never sent.
    #[must_use]
    pub fn commit(&self, effect: CommitEffect) -> Option<&CommitWord> {
        self.commit
            .stated(effect)
            .filter(|fact| fact.confidence.is_proven())
            .map(|fact| &fact.value)
    }

    /// The word that follows what a person at the host sets: the one that stores, else the one that applies.
    #[must_use]
    pub fn last_commit(&self) -> Option<&CommitWord> {
        self.commit(CommitEffect::Store)
            .or_else(|| self.commit(CommitEffect::Apply))
    }

    /// The proven word with which `value` at `address` takes over or stores parameters.
    #[must_use]
    pub fn commit_at(&self, address: Address, value: u16) -> Option<&CommitWord> {
        let all = [CommitEffect::Store, CommitEffect::Apply]
            .into_iter()
            .filter_map(|effect| self.commit(effect));
        all.into_iter()
            .find(|word| word.address == address && word.value == value)
    }

    /// The watchdog time that `word` sets; `None` if the watchdog is off, or the model has none.
    #[must_use]
    pub fn watchdog_time(&self, word: u16) -> Option<Duration> {
        let watchdog = self
            .watchdog
            .as_ref()
            .filter(|watchdog| watchdog.off.value != word)?;
        let register = self.register_at(watchdog.time)?;
        let seconds = f64::from(word) / f64::from(register.scale.max(1));
        (register.unit == UnitOfMeasure::Second).then(|| Duration::from_secs_f64(seconds))
    }

    /// The word that sets the watchdog to exactly `time`, or switches it off without one; `None` if no word does.
    #[must_use]
    pub fn watchdog_word(&self, time: Option<Duration>) -> Option<u16> {
        let watchdog = self.watchdog.as_ref()?;
        let Some(time) = time else {
            return Some(watchdog.off.value);
        };
        let register = self.register_at(watchdog.time)?;
        let steps = time.as_millis() * u128::from(register.scale);
        if !steps.is_multiple_of(1000) {
            return None;
        }
        let word = u16::try_from(steps / 1000).ok()?;
        (register.takes(word) && self.watchdog_time(word) == Some(time)).then_some(word)
    }

    /// Whether the facts about the drive's own watchdog are proven.
    #[must_use]
    pub fn watchdog_is_proven(&self) -> bool {
        self.watchdog.as_ref().is_some_and(|watchdog| {
            let registers = [Some(watchdog.time), watchdog.action].into_iter().flatten();
            let mut registers = registers.filter_map(|address| self.register_at(address));
            watchdog.off.confidence.is_proven()
                && registers.all(|register| register.confidence.is_proven())
        })
    }

    /// Whether a write to `address` sets the drive's own watchdog: its time, its reaction, or a stored twin of either.
    #[must_use]
    pub fn sets_watchdog(&self, address: impl Into<Address>) -> bool {
        let address = address.into();
        let Some(watchdog) = &self.watchdog else {
            return false;
        };
        let is_one =
            |address: Address| watchdog.time == address || watchdog.action == Some(address);
        is_one(address)
            || self
                .stored_twin(address)
                .is_some_and(|register| is_one(register.address))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::model::ModelWatchdog;
    use crate::vendors::testing::fact;

    #[test]
    fn a_time_is_a_word_only_where_the_drive_has_just_that_time() {
        let mut model = crate::vendors::testing::model();
        let Some(register) = model
            .registers
            .iter_mut()
            .find(|register| register.address == 0x020C)
        else {
            panic!("it has a ramp")
        };
        register.unit = UnitOfMeasure::Second;
        register.scale = 10;
        register.range = Some(0..=255);
        assert_eq!(
            (model.watchdog_time(20), model.watchdog_word(None)),
            (None, None),
            "it has none"
        );
        model.watchdog = Some(ModelWatchdog {
            time: 0x020C_u16.into(),
            off: fact(0),
            action: None,
            action_digit: None,
            keeps_running: Vec::new(),
            stops: Vec::new(),
        });
        let word = |millis| model.watchdog_word(Some(Duration::from_millis(millis)));
        assert_eq!(
            [0, 50, 100, 2500, 25_500, 25_600].map(word),
            [None, None, Some(1), Some(25), Some(255), None]
        );
        assert_eq!(
            (model.watchdog_word(None), model.watchdog_time(0)),
            (Some(0), None)
        );
        assert_eq!(model.watchdog_time(25), Some(Duration::from_millis(2500)));
        assert!(
            model.watchdog_is_proven()
                && model.sets_watchdog(0x020C)
                && !model.sets_watchdog(0x020E)
        );
    }
}
