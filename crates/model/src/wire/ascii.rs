//! ASCII frames: two hexadecimal digits for each byte between ':' and CR LF (Modbus over serial line V1.02, 2.5.2).

use super::frame::ExpectedFrame;
use super::pdu::{MAX_PDU_BYTES, function};
use std::ops::Range;

/// Longest ASCII frame in bytes on the wire.
pub const MAX_ADU_BYTES: usize = adu_bytes(MAX_PDU_BYTES);
/// Length of an exception reply: station, function, code and LRC between ':' and CR LF.
pub const EXCEPTION_ADU_BYTES: usize = adu_bytes(2);

const START: u8 = b':';
const END: &[u8; 2] = b"\r\n";
const DIGITS: &[u8; 16] = b"0123456789ABCDEF";

/// Length of the frame that carries a PDU of `pdu_bytes`: two digits for each of its bytes, of the station and of the
/// LRC, between ':' and CR LF.
#[must_use]
pub const fn adu_bytes(pdu_bytes: usize) -> usize {
    1 + 2 * (1 + pdu_bytes + 1) + END.len()
}

/// Appends the frame for `station` to `out`; `pdu` appends its PDU.
pub fn encode(out: &mut Vec<u8>, station: u8, pdu: impl FnOnce(&mut Vec<u8>)) {
    let mut body = vec![station];
    pdu(&mut body);
    body.push(sum(&body).wrapping_neg());
    out.push(START);
    out.extend(body.iter().flat_map(|byte| {
        [
            DIGITS[usize::from(byte >> 4)],
            DIGITS[usize::from(byte & 0xF)],
        ]
    }));
    out.extend(END);
}

/// Station and PDU of a whole frame, if its LRC is right. Digits may be in either case.
#[must_use]
pub fn decode(adu: &[u8]) -> Option<(u8, Vec<u8>)> {
    let digits = adu.strip_prefix(&[START])?.strip_suffix(END)?;
    if adu.len() > MAX_ADU_BYTES {
        return None;
    }
    let mut bytes = bytes_of(digits)?;
    // The LRC complements the other bytes to a sum of 0.
    if bytes.len() < 3 || sum(&bytes) != 0 {
        return None;
    }
    bytes.pop();
    Some((bytes.remove(0), bytes))
}

/// The range of the next sound frame in `bytes`, whatever its function.
#[must_use]
pub fn find(bytes: &[u8]) -> Option<Range<usize>> {
    ended(bytes).find(|place| {
        bytes
            .get(place.clone())
            .is_some_and(|adu| decode(adu).is_some())
    })
}

/// Whether a complete frame begins like the expected reply or its exception and has the same length. If no frame in
/// `bytes` is sound, it is that reply, damaged.
#[must_use]
pub fn holds_damaged(bytes: &[u8], expected: &ExpectedFrame) -> bool {
    ended(bytes).any(|place| {
        let length = match bytes
            .get(place.start + 1..place.start + 5)
            .and_then(bytes_of)
            .as_deref()
        {
            Some([station, _]) if *station != expected.station => return false,
            Some([_, code]) if *code == expected.function => expected.adu_bytes,
            Some([_, code]) if *code == expected.function | function::EXCEPTION_BIT => {
                EXCEPTION_ADU_BYTES
            }
            _ => return false,
        };
        place.len() == length
    })
}

/// The ranges of complete frames, sound or not: each from the last ':' before a CR LF to its end.
fn ended(bytes: &[u8]) -> impl Iterator<Item = Range<usize>> + '_ {
    let mut from = 0;
    std::iter::from_fn(move || {
        loop {
            let length = bytes[from..]
                .windows(END.len())
                .position(|pair| pair == END)?
                + END.len();
            let piece = from..from + length;
            from = piece.end;
            if let Some(start) = bytes[piece.clone()].iter().rposition(|byte| *byte == START) {
                return Some(piece.start + start..piece.end);
            }
        }
    })
}

/// The bytes that `digits` encode, two digits each.
fn bytes_of(digits: &[u8]) -> Option<Vec<u8>> {
    let value = |digit: u8| char::from(digit).to_digit(16);
    let pairs = digits.chunks(2).map(|pair| match *pair {
        [high, low] => u8::try_from(value(high)? << 4 | value(low)?).ok(),
        _ => None,
    });
    pairs.collect()
}

fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::address::DataTable;
    use crate::domain::link::Framing;
    use crate::wire::frame::FoundFrame;
    use crate::wire::framing::FrameAssembler;
    use crate::wire::pdu::{Reply, Request, encode_read_reply};

    /// Requests with their replies as the manuals of TECO's E510, E510s and A510s print them (or with the LRC that
    /// the manual leaves out).
    fn answered() -> [(&'static str, Request, &'static str, Reply); 5] {
        let block = Request::WriteMultiple {
            address: 0x2501_u16.into(),
            values: vec![1, 6000],
        };
        [
            (
                ":01080000A5371B\r\n",
                Request::Loopback { data: 0xA537 },
                ":01080000A5371B\r\n",
                Reply::Echo,
            ),
            (
                ":010325230001B3\r\n",
                read(0x2523),
                ":01030207D023\r\n",
                Reply::Words(vec![2000]),
            ),
            (
                ":01030C100001DF\r\n",
                read(0x0C10),
                ":010302177073\r\n",
                Reply::Words(vec![6000]),
            ),
            (
                ":0106250217704B\r\n",
                setpoint(),
                ":0106250217704B\r\n",
                Reply::Holds { value: 6000 },
            ),
            (
                ":01102501000204000117703B\r\n",
                block,
                ":011025010002C7\r\n",
                Reply::Echo,
            ),
        ]
    }

    /// Requests with exceptions, and how the manual prints each: its misprints repeat a byte of the CRC or swap digits.
    fn refused() -> [(Request, &'static str, u8, Option<&'static str>); 5] {
        let block = Request::WriteMultiple {
            address: 0x2501_u16.into(),
            values: vec![1, 6000],
        };
        [
            (
                Request::Loopback { data: 0xA537 },
                ":01880374\r\n",
                3,
                Some(":01880306\r\n"),
            ),
            (
                Request::Loopback { data: 0xA537 },
                ":01882057\r\n",
                0x20,
                Some(":01882075\r\n"),
            ),
            (read(0x0C10), ":01830478\r\n", 4, Some(":01830440\r\n")),
            (setpoint(), ":01865128\r\n", 0x51, Some(":01860302\r\n")),
            (block, ":0190036C\r\n", 3, Some(":0190030C\r\n")),
        ]
    }

    fn read(address: u16) -> Request {
        Request::Read {
            address: address.into(),
            count: 1,
        }
    }

    fn setpoint() -> Request {
        Request::WriteSingle {
            address: 0x2502_u16.into(),
            value: 6000,
        }
    }

    fn expected(request: &Request) -> ExpectedFrame {
        ExpectedFrame {
            station: 1,
            function: request.function(),
            adu_bytes: adu_bytes(request.reply_pdu_bytes()),
        }
    }

    fn found_in(stream: &[u8], chunk: usize) -> (Vec<FoundFrame>, Vec<u8>) {
        let mut assembler = FrameAssembler::new(Framing::Ascii);
        let mut found = Vec::new();
        for chunk in stream.chunks(chunk) {
            assembler.push(chunk);
            found.extend(std::iter::from_fn(|| assembler.take(None)));
        }
        (found, assembler.end())
    }

    fn frame(noise: &[u8], adu: &str) -> FoundFrame {
        FoundFrame {
            noise: noise.to_vec(),
            adu: adu.as_bytes().to_vec(),
        }
    }

    #[test]
    fn printed_frames_mean_what_the_manual_says_and_format_back() {
        for (asked, request, answered, reply) in answered() {
            let (station, pdu) = decode(asked.as_bytes()).unwrap();
            assert_eq!(
                (station, Request::decode(&pdu)),
                (1, Some(request.clone())),
                "{asked}"
            );
            let (station, pdu) = decode(answered.as_bytes()).unwrap();
            assert_eq!(
                (station, request.reply_in(&pdu)),
                (1, Some(reply.clone())),
                "{answered}"
            );
            assert_eq!(answered.len(), expected(&request).adu_bytes, "{answered}");
            let mut asked_again = Vec::new();
            let mut answered_again = Vec::new();
            encode(&mut asked_again, 1, |out| request.encode(out));
            encode(&mut answered_again, 1, |out| match &reply {
                Reply::Words(words) => encode_read_reply(out, DataTable::Holding, words),
                _ => out.extend_from_slice(&pdu),
            });
            assert_eq!(
                (asked_again.as_slice(), answered_again.as_slice()),
                (asked.as_bytes(), answered.as_bytes())
            );
        }
    }

    #[test]
    fn exceptions_are_read_and_misprinted_checks_are_not() {
        for (request, adu, code, misprint) in refused() {
            let pdu = vec![request.function() | 0x80, code];
            assert_eq!(decode(adu.as_bytes()), Some((1, pdu)), "{adu}");
            assert_eq!(adu.len(), EXCEPTION_ADU_BYTES);
            let Some(misprint) = misprint else { continue };
            assert_eq!(decode(misprint.as_bytes()), None, "{misprint}");
            let mut assembler = FrameAssembler::new(Framing::Ascii);
            assembler.push(misprint.as_bytes());
            assert_eq!(assembler.take(None), None);
            assert!(assembler.holds_damaged(&expected(&request)), "{misprint}");
            assert!(
                !assembler.holds_damaged(&ExpectedFrame {
                    station: 2,
                    ..expected(&request)
                }),
                "{misprint}"
            );
        }
    }

    #[test]
    fn a_frame_is_found_whole_in_pieces_in_either_case_and_glued_to_another() {
        for (.., adu, _) in answered() {
            let lower = adu.to_lowercase();
            for chunk in 1..=adu.len() {
                assert_eq!(
                    found_in(adu.as_bytes(), chunk),
                    (vec![frame(b"", adu)], vec![])
                );
                assert_eq!(
                    found_in(lower.as_bytes(), chunk),
                    (vec![frame(b"", &lower)], vec![])
                );
                let glued = [adu, &lower].concat();
                assert_eq!(
                    found_in(glued.as_bytes(), chunk),
                    (vec![frame(b"", adu), frame(b"", &lower)], vec![])
                );
            }
            assert_eq!(decode(lower.as_bytes()), decode(adu.as_bytes()));
        }
    }

    #[test]
    fn a_colon_restarts_a_frame() {
        let adu = ":01030207D023\r\n";
        for piece in [
            ":",
            ":0103",
            ":01030207D0",
            "\r\n",
            ":01030207D024\r\n",
            "::",
            ":\r\n",
            "0103\r",
            "\u{7}:01\r\r",
        ] {
            for chunk in [1, 100] {
                let stream = [piece, adu].concat();
                assert_eq!(
                    found_in(stream.as_bytes(), chunk),
                    (vec![frame(piece.as_bytes(), adu)], vec![]),
                    "{piece}"
                );
            }
        }
    }

    #[test]
    fn what_is_no_frame_is_none() {
        for text in [
            "",
            ":\r\n",
            ":01\r\n",
            ":01FF\r\n",
            ":01030207D02\r\n",
            ":0103G207D023\r\n",
            "01030207D023\r\n",
        ] {
            assert_eq!(decode(text.as_bytes()), None, "{text}");
        }
        assert_eq!(decode(b":01030207D023\r"), None);
        assert_eq!(decode(b":01030207D023\n"), None);
    }

    /// A wrong bit changes one digit, and one digit changes the sum; if it only changes the case of a digit, the
    /// frame keeps its meaning. Two wrong bits can cancel each other, which no LRC detects.
    #[test]
    fn one_wrong_bit_never_changes_what_a_frame_says() {
        for (_, request, adu, _) in answered() {
            let intended = decode(adu.as_bytes());
            for bit in 0..adu.len() * 8 {
                let mut spoilt = adu.as_bytes().to_vec();
                spoilt[bit / 8] ^= 1 << (bit % 8);
                let (found, rest) = found_in(&spoilt, 3);
                let taken: Vec<_> = found.iter().map(|found| decode(&found.adu)).collect();
                assert!(
                    taken.is_empty() || taken == [intended.clone()],
                    "{:?}",
                    spoilt.escape_ascii().to_string()
                );
                assert_eq!(decode(&rest), None, "{request:?}");
            }
        }
    }

    #[test]
    fn nothing_longer_than_the_longest_frame_is_one() {
        assert_eq!((MAX_ADU_BYTES, EXCEPTION_ADU_BYTES), (513, 11));
        for (pdu_bytes, is_frame) in [(MAX_PDU_BYTES, true), (MAX_PDU_BYTES + 1, false)] {
            let mut adu = Vec::new();
            encode(&mut adu, 1, |out| out.resize(1 + pdu_bytes, 0x11));
            assert_eq!(adu.len(), adu_bytes(pdu_bytes));
            let (found, _) = found_in(&adu, 7);
            assert_eq!(found.len(), usize::from(is_frame), "{pdu_bytes}");
        }
    }

    #[test]
    fn a_babbling_node_cannot_fill_the_memory() {
        for babble in [b'U', START, b'\n'] {
            let mut assembler = FrameAssembler::new(Framing::Ascii);
            let mut pushed_out = 0;
            for _ in 0..1000 {
                pushed_out += assembler.push(&[babble; 100]).len();
            }
            assert_eq!(pushed_out, 100_000 - 2 * MAX_ADU_BYTES);
            assert_eq!(assembler.end().len(), 2 * MAX_ADU_BYTES);
        }
    }
}
