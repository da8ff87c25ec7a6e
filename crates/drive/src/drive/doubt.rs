//! What readings must show before they are believed: a counter that falls, and a block that reads as one word everywhere.

use super::snapshot::DriveSnapshot;
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::profile::model::{Model, PollClass, RegisterRole};
use std::time::Duration;

/// A counter that has fallen is believed after it has stayed there for so long.
const FALL_HOLDS: Duration = Duration::from_secs(10);
/// A counter that is back at its former value within this time was never lower.
const FALL_IS_RECENT: Duration = Duration::from_secs(60);
/// What is doubted is read again after this time.
pub const READ_AGAIN_AFTER: Duration = Duration::from_secs(1);
/// What was not read again within this time is doubted as for the first time.
const DOUBT_LASTS: Duration = Duration::from_secs(60);
/// Most blocks that are doubted at once: more than a plan has of those that matter.
const BLOCKS_MAX: usize = 64;

/// Watches a counter that only rises, unless it is cleared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CounterFallWatch {
    fall: Option<CounterFall>,
}

/// A counter that reads lower than before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct CounterFall {
    from: u64,
    /// The lowest value since.
    to: u64,
    /// When the lowest value was first read.
    at: MonoTime,
    is_believed: bool,
}

impl CounterFallWatch {
    /// What `value`, read at `at`, is to be compared with, where `known` was believed last; `None`: nothing follows from it
    /// yet, because it is lower.
    pub fn base(&mut self, value: u64, known: u64, at: MonoTime) -> Option<u64> {
        if self
            .fall
            .is_some_and(|fall| fall.is_believed && at.since(fall.at) >= FALL_IS_RECENT)
        {
            self.fall = None;
        }
        let Some(fall) = self.fall else {
            if value >= known {
                return Some(known);
            }
            self.begins(known, value, at);
            return None;
        };
        if value >= fall.from {
            // It was never lower.
            self.fall = None;
            return Some(fall.from);
        }
        if fall.is_believed && value >= known {
            return Some(known);
        }
        if fall.is_believed || value < fall.to {
            self.begins(known, value, at);
            return None;
        }
        let is_believed = at.since(fall.at) >= FALL_HOLDS;
        self.fall = Some(CounterFall {
            is_believed,
            ..fall
        });
        is_believed.then_some(fall.to)
    }

    const fn begins(&mut self, from: u64, to: u64, at: MonoTime) {
        self.fall = Some(CounterFall {
            from,
            to,
            at,
            is_believed: false,
        });
    }

    /// Whether the counter has fallen lately.
    #[must_use]
    pub const fn has_fallen(&self) -> bool {
        self.fall.is_some()
    }

    /// Whether the counter is lower than before, and that is not believed yet.
    #[must_use]
    pub fn is_doubted(&self) -> bool {
        self.fall.is_some_and(|fall| !fall.is_believed)
    }
}

/// Watches for blocks that read as zeros or as ones where there were values.
#[derive(Clone, Debug, Default)]
pub struct BlankWatch {
    doubted: Vec<DoubtedBlock>,
}

/// A block that is doubted.
#[derive(Clone, Copy, Debug)]
struct DoubtedBlock {
    first: Address,
    count: usize,
    /// What each of its registers read.
    word: u16,
    /// When the registers first read so.
    since: MonoTime,
}

impl DoubtedBlock {
    /// Whether all registers of a read of `count` words from `address` on lie in it.
    fn holds(&self, address: Address, count: usize) -> bool {
        let offset = address.offset_from(self.first).map(usize::from);
        offset.is_some_and(|offset| offset + count <= self.count)
    }

    /// Whether the read of `words` from `address` on shows another word in it.
    fn is_disproved(&self, address: Address, words: &[u16]) -> bool {
        let here = self.first.onwards().take(self.count);
        here.filter_map(|it| it.word_in(address, words))
            .any(|word| word != self.word)
    }
}

impl BlankWatch {
    /// Whether nothing follows yet from the words that a read from `address` on brought at `at`: they are all zeros, or all
    /// ones, although `snapshot` has other values of the same registers. Read again later, they are believed.
    pub fn doubts(
        &mut self,
        model: &Model,
        snapshot: &DriveSnapshot,
        (address, words): (Address, &[u16]),
        at: MonoTime,
    ) -> bool {
        let blank = words
            .first()
            .copied()
            .filter(|word| is_blank(*word) && words.len() > 1);
        let blank = blank.filter(|blank| words.iter().all(|word| word == blank));
        let had_values = |blank: u16| {
            address.onwards().take(words.len()).any(|it| {
                let is_other = snapshot
                    .reading(it)
                    .is_some_and(|reading| reading.raw != blank);
                is_other && (blank != 0 || is_never_zero(model, it))
            })
        };
        let is_over = |it: &DoubtedBlock| {
            at.since(it.since) >= DOUBT_LASTS || it.is_disproved(address, words)
        };
        self.doubted.retain(|it| !is_over(it));
        let Some(blank) = blank.filter(|blank| had_values(*blank)) else {
            self.doubted.retain(|it| it.first != address);
            return false;
        };
        match self
            .doubted
            .iter()
            .find(|it| it.word == blank && it.holds(address, words.len()))
        {
            Some(known) => at.since(known.since) < READ_AGAIN_AFTER,
            None if self.doubted.len() >= BLOCKS_MAX => false,
            None => {
                self.doubted.push(DoubtedBlock {
                    first: address,
                    count: words.len(),
                    word: blank,
                    since: at,
                });
                true
            }
        }
    }
}

