//! The last readings of one drive.

use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use std::collections::BTreeMap;

/// Whether a drive answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Presence {
    /// It has not been polled yet.
    #[default]
    Unknown,
    /// It answers.
    Online,
    /// It has been silent several times in a row.
    Offline,
}

/// One word with its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// The word as the drive sent it.
    pub raw: u16,
    /// When its reply was complete.
    pub at: MonoTime,
}

/// The known state of a drive, from its own replies.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DriveSnapshot {
    /// Whether it answers.
    pub presence: Presence,
    readings: BTreeMap<Address, Reading>,
}

impl DriveSnapshot {
    /// The last reading of the register at `address`; `None` if it has not been read.
    #[must_use]
    pub fn reading(&self, address: impl Into<Address>) -> Option<Reading> {
        self.readings.get(&address.into()).copied()
    }

    /// Takes the words that were read from `address` on and came at `at`.
    pub fn take(&mut self, address: Address, words: &[u16], at: MonoTime) {
        for (address, raw) in address.onwards().zip(words) {
            self.readings.insert(address, Reading { raw: *raw, at });
        }
    }
}
