//! A common interface to all framings: frames are built, measured and found the same way on every line.

use super::frame::{ExpectedFrame, FoundFrame};
use super::pdu::MAX_PDU_BYTES;
use super::{ascii, mbap, rtu};
use crate::domain::link::Framing;
use std::borrow::Cow;
use std::ops::Range;

/// Length on the wire of the frame that carries a PDU of `pdu_bytes`.
#[must_use]
pub const fn adu_bytes(framing: Framing, pdu_bytes: usize) -> usize {
    match framing {
        Framing::Rtu => rtu::adu_bytes(pdu_bytes),
        Framing::Ascii => ascii::adu_bytes(pdu_bytes),
        Framing::Mbap => mbap::adu_bytes(pdu_bytes),
    }
}

/// Length on the wire of the longest frame.
#[must_use]
pub const fn max_adu_bytes(framing: Framing) -> usize {
    adu_bytes(framing, MAX_PDU_BYTES)
}

/// Appends the frame for `station` to `out`; `pdu` appends its PDU. Where frames are numbered, it has the number 0: see
/// [`set_transaction`].
pub fn encode(framing: Framing, out: &mut Vec<u8>, station: u8, pdu: impl FnOnce(&mut Vec<u8>)) {
    match framing {
        Framing::Rtu => rtu::encode(out, station, pdu),
        Framing::Ascii => ascii::encode(out, station, pdu),
        Framing::Mbap => mbap::encode(out, 0, station, pdu),
    }
}

/// The number of a frame's transaction; `None` where frames have none.
#[must_use]
pub const fn transaction_of(framing: Framing, adu: &[u8]) -> Option<u16> {
    match framing {
        Framing::Rtu | Framing::Ascii => None,
        Framing::Mbap => mbap::transaction(adu),
    }
}

/// Gives a frame the number `transaction`, where frames have one.
pub fn set_transaction(framing: Framing, adu: &mut [u8], transaction: u16) {
    match framing {
        Framing::Rtu | Framing::Ascii => {}
        Framing::Mbap => mbap::set_transaction(adu, transaction),
    }
}

/// Station and PDU of a whole frame, if its check is right.
#[must_use]
pub fn decode(framing: Framing, adu: &[u8]) -> Option<(u8, Cow<'_, [u8]>)> {
    match framing {
        Framing::Rtu => rtu::decode(adu).map(|(station, pdu)| (station, Cow::Borrowed(pdu))),
        Framing::Ascii => ascii::decode(adu).map(|(station, pdu)| (station, Cow::Owned(pdu))),
        Framing::Mbap => {
            let message = mbap::decode(adu)
                .ok()
                .flatten()
                .filter(|message| message.adu_bytes == adu.len());
            message.map(|message| (message.unit, Cow::Borrowed(message.pdu)))
        }
    }
}

/// The range of the first sound frame in `bytes` that can only be the request of a read, wherever it begins: see
/// [`rtu::find_read_request`]. In other framings each frame is found in its turn.
#[must_use]
pub fn find_read_request(framing: Framing, bytes: &[u8]) -> Option<Range<usize>> {
    (framing == Framing::Rtu)
        .then(|| rtu::find_read_request(bytes))
        .flatten()
}

/// Most bytes of a Modbus TCP stream that are kept. All whole messages are taken out between two reads of a port, which
/// give less than this.
const STREAM_BYTES_MAX: usize = 4096 + mbap::MAX_ADU_BYTES;

/// Collects received bytes and finds sound frames among them: see [`rtu::find`], [`ascii::find`] and [`mbap::decode`].
#[derive(Debug)]
pub struct FrameAssembler {
    framing: Framing,
    bytes: Vec<u8>,
}

impl FrameAssembler {
    /// An empty one.
    #[must_use]
    pub const fn new(framing: Framing) -> Self {
        Self {
            framing,
            bytes: Vec::new(),
        }
    }

    /// Maximum number of bytes that are kept: two of the longest frames, of a stream more. Further bytes push out the
    /// oldest.
    #[must_use]
    pub const fn max_bytes(&self) -> usize {
        match self.framing {
            Framing::Rtu | Framing::Ascii => 2 * max_adu_bytes(self.framing),
            Framing::Mbap => STREAM_BYTES_MAX,
        }
    }

