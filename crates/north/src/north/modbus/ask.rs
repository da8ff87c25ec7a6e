//! A client's request, independent of the unit, after every check that needs no unit.

use super::function as client;
use crate::wire::pdu::function;

/// A table of words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WordTable {
    /// Holding registers: 03.
    Holding,
    /// Input registers: 04.
    Input,
}

/// A table of bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BitTable {
    /// Coils: 01.
    Coils,
    /// Discrete inputs: 02.
    Discrete,
}

/// A request that is valid in itself: quantities and byte counts are those of the standard, and no range passes 0xFFFF.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ModbusRequest {
    /// 01 and 02.
    ReadBits {
        /// Which.
        table: BitTable,
        /// First bit.
        address: u16,
        /// 1 to 2000.
        count: u16,
    },
    /// 03 and 04.
    ReadWords {
        /// Which.
        table: WordTable,
        /// First register.
        address: u16,
        /// 1 to 125.
        count: u16,
    },
    /// 08, sub-function 0.
    LoopTest {
        /// The word that is returned.
        data: u16,
    },
    /// 05.
    WriteCoil {
        /// Which.
        address: u16,
        /// On or off.
        on: bool,
    },
    /// 06.
    WriteWord {
        /// Register.
        address: u16,
        /// The word.
        value: u16,
    },
    /// 0F hex.
    WriteCoils {
        /// First coil.
        address: u16,
        /// On or off, in order.
        values: PackedBits,
    },
    /// 10 hex.
    WriteWords {
        /// First register.
        address: u16,
        /// 1 to 123 words, in order.
        values: Vec<u16>,
    },
    /// 16 hex: the register becomes `(old & and) | (or & !and)`.
    MaskWord {
        /// Register.
        address: u16,
        /// Bits that stay.
        and: u16,
        /// New value of the bits that are 0 in `and`.
        or: u16,
    },
    /// 17 hex: writes first, then reads.
    ReadWriteWords {
        /// First register that is read.
        read_address: u16,
        /// 1 to 125.
        read_count: u16,
        /// First register that is written.
        address: u16,
        /// 1 to 121 words, in order.
        values: Vec<u16>,
    },
    /// 2B/0E hex.
    Identify {
        /// Access: 1 to 3 a stream of objects, 4 a single one. Not checked.
        access: u8,
        /// First object, or the one. Not checked.
        object: u8,
    },
}

impl ModbusRequest {
    /// Its function code.
    #[must_use]
    pub const fn function(&self) -> u8 {
        match self {
            Self::ReadBits {
                table: BitTable::Coils,
                ..
            } => client::READ_COILS,
            Self::ReadBits {
                table: BitTable::Discrete,
                ..
            } => client::READ_DISCRETE,
            Self::ReadWords {
                table: WordTable::Holding,
                ..
            } => function::READ_HOLDING,
            Self::ReadWords {
                table: WordTable::Input,
                ..
            } => function::READ_INPUT,
            Self::LoopTest { .. } => function::DIAGNOSTICS,
            Self::WriteCoil { .. } => client::WRITE_COIL,
            Self::WriteWord { .. } => function::WRITE_SINGLE,
            Self::WriteCoils { .. } => client::WRITE_COILS,
            Self::WriteWords { .. } => function::WRITE_MULTIPLE,
            Self::MaskWord { .. } => client::MASK_WRITE,
            Self::ReadWriteWords { .. } => client::READ_WRITE,
            Self::Identify { .. } => client::ENCAPSULATED,
        }
    }

    /// Whether it writes, alone or together with a read.
    #[must_use]
    pub const fn writes(&self) -> bool {
        !matches!(
            self,
            Self::ReadBits { .. }
                | Self::ReadWords { .. }
                | Self::LoopTest { .. }
                | Self::Identify { .. }
        )
    }
}

/// Bits as in a frame: the first in the lowest bit of the first byte.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PackedBits {
    bytes: Vec<u8>,
    count: u16,
}

impl PackedBits {
    /// The first `count` bits in `bytes`; `None` unless there are exactly as many bytes as they need.
    #[must_use]
    pub fn new(bytes: &[u8], count: u16) -> Option<Self> {
        (bytes.len() == usize::from(count.div_ceil(8))).then(|| Self {
            bytes: bytes.to_vec(),
            count,
        })
    }

    /// How many.
    #[must_use]
    pub const fn count(&self) -> u16 {
        self.count
    }

    /// The bit at `place`, from 0; `None` past the last.
    #[must_use]
    pub fn get(&self, place: u16) -> Option<bool> {
        let byte = self.bytes.get(usize::from(place / 8))?;
        (place < self.count).then_some(byte >> (place % 8) & 1 == 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_begin_at_the_lowest_of_the_first_byte() {
        let bits = PackedBits::new(&[0b1000_0001, 0b10], 9).unwrap();
        assert_eq!(bits.count(), 9);
        let found: Vec<_> = (0..10).map(|place| bits.get(place)).collect();
        let mut right = vec![Some(false); 9];
        right[0] = Some(true);
        right[7] = Some(true);
        right.push(None);
        assert_eq!(found, right, "padding is no bit");
        assert_eq!(PackedBits::new(&[0], 9), None);
        assert_eq!(PackedBits::new(&[0, 0], 8), None);
    }
}
