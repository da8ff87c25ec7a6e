//! `[run]`: how run commands are given.

use super::facts::{FactFile, FactReader, given};
use super::kinds::{mask, word};
use super::orders::{DirectionFile, NeverFile, OrderFile, REVERSE_BY};
use super::reset::{self, ResetStepFile};
use super::run_word::{BitFile, FieldFile};
use super::start::StartStepFile;
use super::state::StateFile;
use crate::profile::model::{OrderKind, RunCommand, RunForm, StartWords, WordSenses, ZeroWord};
use crate::profile::register::RegisterFile;
use crate::profile::words::{ZERO_WORDS, declare_words};
use crate::toml_file::declare::{declare_table, optional, required, tables};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey};

declare_words! {
    /// How the words of run commands are built.
    FORMS: FormWord {
        /// Each word is one command.
        Values "values";
        /// Each bit has a meaning of its own, see `[[run.bit]]`.
        Bits "bits";
    }
}

/// How the words are built, as written in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FormWord {
    Values,
    Bits,
}

declare_table! {
    /// The words of run commands. They are written to the register with `role = "run-command"`. Without this table the drive is
    /// only read.
    RunFile is "[run]" with facts: &FactReader<'_> {
        /// How the words are built.
        form: RequiredKey<FormWord> = required(ValueKind::one_of(&FORMS));
        bits as "bit": Vec<BitFile> = tables(|reader| BitFile::read(facts, reader));
        fields as "field": Vec<FieldFile> = tables(|reader| FieldFile::read(facts, reader));
        /// Bits that every command but `release` contains: the drive obeys the bus whatever its settings say.
        priority: OptionalKey<u16> = optional(mask()), or 0, without "none";
        /// The word that ramps the motor down.
        stop: FactFile<OrderFile> = facts.parts(|reader| OrderFile::keys(OrderKind::Stop, reader));
        /// The word that runs the motor forward.
        forward: FactFile<OrderFile> =
            facts.parts(|reader| OrderFile::keys(OrderKind::Forward, reader));
        /// The word that runs the motor in reverse.
        reverse: Option<FactFile<OrderFile>> =
            facts.optional_parts(|reader| OrderFile::keys(OrderKind::Reverse, reader)),
            without "no such order";
        /// The word that cuts the output off.
        coast: Option<FactFile<OrderFile>> =
            facts.optional_parts(|reader| OrderFile::keys(OrderKind::Coast, reader)),
            without "no such order";
        /// The word that resets a trip.
        reset: Option<FactFile<OrderFile>> =
            facts.optional_parts(|reader| OrderFile::keys(OrderKind::Reset, reader)),
            without "no such order";
        /// The word that hands control back to panel and terminals.
        release: Option<FactFile<OrderFile>> =
            facts.optional_parts(|reader| OrderFile::keys(OrderKind::Release, reader)),
            without "no such order";
        /// The words of a reset in the order in which they are written: `stop` first, then only `reset` and `stop`; with bits
        /// `stop` is also the last, because it clears the reset bit. At most 8. A word may be a table with the keys below.
        reset_sequence: OptionalKey<Vec<ResetStepFile>> = reset::sequence(),
            without "required with a `reset` that has no register of its own";
        /// What the drive does with the word 0. Required where the meanings of bits leave it open. A 0 that a client writes is a
        /// coast where 0 coasts and `coast` is proven; otherwise it goes out as the stop word.
        zero: Option<FactFile<ZeroWord>> =
            facts.optional_value(ValueKind::choice(&ZERO_WORDS, zero_means)),
            without "a stop, if `stop` is 0";
        /// The words before the run word, see `[[run.start]]`.
        start: Vec<StartStepFile> = tables(|reader| StartStepFile::read(facts, reader)),
            without "the run word alone";
        /// The word that takes back a start that the drive does not follow. Only beside `[[run.start]]`.
        take_back: Option<FactFile<u16>> = facts.optional_value(word()), without "`stop`";
        /// The states of the drive in the vendor's words, see `[[run.state]]`.
        states as "state": Vec<StateFile> = tables(|reader| StateFile::read(facts, reader)),
            without "no texts";
        /// The direction, where it is written to a register of its own before the run word. `reverse` is then left out.
        direction: Option<FactFile<DirectionFile>> = facts.optional_parts(DirectionFile::keys),
            without "part of the run word";
        /// How reverse is ordered beside the word for forward: by a setpoint below 0. `reverse` is then left out.
        reverse_by: Option<FactFile<()>> = facts.optional_value(ValueKind::one_of(&REVERSE_BY)),
            without "a word of its own";
        /// Words that are never written, whatever a client asks for.
        never: Vec<NeverFile> = tables(|reader| NeverFile::read(facts, reader)), without "none";
    }
}

