//! Requests to drives and their replies, without station, CRC or header.

use super::exception::ILLEGAL_FUNCTION;

/// Function codes (Modbus application protocol V1.1b3, 5.1).
pub mod function {
    /// Read holding registers.
    pub const READ_HOLDING: u8 = 0x03;
    /// Read input registers.
    pub const READ_INPUT: u8 = 0x04;
    /// Write a single register.
    pub const WRITE_SINGLE: u8 = 0x06;
    /// Diagnostics; sub-function 0 returns what was sent.
    pub const DIAGNOSTICS: u8 = 0x08;
    /// Write several registers.
    pub const WRITE_MULTIPLE: u8 = 0x10;
    /// Set in the function code of an exception reply.
    pub const EXCEPTION_BIT: u8 = 0x80;
}

/// Maximum number of words in one read (V1.1b3, 6.3).
pub const MAX_READ_WORDS: u16 = 125;
/// Maximum number of words in one write (V1.1b3, 6.12).
pub const MAX_WRITE_WORDS: u16 = 123;
/// Longest PDU in bytes (V1.1b3, 4.1).
pub const MAX_PDU_BYTES: usize = 253;

/// Exception code that some drives send instead of 01.
pub const FUNCTION_ERROR: u8 = 0x51;

/// A request to a drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// 03: read `count` words from `address` on.
    ReadHolding {
        /// First register.
        address: u16,
        /// Number of words.
        count: u16,
    },
    /// 06: write one word.
    WriteSingle {
        /// Register.
        address: u16,
        /// The word.
        value: u16,
    },
    /// 08 with sub-function 0: the drive returns `data` unchanged.
    Loopback {
        /// Any word; with a fresh one an earlier answer cannot be mistaken for this one.
        data: u16,
    },
    /// 10 hex: write several words.
    WriteMultiple {
        /// First register.
        address: u16,
        /// 1 to 123 words.
        values: Vec<u16>,
    },
    /// A function that the drive does not support, so that its exception is the right answer. It has no effect on a
    /// drive that supports it after all: 08 is sent as a loop test, every other function without data.
    Unserved {
        /// The function, 1 to 127.
        function: u8,
        /// What 08 would return.
        data: u16,
    },
}

/// A drive's valid reply to a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply {
    /// To 03: as many words as requested.
    Words(Vec<u16>),
    /// To 06: the requested register and the value that the drive holds, which need not be the one sent.
    Holds {
        /// The value in the reply.
        value: u16,
    },
    /// To 08 and 10 hex: the echo that the standard prescribes.
    Echo,
}

impl Request {
    /// The function code.
    #[must_use]
    pub const fn function(&self) -> u8 {
        match self {
            Self::ReadHolding { .. } => function::READ_HOLDING,
            Self::WriteSingle { .. } => function::WRITE_SINGLE,
            Self::Loopback { .. } => function::DIAGNOSTICS,
            Self::WriteMultiple { .. } => function::WRITE_MULTIPLE,
            Self::Unserved { function, .. } => *function,
        }
    }

    /// Length of the valid reply's PDU in bytes.
    #[must_use]
    pub const fn reply_pdu_bytes(&self) -> usize {
        match self {
            Self::Unserved { .. } => 2,
            Self::ReadHolding { count, .. } => 2 + 2 * *count as usize,
            Self::WriteSingle { .. } | Self::Loopback { .. } | Self::WriteMultiple { .. } => 5,
        }
    }

    /// Whether a drive may answer with a copy of the request, so that an echo looks like the reply.
    #[must_use]
    pub const fn is_repeated_by_its_reply(&self) -> bool {
        matches!(self, Self::WriteSingle { .. } | Self::Loopback { .. } | Self::Unserved { .. })
    }

    /// Appends the request's PDU to `out`.
    pub fn encode(&self, out: &mut Vec<u8>) {
        out.push(self.function());
        match self {
            Self::ReadHolding { address, count } => put_words(out, &[*address, *count]),
            Self::WriteSingle { address, value } => put_words(out, &[*address, *value]),
            Self::Loopback { data } | Self::Unserved { function: function::DIAGNOSTICS, data } => {
                put_words(out, &[0, *data]);
            }
            Self::WriteMultiple { address, values } => {
                put_words(out, &[*address, values.len() as u16]);
                out.push((values.len() * 2) as u8);
                put_words(out, values);
            }
            Self::Unserved { .. } => {}
        }
    }

    /// Parses a request; `None` if its function is not one of ours or its form is wrong. Quantities are not checked:
    /// that is left to the drive. Nor is whether a function is supported: 08 is a loop test.
    #[must_use]
    pub fn decode(pdu: &[u8]) -> Option<Self> {
        let (&function, rest) = pdu.split_first()?;
        let (head, tail) = rest.split_first_chunk::<4>()?;
        let first = u16::from_be_bytes([head[0], head[1]]);
        let second = u16::from_be_bytes([head[2], head[3]]);
        match (function, tail) {
            (function::READ_HOLDING, []) => Some(Self::ReadHolding { address: first, count: second }),
            (function::WRITE_SINGLE, []) => Some(Self::WriteSingle { address: first, value: second }),
            (function::DIAGNOSTICS, []) if first == 0 => Some(Self::Loopback { data: second }),
            (function::WRITE_MULTIPLE, [bytes, data @ ..])
                if usize::from(*bytes) == data.len() && data.len() == 2 * usize::from(second) =>
            {
                Some(Self::WriteMultiple { address: first, values: words(data) })
            }
            _ => None,
        }
    }

