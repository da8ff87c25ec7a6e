//! What a word in the run command register means: by its bits and fields, and as an order.

use super::{Fact, OrderKind, RunCommand};
use crate::domain::command::Direction;

/// How the words of run commands are built.
#[derive(Clone, Debug, PartialEq)]
pub enum RunForm {
    /// Each word is one command.
    Values,
    /// Bits and fields have meanings of their own.
    Bits {
        /// The bits with their meanings, in order, each at most once.
        bits: Vec<RunBit>,
        /// The fields, in order. They share no bit with each other or with `bits`.
        fields: Vec<RunField>,
        /// Bits that every command but release contains. They make the drive obey the bus whatever its own settings
        /// say, so even a stop takes control. 0 if the model has none.
        priority: u16,
    },
}

/// One bit of a run command.
#[derive(Clone, Debug, PartialEq)]
pub struct RunBit {
    /// Its number, 0 for the lowest.
    pub bit: Fact<u8>,
    /// What it means.
    pub meaning: BitMeaning,
    /// The meaning holds while the bit is 0, not while it is 1.
    pub is_inverted: bool,
}

/// Neighbouring bits of a run command whose values have meanings.
#[derive(Clone, Debug, PartialEq)]
pub struct RunField {
    /// The bits.
    pub mask: Fact<u16>,
    /// The known values, shifted down, in order; `None`: it does nothing.
    pub values: Vec<(u16, Option<BitMeaning>)>,
}

/// What a bit of a run command means while it holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BitMeaning {
    /// Run; without it the motor is ramped down, unless the model has a `Stop`: then a run order stays until that.
    Run,
    /// The direction is reverse; without it forward, unless the model has a `Forward` as well.
    Reverse,
    /// The direction is forward; without it reverse, unless the model has a `Reverse` as well.
    Forward,
    /// Run forward.
    RunForward,
    /// Run in reverse.
    RunReverse,
    /// Ramp down and stop.
    Stop,
    /// Stop by the fast ramp.
    QuickStop,
    /// Stop by direct current.
    DcBrake,
    /// Keep the output frequency as it is.
    Freeze,
    /// Change the direction.
    Toggle,
    /// The drive does not take the word.
    Ignored,
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

impl BitMeaning {
    /// Whether the motor turns.
    #[must_use]
    pub const fn turns(self) -> bool {
        matches!(
            self,
            Self::Run | Self::RunForward | Self::RunReverse | Self::Jog
        )
    }
}

/// What a drive does with a run command of all zeros.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ZeroWord {
    /// The drive ramps down and stops.
    Stop,
    /// The drive coasts.
    Coast,
    /// The drive takes the word, and goes on as it was ordered before.
    Nothing,
    /// The drive does not take the word.
    Ignored,
    /// The drive obeys panel and terminals from then on.
    Release,
}

/// A meaning of some bits, and when it holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitSense {
    /// The bits.
    pub mask: u16,
    /// The masked word with which it holds.
    pub word: u16,
    /// The meaning.
    pub meaning: BitMeaning,
}

impl BitSense {
    /// The sense in which a single bit has this `meaning`.
    #[must_use]
    pub const fn of_bit(bit: u8, is_inverted: bool, meaning: BitMeaning) -> Self {
        let mask = 1 << (bit & 15);
        Self {
            mask,
            word: if is_inverted { 0 } else { mask },
            meaning,
        }
    }

    /// The sense in which a field has this `meaning`, with `value`, which is shifted down.
    #[must_use]
    pub const fn of_field(mask: u16, value: u16, meaning: BitMeaning) -> Self {
        let shift = if mask == 0 { 0 } else { mask.trailing_zeros() };
        Self {
            mask,
            word: value << shift & mask,
            meaning,
        }
    }

    /// Whether it holds with `word`.
    #[must_use]
    pub const fn holds(&self, word: u16) -> bool {
        word & self.mask == self.word
    }

    /// Whether it holds with the word 0.
    #[must_use]
    pub const fn is_inverted(&self) -> bool {
        self.word == 0
    }
}

