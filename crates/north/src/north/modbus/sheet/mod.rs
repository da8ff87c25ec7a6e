//! Every Modbus map of a gateway as rows with all their numbers, for printing: made from the tables and models that
//! serve requests, so that there is no second list.

mod gateway;
mod native;
#[cfg(test)]
mod tests;
mod uniform;

pub use gateway::gateway;
pub use native::native;
pub use uniform::uniform;

use super::map::{MapRow, MapTable, RowContent};
use super::uniform::ABSENT;
use crate::domain::command::Reason;
use crate::profile::scale::{Decimal, digits_of};

/// Which Modbus tables contain a row, with the functions that reach it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SheetTable {
    /// Coils.
    Coil,
    /// Discrete inputs.
    Discrete,
    /// Input registers and holding registers with equal content.
    Word,
    /// Holding registers only.
    Holding,
    /// Input registers only.
    Input,
}

impl SheetTable {
    /// The word that a sheet shows.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Coil => "coil",
            Self::Discrete => "discrete input",
            Self::Word => "holding and input register",
            Self::Holding => "holding register",
            Self::Input => "input register",
        }
    }

    /// The number by which data sheets call the value at `address`, counted from 1 after the digit of its table: 00001,
    /// 10001, 40001. Above 9999 it has six digits.
    #[must_use]
    pub fn number(self, address: u16) -> String {
        let digit = match self {
            Self::Coil => 0,
            Self::Discrete => 1,
            Self::Input => 3,
            Self::Word | Self::Holding => 4,
        };
        numbered(digit, address)
    }

    /// The number of the same value as an input register; `None` if it is none.
    #[must_use]
    pub fn input_number(self, address: u16) -> Option<String> {
        (self == Self::Word).then(|| numbered(3, address))
    }
}

impl From<MapTable> for SheetTable {
    fn from(table: MapTable) -> Self {
        match table {
            MapTable::Coil => Self::Coil,
            MapTable::Discrete => Self::Discrete,
            MapTable::Word => Self::Word,
            MapTable::Holding => Self::Holding,
        }
    }
}

fn numbered(digit: u8, address: u16) -> String {
    let number = u32::from(address) + 1;
    if number < 10_000 {
        format!("{digit}{number:04}")
    } else {
        format!("{digit}{number:05}")
    }
}

/// How the words of a row are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SheetFormat {
    /// One bit.
    Bit,
    /// A word without a sign.
    Unsigned,
    /// A word in two's complement.
    Signed,
    /// Two words without a sign, the high one first.
    Wide,
}

impl SheetFormat {
    /// The word that a sheet shows.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Bit => "bit",
            Self::Unsigned => "uint16",
            Self::Signed => "int16",
            Self::Wide => "uint32, high word first",
        }
    }
}

/// One value of a map.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SheetRow {
    /// The table it belongs to.
    pub table: SheetTable,
    /// First address, from 0, as it is sent.
    pub address: u16,
    /// How many addresses.
    pub count: u16,
    /// What it concerns: a drive or a line by its name; empty if the unit already determines it.
    pub of: String,
    /// The vendor's code; empty without one.
    pub code: String,
    /// A name in one word; empty without one.
    pub name: String,
    /// What it is.
    pub title: String,
    /// What one step is; empty for codes and bits.
    pub step: String,
    /// The unit of measure; empty without one.
    pub unit: &'static str,
    /// How it is read.
    pub format: SheetFormat,
    /// The row can be read.
    pub is_read: bool,
    /// The row can be written by some client.
    pub is_written: bool,
    /// What its values mean.
    pub meaning: String,
    /// Values with a special meaning, and notes on this drive.
    pub special: String,
}

impl SheetRow {
    /// The access, as a table shows it.
    #[must_use]
    pub const fn access(&self) -> &'static str {
        match (self.is_read, self.is_written) {
            (true, true) => "read, write",
            (true, false) => "read",
            (false, true) => "write",
            (false, false) => "-",
        }
    }

    /// The functions that reach it, in hexadecimal. `is_native` for registers of a drive, which are written by fewer.
    #[must_use]
    pub const fn functions(&self, is_native: bool) -> &'static str {
        match (self.table, self.is_written, is_native) {
            (SheetTable::Coil, true, _) if !self.is_read => "05 0F",
            _ if !self.is_read && self.is_written => "06 10",
            _ if !self.is_read => "-",
            (SheetTable::Coil, false, _) => "01",
            (SheetTable::Coil, true, _) => "01 05 0F",
            (SheetTable::Discrete, ..) => "02",
            (SheetTable::Input, ..) => "04",
            (SheetTable::Word, false, _) => "03 04",
            (SheetTable::Word, true, true) => "03 04 06 10",
            (SheetTable::Word, true, false) => "03 04 06 10 16 17",
            (SheetTable::Holding, false, _) => "03",
            (SheetTable::Holding, true, true) => "03 06 10",
            (SheetTable::Holding, true, false) => "03 06 10 16 17",
        }
    }
}

/// `row` of one of the gateway's own maps, at `address`.
fn of_map(row: &MapRow, address: u16) -> SheetRow {
    let table = SheetTable::from(row.table);
    let (step, unit, meaning) = match row.holds {
        RowContent::Steps(count, unit) => (step_text(count), unit.symbol(), String::new()),
        RowContent::Number(about) => (step_text(1), "", about.to_owned()),
        RowContent::Codes(codes) => (String::new(), "", codes.to_owned()),
        RowContent::Reason => (String::new(), "", reasons()),
    };
    let format = match (table, row.is_signed()) {
        (SheetTable::Coil | SheetTable::Discrete, _) => SheetFormat::Bit,
        // More words than two are no number.
        _ if row.count == 2 => SheetFormat::Wide,
        (_, true) => SheetFormat::Signed,
        (_, false) => SheetFormat::Unsigned,
    };
    SheetRow {
        table,
        address,
        count: row.count,
        of: String::new(),
        code: String::new(),
        name: row.key.to_owned(),
        title: row.name.to_owned(),
        step,
        unit,
        format,
        is_read: true,
        is_written: false,
        meaning,
        special: row
            .absent
            .map(|absent| absent_text(row.count, absent, "not known"))
            .unwrap_or_default(),
    }
}

/// One of `count` steps, as a decimal.
fn step_text(count: u32) -> String {
    Decimal::new(1, digits_of(count)).to_string()
}

/// The text that `absent` in each of `count` words means `why`.
fn absent_text(count: u16, absent: u16, why: &str) -> String {
    match count {
        1 if absent == ABSENT => format!("{absent}: {why}"),
        1 => format!("{absent} (-32768): {why}"),
        _ => format!("{absent} in each word: {why}"),
    }
}

fn reasons() -> String {
    let all = Reason::ALL
        .iter()
        .map(|reason| format!("{} {}", reason.number(), reason.keyword()));
    all.collect::<Vec<_>>().join(", ")
}