const fn is_blank(word: u16) -> bool {
    matches!(word, 0 | u16::MAX)
}

/// Whether a register that held a value does not come to 0 by itself, as one that measures the motor does.
fn is_never_zero(model: &Model, address: Address) -> bool {
    let lasts = |role: Option<RegisterRole>, poll: Option<PollClass>| match role {
        Some(role) => matches!(
            role,
            RegisterRole::DcLinkVoltage
                | RegisterRole::RunHours
                | RegisterRole::Energy
                | RegisterRole::TripCount
        ),
        None => matches!(poll, Some(PollClass::Minutely | PollClass::Hourly)),
    };
    model
        .registers
        .iter()
        .any(|it| it.address == address && lasts(it.role, it.poll))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vendors::testing::model;

    fn at(seconds: u64) -> MonoTime {
        MonoTime::from_millis(seconds * 1000)
    }

    #[test]
    fn a_fall_is_believed_when_it_has_held() {
        let mut watch = CounterFallWatch::default();
        assert_eq!(watch.base(5, 5, at(0)), Some(5));
        for second in 1..11 {
            assert_eq!(watch.base(0, 5, at(second)), None, "{second}");
        }
        assert_eq!(
            watch.base(1, 5, at(11)),
            Some(0),
            "what it has counted since then counts"
        );
        assert_eq!(watch.base(1, 1, at(12)), Some(1));
    }

    #[test]
    fn what_is_back_within_a_minute_was_never_lower() {
        for back_after in [2, 9, 15, 59] {
            let mut watch = CounterFallWatch::default();
            let mut known = 5;
            for second in 1..=back_after {
                known = watch.base(0, known, at(second)).unwrap_or(known);
            }
            assert_eq!(
                watch.base(5, known, at(1 + back_after)),
                Some(5),
                "{back_after}"
            );
            assert!(!watch.has_fallen());
        }
        let mut watch = CounterFallWatch::default();
        let mut known = 5;
        for second in 1..=70 {
            known = watch.base(0, known, at(second)).unwrap_or(known);
        }
        assert_eq!(
            (known, watch.base(5, known, at(71))),
            (0, Some(0)),
            "later it has counted"
        );
    }

    #[test]
    fn a_fall_that_goes_on_begins_again() {
        let mut watch = CounterFallWatch::default();
        assert_eq!(watch.base(4, 9, at(0)), None);
        assert_eq!(watch.base(2, 9, at(9)), None);
        assert_eq!(watch.base(2, 9, at(12)), None, "held for 3 s");
        assert_eq!(watch.base(2, 9, at(19)), Some(2));
    }

    #[test]
    fn a_block_of_zeros_or_ones_where_there_were_values_is_read_again() {
        let model = model();
        let count = model.register_for(RegisterRole::TripCount).unwrap().address;
        let output = model
            .register_for(RegisterRole::OutputFrequency)
            .unwrap()
            .address;
        let mut snapshot = DriveSnapshot::default();
        snapshot.take(count, &[5, 0], at(0));
        snapshot.take(output, &[3000, 0], at(0));
        let mut watch = BlankWatch::default();
        let mut doubts = |address: Address, words: &[u16], ms: u64| {
            watch.doubts(
                &model,
                &snapshot,
                (address, words),
                MonoTime::from_millis(ms),
            )
        };
        for blank in [0, u16::MAX] {
            assert!(doubts(count, &[blank; 2], 1000));
            assert!(doubts(count, &[blank; 2], 1900));
            assert!(!doubts(count, &[blank; 2], 2000), "a second later it is so");
            assert!(!doubts(count, &[5, 0], 2100));
            assert!(doubts(count, &[blank; 2], 2200), "it begins again");
            assert!(!doubts(count, &[blank], 2300), "one word is no block");
            assert!(!doubts(count, &[5, 0], 2400));
        }
        assert!(!doubts(output, &[0, 0], 3000), "a motor at standstill");
        // Polls are joined with their neighbours: the good one begins elsewhere.
        assert!(doubts(count, &[0; 2], 4000));
        let before = Address::holding(count.number() - 1);
        assert!(!doubts(before, &[7, 5, 0], 4100));
        assert!(
            doubts(count, &[0; 2], 6000),
            "the next time it begins again"
        );
        // Nothing was read since.
        assert!(
            doubts(count, &[0; 2], 3_606_000),
            "what was doubted an hour ago"
        );
        assert!(doubts(output, &[u16::MAX; 2], 3000));
    }
}
