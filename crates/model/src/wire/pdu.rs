//! Requests to drives and their replies, without station, CRC or header.

use super::exception::ILLEGAL_FUNCTION;
use crate::domain::address::{Address, DataTable};

/// Function codes (Modbus application protocol V1.1b3, 5.1).
pub mod function {
    /// Read coils.
    pub const READ_COILS: u8 = 0x01;
    /// Read discrete inputs.
    pub const READ_DISCRETE: u8 = 0x02;
    /// Read holding registers.
    pub const READ_HOLDING: u8 = 0x03;
    /// Read input registers.
    pub const READ_INPUT: u8 = 0x04;
    /// Write a single coil.
    pub const WRITE_COIL: u8 = 0x05;
    /// Write a single register.
    pub const WRITE_SINGLE: u8 = 0x06;
    /// Diagnostics; sub-function 0 returns what was sent.
    pub const DIAGNOSTICS: u8 = 0x08;
    /// Write several coils.
    pub const WRITE_COILS: u8 = 0x0F;
    /// Write several registers.
    pub const WRITE_MULTIPLE: u8 = 0x10;
    /// Set in the function code of an exception reply.
    pub const EXCEPTION_BIT: u8 = 0x80;
}

/// Maximum number of words in one read (V1.1b3, 6.3).
pub const MAX_READ_WORDS: u16 = 125;
/// Maximum number of words in one write (V1.1b3, 6.12).
pub const MAX_WRITE_WORDS: u16 = 123;
/// Most bits that one read of this program asks for. The standard allows 2,000; no drive has as many.
pub const MAX_READ_BITS: u16 = 125;
/// The word that sets a coil; 0 clears it (V1.1b3, 6.5).
const COIL_ON: u16 = 0xFF00;
/// Longest PDU in bytes (V1.1b3, 4.1).
pub const MAX_PDU_BYTES: usize = 253;

/// Exception code that some drives send instead of 01.
pub const FUNCTION_ERROR: u8 = 0x51;

