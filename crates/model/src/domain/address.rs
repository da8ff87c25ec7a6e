//! Addresses of a drive's data: one of the four tables of the Modbus data model, and a number in it.

use std::fmt;

/// A table of the Modbus data model (application protocol V1.1b3, 4.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum DataTable {
    /// Holding registers: words that are read by 03 and written by 06 or 10 hex.
    #[default]
    Holding,
    /// Input registers: words that are read by 04.
    Input,
    /// Coils: bits that are read by 01 and written by 05 or 0F hex.
    Coil,
    /// Discrete inputs: bits that are read by 02.
    Discrete,
}

impl DataTable {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Holding, Self::Input, Self::Coil, Self::Discrete];

    /// The word for it in model files.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Holding => "holding",
            Self::Input => "input",
            Self::Coil => "coil",
            Self::Discrete => "discrete",
        }
    }

    /// Whether it holds bits. Each is read and written as a word, 0 or 1.
    #[must_use]
    pub const fn is_of_bits(self) -> bool {
        matches!(self, Self::Coil | Self::Discrete)
    }

    /// Whether a master may write to it.
    #[must_use]
    pub const fn is_writable(self) -> bool {
        matches!(self, Self::Holding | Self::Coil)
    }
}

/// Where one word or bit of a drive is. Ordered by table, then by number.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address {
    table: DataTable,
    number: u16,
}

impl Address {
    /// The address with `number`, as it is sent on the wire, in `table`.
    #[must_use]
    pub const fn new(table: DataTable, number: u16) -> Self {
        Self { table, number }
    }

    /// The holding register with `number`.
    #[must_use]
    pub const fn holding(number: u16) -> Self {
        Self::new(DataTable::Holding, number)
    }

    /// Its table.
    #[must_use]
    pub const fn table(self) -> DataTable {
        self.table
    }

    /// Its number, as it is sent on the wire.
    #[must_use]
    pub const fn number(self) -> u16 {
        self.number
    }

    /// The address with `number` in this table.
    #[must_use]
    pub const fn at(self, number: u16) -> Self {
        Self { number, ..self }
    }

    /// The address `count` further on; `None` beyond the end of the table.
    #[must_use]
    pub const fn checked_add(self, count: u16) -> Option<Self> {
        match self.number.checked_add(count) {
            Some(number) => Some(self.at(number)),
            None => None,
        }
    }

    /// The address `count` further on, at most the last one of the table.
    #[must_use]
    pub const fn saturating_add(self, count: u16) -> Self {
        self.at(self.number.saturating_add(count))
    }

    /// How far it is behind `first`; `None` if it is before it or in another table.
    #[must_use]
    pub fn offset_from(self, first: Self) -> Option<u16> {
        if self.table == first.table {
            self.number.checked_sub(first.number)
        } else {
            None
        }
    }

    /// Its word among `words`, which were read from `first` on.
    #[must_use]
    pub fn word_in(self, first: Self, words: &[u16]) -> Option<u16> {
        words.get(usize::from(self.offset_from(first)?)).copied()
    }

    /// The addresses from this one on to the end of its table.
    pub fn onwards(self) -> impl Iterator<Item = Self> {
        (self.number..=u16::MAX).map(move |number| self.at(number))
    }
}

impl From<u16> for Address {
    /// A holding register.
    fn from(number: u16) -> Self {
        Self::holding(number)
    }
}

impl PartialEq<u16> for Address {
    /// Whether it is the holding register with this number.
    fn eq(&self, number: &u16) -> bool {
        *self == Self::holding(*number)
    }
}

impl fmt::Display for Address {
    /// `0x2100` for a holding register, `coil 0x0001` for others.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.table {
            DataTable::Holding => write!(f, "0x{:04X}", self.number),
            table => write!(f, "{} 0x{:04X}", table.keyword(), self.number),
        }
    }
}

impl fmt::Debug for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_counts_within_its_table() {
        let coil = Address::new(DataTable::Coil, 3);
        assert_eq!(coil.checked_add(2), Some(Address::new(DataTable::Coil, 5)));
        assert_eq!(Address::holding(u16::MAX).checked_add(1), None);
        assert_eq!(coil.offset_from(Address::new(DataTable::Coil, 1)), Some(2));
        assert_eq!(coil.offset_from(Address::holding(1)), None, "another table");
        assert_eq!(
            coil.word_in(Address::new(DataTable::Coil, 2), &[0, 1]),
            Some(1)
        );
        assert_eq!(
            (coil.to_string(), Address::holding(0x2100).to_string()),
            ("coil 0x0003".into(), "0x2100".into())
        );
    }
}
