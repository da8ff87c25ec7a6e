//! A model file as it is written: each fact with its place, its confidence and its source, nothing compared.

use super::model::{Boundary, Confidence, Fact, RefusedWrite};
use super::reader::{Given, Needed, Place, Reader, Section, Written};
use super::register::RegisterFile;
use super::values::Kind;
use super::words::{BOUNDARIES, CONFIDENCES, FRAMINGS, INTERFACES, PARITIES, REFUSED_WRITES};
use crate::domain::link::{Framing, Interface, Parity};
use crate::domain::problem::Problem;
use std::time::Duration;

/// Speeds that a file may state, in bit/s.
const BAUDS: std::ops::RangeInclusive<u32> = 300..=1_000_000;

/// How sure something is, and where it comes from.
pub(super) type Origin = (Confidence, String);

/// A fact as written: a table that holds the value, its confidence and its source. What of it is nothing is
/// already reported.
pub(super) struct FactFile<T> {
    pub value: Needed<T>,
    pub origin: Option<Origin>,
}

impl<T> FactFile<T> {
    const UNUSABLE: Self = Self { value: None, origin: None };

    /// The fact with its value made into another, where all of it can be used.
    pub fn and_then<U>(&self, make: impl FnOnce(&T) -> Option<U>) -> Option<Fact<U>> {
        let (confidence, source) = self.origin.clone()?;
        Some(Fact { value: make(&self.value.as_ref()?.value)?, confidence, source })
    }
}

impl<T: Clone> FactFile<T> {
    /// The fact, where all of it can be used.
    pub fn ready(&self) -> Option<Fact<T>> {
        self.and_then(|value| Some(value.clone()))
    }
}

/// The whole file.
pub(super) struct ModelFile {
    pub id: Needed<String>,
    pub vendor: Needed<String>,
    pub title: Needed<String>,
    pub documents: Option<Vec<(String, String)>>,
    pub link: Option<LinkFile>,
    pub timing: Option<TimingFile>,
    pub read: Option<ReadFile>,
    pub refused_write: Option<FactFile<RefusedWrite>>,
    pub barrier_reads: Vec<BarrierFile>,
    pub run: Given<RunFile>,
    pub registers: Vec<RegisterFile>,
}

/// `[link]`
pub(super) struct LinkFile {
    pub default: FactFile<DefaultFile>,
    pub bauds: FactFile<Vec<u32>>,
    pub parities: FactFile<Vec<Parity>>,
    pub stop_bits: FactFile<Vec<u8>>,
    pub data_bits: FactFile<Vec<u8>>,
    pub framings: FactFile<Vec<Framing>>,
    pub interfaces: FactFile<Vec<Interface>>,
    pub stations: FactFile<StationsFile>,
    pub broadcast: Option<FactFile<BroadcastFile>>,
}

/// `link.default`
pub(super) struct DefaultFile {
    pub baud: Needed<u32>,
    pub data_bits: Needed<u8>,
    pub parity: Needed<Parity>,
    pub stop_bits: Needed<u8>,
}

/// `link.stations`
pub(super) struct StationsFile {
    pub from: Needed<u8>,
    pub to: Needed<u8>,
}

/// `link.broadcast`
pub(super) struct BroadcastFile {
    pub station: Needed<u8>,
    pub functions: Needed<Vec<u8>>,
}

/// `[timing]`
pub(super) struct TimingFile {
    pub gap_chars: FactFile<f64>,
    pub reply_timeout_cap: FactFile<Duration>,
    pub processing_max: Option<FactFile<Duration>>,
    pub max_lateness: FactFile<Duration>,
}

/// `[read]`
pub(super) struct ReadFile {
    pub max_words: FactFile<u16>,
    pub boundary: Given<Boundary>,
}

/// One of `[[barrier_read]]`
pub(super) struct BarrierFile {
    pub place: Place,
    pub address: Needed<u16>,
    pub count: Needed<u16>,
}

/// `[run]`
pub(super) struct RunFile {
    pub stop: FactFile<u16>,
    pub forward: FactFile<u16>,
    pub reverse: Option<FactFile<u16>>,
    pub coast: Option<FactFile<u16>>,
    pub reset: Option<FactFile<u16>>,
    pub reset_sequence: Given<Vec<Written<u16>>>,
}

/// Reads the outermost table of a model file.
pub(super) fn read(section: Section<'_>, problems: &mut Vec<Problem>) -> ModelFile {
    let mut reader = Reader::new(section, problems);
    let documents = reader.required_table("documents").map(|it| documents(reader.open(it)));
    let proven = Facts { documents: documents.as_deref(), defaults: false };
    let chosen = Facts { documents: documents.as_deref(), defaults: true };
    let file = ModelFile {
        id: reader.required("id", &Kind::parsed("`vendor-model`: a to z and 0 to 9 between single dashes", id)),
        vendor: reader.required("vendor", &Kind::text()),
        title: reader.required("title", &Kind::text()),
        link: reader.required_table("link").map(|it| proven.link(reader.open(it))),
        timing: reader.required_table("timing").map(|it| chosen.timing(reader.open(it))),
        read: reader.required_table("read").map(|it| proven.read(reader.open(it))),
        refused_write: reader.required_table("write").map(|it| proven.refused_write(reader.open(it))),
        barrier_reads: reader.tables("barrier_read").into_iter().map(|it| barrier(reader.open(it))).collect(),
        run: match reader.table("run") {
            Given::LeftOut => Given::LeftOut,
            Given::Unusable => Given::Unusable,
            Given::Usable(Written { value, place }) => {
                Given::Usable(Written { value: proven.run(reader.open(value)), place })
            }
        },
        registers: reader.tables("register").into_iter().map(|it| proven.register(reader.open(it))).collect(),
        documents,
    };
    reader.finish();
    file
}