/// What a drive does with a word of bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WordEffect {
    /// The drive does not take the word.
    Ignored,
    /// The word does not claim the bus: whom the drive obeys is up to its settings.
    Release,
    /// The drive trips.
    Trip,
    /// The drive cuts its output off.
    Coast,
    /// The drive stops the motor.
    Stop,
    /// The drive runs; `None`: the word does not say in which direction.
    Run(Option<Direction>),
    /// A motor that runs changes its direction, or may do so.
    Turns,
    /// The drive goes on as it was ordered before.
    Nothing,
}

/// The meanings of all bits and fields of a model's run commands. The one place that says what a word of bits does.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WordSenses(pub Vec<BitSense>);

impl WordSenses {
    /// The meanings that hold with `word`.
    pub fn held(&self, word: u16) -> impl Iterator<Item = &BitSense> {
        self.0.iter().filter(move |sense| sense.holds(word))
    }

    /// Whether the model has `meaning` at all.
    #[must_use]
    pub fn exists(&self, meaning: BitMeaning) -> bool {
        self.0.iter().any(|sense| sense.meaning == meaning)
    }

    /// Whether `meaning` holds with `word`.
    #[must_use]
    pub fn has(&self, word: u16, meaning: BitMeaning) -> bool {
        self.held(word).any(|sense| sense.meaning == meaning)
    }

    /// What the drive does with `word`. What keeps a motor from turning takes precedence.
    #[must_use]
    pub fn effect(&self, word: u16) -> WordEffect {
        use BitMeaning::{
            BusRun, Coast, DcBrake, Forward, Freeze, Ignored, QuickStop, Reverse, Stop, Toggle,
            Trip,
        };
        let has = |meaning| self.has(word, meaning);
        if has(Ignored) {
            WordEffect::Ignored
        } else if self.exists(BusRun) && !has(BusRun) {
            WordEffect::Release
        } else if has(Trip) {
            WordEffect::Trip
        } else if has(Coast) {
            WordEffect::Coast
        } else if [Stop, QuickStop, DcBrake].into_iter().any(has) {
            WordEffect::Stop
        } else if has(Freeze) {
            WordEffect::Nothing
        } else if has(Toggle) {
            WordEffect::Turns
        } else if self.held(word).any(|sense| sense.meaning.turns()) {
            WordEffect::Run(self.direction(word))
        } else if self.exists(Stop)
            && self
                .held(word)
                .any(|sense| matches!(sense.meaning, Forward | Reverse))
        {
            WordEffect::Turns
        } else if self.exists(Stop) {
            WordEffect::Nothing
        } else {
            WordEffect::Stop
        }
    }

    /// The direction in which `word` runs the motor; `None` if it says none, or both.
    #[must_use]
    pub fn direction(&self, word: u16) -> Option<Direction> {
        use BitMeaning::{Forward, Reverse, RunForward, RunReverse};
        let has =
            |meanings: [BitMeaning; 2]| meanings.into_iter().any(|meaning| self.has(word, meaning));
        match (has([Forward, RunForward]), has([Reverse, RunReverse])) {
            (true, true) => None,
            (true, false) => Some(Direction::Forward),
            (false, true) => Some(Direction::Reverse),
            (false, false) if !self.exists(Forward) => Some(Direction::Forward),
            (false, false) if !self.exists(Reverse) => Some(Direction::Reverse),
            (false, false) => None,
        }
    }

    /// Whether forward and reverse hold at once.
    #[must_use]
    pub fn contradicts(&self, word: u16) -> bool {
        use BitMeaning::{Forward, Reverse, RunForward, RunReverse};
        let has =
            |meanings: [BitMeaning; 2]| meanings.into_iter().any(|meaning| self.has(word, meaning));
        has([Forward, RunForward]) && has([Reverse, RunReverse])
    }
}

