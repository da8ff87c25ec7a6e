//! What one read may cover: how many words, from where to where, and whether it may run over addresses without a register.

use super::Fact;
use crate::domain::address::{Address, DataTable};

/// Limits of reads.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadLimits {
    /// Maximum number of words in one read. With 1, no read ever covers two registers.
    pub max_words: Fact<u16>,
    /// Maximum number of words in one read with ASCII frames, if the model supports them.
    pub max_words_ascii: Option<Fact<u16>>,
    /// The longest RTU frame that the drive takes or sends. The numbers of words are already as small as it demands.
    pub max_bytes: Option<Fact<u16>>,
    /// A boundary that no read may cross.
    pub boundary: Option<ReadBoundary>,
    /// What the drive does about addresses without a register. `None`: it refuses the whole read.
    pub holes: Option<Fact<ReadHoles>>,
    /// Ranges of addresses with limits of their own, in order; no read crosses the edge of one.
    pub areas: Vec<ReadArea>,
}

impl ReadLimits {
    /// How many words may be read from `address` in one frame.
    pub(in crate::profile) fn words_at(&self, address: Address) -> u16 {
        let number = address.number();
        let most = self.words_to_boundary(number);
        let areas = || {
            self.areas
                .iter()
                .filter(|area| area.table == address.table())
        };
        if let Some(area) = areas().find(|area| area.contains(number)) {
            let to_edge = (area.to - number).saturating_add(1);
            return area
                .max_words
                .value
                .min(to_edge)
                .min(self.to_boundary(number));
        }
        let next = areas()
            .map(|area| area.from)
            .filter(|from| *from > number)
            .min();
        next.map_or(most, |from| most.min(from - number))
    }

    /// The most words that any read may have.
    #[must_use]
    pub fn longest(&self) -> u16 {
        self.areas
            .iter()
            .map(|area| area.max_words.value)
            .fold(self.max_words.value, u16::max)
    }

    /// Whether a read may run over addresses without a register. What they show then proves nothing.
    #[must_use]
    pub fn reads_holes(&self) -> bool {
        self.holes
            .as_ref()
            .is_some_and(|holes| holes.value != ReadHoles::Refused)
    }

    fn words_to_boundary(&self, address: u16) -> u16 {
        self.max_words.value.min(self.to_boundary(address))
    }

    const fn to_boundary(&self, address: u16) -> u16 {
        match self.boundary {
            Some(ReadBoundary::HighByte) => 0x100 - (address & 0xFF),
            None => (u16::MAX - address).saturating_add(1),
        }
    }
}

/// A boundary that no read may cross.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ReadBoundary {
    /// A change of the address's high byte, that is, of the parameter group.
    HighByte,
}

/// What a drive does about a read of an address without a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ReadHoles {
    /// The drive answers with an exception.
    Refused,
    /// The drive shows 0.
    Zero,
    /// The drive shows something.
    Read,
}

/// A range of addresses with a limit of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadArea {
    /// Its table.
    pub table: DataTable,
    /// First address.
    pub from: u16,
    /// Last address.
    pub to: u16,
    /// Maximum number of words in one read.
    pub max_words: Fact<u16>,
}

impl ReadArea {
    const fn contains(&self, address: u16) -> bool {
        self.from <= address && address <= self.to
    }
}