/// Reads facts and checks that each names one of the documents.
struct Facts<'d> {
    /// Nothing: the documents themselves cannot be read, so no source can be told wrong.
    documents: Option<&'d [(String, String)]>,
    /// Whether a fact may be a choice without a document.
    defaults: bool,
}

impl Facts<'_> {
    fn link(&self, mut reader: Reader<'_, '_>) -> LinkFile {
        let link = LinkFile {
            default: self.needed(&mut reader, "default", |reader| whole(reader, default_settings)),
            bauds: self.list(&mut reader, "bauds", &Kind::number(BAUDS)),
            parities: self.list(&mut reader, "parities", &Kind::one_of(&PARITIES)),
            stop_bits: self.list(&mut reader, "stop_bits", &Kind::number(1..=2_u8)),
            data_bits: self.list(&mut reader, "data_bits", &Kind::number(7..=8_u8)),
            framings: self.list(&mut reader, "framings", &Kind::one_of(&FRAMINGS)),
            interfaces: self.list(&mut reader, "interfaces", &Kind::one_of(&INTERFACES)),
            stations: self.needed(&mut reader, "stations", |reader| whole(reader, stations)),
            broadcast: self.optional(&mut reader, "broadcast", |reader| whole(reader, broadcast)),
        };
        reader.finish();
        link
    }

    fn timing(&self, mut reader: Reader<'_, '_>) -> TimingFile {
        let time = Kind::duration(Duration::from_millis(1)..=Duration::from_secs(60));
        let timing = TimingFile {
            gap_chars: self.value(&mut reader, "gap_chars", &Kind::decimal(3.5..=100.0)),
            reply_timeout_cap: self.value(&mut reader, "reply_timeout_cap", &time),
            processing_max: self.optional_value(&mut reader, "processing_max", &time),
            max_lateness: self.value(&mut reader, "max_lateness", &time),
        };
        reader.finish();
        timing
    }

    fn read(&self, mut reader: Reader<'_, '_>) -> ReadFile {
        let read = ReadFile {
            max_words: self.value(&mut reader, "max_words", &Kind::number(1..=125_u16)),
            boundary: reader.optional("boundary", &Kind::one_of(&BOUNDARIES)),
        };
        reader.finish();
        read
    }

    fn refused_write(&self, mut reader: Reader<'_, '_>) -> FactFile<RefusedWrite> {
        let refused = self.value(&mut reader, "refused", &Kind::one_of(&REFUSED_WRITES));
        reader.finish();
        refused
    }

    fn run(&self, mut reader: Reader<'_, '_>) -> RunFile {
        let word = Kind::number(0..=u16::MAX);
        let run = RunFile {
            stop: self.value(&mut reader, "stop", &word),
            forward: self.value(&mut reader, "forward", &word),
            reverse: self.optional_value(&mut reader, "reverse", &word),
            coast: self.optional_value(&mut reader, "coast", &word),
            reset: self.optional_value(&mut reader, "reset", &word),
            reset_sequence: reader.list("reset_sequence", &word),
        };
        reader.finish();
        run
    }

    fn register(&self, mut reader: Reader<'_, '_>) -> RegisterFile {
        let origin = self.origin(&mut reader);
        RegisterFile::of_model(reader, origin)
    }

    /// The fact `key`, whose value stands under `value`.
    fn value<T>(&self, reader: &mut Reader<'_, '_>, key: &'static str, kind: &Kind<'_, T>) -> FactFile<T> {
        self.needed(reader, key, |reader| reader.required("value", kind))
    }

    /// The fact `key`, whose value stands under `value`; nothing where it is left out.
    fn optional_value<T>(
        &self,
        reader: &mut Reader<'_, '_>,
        key: &'static str,
        kind: &Kind<'_, T>,
    ) -> Option<FactFile<T>> {
        self.optional(reader, key, |reader| reader.required("value", kind))
    }

    /// The fact `key`, whose value is a list under `value`.
    fn list<T>(&self, reader: &mut Reader<'_, '_>, key: &'static str, kind: &Kind<'_, T>) -> FactFile<Vec<T>> {
        self.needed(reader, key, |reader| filled_list(reader, "value", kind))
    }

    fn needed<T>(
        &self,
        reader: &mut Reader<'_, '_>,
        key: &'static str,
        value: impl FnOnce(&mut Reader<'_, '_>) -> Needed<T>,
    ) -> FactFile<T> {
        match reader.required_table(key) {
            None => FactFile::UNUSABLE,
            Some(section) => self.fact(reader.open(section), value),
        }
    }

    fn optional<T>(
        &self,
        reader: &mut Reader<'_, '_>,
        key: &'static str,
        value: impl FnOnce(&mut Reader<'_, '_>) -> Needed<T>,
    ) -> Option<FactFile<T>> {
        match reader.table(key) {
            Given::LeftOut => None,
            Given::Unusable => Some(FactFile::UNUSABLE),
            Given::Usable(section) => Some(self.fact(reader.open(section.value), value)),
        }
    }

    fn fact<T>(&self, mut reader: Reader<'_, '_>, value: impl FnOnce(&mut Reader<'_, '_>) -> Needed<T>) -> FactFile<T> {
        let fact = FactFile { value: value(&mut reader), origin: self.origin(&mut reader) };
        reader.finish();
        fact
    }

    /// The keys `confidence` and `source`, which stand in every fact and every register.
    fn origin(&self, reader: &mut Reader<'_, '_>) -> Option<Origin> {
        let confidence = reader.required("confidence", &Kind::one_of(&CONFIDENCES));
        let right = "a document's short name and a place in it, or the reason of a default";
        let source = reader.required("source", &Kind::parsed(right, filled));
        let confidence = confidence.filter(|it| self.may_be(it, reader.problems()))?.value;
        let cites = confidence != Confidence::Default;
        Some((confidence, source.filter(|it| !cites || self.is_cited(it, reader.problems()))?.value))
    }

    fn may_be(&self, confidence: &Written<Confidence>, problems: &mut Vec<Problem>) -> bool {
        let what = match confidence.value {
            Confidence::Default if !self.defaults => "`default` is for timings only: an unknown is never a default",
            Confidence::Configured => "`configured` is for registers that the gateway's configuration adds",
            _ => return true,
        };
        problems
            .push(confidence.place.problem(what).right("\"manual\", \"second-source\", \"sibling\" or \"inferred\""));
        false
    }

    fn is_cited(&self, source: &Written<String>, problems: &mut Vec<Problem>) -> bool {
        let Some(documents) = self.documents else { return true };
        let (name, place) = source.value.split_once(' ').unwrap_or((&source.value, ""));
        if !place.is_empty() && documents.iter().any(|(document, _)| document == name) {
            return true;
        }
        let names: Vec<_> = documents.iter().map(|(document, _)| format!("`{document} ...`")).collect();
        let problem = source.place.problem(format!("`{}` cites no place in a declared document", source.value));
        problems.push(problem.right(names.join(" or ")));
        false
    }
}