    /// Whether an exception with `code` answers this request. An unsupported function is answered only by the exception
    /// that says so.
    #[must_use]
    pub const fn is_answered_by(&self, code: u8) -> bool {
        !matches!(self, Self::Unserved { .. }) || matches!(code, ILLEGAL_FUNCTION | FUNCTION_ERROR)
    }

    /// Parses `pdu` as the reply to this request. `None` if it does not answer it: another function or length, for 06
    /// another register, for 08 other data, for 10 hex another range. No normal reply answers a function that the drive
    /// does not support.
    #[must_use]
    pub fn reply_in(&self, pdu: &[u8]) -> Option<Reply> {
        let (&function, data) = pdu.split_first()?;
        if function != self.function() || pdu.len() != self.reply_pdu_bytes() {
            return None;
        }
        match self {
            Self::ReadHolding { .. } => {
                let (&bytes, data) = data.split_first()?;
                (usize::from(bytes) == data.len()).then(|| Reply::Words(words(data)))
            }
            Self::WriteSingle { address, .. } => {
                let [address_hi, address_lo, value_hi, value_lo] = *data else { return None };
                (u16::from_be_bytes([address_hi, address_lo]) == *address)
                    .then_some(Reply::Holds { value: u16::from_be_bytes([value_hi, value_lo]) })
            }
            Self::Loopback { data: sent } => (words(data) == [0, *sent]).then_some(Reply::Echo),
            Self::WriteMultiple { address, values } => {
                (words(data) == [*address, values.len() as u16]).then_some(Reply::Echo)
            }
            Self::Unserved { .. } => None,
        }
    }
}

/// Whether `pdu` can only be a request, so that its sender is a master.
#[must_use]
pub fn is_request(pdu: &[u8]) -> bool {
    match pdu {
        // A reply with 5 bytes would have half a word.
        [function::READ_HOLDING | function::READ_INPUT, rest @ ..] => rest.len() == 4,
        _ => matches!(Request::decode(pdu), Some(Request::WriteMultiple { .. })),
    }
}

/// Appends the PDU of a reply to 03 to `out`. `words` has at most 125 words.
pub fn encode_words_reply(out: &mut Vec<u8>, words: &[u16]) {
    out.push(function::READ_HOLDING);
    out.push((words.len() * 2) as u8);
    put_words(out, words);
}

/// Appends `words` to `out`, high byte first.
pub fn put_words(out: &mut Vec<u8>, words: &[u16]) {
    out.extend(words.iter().flat_map(|word| word.to_be_bytes()));
}

/// The words in `bytes`, high byte first; an odd byte at the end is ignored.
#[must_use]
pub fn words(bytes: &[u8]) -> Vec<u16> {
    bytes.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_request_survives_a_round_trip() {
        let requests = [
            Request::ReadHolding { address: 0x0101, count: 8 },
            Request::WriteSingle { address: 2, value: 1 },
            Request::Loopback { data: 0xBEEF },
            Request::WriteMultiple { address: 0x2501, values: vec![1, 3000] },
        ];
        for request in requests {
            let mut pdu = Vec::new();
            request.encode(&mut pdu);
            assert_eq!(Request::decode(&pdu), Some(request));
            pdu.push(0);
            assert_eq!(Request::decode(&pdu), None);
        }
    }

    #[test]
    fn what_a_drive_does_not_serve_does_nothing_on_one_that_does() {
        let pdu = |function| {
            let mut pdu = Vec::new();
            Request::Unserved { function, data: 0xBEEF }.encode(&mut pdu);
            pdu
        };
        assert_eq!(pdu(8), [8, 0, 0, 0xBE, 0xEF]);
        assert_eq!(pdu(0x11), [0x11]);
        let request = Request::Unserved { function: 8, data: 0xBEEF };
        assert_eq!(request.reply_in(&[8, 0, 0, 0xBE, 0xEF]), None);
        assert!(request.is_answered_by(1) && request.is_answered_by(0x51) && !request.is_answered_by(2));
        assert!(Request::Loopback { data: 1 }.is_answered_by(2));
    }

    #[test]
    fn only_the_right_reply_is_a_reply() {
        let read = Request::ReadHolding { address: 0x0101, count: 1 };
        assert_eq!(read.reply_in(&[3, 2, 0x17, 0x70]), Some(Reply::Words(vec![6000])));
        for wrong in [&[3, 4, 0, 1, 0, 2][..], &[3, 3, 0, 1], &[6, 2, 0x17, 0x70], &[3], &[]] {
            assert_eq!(read.reply_in(wrong), None, "{wrong:?}");
        }
        let write = Request::WriteSingle { address: 2, value: 1 };
        assert_eq!(write.reply_in(&[6, 0, 2, 0, 0]), Some(Reply::Holds { value: 0 }));
        assert_eq!(write.reply_in(&[6, 0, 4, 0, 1]), None);
        let loopback = Request::Loopback { data: 7 };
        assert_eq!(loopback.reply_in(&[8, 0, 0, 0, 7]), Some(Reply::Echo));
        assert_eq!(loopback.reply_in(&[8, 0, 0, 0, 8]), None);
        let block = Request::WriteMultiple { address: 9, values: vec![1, 2] };
        assert_eq!(block.reply_in(&[0x10, 0, 9, 0, 2]), Some(Reply::Echo));
        assert_eq!(block.reply_in(&[0x10, 0, 9, 0, 1]), None);
    }
}
