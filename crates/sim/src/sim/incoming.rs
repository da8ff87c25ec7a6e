//! Splits the master's bytes into requests, as seen by the drives.

use crate::domain::link::{Framing, LinkSettings};
use crate::profile::model::Model;
use crate::wire::framing;
use crate::wire::{crc, mbap, pdu::function};
use std::time::Duration;

/// Pause between two characters that ends an ASCII frame (Modbus over serial line V1.02, 2.5.2.1), and a message that stays
/// incomplete.
const LONGEST_ASCII_HOLE: Duration = Duration::from_secs(1);

/// Bytes of the master that form no complete request yet.
#[derive(Debug)]
pub(super) struct IncomingBytes {
    framing: Framing,
    bytes: Vec<u8>,
}

impl IncomingBytes {
    pub fn new(framing: Framing) -> Self {
        Self {
            framing,
            bytes: Vec::with_capacity(framing::max_adu_bytes(framing) + 1),
        }
    }

    pub const fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Whether `byte` begins a request, whatever preceded it.
    pub fn begins_with(&self, byte: u8) -> bool {
        self.is_empty() || (self.framing == Framing::Ascii && byte == b':')
    }

    /// Takes a byte; one byte more than the longest frame marks the bytes as invalid.
    pub fn push(&mut self, byte: u8) {
        if self.bytes.len() <= framing::max_adu_bytes(self.framing) {
            self.bytes.push(byte);
        } else if self.framing == Framing::Ascii {
            // An overlong request has an end, too.
            self.bytes.remove(0);
            self.bytes.push(byte);
        }
    }

    /// Whether the request is complete without any silence: in RTU at its function's length with a valid CRC, in ASCII at
    /// CR LF, in Modbus TCP at the length in its header.
    pub fn is_whole(&self) -> bool {
        match self.framing {
            Framing::Ascii => self.bytes.ends_with(b"\r\n"),
            Framing::Rtu => is_whole_rtu(&self.bytes),
            Framing::Mbap => matches!(mbap::decode(&self.bytes), Ok(Some(_))),
        }
    }

    /// Silence that ends the current request, where `silence` separates frames.
    pub const fn longest_hole(&self, silence: Duration) -> Duration {
        match self.framing {
            Framing::Rtu => silence,
            Framing::Ascii | Framing::Mbap => LONGEST_ASCII_HOLE,
        }
    }

    /// Takes the bytes out, to be returned to [`Self::clear`].
    pub fn take(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }

    /// Starts again in `buffer`.
    pub fn clear(&mut self, mut buffer: Vec<u8>) {
        buffer.clear();
        self.bytes = buffer;
    }
}

fn is_whole_rtu(request: &[u8]) -> bool {
    let length = match (request.get(1), request.get(6)) {
        (Some(0x01..=0x06 | &function::DIAGNOSTICS), _) => 8,
        (Some(0x0F | &function::WRITE_MULTIPLE), Some(bytes)) => 9 + usize::from(*bytes),
        _ => return false,
    };
    request.len() == length && crc::is_sound(request)
}

/// The silence that any line needs: above 19,200 bit/s character times are too short to measure.
pub(super) fn least_silence(framing: Framing, link: LinkSettings) -> Duration {
    match framing {
        Framing::Ascii => Duration::from_millis(10),
        Framing::Rtu if link.baud > 19_200 => Duration::from_micros(1_750),
        Framing::Rtu | Framing::Mbap => Duration::ZERO,
    }
}

/// The silence that a drive of `model` requires before a request.
pub(super) fn silence_for(model: &Model, framing: Framing, link: LinkSettings) -> Duration {
    let gap = match framing {
        Framing::Rtu => link.chars(model.timing.gap_chars.value),
        Framing::Ascii | Framing::Mbap => Duration::ZERO,
    };
    model
        .quirks
        .pause_before_request
        .as_ref()
        .map_or(gap, |pause| gap.max(pause.value))
}