    /// Takes received bytes; returns those that were pushed out unused.
    pub fn push(&mut self, received: &[u8]) -> Vec<u8> {
        self.bytes.extend_from_slice(received);
        let excess = self.bytes.len().saturating_sub(self.max_bytes());
        self.bytes.drain(..excess).collect()
    }

    /// Removes the next sound frame, with the noise before it.
    pub fn take(&mut self, expected: Option<&ExpectedFrame>) -> Option<FoundFrame> {
        let place = match self.framing {
            Framing::Rtu => rtu::find(&self.bytes, expected),
            Framing::Ascii => ascii::find(&self.bytes),
            Framing::Mbap => mbap::decode(&self.bytes)
                .ok()
                .flatten()
                .map(|message| 0..message.adu_bytes),
        }?;
        Some(self.take_out(place))
    }

    /// Removes the next sound frame of whatever kind, with the noise before it: see [`rtu::find_any`].
    pub fn take_any(&mut self) -> Option<FoundFrame> {
        match self.framing {
            Framing::Rtu => rtu::find_any(&self.bytes).map(|place| self.take_out(place)),
            Framing::Ascii | Framing::Mbap => self.take(None),
        }
    }

    fn take_out(&mut self, place: Range<usize>) -> FoundFrame {
        let adu = self.bytes[place.clone()].to_vec();
        let noise = self.bytes[..place.start].to_vec();
        self.bytes.drain(..place.end);
        FoundFrame { noise, adu }
    }

    /// Removes the next sound frame that cannot be composed of parts of others, with the noise before it: see
    /// [`rtu::find_certain`]. `is_over`: the bytes are followed by silence.
    pub fn take_certain(
        &mut self,
        expected: Option<&ExpectedFrame>,
        is_over: bool,
    ) -> Option<FoundFrame> {
        let (Framing::Rtu, Some(expected)) = (self.framing, expected) else {
            return self.take(expected);
        };
        let place = rtu::find_certain(&self.bytes, expected, is_over)?;
        Some(self.take_out(place))
    }

    /// Whether a sound frame waits for the silence that makes it certain.
    #[must_use]
    pub fn waits_for_silence(&self, expected: &ExpectedFrame) -> bool {
        self.framing == Framing::Rtu && rtu::find_certain(&self.bytes, expected, true).is_some()
    }

    /// Removes the first copy of `frame` and everything before it; returns the latter.
    pub fn take_copy(&mut self, frame: &[u8]) -> Option<Vec<u8>> {
        let start = self
            .bytes
            .windows(frame.len().max(1))
            .position(|window| window == frame)?;
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

    /// Silence has followed: removes all remaining bytes, which are noise, a damaged or incomplete frame, or one whose
    /// function code does not determine its length, which [`decode`] then recognises. A stream loses nothing, so there
    /// the rest of an incomplete frame is still to come.
    pub fn end(&mut self) -> Vec<u8> {
        if self.is_stream() {
            Vec::new()
        } else {
            self.clear()
        }
    }

    /// Removes all bytes: nothing that belongs to them will follow.
    pub fn clear(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }

    /// Whether the bytes do not begin with a header, in a stream where they must. No later byte can be trusted to begin
    /// a frame.
    #[must_use]
    pub fn is_out_of_step(&self) -> bool {
        self.is_stream() && mbap::decode(&self.bytes).is_err()
    }

    const fn is_stream(&self) -> bool {
        matches!(self.framing, Framing::Mbap)
    }

    /// Whether the pending bytes, which contain no sound frame, are the expected reply or its exception, damaged. Where
    /// frames have no end mark, this is certain only once silence has followed.
    #[must_use]
    pub fn holds_damaged(&self, expected: &ExpectedFrame) -> bool {
        match self.framing {
            Framing::Rtu => rtu::holds_damaged(&self.bytes, expected),
            Framing::Ascii => ascii::holds_damaged(&self.bytes, expected),
            Framing::Mbap => false,
        }
    }

    /// Whether frames have an end mark or say their length, so that nothing after it can belong to them.
    #[must_use]
    pub const fn sees_ends(&self) -> bool {
        matches!(self.framing, Framing::Ascii | Framing::Mbap)
    }
}
