//! What a model says of the line that it hangs on, and of the times there.

use super::Fact;
use crate::domain::link::{Framing, Interface, LinkSettings, Parity};
use std::ops::RangeInclusive;
use std::time::Duration;

/// What a model says of the line it hangs on.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// Factory settings.
    pub default: Fact<LinkSettings>,
    /// Speeds in bit/s that can be set.
    pub bauds: Fact<Vec<u32>>,
    /// Parities that can be set.
    pub parities: Fact<Vec<Parity>>,
    /// Stop bits that can be set.
    pub stop_bits: Fact<Vec<u8>>,
    /// Data bits that can be set.
    pub data_bits: Fact<Vec<u8>>,
    /// Framings that the drive understands.
    pub framings: Fact<Vec<Framing>>,
    /// Interfaces that the drive has.
    pub interfaces: Fact<Vec<Interface>>,
    /// Station numbers that can be set.
    pub stations: Fact<RangeInclusive<u8>>,
    /// Broadcast, if it is documented.
    pub broadcast: Option<Broadcast>,
}

/// A documented broadcast.
#[derive(Clone, Debug, PartialEq)]
pub struct Broadcast {
    /// The station number that addresses all.
    pub station: Fact<u8>,
    /// Functions that may be broadcast. None is answered.
    pub functions: Vec<u8>,
}

/// Times on the line.
#[derive(Clone, Debug, PartialEq)]
pub struct Timing {
    /// Silence before and after each frame, in characters.
    pub gap_chars: Fact<f64>,
    /// Longest wait for a reply after the end of the request, while nothing better is known.
    pub reply_timeout_cap: Fact<Duration>,
    /// Longest time the drive works on a request, where a document says so.
    pub processing_max: Option<Fact<Duration>>,
    /// The same for a write to a stored register.
    pub stored_write_max: Option<Fact<Duration>>,
    /// Longest delay of replies that can be set on the drive, on top of its processing.
    pub reply_delay_max: Option<Fact<Duration>>,
    /// Bits of a character of the drive's replies, where it sends more of them than it receives.
    pub reply_char_bits: Option<Fact<u8>>,
    /// How long after a time-out a reply to the timed-out request may still come.
    pub max_lateness: Fact<Duration>,
}
