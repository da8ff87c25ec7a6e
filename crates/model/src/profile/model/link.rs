//! Line settings and timing of a model.

use super::Fact;
use crate::domain::link::{Framing, Interface, LinkSettings, Parity};
use std::ops::RangeInclusive;
use std::time::Duration;

/// Line settings that a model supports.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelLink {
    /// Factory settings.
    pub default: Fact<FactorySetting>,
    /// Speeds in bit/s that can be configured.
    pub bauds: Fact<Vec<u32>>,
    /// Parities that can be configured.
    pub parities: Fact<Vec<Parity>>,
    /// Stop bits that can be configured.
    pub stop_bits: Fact<Vec<u8>>,
    /// Data bits that can be configured.
    pub data_bits: Fact<Vec<u8>>,
    /// Framings that the drive understands.
    pub framings: Fact<Vec<Framing>>,
    /// Interfaces that the drive has.
    pub interfaces: Fact<Vec<Interface>>,
    /// Station numbers that can be configured.
    pub stations: Fact<RangeInclusive<u8>>,
    /// Broadcast, if it is documented.
    pub broadcast: Option<ModelBroadcast>,
}

/// How a drive is set when it leaves the factory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FactorySetting {
    /// Set to these settings.
    Set(LinkSettings),
    /// The setting is unknown: what to read at the drive's panel.
    Ask(String),
}

impl ModelLink {
    /// The factory settings; `None` if they must be read at the drive.
    #[must_use]
    pub const fn factory(&self) -> Option<LinkSettings> {
        match self.default.value {
            FactorySetting::Set(settings) => Some(settings),
            FactorySetting::Ask(_) => None,
        }
    }

    /// The factory settings if they can be used with `framing`: RTU frames are bytes, so 7 data bits are the setting of
    /// a drive with ASCII frames.
    #[must_use]
    pub fn factory_with(&self, framing: Framing) -> Option<LinkSettings> {
        self.factory()
            .filter(|settings| framing == Framing::Ascii || settings.data_bits == 8)
    }

    /// What to read at the drive's panel, where there are no known factory settings.
    #[must_use]
    pub fn asks(&self) -> Option<&str> {
        match &self.default.value {
            FactorySetting::Set(_) => None,
            FactorySetting::Ask(text) => Some(text),
        }
    }

    /// The settings of a drive that is only played: those of the factory, or else the usual ones, and the first of its
    /// list where a usual one cannot be set.
    #[must_use]
    pub fn played(&self) -> LinkSettings {
        let usual = LinkSettings::DEFAULT;
        self.factory().unwrap_or_else(|| LinkSettings {
            baud: usual_or_first(usual.baud, &self.bauds.value),
            data_bits: usual_or_first(usual.data_bits, &self.data_bits.value),
            parity: usual_or_first(usual.parity, &self.parities.value),
            stop_bits: usual_or_first(usual.stop_bits, &self.stop_bits.value),
        })
    }
}

fn usual_or_first<T: Copy + PartialEq>(usual: T, list: &[T]) -> T {
    if list.contains(&usual) {
        usual
    } else {
        list.first().copied().unwrap_or(usual)
    }
}

impl std::fmt::Display for FactorySetting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Set(settings) => settings.fmt(f),
            Self::Ask(text) => write!(f, "read at the drive: {text}"),
        }
    }
}

/// A documented broadcast.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelBroadcast {
    /// The station number that addresses all drives.
    pub station: Fact<u8>,
    /// Functions that may be broadcast. The drive never replies to a broadcast.
    pub functions: Vec<u8>,
}

/// Times on the line.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelTiming {
    /// Silence before and after each frame, in characters.
    pub gap_chars: Fact<f64>,
    /// Maximum wait for a reply after the end of the request, until response times have been measured.
    pub reply_timeout_cap: Fact<Duration>,
    /// Maximum processing time of a request, if documented.
    pub processing_max: Option<Fact<Duration>>,
    /// Maximum processing time of a write to a stored register, if documented.
    pub stored_write_max: Option<Fact<Duration>>,
    /// Maximum reply delay that can be configured on the drive, on top of its processing time.
    pub reply_delay_max: Option<Fact<Duration>>,
    /// Bits per character of the drive's replies, if it sends more than it receives.
    pub reply_char_bits: Option<Fact<u8>>,
    /// How long the drive is left alone after its reply to a write.
    pub pause_after_write: Option<Fact<Duration>>,
    /// How long the drive is left alone after its reply to a write to a stored register, where that takes longer.
    pub pause_after_stored_write: Option<Fact<Duration>>,
    /// How long after a time-out a late reply may still arrive.
    pub max_lateness: Fact<Duration>,
}

impl ModelTiming {
    /// How long the drive is left alone after a write, which went to a stored register if `is_stored`.
    #[must_use]
    pub fn pause_after(&self, is_stored: bool) -> Duration {
        let stored = if is_stored {
            self.pause_after_stored_write.as_ref()
        } else {
            None
        };
        let pauses = [self.pause_after_write.as_ref(), stored]
            .into_iter()
            .flatten();
        pauses.map(|pause| pause.value).max().unwrap_or_default()
    }
}
