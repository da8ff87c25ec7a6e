//! Line settings and timing of a model.

use super::Fact;
use crate::domain::link::{Framing, Interface, LinkSettings, Parity};
use std::ops::RangeInclusive;
use std::time::Duration;

/// Line settings that a model supports.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// Factory settings.
    pub default: Fact<LinkSettings>,
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
    pub broadcast: Option<Broadcast>,
}

/// A documented broadcast.
#[derive(Clone, Debug, PartialEq)]
pub struct Broadcast {
    /// The station number that addresses all drives.
    pub station: Fact<u8>,
    /// Functions that may be broadcast. The drive never replies to a broadcast.
    pub functions: Vec<u8>,
}

/// Times on the line.
#[derive(Clone, Debug, PartialEq)]
pub struct Timing {
    /// Silence before and after each frame, in characters.
    pub gap_chars: Fact<f64>,
    /// Maximum wait for a reply after the end of the request, until response times have been measured.
    pub reply_timeout_cap: Fact<Duration>,
    /// Maximum processing time of a request, if documented.
    pub processing_max: Option<Fact<Duration>>,
    /// The same for a write to a stored register.
    pub stored_write_max: Option<Fact<Duration>>,
    /// Maximum reply delay that can be configured on the drive, on top of its processing time.
    pub reply_delay_max: Option<Fact<Duration>>,
    /// Bits per character of the drive's replies, if it sends more than it receives.
    pub reply_char_bits: Option<Fact<u8>>,
    /// How long the drive is left alone after its reply to a write.
    pub pause_after_write: Option<Fact<Duration>>,
    /// The same after a write to a stored register, where that takes longer.
    pub pause_after_stored_write: Option<Fact<Duration>>,
    /// How long after a time-out a late reply may still arrive.
    pub max_lateness: Fact<Duration>,
}

impl Timing {
    /// How long the drive is left alone after a write, which went to a stored register if `is_stored`.
    #[must_use]
    pub fn pause_after(&self, is_stored: bool) -> Duration {
        let stored = self.pause_after_stored_write.as_ref().filter(|_| is_stored);
        let pauses = [self.pause_after_write.as_ref(), stored].into_iter().flatten();
        pauses.map(|pause| pause.value).max().unwrap_or_default()
    }
}
