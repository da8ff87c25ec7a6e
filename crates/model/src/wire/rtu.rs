//! RTU frames: building them, and finding replies in a stream of bytes by length, CRC and silence.

use super::crc;
use super::frame::ExpectedFrame;
use super::pdu::function;
use std::ops::Range;

/// Longest RTU frame in bytes (Modbus over serial line V1.02, 2.5.1).
pub const MAX_ADU_BYTES: usize = 256;
/// Station before and CRC after the PDU.
pub const OVERHEAD_BYTES: usize = 3;
/// Length of an exception reply: station, function, code, CRC.
pub const EXCEPTION_ADU_BYTES: usize = 5;

/// Length of a request with two words: of a read, of one register's write, of a loop test.
const REQUEST_ADU_BYTES: usize = 8;

/// Length of the frame that carries a PDU of `pdu_bytes`.
#[must_use]
pub const fn adu_bytes(pdu_bytes: usize) -> usize {
    OVERHEAD_BYTES + pdu_bytes
}

/// Appends the frame for `station` to `out`; `pdu` appends its PDU.
pub fn encode(out: &mut Vec<u8>, station: u8, pdu: impl FnOnce(&mut Vec<u8>)) {
    let start = out.len();
    out.push(station);
    pdu(out);
    let check = crc::modbus(&out[start..]);
    out.extend(check.to_le_bytes());
}

/// Station and PDU of a whole frame, if its CRC is right.
#[must_use]
pub fn decode(adu: &[u8]) -> Option<(u8, &[u8])> {
    match adu {
        [station, pdu @ .., _, _] if !pdu.is_empty() && crc::is_sound(adu) => Some((*station, pdu)),
        _ => None,
    }
}

/// Length of the reply frame that begins with `head`, from function code and byte count.
#[must_use]
pub fn reply_adu_bytes(head: &[u8]) -> ReplyLength {
    let Some(&code) = head.get(1) else {
        return ReplyLength::NotYetKnown;
    };
    match code {
        0x01..=0x04 | 0x17 => match head.get(2) {
            Some(&count) => ReplyLength::Known(OVERHEAD_BYTES + 2 + usize::from(count)),
            None => ReplyLength::NotYetKnown,
        },
        0x05 | 0x06 | function::DIAGNOSTICS | 0x0F | function::WRITE_MULTIPLE => {
            ReplyLength::Known(8)
        }
        0x16 => ReplyLength::Known(10),
        _ if code & function::EXCEPTION_BIT != 0 => ReplyLength::Known(EXCEPTION_ADU_BYTES),
        _ => ReplyLength::OnlySilenceTells,
    }
}

/// What is known about the length of a reply from its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReplyLength {
    /// More bytes are needed.
    NotYetKnown,
    /// The frame, station and CRC included, has this many bytes.
    Known(usize),
    /// The function code has no known reply format: only silence ends the frame.
    OnlySilenceTells,
}

/// The range of the next sound frame in `bytes`.
///
/// A frame at the start is delimited by its own length. After noise only the expected reply is searched for, because a
/// random position has a chance of 1 in 65,536 to look like the start of some frame.
#[must_use]
pub fn find(bytes: &[u8], expected: Option<&ExpectedFrame>) -> Option<Range<usize>> {
    let is_sound = |place: Range<usize>| bytes.get(place).is_some_and(crc::is_sound);
    if let ReplyLength::Known(length) = reply_adu_bytes(bytes)
        && length <= MAX_ADU_BYTES
        && is_sound(0..length)
    {
        return Some(0..length);
    }
    let expected = expected?;
    (1..bytes.len()).find_map(|start| {
        let place = start..start + adu_bytes_at(expected, &bytes[start..])?;
        is_sound(place.clone()).then_some(place)
    })
}

