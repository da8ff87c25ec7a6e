//! The books of a fleet: for each update of each drive, whether it was sent, acknowledged and received.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

/// Most updates that are booked. Each costs three bits, so that the books stay below 200 MB.
pub const UPDATES_MAX: u64 = 500_000_000;
const WORD_BITS: u64 = u64::BITS as u64;

/// The state of each update. Updates of a drive are numbered from 0 in the order in which they are first sent.
#[derive(Debug)]
pub struct Ledger {
    words_per_drive: usize,
    updates_per_drive: u32,
    sent: Vec<AtomicU64>,
    acknowledged: Vec<AtomicU64>,
    received: Vec<AtomicU64>,
    /// The highest number received of each drive, plus one.
    newest: Vec<AtomicU32>,
}

/// The kind of a received message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Receipt {
    /// An update that was not received before.
    First,
    /// The same, after a newer one of its drive.
    Late,
    /// One that was received already.
    Again,
    /// One that was never sent.
    Foreign,
}

/// All updates, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Balance {
    /// Sent at least once.
    pub sent: u64,
    /// Acknowledged by the broker.
    pub acknowledged: u64,
    /// Received at least once.
    pub received: u64,
    /// Acknowledged and not received.
    pub acknowledged_missing: u64,
    /// Sent, neither acknowledged nor received.
    pub unacknowledged_missing: u64,
}

impl Ledger {
    /// Empty books for a number of drives with at most a number of updates each; `None` if that is more than
    /// [`UPDATES_MAX`].
    #[must_use]
    pub fn new(drives: usize, updates_per_drive: u32) -> Option<Self> {
        let words = u64::from(updates_per_drive).div_ceil(WORD_BITS);
        let words_of_all = words
            .checked_mul(drives as u64)
            .filter(|all| *all <= UPDATES_MAX / WORD_BITS)?;
        let bits = || {
            std::iter::repeat_with(AtomicU64::default)
                .take(words_of_all as usize)
                .collect()
        };
        Some(Self {
            words_per_drive: words as usize,
            updates_per_drive,
            sent: bits(),
            acknowledged: bits(),
            received: bits(),
            newest: std::iter::repeat_with(AtomicU32::default)
                .take(drives)
                .collect(),
        })
    }

    /// Books that an update was sent to the broker.
    pub fn sent(&self, drive: usize, number: u32) {
        self.book(&self.sent, drive, number);
    }

    /// Books that the broker has acknowledged an update.
    pub fn acknowledged(&self, drive: usize, number: u32) {
        self.book(&self.acknowledged, drive, number);
    }

    /// Books that an update was received.
    pub fn received(&self, drive: usize, number: u32) -> Receipt {
        let Some((word, bit)) = self.place(drive, number) else {
            return Receipt::Foreign;
        };
        let is_sent = self
            .sent
            .get(word)
            .is_some_and(|sent| sent.load(Ordering::Acquire) & bit != 0);
        if !is_sent {
            return Receipt::Foreign;
        }
        if !self.book(&self.received, drive, number) {
            return Receipt::Again;
        }
        let newest = self
            .newest
            .get(drive)
            .map(|newest| newest.fetch_max(number + 1, Ordering::Relaxed));
        if newest.is_some_and(|newest| newest > number) {
            Receipt::Late
        } else {
            Receipt::First
        }
    }

    /// All counts. While other threads still book, it is a snapshot of each drive.
    #[must_use]
    pub fn balance(&self) -> Balance {
        let books = self.sent.iter().zip(&self.acknowledged).zip(&self.received);
        books.fold(
            Balance::default(),
            |sum, ((sent, acknowledged), received)| {
                let [sent, acknowledged, received] =
                    [sent, acknowledged, received].map(|it| it.load(Ordering::Acquire));
                let count = |bits: u64| u64::from(bits.count_ones());
                Balance {
                    sent: sum.sent + count(sent),
                    acknowledged: sum.acknowledged + count(acknowledged),
                    received: sum.received + count(received),
                    acknowledged_missing: sum.acknowledged_missing
                        + count(acknowledged & !received),
                    unacknowledged_missing: sum.unacknowledged_missing
                        + count(sent & !acknowledged & !received),
                }
            },
        )
    }

    /// Sets the bit of an update. Returns whether it was not set before.
    fn book(&self, book: &[AtomicU64], drive: usize, number: u32) -> bool {
        let Some((word, bit)) = self.place(drive, number) else {
            return false;
        };
        book.get(word)
            .is_some_and(|word| word.fetch_or(bit, Ordering::AcqRel) & bit == 0)
    }

    fn place(&self, drive: usize, number: u32) -> Option<(usize, u64)> {
        if drive >= self.newest.len() || number >= self.updates_per_drive {
            return None;
        }
        let word = u64::from(number) / WORD_BITS;
        let bit = u64::from(number) % WORD_BITS;
        Some((drive * self.words_per_drive + word as usize, 1 << bit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_acknowledged_and_does_not_come_is_missing() {
        let ledger = Ledger::new(2, 100).unwrap();
        for number in 0..100 {
            ledger.sent(1, number);
            if number < 70 {
                ledger.acknowledged(1, number);
            }
            if number % 2 == 0 {
                assert_eq!(ledger.received(1, number), Receipt::First);
            }
        }
        let balance = ledger.balance();
        let expected = Balance {
            sent: 100,
            acknowledged: 70,
            received: 50,
            acknowledged_missing: 35,
            unacknowledged_missing: 15,
        };
        assert_eq!(balance, expected);
    }

    #[test]
    fn repeats_and_strangers_are_distinguished() {
        let ledger = Ledger::new(3, 65).unwrap();
        for number in [0, 63, 64] {
            ledger.sent(2, number);
        }
        assert_eq!(ledger.received(2, 64), Receipt::First);
        assert_eq!(
            ledger.received(2, 63),
            Receipt::Late,
            "a newer one of the drive was there"
        );
        assert_eq!(ledger.received(2, 64), Receipt::Again);
        for (drive, number) in [(2, 1), (1, 0), (2, 65), (3, 0), (usize::MAX, u32::MAX)] {
            assert_eq!(
                ledger.received(drive, number),
                Receipt::Foreign,
                "{drive}: {number}"
            );
        }
        assert_eq!(ledger.balance().received, 2);
    }

    #[test]
    fn the_books_are_bounded() {
        assert!(Ledger::new(1_000_000, u32::MAX).is_none());
        assert!(Ledger::new(usize::MAX, 64).is_none());
        assert!(Ledger::new(0, 0).is_some());
    }
}