impl RunForm {
    /// The meanings of its bits and fields; empty if each word is one command.
    #[must_use]
    pub fn senses(&self) -> WordSenses {
        let Self::Bits { bits, fields, .. } = self else {
            return WordSenses::default();
        };
        let bits = bits
            .iter()
            .map(|it| BitSense::of_bit(it.bit.value, it.is_inverted, it.meaning));
        let of_field = |field: &RunField| {
            let mask = field.mask.value;
            let known = field
                .values
                .iter()
                .filter_map(move |(value, meaning)| Some((*value, (*meaning)?)));
            known
                .map(move |(value, meaning)| BitSense::of_field(mask, value, meaning))
                .collect::<Vec<_>>()
        };
        WordSenses(bits.chain(fields.iter().flat_map(of_field)).collect())
    }
}

/// What a word in the run command register orders when a client writes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OrderedWord {
    /// Stop.
    Stop,
    /// Run.
    Go(Direction),
    /// Coast.
    Coast,
    /// Reset a trip.
    Reset,
    /// Hand control back to panel and terminals.
    Release,
}

impl OrderedWord {
    const fn of(kind: OrderKind) -> Self {
        match kind {
            OrderKind::Stop => Self::Stop,
            OrderKind::Forward => Self::Go(Direction::Forward),
            OrderKind::Reverse => Self::Go(Direction::Reverse),
            OrderKind::Coast => Self::Coast,
            OrderKind::Reset => Self::Reset,
            OrderKind::Release => Self::Release,
        }
    }
}

impl RunCommand {
    /// What `word` orders when a client writes it; `None` if it is not exactly one known command.
    ///
    /// A client that writes 0 wants the motor stopped. Where 0 is no command of the drive, it is therefore the order to stop, and
    /// the drive's own word for that is sent, never the 0: it would be ignored, or would leave the motor running. Where 0
    /// coasts, it is a coast, if that is proven.
    #[must_use]
    pub fn order_in(&self, word: u16) -> Option<OrderedWord> {
        // The word of an order that has a register of its own means nothing here.
        let is_here = |kind: OrderKind| {
            self.places
                .registers
                .iter()
                .all(|(other, _)| *other != kind)
        };
        let is_word = |kind: OrderKind| self.word(kind).is_some_and(|fact| fact.value == word);
        let exact = OrderKind::ALL
            .into_iter()
            .find(|kind| is_word(*kind) && is_here(*kind));
        let kept = (self.is_stop(word) && is_here(OrderKind::Stop)).then_some(OrderedWord::Stop);
        match exact.map(OrderedWord::of).or(kept) {
            None if word == 0 => self.order_in_zero(),
            order => order,
        }
    }

    /// What a written 0 orders that is no command; `None` if the model does not say what a drive does with it.
    fn order_in_zero(&self) -> Option<OrderedWord> {
        let can_coast = self
            .coast
            .as_ref()
            .is_some_and(|coast| coast.confidence.is_proven());
        Some(match self.zero.as_ref()?.value {
            ZeroWord::Coast if can_coast => OrderedWord::Coast,
            ZeroWord::Stop
            | ZeroWord::Coast
            | ZeroWord::Nothing
            | ZeroWord::Ignored
            | ZeroWord::Release => OrderedWord::Stop,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;
    use crate::profile::model::Confidence;
    use crate::profile::testing::ZERO_NOTHING;

    #[test]
    fn a_word_of_another_register_orders_nothing_in_the_run_command() {
        let mut run = check::model(ZERO_NOTHING).unwrap().run.unwrap();
        let fact = |value| {
            Some(Fact {
                value,
                confidence: Confidence::Manual,
                source: "UM 4".to_owned(),
            })
        };
        (run.release, run.coast) = (fact(0), fact(7));
        assert_eq!(
            (run.order_in(0), run.order_in(7)),
            (Some(OrderedWord::Release), Some(OrderedWord::Coast))
        );
        run.places.registers = [OrderKind::Release, OrderKind::Coast]
            .map(|kind| (kind, 0x3000_u16.into()))
            .to_vec();
        assert_eq!(
            (run.order_in(0), run.order_in(7)),
            (Some(OrderedWord::Stop), None)
        );
        assert_eq!(
            run.order_in(0x0012),
            Some(OrderedWord::Go(Direction::Forward))
        );
    }
}
