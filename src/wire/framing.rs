//! Both framings behind one door: frames are built, measured and found the same way whatever a line speaks.

use super::frame::{Expected, Found};
use super::pdu::MAX_PDU_BYTES;
use super::{ascii, rtu};
use crate::domain::link::Framing;
use std::borrow::Cow;

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

/// Collects received bytes and finds sound frames among them: see [`rtu::Assembler`] and [`ascii::Assembler`].
#[derive(Debug)]
pub enum Assembler {
    /// Frames end by length and silence.
    Rtu(rtu::Assembler),
    /// Frames end by themselves.
    Ascii(ascii::Assembler),
}

impl Assembler {
    /// An empty one.
    #[must_use]
    pub fn new(framing: Framing) -> Self {
        match framing {
            Framing::Rtu => Self::Rtu(rtu::Assembler::default()),
            Framing::Ascii => Self::Ascii(ascii::Assembler::default()),
        }
    }

    /// Takes received bytes; returns those that were pushed out because nobody could use them.
    pub fn push(&mut self, received: &[u8]) -> Vec<u8> {
        match self {
            Self::Rtu(it) => it.push(received),
            Self::Ascii(it) => it.push(received),
        }
    }

    /// Takes the next sound frame out, with the noise before it.
    pub fn take(&mut self, expected: Option<&Expected>) -> Option<Found> {
        match self {
            Self::Rtu(it) => it.take(expected),
            Self::Ascii(it) => it.take(),
        }
    }

    /// Whether no bytes wait.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        match self {
            Self::Rtu(it) => it.is_empty(),
            Self::Ascii(it) => it.is_empty(),
        }
    }

    /// Gives out all that is left.
    pub fn end(&mut self) -> Vec<u8> {
        match self {
            Self::Rtu(it) => it.end(),
            Self::Ascii(it) => it.end(),
        }
    }

    /// Whether the bytes that wait, with nothing sound among them, hold the expected reply or its exception, damaged.
    /// Where frames do not end by themselves, only silence behind the bytes makes that sure.
    #[must_use]
    pub fn holds_damaged(&self, expected: &Expected) -> bool {
        match self {
            Self::Rtu(it) => it.holds_damaged(expected),
            Self::Ascii(it) => it.holds_damaged(expected),
        }
    }

    /// Whether a frame itself says that it is over, so that nothing behind it can belong to it.
    #[must_use]
    pub const fn sees_ends(&self) -> bool {
        matches!(self, Self::Ascii(_))
    }
}
