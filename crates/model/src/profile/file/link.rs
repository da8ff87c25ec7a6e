//! `[link]` and `[timing]`: line settings and timing.

use super::facts::{FactFile, FactReader, given};
use super::kinds::{filled, filled_list, function_code, ms, seconds, time, values_of};
use crate::domain::link::{Framing, Interface, LinkSettings, Parity};
use crate::profile::model::{FactorySetting, ModelBroadcast, ModelLink, ModelTiming};
use crate::toml_file::declare::{KeyForm, declare_table, optional, required};
use crate::toml_file::values::ValueKind;
use crate::toml_file::words::{FRAMINGS, INTERFACES, PARITIES};
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey};
use std::ops::RangeInclusive;
use std::time::Duration;

/// The longest pause after a write: a stop waits for it. A drive that takes longer is deaf after some registers.
const PAUSE_MAX: Duration = seconds(1);

/// Speeds that a file may state, in bit/s.
const BAUDS: RangeInclusive<u32> = 300..=1_000_000;

declare_table! {
    /// The serial line: what can be set at the drive.
    LinkFile is "[link]" with facts: &FactReader<'_> {
        /// The factory setting, or `ask` alone where it differs by edition or no document states it.
        default: FactFile<DefaultFile> = facts.parts(DefaultFile::keys);
        /// The speeds in bit/s that can be set.
        bauds: FactFile<Vec<u32>> = facts.list(ValueKind::number(BAUDS));
        /// The parities that can be set.
        parities: FactFile<Vec<Parity>> = facts.list(ValueKind::one_of(&PARITIES));
        /// The stop bits that can be set.
        stop_bits: FactFile<Vec<u8>> = facts.list(stop_bits());
        /// The data bits that can be set.
        data_bits: FactFile<Vec<u8>> = facts.list(data_bits());
        /// The framings that the drive understands.
        framings: FactFile<Vec<Framing>> = facts.list(ValueKind::one_of(&FRAMINGS));
        /// The interfaces that the drive has.
        interfaces: FactFile<Vec<Interface>> = facts.list(ValueKind::one_of(&INTERFACES));
        /// The station numbers that can be set.
        stations: FactFile<StationsFile> = facts.parts(StationsFile::keys);
        /// A documented broadcast. It is used for one thing only, a stop for every drive of a line.
        broadcast: Option<FactFile<BroadcastFile>> = facts.optional_parts(BroadcastFile::keys);
    }
}

declare_table! {
    /// `link.default`: a setting, or what to read at the drive.
    DefaultFile is "link.default" {
        /// What to read at the drive's panel. A configuration must then state `baud`, `parity` and `stop_bits` of the line, and
        /// `data_bits` with ASCII frames.
        ask: OptionalKey<String> =
            optional(ValueKind::parsed("what to read at the drive's panel, not empty", filled));
        /// Speed in bit/s.
        baud after ask: RequiredKey<u32> = unless(ask, ValueKind::number(BAUDS)), without "required without `ask`";
        /// Data bits; 7 is a factory setting of ASCII frames.
        data_bits after ask: RequiredKey<u8> = unless(ask, data_bits()), without "required without `ask`";
        /// Parity.
        parity after ask: RequiredKey<Parity> = unless(ask, ValueKind::one_of(&PARITIES)),
            without "required without `ask`";
        /// Stop bits.
        stop_bits after ask: RequiredKey<u8> = unless(ask, stop_bits()), without "required without `ask`";
    }
}

declare_table! {
    /// `link.stations`
    StationsFile is "link.stations" {
        /// The lowest.
        from: RequiredKey<u8> = required(ValueKind::number(1..=247));
        /// The highest.
        to: RequiredKey<u8> = required(ValueKind::number(1..=247));
    }
}

declare_table! {
    /// `link.broadcast`
    BroadcastFile is "link.broadcast" {
        /// The station number that addresses all drives.
        station: RequiredKey<u8> = required(ValueKind::number(0..=255));
        /// The functions that may be broadcast; each is in `functions`.
        functions: RequiredKey<Vec<LocatedValue<u8>>> = filled_list(function_code());
    }
}

declare_table! {
    /// Times on the line. Here, and only here, a fact may be a `default`.
    TimingFile is "[timing]" with facts: &FactReader<'_> {
        /// Silence before and after each frame, in characters.
        gap_chars: FactFile<f64> = facts.value(ValueKind::decimal(3.5..=100.0));
        /// How long a reply is waited for until response times have been measured.
        reply_timeout_cap: FactFile<Duration> = facts.value(time());
        /// The longest processing time of a request.
        processing_max: Option<FactFile<Duration>> = facts.optional_value(time()), without "not known";
        /// The longest processing time of a write to a stored register.
        stored_write_max: Option<FactFile<Duration>> = facts.optional_value(time()),
            without "not known";
        /// The longest reply delay that can be set at the drive, on top of its processing time.
        reply_delay_max: Option<FactFile<Duration>> = facts.optional_value(time()),
            without "not known";
        /// Bits per character of the drive's replies, if they are more than in requests.
        reply_char_bits: Option<FactFile<u8>> = facts.optional_value(ValueKind::number(7..=13)),
            without "as in requests";
        /// How long the drive is left alone after its reply to a write. A stop waits for it too.
        pause_after_write: Option<FactFile<Duration>> = facts.optional_value(pause()), without "none";
        /// How long the drive is left alone after its reply to a write of a stored register.
        pause_after_stored_write: Option<FactFile<Duration>> = facts.optional_value(pause()),
            without "as `pause_after_write`";
        /// How long after a time-out a late reply may still arrive.
        max_lateness: FactFile<Duration> = facts.value(time());
    }
}

fn data_bits() -> ValueKind<'static, u8> {
    ValueKind::number(7..=8)
}

fn stop_bits() -> ValueKind<'static, u8> {
    ValueKind::number(1..=2)
}

/// How long a drive may need to be left alone.
fn pause() -> ValueKind<'static, Duration> {
    ValueKind::duration(ms(1)..=PAUSE_MAX)
}

/// A part of a factory setting, which has no place beside `ask`.
fn unless<'k, T: 'k>(
    ask: &OptionalKey<String>,
    kind: ValueKind<'k, T>,
) -> KeyForm<'k, RequiredKey<T>> {
    let asks = !matches!(ask, OptionalKey::Absent);
    KeyForm::of(kind, move |reader, key, kind| {
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
    })
}

impl LinkFile {
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
                    functions: values_of(
                        &broadcast.value.as_ref()?.value.functions.as_ref()?.value,
                    ),
                }),
            },
        })
    }
}

impl DefaultFile {
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

impl StationsFile {
    fn ready(&self) -> Option<RangeInclusive<u8>> {
        Some(self.from.as_ref()?.value..=self.to.as_ref()?.value)
    }
}

impl TimingFile {
    /// `None` if any part is unusable.
    pub(super) fn ready(&self) -> Option<ModelTiming> {
        Some(ModelTiming {
            gap_chars: self.gap_chars.ready()?,
            reply_timeout_cap: self.reply_timeout_cap.ready()?,
            processing_max: given(&self.processing_max)?,
            stored_write_max: given(&self.stored_write_max)?,
            reply_delay_max: given(&self.reply_delay_max)?,
            reply_char_bits: given(&self.reply_char_bits)?,
            pause_after_write: given(&self.pause_after_write)?,
            pause_after_stored_write: given(&self.pause_after_stored_write)?,
            max_lateness: self.max_lateness.ready()?,
        })
    }
}
