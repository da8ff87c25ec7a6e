//! Both framings behind one door: frames are built, measured and found the same way whatever a line speaks.

use super::frame::{Expected, Found};
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

    /// Most bytes that are kept: two of the longest frames. What comes on top pushes out the oldest.
    #[must_use]
    pub const fn max_bytes(&self) -> usize {
        2 * max_adu_bytes(self.framing)
    }

    /// Takes received bytes; returns those that were pushed out because nobody could use them.
    pub fn push(&mut self, received: &[u8]) -> Vec<u8> {
        self.bytes.extend_from_slice(received);
        let excess = self.bytes.len().saturating_sub(self.max_bytes());
        self.bytes.drain(..excess).collect()
    }

    /// Takes the next sound frame out, with the noise before it.
    pub fn take(&mut self, expected: Option<&Expected>) -> Option<Found> {
        let place = match self.framing {
            Framing::Rtu => rtu::find(&self.bytes, expected),
            Framing::Ascii => ascii::find(&self.bytes),
        }?;
        Some(self.take_out(place))
    }

    fn take_out(&mut self, place: Range<usize>) -> Found {
        let adu = self.bytes[place.clone()].to_vec();
        let noise = self.bytes[..place.start].to_vec();
        self.bytes.drain(..place.end);
        Found { noise, adu }
    }

    /// Takes the next sound frame out that cannot be made up of others, with the noise before it: see
    /// [`rtu::find_certain`]. `is_over`: silence has followed behind the bytes.
    pub fn take_certain(&mut self, expected: Option<&Expected>, is_over: bool) -> Option<Found> {
        let (Framing::Rtu, Some(expected)) = (self.framing, expected) else { return self.take(expected) };
        let place = rtu::find_certain(&self.bytes, expected, is_over)?;
        Some(self.take_out(place))
    }

    /// Whether a sound frame waits for the silence that makes it certain.
    #[must_use]
    pub fn waits_for_silence(&self, expected: &Expected) -> bool {
        self.framing == Framing::Rtu && rtu::find_certain(&self.bytes, expected, true).is_some()
    }

    /// Takes the first copy of `frame` out, with all before it; returns what stood before it.
    pub fn take_copy(&mut self, frame: &[u8]) -> Option<Vec<u8>> {
        let start = self.bytes.windows(frame.len().max(1)).position(|window| window == frame)?;
        let before = self.bytes[..start].to_vec();
        self.bytes.drain(..start + frame.len());
        Some(before)
    }

    /// Whether no bytes wait.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// The bytes that wait.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Gives out all that is left: noise, a damaged frame, one that was never ended, or one whose length no function
    /// code tells, which [`decode`] finds out.
    pub fn end(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }

    /// Whether the bytes that wait, with nothing sound among them, hold the expected reply or its exception, damaged.
    /// Where frames do not end by themselves, only silence behind the bytes makes that sure.
    #[must_use]
    pub fn holds_damaged(&self, expected: &Expected) -> bool {
        match self.framing {
            Framing::Rtu => rtu::holds_damaged(&self.bytes, expected),
            Framing::Ascii => ascii::holds_damaged(&self.bytes, expected),
        }
    }

    /// Whether a frame itself says that it is over, so that nothing behind it can belong to it.
    #[must_use]
    pub const fn sees_ends(&self) -> bool {
        matches!(self.framing, Framing::Ascii)
    }
}