/// The range of the next sound frame in `bytes` that cannot be composed of parts of others.
///
/// The beginning of a truncated frame followed by the beginning of the next one has a valid CRC once in 65,536 times.
/// A range inside which the expected reply may begin is therefore a frame only if silence follows it immediately:
/// `is_over`.
#[must_use]
pub fn find_certain(bytes: &[u8], expected: &ExpectedFrame, is_over: bool) -> Option<Range<usize>> {
    let by_its_own_length = match reply_adu_bytes(bytes) {
        ReplyLength::Known(length) if length <= MAX_ADU_BYTES => Some(0..length),
        _ => None,
    };
    let as_expected = (0..bytes.len())
        .filter_map(|start| Some(start..start + adu_bytes_at(expected, &bytes[start..])?));
    let is_sound = |place: &Range<usize>| bytes.get(place.clone()).is_some_and(crc::is_sound);
    for place in by_its_own_length
        .into_iter()
        .chain(as_expected)
        .filter(is_sound)
    {
        let is_last = place.end == bytes.len();
        if (is_last && is_over)
            || !(place.start + 1..place.end).any(|start| may_begin(&bytes[start..], expected))
        {
            return Some(place);
        }
        if is_last {
            return None;
        }
    }
    None
}

/// The range of the first sound frame in `bytes`, a request or a reply of any station, for one who only listens. Unlike a
/// reply that is awaited, it may stand anywhere: what precedes it is noise, or a frame that came damaged.
#[must_use]
pub fn find_any(bytes: &[u8]) -> Option<Range<usize>> {
    find_by(bytes, |head| {
        let reply = match reply_adu_bytes(head) {
            ReplyLength::Known(length) => Some(length),
            ReplyLength::NotYetKnown | ReplyLength::OnlySilenceTells => None,
        };
        [request_adu_bytes(head), reply]
    })
}

/// The range of the next sound frame in `bytes` that can only be the request of a read, of no more than a drive gives
/// in one frame.
#[must_use]
pub fn find_read_request(bytes: &[u8]) -> Option<Range<usize>> {
    find_by(bytes, |head| match *head {
        [
            _,
            function::READ_COILS..=function::READ_INPUT,
            _,
            _,
            0,
            1..=125,
            ..,
        ] => [Some(REQUEST_ADU_BYTES), None],
        _ => [None, None],
    })
}

fn find_by(bytes: &[u8], lengths: impl Fn(&[u8]) -> [Option<usize>; 2]) -> Option<Range<usize>> {
    (0..bytes.len()).find_map(|start| {
        let places = lengths(&bytes[start..])
            .into_iter()
            .flatten()
            .map(|length| start..start + length);
        places
            .filter(|place| place.len() <= MAX_ADU_BYTES)
            .find(|place| bytes.get(place.clone()).is_some_and(crc::is_sound))
    })
}

/// Length of the request frame that begins with `head`, if its function is one of ours.
fn request_adu_bytes(head: &[u8]) -> Option<usize> {
    match (head.get(1)?, head.get(6)) {
        (0x01..=0x06 | &function::DIAGNOSTICS, _) => Some(REQUEST_ADU_BYTES),
        (&function::WRITE_COILS | &function::WRITE_MULTIPLE, Some(bytes)) => {
            Some(9 + usize::from(*bytes))
        }
        _ => None,
    }
}

/// Whether `bytes` may be the beginning of the expected reply or its exception. A complete but damaged one is not.
fn may_begin(bytes: &[u8], expected: &ExpectedFrame) -> bool {
    let head = [expected.station, expected.function];
    let has_count = (0x01..=0x04).contains(&expected.function);
    let data = if has_count {
        expected.adu_bytes.checked_sub(OVERHEAD_BYTES + 2)
    } else {
        None
    };
    let is_like = |head: &[u8], length: usize| {
        let known = bytes.len().min(head.len());
        let is_whole = bytes.len() >= length;
        bytes[..known] == head[..known] && (!is_whole || crc::is_sound(&bytes[..length]))
    };
    let count = data.and_then(|data| u8::try_from(data).ok());
    let normal: Vec<u8> = head.into_iter().chain(count).collect();
    is_like(&normal, expected.adu_bytes)
        || is_like(
            &[head[0], head[1] | function::EXCEPTION_BIT],
            EXCEPTION_ADU_BYTES,
        )
}

/// Whether `bytes` begin like the expected reply or its exception and have the same length. If no frame in them is
/// sound, they may be that reply, damaged, once silence has followed.
#[must_use]
pub fn holds_damaged(bytes: &[u8], expected: &ExpectedFrame) -> bool {
    adu_bytes_at(expected, bytes) == Some(bytes.len())
}