impl RunFile {
    /// The usable command words, each with its order.
    pub fn words(&self) -> impl Iterator<Item = (OrderKind, &LocatedValue<u16>)> {
        OrderKind::ALL
            .into_iter()
            .filter_map(|kind| Some((kind, self.word(kind)?)))
    }

    /// The usable meanings of bits and fields.
    pub fn senses(&self) -> WordSenses {
        let bits = self.bits.iter().filter_map(BitFile::sense);
        WordSenses(
            bits.chain(self.fields.iter().flat_map(FieldFile::senses))
                .collect(),
        )
    }

    /// The usable words that are written to the register for run commands, each with its order.
    pub fn own_words(&self) -> impl Iterator<Item = (OrderKind, &LocatedValue<u16>)> {
        self.words().filter(|(kind, _)| self.named(*kind).is_none())
    }

    /// The words that are never written, each with the register that it names.
    pub fn never(&self) -> impl Iterator<Item = (Option<&str>, &LocatedValue<u16>)> {
        self.never.iter().filter_map(|never| {
            let name = never.register.valid();
            Some((name.map(|name| name.value.as_str()), never.value.as_ref()?))
        })
    }

    /// The words that are written beside the orders when the drive is started.
    pub fn start_words(&self) -> impl Iterator<Item = &LocatedValue<u16>> {
        let steps = self.start.iter().filter_map(|step| step.write.as_ref());
        let back = self.take_back.iter();
        steps.chain(back.filter_map(|fact| fact.value.as_ref()))
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<RunCommand> {
        let forward = self.forward.order()?;
        let ready = |order: &Option<FactFile<OrderFile>>| match order {
            None => Some(None),
            Some(order) => order.order().map(Some),
        };
        Some(RunCommand {
            form: match self.form.as_ref()?.value {
                FormWord::Values => RunForm::Values,
                FormWord::Bits => {
                    let mut bits = self
                        .bits
                        .iter()
                        .map(BitFile::ready)
                        .collect::<Option<Vec<_>>>()?;
                    bits.sort_by_key(|bit| bit.bit.value);
                    let mut fields = self
                        .fields
                        .iter()
                        .map(FieldFile::ready)
                        .collect::<Option<Vec<_>>>()?;
                    fields.sort_by_key(|field| field.mask.value);
                    RunForm::Bits {
                        bits,
                        fields,
                        priority: self.priority()?,
                    }
                }
            },
            stop: self.stop.order()?,
            stop_bits: self.stop_bits()?,
            reverse: ready(&self.reverse)?.or_else(|| self.reverse_by_place(&forward)),
            forward,
            coast: ready(&self.coast)?,
            reset: ready(&self.reset)?,
            release: ready(&self.release)?,
            reset_sequence: reset::ready(&self.reset_sequence, registers)?,
            never: self.own_never()?,
            zero: given(&self.zero)?,
            places: self.places(registers)?,
            start: StartWords {
                steps: self
                    .start
                    .iter()
                    .map(|step| step.ready(registers))
                    .collect::<Option<_>>()?,
                take_back: given(&self.take_back)?,
            },
            states: self
                .states
                .iter()
                .map(|state| state.ready(registers))
                .collect::<Option<_>>()?,
        })
    }

    /// `word` in the notation of the file's form.
    pub fn shown(&self, word: u16) -> String {
        match self.form.as_ref().map(|form| form.value) {
            Some(FormWord::Bits) => format!("0x{word:04X}"),
            Some(FormWord::Values) | None => word.to_string(),
        }
    }
}

/// What a drive does with a word of zeros, for a file that says something else.
const fn zero_means(zero: ZeroWord) -> &'static str {
    match zero {
        ZeroWord::Stop => "the motor ramps down",
        ZeroWord::Coast => "the motor coasts",
        ZeroWord::Nothing => "the word is taken and changes nothing",
        ZeroWord::Ignored => "the word is not taken",
        ZeroWord::Release => "panel and terminals take over",
    }
}
