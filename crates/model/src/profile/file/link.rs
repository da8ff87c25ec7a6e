//! `[link]` and `[timing]`: line settings and timing.

use super::facts::{FactFile, FactReader, filled, filled_list, optional, whole};
use crate::domain::link::{Framing, Interface, LinkSettings, Parity};
use crate::profile::model::{FactorySetting, ModelBroadcast, ModelLink, ModelTiming};
use crate::toml_file::values::ValueKind;
use crate::toml_file::words::{FRAMINGS, INTERFACES, PARITIES};
use crate::toml_file::{OptionalKey, RequiredKey, TableReader};
use std::ops::RangeInclusive;
use std::time::Duration;

/// The longest pause after a write: a stop waits for it. A drive that takes longer is deaf after some registers.
const PAUSE_MAX: Duration = Duration::from_secs(1);

/// Speeds that a file may state, in bit/s.
const BAUDS: RangeInclusive<u32> = 300..=1_000_000;

/// `[link]`
pub(in crate::profile) struct LinkFile {
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

impl LinkFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let link = Self {
            default: facts.needed(&mut reader, "default", |reader| {
                whole(reader, DefaultFile::read)
            }),
            bauds: facts.list(&mut reader, "bauds", &ValueKind::number(BAUDS)),
            parities: facts.list(&mut reader, "parities", &ValueKind::one_of(&PARITIES)),
            stop_bits: facts.list(&mut reader, "stop_bits", &ValueKind::number(1..=2_u8)),
            data_bits: facts.list(&mut reader, "data_bits", &ValueKind::number(7..=8_u8)),
            framings: facts.list(&mut reader, "framings", &ValueKind::one_of(&FRAMINGS)),
            interfaces: facts.list(&mut reader, "interfaces", &ValueKind::one_of(&INTERFACES)),
            stations: facts.needed(&mut reader, "stations", |reader| {
                whole(reader, StationsFile::read)
            }),
            broadcast: facts.optional(&mut reader, "broadcast", |reader| {
                whole(reader, BroadcastFile::read)
            }),
        };
        reader.finish();
        link
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self) -> Option<ModelLink> {
        Some(ModelLink {
            default: self.default.and_then(DefaultFile::ready)?,
            bauds: self.bauds.ready()?,
            parities: self.parities.ready()?,
            stop_bits: self.stop_bits.ready()?,
            data_bits: self.data_bits.ready()?,
            framings: self.framings.ready()?,
            interfaces: self.interfaces.ready()?,
            stations: self.stations.and_then(StationsFile::ready)?,
            broadcast: match &self.broadcast {
                None => None,
                Some(broadcast) => Some(ModelBroadcast {
                    station: broadcast.and_then(|it| Some(it.station.as_ref()?.value))?,
                    functions: broadcast
                        .value
                        .as_ref()?
                        .value
                        .functions
                        .as_ref()?
                        .value
                        .clone(),
                }),
            },
        })
    }
}

/// `link.default`: a setting, or what to read at the drive.
pub(in crate::profile) struct DefaultFile {
    ask: OptionalKey<String>,
    pub baud: RequiredKey<u32>,
    pub data_bits: RequiredKey<u8>,
    pub parity: RequiredKey<Parity>,
    pub stop_bits: RequiredKey<u8>,
}

impl DefaultFile {
    fn read(reader: &mut TableReader<'_, '_>) -> Self {
        let right = "what to read at the drive's panel, not empty";
        let ask = reader.optional("ask", &ValueKind::parsed(right, filled));
        let asks = !matches!(ask, OptionalKey::Absent);
        Self {
            baud: unless(asks, reader, "baud", &ValueKind::number(BAUDS)),
            data_bits: unless(asks, reader, "data_bits", &ValueKind::number(7..=8_u8)),
            parity: unless(asks, reader, "parity", &ValueKind::one_of(&PARITIES)),
            stop_bits: unless(asks, reader, "stop_bits", &ValueKind::number(1..=2_u8)),
            ask,
        }
    }

    fn ready(&self) -> Option<FactorySetting> {
        match &self.ask {
            OptionalKey::Absent => {}
            OptionalKey::Invalid => return None,
            OptionalKey::Valid(text) => return Some(FactorySetting::Ask(text.value.clone())),
        }
        Some(FactorySetting::Set(LinkSettings {
            baud: self.baud.as_ref()?.value,
            data_bits: self.data_bits.as_ref()?.value,
            parity: self.parity.as_ref()?.value,
            stop_bits: self.stop_bits.as_ref()?.value,
        }))
    }
}