/// Length of the frame at the start of `bytes` if that could be the expected reply or its exception.
fn adu_bytes_at(expected: &ExpectedFrame, bytes: &[u8]) -> Option<usize> {
    let [station, code, ..] = *bytes else {
        return None;
    };
    match code {
        _ if station != expected.station => None,
        _ if code == expected.function => Some(expected.adu_bytes),
        _ if code == expected.function | function::EXCEPTION_BIT => Some(EXCEPTION_ADU_BYTES),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::link::Framing;
    use crate::wire::frame::FoundFrame;
    use crate::wire::framing::FrameAssembler;

    const EXPECTED: ExpectedFrame = ExpectedFrame {
        station: 1,
        function: 3,
        adu_bytes: 7,
    };
    const REPLY: [u8; 7] = [0x01, 0x03, 0x02, 0x17, 0x70, 0xB6, 0x50];

    #[test]
    fn a_frame_ends_by_its_length() {
        let mut assembler = FrameAssembler::new(Framing::Rtu);
        for byte in &REPLY[..6] {
            assembler.push(&[*byte]);
            assert_eq!(assembler.take(Some(&EXPECTED)), None);
        }
        assembler.push(&REPLY[6..]);
        assert_eq!(
            assembler.take(Some(&EXPECTED)),
            Some(FoundFrame {
                noise: vec![],
                adu: REPLY.to_vec()
            })
        );
        assert!(assembler.is_empty());
    }

    #[test]
    fn noise_before_the_reply_is_distinguished() {
        let mut assembler = FrameAssembler::new(Framing::Rtu);
        assembler.push(&[0xFF, 0x01, 0x03, 0x00]);
        assembler.push(&REPLY);
        let found = assembler.take(Some(&EXPECTED)).unwrap();
        assert_eq!(found.noise, [0xFF, 0x01, 0x03, 0x00]);
        assert_eq!(found.adu, REPLY);
    }

    #[test]
    fn a_listener_finds_requests_and_replies_one_after_the_other() {
        let framed = |station: u8, pdu: &[u8]| {
            let mut out = Vec::new();
            encode(&mut out, station, |to| to.extend_from_slice(pdu));
            out
        };
        let read = framed(1, &[3, 0, 2, 0, 2]);
        let frames = [
            read.clone(),
            framed(1, &[3, 4, 0, 5, 0, 6]),
            framed(2, &[6, 0, 1, 0, 3]),
            framed(2, &[6, 0, 1, 0, 3]),
            framed(2, &[0x10, 0, 1, 0, 2, 4, 0, 1, 0, 2]),
            framed(2, &[0x10, 0, 1, 0, 2]),
            framed(1, &[0x83, 2]),
        ];
        let mut bytes = vec![0x55, 0x03, 0xFF];
        bytes.extend(frames.concat());
        let mut found = Vec::new();
        while let Some(place) = find_any(&bytes) {
            found.push(bytes[place.clone()].to_vec());
            bytes.drain(..place.end);
        }
        assert_eq!(found, frames);
        assert!(bytes.is_empty());
        for cut in 0..read.len() {
            assert_eq!(find_any(&read[..cut]), None, "{cut}");
        }
        assert_eq!(
            find_read_request(&[&[0x55], &read[..]].concat()),
            Some(1..9)
        );
        assert_eq!(find_read_request(&frames[1..].concat()), None);
    }

    #[test]
    fn nothing_longer_than_the_longest_frame_is_one() {
        for (count, is_frame) in [(251_u8, true), (252, false), (255, false)] {
            let mut adu = Vec::new();
            encode(&mut adu, 1, |out| {
                out.extend([3, count].into_iter().chain((0..count).map(|_| 0x11)))
            });
            let mut assembler = FrameAssembler::new(Framing::Rtu);
            assembler.push(&adu);
            assert_eq!(assembler.take(None).is_some(), is_frame, "{count}");
        }
    }

    #[test]
    fn a_babbling_node_cannot_fill_the_memory() {
        let mut assembler = FrameAssembler::new(Framing::Rtu);
        let mut pushed_out = 0;
        for _ in 0..1000 {
            pushed_out += assembler.push(&[0x55; 100]).len();
        }
        assert_eq!(pushed_out, 100_000 - 2 * MAX_ADU_BYTES);
        assert_eq!(assembler.end().len(), 2 * MAX_ADU_BYTES);
    }
}
