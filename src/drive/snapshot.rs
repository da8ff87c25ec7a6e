//! What was last read from one drive.

use crate::domain::time::MonoTime;
use std::collections::BTreeMap;

/// Whether a drive answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Presence {
    /// Not asked yet.
    #[default]
    Unknown,
    /// It answered the last time it was asked.
    Online,
    /// It has been silent several times in a row.
    Offline,
}

/// One word with the moment its reply was complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// The word as the drive sent it.
    pub raw: u16,
    /// When its reply was complete.
    pub at: MonoTime,
}

/// What is known of a drive from its own replies.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DriveSnapshot {
    /// Whether it answers.
    pub presence: Presence,
    readings: BTreeMap<u16, Reading>,
}

impl DriveSnapshot {
    /// The last reading of the polled register at `address`.
    #[must_use]
    pub fn reading(&self, address: u16) -> Option<Reading> {
        self.readings.get(&address).copied()
    }

    /// Takes the words that were read from `address` on and came at `at`.
    pub fn take(&mut self, address: u16, words: &[u16], at: MonoTime) {
        for (offset, raw) in (0..).zip(words) {
            self.readings.insert(address.wrapping_add(offset), Reading { raw: *raw, at });
        }
    }
}