/// A request to a drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// 03, 04, 01 or 02, by the table: read `count` words or bits from `address` on.
    Read {
        /// First register, coil or input.
        address: Address,
        /// Number of words or bits.
        count: u16,
    },
    /// 06, or 05 for a coil: write one word or bit.
    WriteSingle {
        /// Register or coil.
        address: Address,
        /// The word; of a coil, 0 or 1.
        value: u16,
    },
    /// 08 with sub-function 0: the drive returns `data` unchanged.
    Loopback {
        /// Any word; with a fresh one an earlier answer cannot be mistaken for this one.
        data: u16,
    },
    /// 10 hex, or 0F hex for coils: write several words or bits.
    WriteMultiple {
        /// First register or coil.
        address: Address,
        /// 1 to 123 words; of coils, 0 or 1 each.
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
    /// A read of `count` words or bits from `address` on.
    #[must_use]
    pub fn read(address: impl Into<Address>, count: u16) -> Self {
        Self::Read {
            address: address.into(),
            count,
        }
    }

    /// A write of one word or bit.
    #[must_use]
    pub fn write(address: impl Into<Address>, value: u16) -> Self {
        Self::WriteSingle {
            address: address.into(),
            value,
        }
    }

    /// The function code.
    #[must_use]
    pub const fn function(&self) -> u8 {
        match self {
            Self::Read { address, .. } => match address.table() {
                DataTable::Holding => function::READ_HOLDING,
                DataTable::Input => function::READ_INPUT,
                DataTable::Coil => function::READ_COILS,
                DataTable::Discrete => function::READ_DISCRETE,
            },
            Self::WriteSingle { address, .. } if address.table().is_of_bits() => {
                function::WRITE_COIL
            }
            Self::WriteSingle { .. } => function::WRITE_SINGLE,
            Self::Loopback { .. } => function::DIAGNOSTICS,
            Self::WriteMultiple { address, .. } if address.table().is_of_bits() => {
                function::WRITE_COILS
            }
            Self::WriteMultiple { .. } => function::WRITE_MULTIPLE,
            Self::Unserved { function, .. } => *function,
        }
    }

    /// The addresses that it writes; none if it is a read or a test.
    pub fn written(&self) -> impl Iterator<Item = Address> + use<> {
        let (first, count) = match self {
            Self::WriteSingle { address, .. } => (*address, 1),
            Self::WriteMultiple { address, values } => (*address, values.len()),
            Self::Read { .. } | Self::Loopback { .. } | Self::Unserved { .. } => {
                (Address::default(), 0)
            }
        };
        first.onwards().take(count)
    }

    /// Length of the valid reply's PDU in bytes.
    #[must_use]
    pub const fn reply_pdu_bytes(&self) -> usize {
        match self {
            Self::Unserved { .. } => 2,
            Self::Read { address, count } if address.table().is_of_bits() => {
                2 + bit_bytes(*count as usize)
            }
            Self::Read { count, .. } => 2 + 2 * *count as usize,
            Self::WriteSingle { .. } | Self::Loopback { .. } | Self::WriteMultiple { .. } => 5,
        }
    }

    /// Whether a drive may answer with a copy of the request, so that an echo looks like the reply.
    #[must_use]
    pub const fn is_repeated_by_its_reply(&self) -> bool {
        matches!(
            self,
            Self::WriteSingle { .. } | Self::Loopback { .. } | Self::Unserved { .. }
        )
    }

    /// Appends the request's PDU to `out`.
    pub fn encode(&self, out: &mut Vec<u8>) {
        out.push(self.function());
        match self {
            Self::Read { address, count } => put_words(out, &[address.number(), *count]),
            Self::WriteSingle { address, value } => {
                put_words(out, &[address.number(), single(*address, *value)])
            }
            Self::Loopback { data }
            | Self::Unserved {
                function: function::DIAGNOSTICS,
                data,
            } => {
                put_words(out, &[0, *data]);
            }
            Self::WriteMultiple { address, values } => {
                put_words(out, &[address.number(), values.len() as u16]);
                if address.table().is_of_bits() {
                    out.push(bit_bytes(values.len()) as u8);
                    put_bits(out, values);
                } else {
                    out.push((values.len() * 2) as u8);
                    put_words(out, values);
                }
            }
            Self::Unserved { .. } => {}
        }
    }

    /// The request that `pdu` holds; `None` if its function is not one of ours or its form is wrong.
    /// Quantities are not judged: that is up to the drive. Whether a function is served neither: 08 is a loop test.
    #[must_use]
    pub fn decode(pdu: &[u8]) -> Option<Self> {
        let (&function, rest) = pdu.split_first()?;
        let (head, tail) = rest.split_first_chunk::<4>()?;
        let first = u16::from_be_bytes([head[0], head[1]]);
        let second = u16::from_be_bytes([head[2], head[3]]);
        match (function, tail) {
            (
                function::READ_HOLDING
                | function::READ_INPUT
                | function::READ_COILS
                | function::READ_DISCRETE,
                [],
            ) => Some(Self::Read {
                address: Address::new(table_of(function), first),
                count: second,
            }),
            (function::WRITE_SINGLE, []) => Some(Self::write(first, second)),
            (function::WRITE_COIL, []) if matches!(second, 0 | COIL_ON) => Some(Self::write(
                Address::new(DataTable::Coil, first),
                u16::from(second == COIL_ON),
            )),
            (function::DIAGNOSTICS, []) if first == 0 => Some(Self::Loopback { data: second }),
            (function::WRITE_MULTIPLE, [bytes, data @ ..])
                if usize::from(*bytes) == data.len() && data.len() == 2 * usize::from(second) =>
            {
                Some(Self::WriteMultiple {
                    address: Address::holding(first),
                    values: words(data),
                })
            }
            (function::WRITE_COILS, [bytes, data @ ..])
                if usize::from(*bytes) == data.len() && data.len() == bit_bytes(second.into()) =>
            {
                let values = bits(data, second.into());
                Some(Self::WriteMultiple {
                    address: Address::new(DataTable::Coil, first),
                    values,
                })
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

    /// What `pdu` answers to this request; `None` if it does not answer it: another function or length, for 05 and 06
    /// another address, for 08 other data, for 0F and 10 hex another range. No normal reply answers a function that the
    /// drive does not serve.
    #[must_use]
    pub fn reply_in(&self, pdu: &[u8]) -> Option<Reply> {
        let (&function, data) = pdu.split_first()?;
        if function != self.function() || pdu.len() != self.reply_pdu_bytes() {
            return None;
        }
        match self {
            Self::Read { address, count } => {
                let (&bytes, data) = data.split_first()?;
                let is_of_bits = address.table().is_of_bits();
                let values = || {
                    if is_of_bits {
                        bits(data, usize::from(*count))
                    } else {
                        words(data)
                    }
                };
                (usize::from(bytes) == data.len()).then(|| Reply::Words(values()))
            }
            Self::WriteSingle { address, .. } => {
                let [address_hi, address_lo, value_hi, value_lo] = *data else {
                    return None;
                };
                let value = u16::from_be_bytes([value_hi, value_lo]);
                let value = match (address.table().is_of_bits(), value) {
                    (false, value) => value,
                    (true, 0) => 0,
                    (true, COIL_ON) => 1,
                    (true, _) => return None,
                };
                (u16::from_be_bytes([address_hi, address_lo]) == address.number())
                    .then_some(Reply::Holds { value })
            }
            Self::Loopback { data: sent } => (words(data) == [0, *sent]).then_some(Reply::Echo),
            Self::WriteMultiple { address, values } => {
                (words(data) == [address.number(), values.len() as u16]).then_some(Reply::Echo)
            }
            Self::Unserved { .. } => None,
        }
    }
}

/// The table that `function` reads.
const fn table_of(function: u8) -> DataTable {
    match function {
        function::READ_COILS => DataTable::Coil,
        function::READ_DISCRETE => DataTable::Discrete,
        function::READ_INPUT => DataTable::Input,
        _ => DataTable::Holding,
    }
}

/// `value` as 05 or 06 carries it.
const fn single(address: Address, value: u16) -> u16 {
    match (address.table().is_of_bits(), value) {
        (false, value) => value,
        (true, 0) => 0,
        (true, _) => COIL_ON,
    }
}

/// Bytes that hold `count` bits.
const fn bit_bytes(count: usize) -> usize {
    count.div_ceil(8)
}

/// Whether `pdu` can only be a request: another master asks drives on this line.
#[must_use]
pub fn is_request(pdu: &[u8]) -> bool {
    match pdu {
        // A reply with 5 bytes would have half a word.
        [function::READ_HOLDING | function::READ_INPUT, rest @ ..] => rest.len() == 4,
        // A reply with three bytes of bits is as long.
        [function::READ_COILS | function::READ_DISCRETE, rest @ ..] => {
            rest.len() == 4 && rest[0] != 3
        }
        _ => matches!(Request::decode(pdu), Some(Request::WriteMultiple { .. })),
    }
}

/// Appends the PDU of the reply to a read from `table` to `out`. At most 125 words fit; bits are 0 or 1 each.
pub fn encode_read_reply(out: &mut Vec<u8>, table: DataTable, values: &[u16]) {
    out.push(Request::read(Address::new(table, 0), 0).function());
    if table.is_of_bits() {
        out.push(bit_bytes(values.len()) as u8);
        put_bits(out, values);
    } else {
        out.push((values.len() * 2) as u8);
        put_words(out, values);
    }
}

/// Appends `words` to `out`, high byte first.
pub fn put_words(out: &mut Vec<u8>, words: &[u16]) {
    out.extend(words.iter().flat_map(|word| word.to_be_bytes()));
}

/// Appends `bits`, each 0 or another number, to `out`: the first in the lowest bit of the first byte.
fn put_bits(out: &mut Vec<u8>, bits: &[u16]) {
    let byte = |bits: &[u16]| {
        bits.iter()
            .rev()
            .fold(0, |byte, bit| byte << 1 | u8::from(*bit != 0))
    };
    out.extend(bits.chunks(8).map(byte));
}

/// The words in `bytes`, high byte first; an odd byte at the end is left out.
#[must_use]
pub fn words(bytes: &[u8]) -> Vec<u16> {
    bytes
        .chunks_exact(2)
        .map(|pair| u16::from_be_bytes([pair[0], pair[1]]))
        .collect()
}

/// The first `count` bits in `bytes`, 0 or 1 each.
fn bits(bytes: &[u8], count: usize) -> Vec<u16> {
    let all = bytes
        .iter()
        .flat_map(|byte| (0..8).map(move |bit| u16::from(byte >> bit & 1)));
    all.take(count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_request_survives_a_round_trip() {
        let requests = [
            Request::read(0x0101, 8),
            Request::read(Address::new(DataTable::Input, 3), 2),
            Request::read(Address::new(DataTable::Coil, 6), 7),
            Request::read(Address::new(DataTable::Discrete, 0), 16),
            Request::write(2, 1),
            Request::write(Address::new(DataTable::Coil, 0), 1),
            Request::write(Address::new(DataTable::Coil, 0x49), 0),
            Request::Loopback { data: 0xBEEF },
            Request::WriteMultiple {
                address: Address::holding(0x2501),
                values: vec![1, 3000],
            },
            Request::WriteMultiple {
                address: Address::new(DataTable::Coil, 0),
                values: vec![1, 0, 0, 0, 0, 0, 0, 1, 1],
            },
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
            Request::Unserved {
                function,
                data: 0xBEEF,
            }
            .encode(&mut pdu);
            pdu
        };
        assert_eq!(pdu(8), [8, 0, 0, 0xBE, 0xEF]);
        assert_eq!(pdu(0x11), [0x11]);
        let request = Request::Unserved {
            function: 8,
            data: 0xBEEF,
        };
        assert_eq!(request.reply_in(&[8, 0, 0, 0xBE, 0xEF]), None);
        assert!(
            request.is_answered_by(1) && request.is_answered_by(0x51) && !request.is_answered_by(2)
        );
        assert!(Request::Loopback { data: 1 }.is_answered_by(2));
    }

    #[test]
    fn only_the_right_reply_is_a_reply() {
        let read = Request::read(0x0101, 1);
        assert_eq!(
            read.reply_in(&[3, 2, 0x17, 0x70]),
            Some(Reply::Words(vec![6000]))
        );
        for wrong in [
            &[3, 4, 0, 1, 0, 2][..],
            &[3, 3, 0, 1],
            &[6, 2, 0x17, 0x70],
            &[3],
            &[],
        ] {
            assert_eq!(read.reply_in(wrong), None, "{wrong:?}");
        }
        let write = Request::write(2, 1);
        assert_eq!(
            write.reply_in(&[6, 0, 2, 0, 0]),
            Some(Reply::Holds { value: 0 })
        );
        assert_eq!(write.reply_in(&[6, 0, 4, 0, 1]), None);
        let loopback = Request::Loopback { data: 7 };
        assert_eq!(loopback.reply_in(&[8, 0, 0, 0, 7]), Some(Reply::Echo));
        assert_eq!(loopback.reply_in(&[8, 0, 0, 0, 8]), None);
        let block = Request::WriteMultiple {
            address: Address::holding(9),
            values: vec![1, 2],
        };
        assert_eq!(block.reply_in(&[0x10, 0, 9, 0, 2]), Some(Reply::Echo));
        assert_eq!(block.reply_in(&[0x10, 0, 9, 0, 1]), None);
    }

    #[test]
    fn coils_are_read_and_written_as_bits() {
        // The printed exchanges of an Omron/Hitachi manual and of an H100: read 7 coils, set a coil.
        let read = Request::read(Address::new(DataTable::Coil, 6), 7);
        let mut pdu = Vec::new();
        read.encode(&mut pdu);
        assert_eq!(pdu, [1, 0, 6, 0, 7]);
        assert_eq!(
            read.reply_in(&[1, 1, 0x45]),
            Some(Reply::Words(vec![1, 0, 1, 0, 0, 0, 1]))
        );
        assert_eq!(read.reply_in(&[1, 2, 0x45, 0]), None);
        let run = Request::write(Address::new(DataTable::Coil, 0), 1);
        let mut pdu = Vec::new();
        run.encode(&mut pdu);
        assert_eq!(pdu, [5, 0, 0, 0xFF, 0]);
        assert_eq!(run.reply_in(&pdu), Some(Reply::Holds { value: 1 }));
        assert_eq!(
            run.reply_in(&[5, 0, 0, 0, 0]),
            Some(Reply::Holds { value: 0 })
        );
        for wrong in [
            &[5, 0, 1, 0xFF, 0][..],
            &[5, 0, 0, 0, 1],
            &[6, 0, 0, 0xFF, 0],
        ] {
            assert_eq!(run.reply_in(wrong), None, "{wrong:?}");
        }
    }

    #[test]
    fn a_read_of_coils_looks_like_a_request_unless_it_may_be_a_reply() {
        assert!(is_request(&[1, 0, 6, 0, 7]));
        assert!(!is_request(&[1, 3, 6, 0, 7]));
        assert!(!is_request(&[1, 1, 0x45]));
    }
}
