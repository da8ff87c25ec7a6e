//! The header of Modbus TCP (messaging on TCP/IP implementation guide V1.0b, 3.1.3).

use super::pdu::MAX_PDU_BYTES;

/// Bytes before the PDU: transaction, protocol, length, unit.
pub const HEADER_BYTES: usize = 7;
/// Longest message: header and PDU.
pub const MAX_ADU_BYTES: usize = HEADER_BYTES + MAX_PDU_BYTES;

/// Length of the message that carries a PDU of `pdu_bytes`.
#[must_use]
pub const fn adu_bytes(pdu_bytes: usize) -> usize {
    HEADER_BYTES + pdu_bytes
}

/// One whole message at the start of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MbapMessage<'a> {
    /// The client's number for the request.
    pub transaction: u16,
    /// The addressed unit.
    pub unit: u8,
    /// Function code and data, 1 to 253 bytes.
    pub pdu: &'a [u8],
    /// Bytes that the whole message takes in the stream.
    pub adu_bytes: usize,
}

/// Why the stream cannot be read any further. After either error, no later byte can be trusted to start a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MalformedStream {
    /// The protocol identifier is not 0.
    #[error("protocol identifier {0} instead of 0")]
    Protocol(u16),
    /// The length leaves no room for a function code or exceeds the longest message.
    #[error("length {0} is outside 2 to 254")]
    Length(u16),
}

/// The message at the start of `stream`; `None` while it is incomplete. A wrong header is reported as soon as
/// its bytes have arrived.
///
/// # Errors
/// [`MalformedStream`] if this is not a Modbus TCP header.
pub fn decode(stream: &[u8]) -> Result<Option<MbapMessage<'_>>, MalformedStream> {
    let word = |at: usize| Some(u16::from_be_bytes([*stream.get(at)?, *stream.get(at + 1)?]));
    if let Some(protocol) = word(2)
        && protocol != 0
    {
        return Err(MalformedStream::Protocol(protocol));
    }
    let (Some(transaction), Some(length)) = (word(0), word(4)) else {
        return Ok(None);
    };
    let after_length = usize::from(length);
    if !(2..=1 + MAX_PDU_BYTES).contains(&after_length) {
        return Err(MalformedStream::Length(length));
    }
    let adu_bytes = 6 + after_length;
    let Some(body) = stream.get(6..adu_bytes) else {
        return Ok(None);
    };
    Ok(Some(MbapMessage {
        transaction,
        unit: body[0],
        pdu: &body[1..],
        adu_bytes,
    }))
}

/// Appends a message to `out`; `pdu` appends its PDU, which must have 1 to 253 bytes.
pub fn encode(out: &mut Vec<u8>, transaction: u16, unit: u8, pdu: impl FnOnce(&mut Vec<u8>)) {
    let start = out.len();
    out.extend(transaction.to_be_bytes());
    out.extend([0, 0, 0, 0, unit]);
    pdu(out);
    let length = (out.len() - start - 6) as u16;
    out[start + 4..start + 6].copy_from_slice(&length.to_be_bytes());
}

/// The transaction of a message; `None` if it is too short to have one.
#[must_use]
pub const fn transaction(adu: &[u8]) -> Option<u16> {
    match adu {
        [high, low, ..] => Some(u16::from_be_bytes([*high, *low])),
        _ => None,
    }
}

/// Gives a message the number `transaction`.
pub fn set_transaction(adu: &mut [u8], transaction: u16) {
    if let Some(place) = adu.get_mut(..2) {
        place.copy_from_slice(&transaction.to_be_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_taken_when_it_is_whole() {
        let mut stream = Vec::new();
        encode(&mut stream, 0x1234, 7, |out| {
            out.extend([3, 0x01, 0x01, 0, 1])
        });
        assert_eq!(stream, [0x12, 0x34, 0, 0, 0, 6, 7, 3, 1, 1, 0, 1]);
        for end in 0..stream.len() {
            assert_eq!(decode(&stream[..end]), Ok(None));
        }
        stream.push(0xAA);
        let message = decode(&stream).unwrap().unwrap();
        assert_eq!(
            (message.transaction, message.unit, message.adu_bytes),
            (0x1234, 7, 12)
        );
        assert_eq!(message.pdu, [3, 1, 1, 0, 1]);
    }

    #[test]
    fn a_wrong_header_is_reported_at_once() {
        assert_eq!(decode(&[0, 1, 0, 1]), Err(MalformedStream::Protocol(1)));
        for length in [0_u16, 1, 255, 60_000, 65_535] {
            let [hi, lo] = length.to_be_bytes();
            assert_eq!(
                decode(&[0, 1, 0, 0, hi, lo]),
                Err(MalformedStream::Length(length))
            );
        }
    }
}