/// The part `key` of a factory setting, which has no place beside `ask`.
fn unless<T>(
    asks: bool,
    reader: &mut TableReader<'_, '_>,
    key: &'static str,
    kind: &ValueKind<'_, T>,
) -> RequiredKey<T> {
    if !asks {
        return reader.required(key, kind);
    }
    if let OptionalKey::Valid(given) = reader.optional(key, kind) {
        let problem = given.location.problem(format!(
            "`ask` says that the factory setting is unknown, `{key}` what it is"
        ));
        reader
            .problems()
            .push(problem.right("one of both: leave out `ask`, or the setting"));
    }
    None
}

/// `link.stations`
pub(in crate::profile) struct StationsFile {
    pub from: RequiredKey<u8>,
    pub to: RequiredKey<u8>,
}

impl StationsFile {
    fn read(reader: &mut TableReader<'_, '_>) -> Self {
        Self {
            from: reader.required("from", &ValueKind::number(1..=247_u8)),
            to: reader.required("to", &ValueKind::number(1..=247_u8)),
        }
    }

    fn ready(&self) -> Option<RangeInclusive<u8>> {
        Some(self.from.as_ref()?.value..=self.to.as_ref()?.value)
    }
}

/// `link.broadcast`
pub(in crate::profile) struct BroadcastFile {
    pub station: RequiredKey<u8>,
    pub functions: RequiredKey<Vec<u8>>,
}

impl BroadcastFile {
    fn read(reader: &mut TableReader<'_, '_>) -> Self {
        Self {
            station: reader.required("station", &ValueKind::number(0..=255_u8)),
            functions: filled_list(reader, "functions", &ValueKind::number(1..=127_u8)),
        }
    }
}

/// `[timing]`
pub(in crate::profile) struct TimingFile {
    gap_chars: FactFile<f64>,
    reply_timeout_cap: FactFile<Duration>,
    processing_max: Option<FactFile<Duration>>,
    stored_write_max: Option<FactFile<Duration>>,
    reply_delay_max: Option<FactFile<Duration>>,
    reply_char_bits: Option<FactFile<u8>>,
    pub pause_after_write: Option<FactFile<Duration>>,
    pub pause_after_stored_write: Option<FactFile<Duration>>,
    max_lateness: FactFile<Duration>,
}

impl TimingFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let time = time();
        let pause = ValueKind::duration(Duration::from_millis(1)..=PAUSE_MAX);
        let timing = Self {
            gap_chars: facts.value(&mut reader, "gap_chars", &ValueKind::decimal(3.5..=100.0)),
            reply_timeout_cap: facts.value(&mut reader, "reply_timeout_cap", &time),
            processing_max: facts.optional_value(&mut reader, "processing_max", &time),
            stored_write_max: facts.optional_value(&mut reader, "stored_write_max", &time),
            reply_delay_max: facts.optional_value(&mut reader, "reply_delay_max", &time),
            reply_char_bits: facts.optional_value(
                &mut reader,
                "reply_char_bits",
                &ValueKind::number(7..=13_u8),
            ),
            pause_after_write: facts.optional_value(&mut reader, "pause_after_write", &pause),
            pause_after_stored_write: facts.optional_value(
                &mut reader,
                "pause_after_stored_write",
                &pause,
            ),
            max_lateness: facts.value(&mut reader, "max_lateness", &time),
        };
        reader.finish();
        timing
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self) -> Option<ModelTiming> {
        Some(ModelTiming {
            gap_chars: self.gap_chars.ready()?,
            reply_timeout_cap: self.reply_timeout_cap.ready()?,
            processing_max: optional(self.processing_max.as_ref())?,
            stored_write_max: optional(self.stored_write_max.as_ref())?,
            reply_delay_max: optional(self.reply_delay_max.as_ref())?,
            reply_char_bits: optional(self.reply_char_bits.as_ref())?,
            pause_after_write: optional(self.pause_after_write.as_ref())?,
            pause_after_stored_write: optional(self.pause_after_stored_write.as_ref())?,
            max_lateness: self.max_lateness.ready()?,
        })
    }
}

/// A time that a model may state.
pub(super) fn time() -> ValueKind<'static, Duration> {
    ValueKind::duration(Duration::from_millis(1)..=Duration::from_secs(60))
}