/// Titles of documents by their short names.
fn documents(reader: Reader<'_, '_>) -> Vec<(String, String)> {
    reader.all(&Kind::text()).into_iter().map(|(name, title)| (name, title.value)).collect()
}

fn default_settings(reader: &mut Reader<'_, '_>) -> DefaultFile {
    DefaultFile {
        baud: reader.required("baud", &Kind::number(BAUDS)),
        data_bits: reader.required("data_bits", &Kind::number(7..=8_u8)),
        parity: reader.required("parity", &Kind::one_of(&PARITIES)),
        stop_bits: reader.required("stop_bits", &Kind::number(1..=2_u8)),
    }
}

fn stations(reader: &mut Reader<'_, '_>) -> StationsFile {
    StationsFile {
        from: reader.required("from", &Kind::number(1..=247_u8)),
        to: reader.required("to", &Kind::number(1..=247_u8)),
    }
}

fn broadcast(reader: &mut Reader<'_, '_>) -> BroadcastFile {
    BroadcastFile {
        station: reader.required("station", &Kind::number(0..=255_u8)),
        functions: filled_list(reader, "functions", &Kind::number(1..=127_u8)),
    }
}

fn barrier(mut reader: Reader<'_, '_>) -> BarrierFile {
    let barrier = BarrierFile {
        place: reader.place().clone(),
        address: reader.required("address", &Kind::address()),
        count: reader.required("count", &Kind::number(1..=125_u16)),
    };
    reader.finish();
    barrier
}

/// A value that has several parts beside confidence and source, which stands where its table stands.
fn whole<T>(reader: &mut Reader<'_, '_>, parts: impl FnOnce(&mut Reader<'_, '_>) -> T) -> Needed<T> {
    let value = parts(reader);
    Some(Written { value, place: reader.place().clone() })
}

fn filled_list<T>(reader: &mut Reader<'_, '_>, key: &'static str, kind: &Kind<'_, T>) -> Needed<Vec<T>> {
    let Written { value: list, place } = reader.required_list(key, kind)?;
    if list.is_empty() {
        reader.problems().push(place.problem("is empty").right(format!("at least {}", kind.right())));
        return None;
    }
    Some(Written { value: list.into_iter().map(|written| written.value).collect(), place })
}

fn id(text: &str) -> Option<String> {
    let part = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit());
    (text.contains('-') && text.len() <= 64 && text.split('-').all(part)).then(|| text.to_owned())
}

fn filled(text: &str) -> Option<String> {
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}
