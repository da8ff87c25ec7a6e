//! `[run]`: how run commands are given.

use super::facts::{FactFile, FactReader, optional};
use super::orders::PlacesFile;
use super::reset::{self, ResetStepFile};
use super::run_word::{BitFile, FieldFile};
use super::start::StartFile;
use super::state::StateFile;
use crate::profile::model::{OrderKind, RunCommand, RunForm, WordSenses, ZeroWord};
use crate::profile::register::RegisterFile;
use crate::profile::words::ZERO_WORDS;
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader};

/// How the words of run commands are built.
const FORMS: [(&str, FormWord); 2] = [("values", FormWord::Values), ("bits", FormWord::Bits)];

/// How the words are built, as written in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::profile) enum FormWord {
    Values,
    Bits,
}

/// `[run]`
pub(in crate::profile) struct RunFile {
    pub form: RequiredKey<FormWord>,
    pub bits: Vec<BitFile>,
    pub fields: Vec<FieldFile>,
    pub priority: OptionalKey<u16>,
    pub stop: FactFile<u16>,
    pub forward: FactFile<u16>,
    pub reverse: Option<FactFile<u16>>,
    pub coast: Option<FactFile<u16>>,
    pub reset: Option<FactFile<u16>>,
    pub release: Option<FactFile<u16>>,
    pub reset_sequence: OptionalKey<Vec<ResetStepFile>>,
    pub zero: Option<FactFile<ZeroWord>>,
    pub places: PlacesFile,
    pub start: StartFile,
    pub states: Vec<StateFile>,
}

impl RunFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let mut places = PlacesFile::default();
        let mut run = Self {
            form: reader.required("form", &ValueKind::one_of(&FORMS)),
            bits: reader
                .tables("bit")
                .into_iter()
                .map(|it| BitFile::read(facts, reader.open(it)))
                .collect(),
            fields: reader
                .tables("field")
                .into_iter()
                .map(|it| FieldFile::read(facts, reader.open(it)))
                .collect(),
            priority: reader.optional("priority", &ValueKind::number(1..=u16::MAX)),
            stop: places.order(facts, &mut reader, OrderKind::Stop),
            forward: places.order(facts, &mut reader, OrderKind::Forward),
            reverse: places.optional_order(facts, &mut reader, OrderKind::Reverse),
            coast: places.optional_order(facts, &mut reader, OrderKind::Coast),
            reset: places.optional_order(facts, &mut reader, OrderKind::Reset),
            release: places.optional_order(facts, &mut reader, OrderKind::Release),
            reset_sequence: reset::read(&mut reader),
            zero: facts.optional_value(
                &mut reader,
                "zero",
                &ValueKind::choice(&ZERO_WORDS, zero_means),
            ),
            places: PlacesFile::default(),
            start: StartFile::read(facts, &mut reader),
            states: reader
                .tables("state")
                .into_iter()
                .map(|it| StateFile::read(facts, reader.open(it)))
                .collect(),
        };
        places.read_rest(facts, &mut reader);
        run.places = places;
        reader.finish();
        run
    }

    /// The usable command words, each with its order.
    pub fn words(&self) -> impl Iterator<Item = (OrderKind, &LocatedValue<u16>)> {
        let all = [
            (OrderKind::Stop, Some(&self.stop)),
            (OrderKind::Forward, Some(&self.forward)),
            (OrderKind::Reverse, self.reverse.as_ref()),
            (OrderKind::Coast, self.coast.as_ref()),
            (OrderKind::Reset, self.reset.as_ref()),
            (OrderKind::Release, self.release.as_ref()),
        ];
        all.into_iter()
            .filter_map(|(order, fact)| Some((order, fact?.value.as_ref()?)))
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
        self.words()
            .filter(|(kind, _)| self.places.named(*kind).is_none())
    }

    /// The words that are never written, each with the register that it names.
    pub fn never(&self) -> impl Iterator<Item = (Option<&str>, &LocatedValue<u16>)> {
        let all = self.places.never.iter();
        all.filter_map(|(fact, name)| {
            Some((
                name.valid().map(|name| name.value.as_str()),
                fact.value.as_ref()?,
            ))
        })
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self, registers: &[RegisterFile]) -> Option<RunCommand> {
        let forward = self.forward.ready()?;
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
                        priority: self.priority.or(0)?,
                    }
                }
            },
            stop: self.stop.ready()?,
            stop_bits: self.places.stop_bits(),
            reverse: optional(self.reverse.as_ref())?.or_else(|| self.places.reverse(&forward)),
            forward,
            coast: optional(self.coast.as_ref())?,
            reset: optional(self.reset.as_ref())?,
            release: optional(self.release.as_ref())?,
            reset_sequence: reset::ready(&self.reset_sequence, registers)?,
            never: self.places.own_never()?,
            zero: optional(self.zero.as_ref())?,
            places: self.places.ready(registers)?,
            start: self.start.ready(registers)?,
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
