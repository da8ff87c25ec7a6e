//! The last readings of one drive.

use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::profile::model::Register;
use crate::profile::scale::ScaledValue;

/// Whether a drive answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum DrivePresence {
    /// The drive has not been polled yet.
    #[default]
    Unknown,
    /// The drive answers.
    Online,
    /// The drive has been silent several times in a row.
    Offline,
}

/// One word with its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WordReading {
    /// The word as the drive sent it.
    pub raw: u16,
    /// When its reply was complete.
    pub at: MonoTime,
}

/// The value of a register with its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ValueReading {
    /// The value.
    pub value: ScaledValue,
    /// The word at its address as the drive sent it.
    pub raw: u16,
    /// When the oldest of its words arrived.
    pub at: MonoTime,
}

/// The known state of a drive, from its own replies.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DriveSnapshot {
    /// Whether it answers.
    pub presence: DrivePresence,
    /// The drive has not shown yet what every drive of its model shows, so that no reading counts.
    pub is_implausible: bool,
    /// In the order of their keys: they are looked up for every word that a client reads, and copied for every view.
    readings: Vec<(u32, WordReading)>,
}

/// Distinguishes and orders addresses as one number.
const fn key(address: Address) -> u32 {
    (address.table() as u32) << 16 | address.number() as u32
}

impl DriveSnapshot {
    /// Nothing was read of the drive yet; `is_implausible`: its model asks for something first.
    #[must_use]
    pub fn unread(is_implausible: bool) -> Self {
        Self {
            is_implausible,
            ..Self::default()
        }
    }

    /// The last reading of the register at `address`; `None` if it has not been read.
    #[must_use]
    pub fn reading(&self, address: impl Into<Address>) -> Option<WordReading> {
        let place = self.place_of(address.into()).ok()?;
        self.readings.get(place).map(|(_, reading)| *reading)
    }

    /// Whether anything was ever read.
    #[must_use]
    pub const fn has_readings(&self) -> bool {
        !self.readings.is_empty()
    }

    /// The value of `register` from the last readings; `None` if a word that it needs has not been read, if its two
    /// words are not from one reply, or if another register holds what the model gives no meaning.
    #[must_use]
    pub fn value(&self, register: &Register) -> Option<ValueReading> {
        let first = self.reading(register.address)?;
        if register.form.is_plain() {
            return Some(ValueReading {
                value: register.plain_value(first.raw),
                raw: first.raw,
                at: first.at,
            });
        }
        if register.form.pair.is_some()
            && self.reading(register.address.checked_add(1)?)?.at != first.at
        {
            return None;
        }
        let parts = register
            .form
            .plus
            .iter()
            .map(|part| Some(self.reading(part.address)?.at));
        let at = parts
            .collect::<Option<Vec<_>>>()?
            .into_iter()
            .fold(first.at, MonoTime::min);
        let value = register.value(|address| self.reading(address).map(|reading| reading.raw))?;
        Some(ValueReading {
            value,
            raw: first.raw,
            at,
        })
    }

    /// When the value of `register` was read; `None` if it has none. To ask only this is quicker.
    #[must_use]
    pub fn read_at(&self, register: &Register) -> Option<MonoTime> {
        if register.form.is_plain() {
            return self.reading(register.address).map(|reading| reading.at);
        }
        self.value(register).map(|reading| reading.at)
    }

    /// Discards the words at `addresses`: after a drive was away they may be others.
    pub fn forget(&mut self, addresses: impl IntoIterator<Item = Address>) {
        for address in addresses {
            if let Ok(place) = self.place_of(address) {
                self.readings.remove(place);
            }
        }
    }

    /// Where the reading at `address` is, or belongs.
    fn place_of(&self, address: Address) -> Result<usize, usize> {
        self.readings
            .binary_search_by_key(&key(address), |(key, _)| *key)
    }

    /// Takes the words that were read from `address` on and came at `at`.
    pub fn take(&mut self, address: Address, words: &[u16], at: MonoTime) {
        for (address, raw) in address.onwards().zip(words) {
            let reading = WordReading { raw: *raw, at };
            match self.place_of(address) {
                Ok(place) => self.readings[place].1 = reading,
                Err(place) => self.readings.insert(place, (key(address), reading)),
            }
        }
    }
}
