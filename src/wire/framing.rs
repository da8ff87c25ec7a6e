//! A common interface to both framings: frames are built, measured and found the same way on every line.

use super::frame::{Expected, FoundFrame};
use super::pdu::MAX_PDU_BYTES;
use super::{ascii, rtu};
use crate::domain::link::Framing;
use std::borrow::Cow;
use std::ops::Range;

/// Length on the wire of the frame that carries a PDU of `pdu_bytes`.
#[must_use]
pub const fn adu_bytes(framing: Framing, pdu_bytes: usize) -> usize {
    match framing {
        Framing::Rtu => rtu::adu_bytes(pdu_bytes),
        Framing::Ascii => ascii::adu_bytes(pdu_bytes),
    }
}

/// Length on the wire of the longest frame.
#[must_use]
pub const fn max_adu_bytes(framing: Framing) -> usize {
    adu_bytes(framing, MAX_PDU_BYTES)
}

/// Appends the frame for `station` to `out`; `pdu` appends its PDU.
pub fn encode(framing: Framing, out: &mut Vec<u8>, station: u8, pdu: impl FnOnce(&mut Vec<u8>)) {
    match framing {
        Framing::Rtu => rtu::encode(out, station, pdu),
        Framing::Ascii => ascii::encode(out, station, pdu),
    }
}

/// Station and PDU of a whole frame, if its check is right.
#[must_use]
pub fn decode(framing: Framing, adu: &[u8]) -> Option<(u8, Cow<'_, [u8]>)> {
    match framing {
        Framing::Rtu => rtu::decode(adu).map(|(station, pdu)| (station, Cow::Borrowed(pdu))),
        Framing::Ascii => ascii::decode(adu).map(|(station, pdu)| (station, Cow::Owned(pdu))),
    }
}

/// Collects received bytes and finds sound frames among them: see [`rtu::find`] and [`ascii::find`].
#[derive(Debug)]
pub struct Assembler {
    framing: Framing,
    bytes: Vec<u8>,
}

impl Assembler {
    /// An empty one.
    #[must_use]
    pub const fn new(framing: Framing) -> Self {
        Self { framing, bytes: Vec::new() }
    }

    /// Maximum number of bytes that are kept: two of the longest frames. Further bytes push out the oldest.
    #[must_use]
    pub const fn max_bytes(&self) -> usize {
        2 * max_adu_bytes(self.framing)
    }

    /// Takes received bytes; returns those that were pushed out unused.
    pub fn push(&mut self, received: &[u8]) -> Vec<u8> {
        self.bytes.extend_from_slice(received);
        let excess = self.bytes.len().saturating_sub(self.max_bytes());
        self.bytes.drain(..excess).collect()
    }

    /// Removes the next sound frame, with the noise before it.
    pub fn take(&mut self, expected: Option<&Expected>) -> Option<FoundFrame> {
        let place = match self.framing {
            Framing::Rtu => rtu::find(&self.bytes, expected),
            Framing::Ascii => ascii::find(&self.bytes),
        }?;
        Some(self.take_out(place))
    }

    fn take_out(&mut self, place: Range<usize>) -> FoundFrame {
        let adu = self.bytes[place.clone()].to_vec();
        let noise = self.bytes[..place.start].to_vec();
        self.bytes.drain(..place.end);
        FoundFrame { noise, adu }
    }

    /// Removes the next sound frame that cannot be composed of parts of others, with the noise before it: see
    /// [`rtu::find_certain`]. `is_over`: the bytes are followed by silence.
    pub fn take_certain(&mut self, expected: Option<&Expected>, is_over: bool) -> Option<FoundFrame> {
        let (Framing::Rtu, Some(expected)) = (self.framing, expected) else { return self.take(expected) };
        let place = rtu::find_certain(&self.bytes, expected, is_over)?;
        Some(self.take_out(place))
    }

    /// Whether a sound frame waits for the silence that makes it certain.
    #[must_use]
    pub fn waits_for_silence(&self, expected: &Expected) -> bool {
        self.framing == Framing::Rtu && rtu::find_certain(&self.bytes, expected, true).is_some()
    }

    /// Removes the first copy of `frame` and everything before it; returns the latter.
    pub fn take_copy(&mut self, frame: &[u8]) -> Option<Vec<u8>> {
        let start = self.bytes.windows(frame.len().max(1)).position(|window| window == frame)?;
        let before = self.bytes[..start].to_vec();
        self.bytes.drain(..start + frame.len());
        Some(before)
    }

    /// Whether no bytes are pending.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// The pending bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Removes all remaining bytes: noise, a damaged or incomplete frame, or one whose function code does not determine
    /// its length, which [`decode`] then recognises.
    pub fn end(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }

    /// Whether the pending bytes, which contain no sound frame, are the expected reply or its exception, damaged. Where
    /// frames have no end mark, this is certain only once silence has followed.
    #[must_use]
    pub fn holds_damaged(&self, expected: &Expected) -> bool {
        match self.framing {
            Framing::Rtu => rtu::holds_damaged(&self.bytes, expected),
            Framing::Ascii => ascii::holds_damaged(&self.bytes, expected),
        }
    }

    /// Whether frames have an end mark, so that nothing after it can belong to them.
    #[must_use]
    pub const fn sees_ends(&self) -> bool {
        matches!(self.framing, Framing::Ascii)
    }
}
