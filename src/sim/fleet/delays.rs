//! Times counted by many threads at once, in buckets that grow with them.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Buckets of each octave: a bucket is at most a thirty-second wider than the times in it.
const SUB_BITS: u32 = 5;
/// Times are told apart below 19 hours.
const TOP_BITS: u32 = 36;
const BUCKETS: usize = ((TOP_BITS - SUB_BITS + 1) << SUB_BITS) as usize;

/// Times with a resolution of a microsecond or a thirty-second of themselves.
#[derive(Debug)]
pub struct Delays {
    counts: Vec<AtomicU64>,
    longest_us: AtomicU64,
}

impl Default for Delays {
    fn default() -> Self {
        Self {
            counts: std::iter::repeat_with(AtomicU64::default).take(BUCKETS).collect(),
            longest_us: AtomicU64::new(0),
        }
    }
}

impl Delays {
    /// Counts `time`.
    pub fn add(&self, time: Duration) {
        let micros = u64::try_from(time.as_micros()).unwrap_or(u64::MAX).min((1 << TOP_BITS) - 1);
        if let Some(count) = self.counts.get(place(micros)) {
            count.fetch_add(1, Ordering::Relaxed);
        }
        self.longest_us.fetch_max(micros, Ordering::Relaxed);
    }

    /// The longest time; zero if there is none.
    #[must_use]
    pub fn longest(&self) -> Duration {
        Duration::from_micros(self.longest_us.load(Ordering::Relaxed))
    }

    /// A time that `per_mille` of all do not exceed, up to a thirty-second longer than it was; zero if there is none.
    #[must_use]
    pub fn within(&self, per_mille: u16) -> Duration {
        let counts: Vec<_> = self.counts.iter().map(|count| count.load(Ordering::Relaxed)).collect();
        let wanted = (counts.iter().sum::<u64>() * u64::from(per_mille)).div_ceil(1000);
        let mut seen = 0;
        for (place, count) in counts.iter().enumerate() {
            seen += count;
            if seen >= wanted && seen > 0 {
                return Duration::from_micros(upper_end(place)).min(self.longest());
            }
        }
        Duration::ZERO
    }
}

/// The bucket of a time.
const fn place(micros: u64) -> usize {
    let octave = u64::BITS - (micros >> SUB_BITS).leading_zeros();
    let sub = (micros >> octave.saturating_sub(1)) & ((1 << SUB_BITS) - 1);
    (((octave as u64) << SUB_BITS) | sub) as usize
}

/// The longest time in the bucket at `place`.
const fn upper_end(place: usize) -> u64 {
    let (octave, sub) = (place as u64 >> SUB_BITS, place as u64 & ((1 << SUB_BITS) - 1));
    match octave.checked_sub(1) {
        None => sub,
        Some(shift) => (((1 << SUB_BITS) + sub + 1) << shift) - 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_follow_each_other_without_hole_and_hold_their_ends() {
        assert_eq!(place((1 << TOP_BITS) - 1), BUCKETS - 1);
        for at in 0..BUCKETS {
            let end = upper_end(at);
            assert_eq!((place(end), place(end + 1)), (at, at + 1), "{at}");
        }
        for micros in (1..1 << TOP_BITS).step_by(99_999_989) {
            let end = upper_end(place(micros));
            assert!(micros <= end && end - micros <= micros / 32, "{micros}");
        }
    }

    #[test]
    fn shares_are_told() {
        let delays = Delays::default();
        assert_eq!((delays.within(500), delays.longest()), (Duration::ZERO, Duration::ZERO));
        (1..=1000).for_each(|millis| delays.add(Duration::from_millis(millis)));
        for (per_mille, millis) in [(0, 1), (500, 500), (990, 990), (1000, 1000)] {
            let found = delays.within(per_mille).as_secs_f64() * 1e3;
            assert!((f64::from(millis)..=f64::from(millis) * 1.032).contains(&found), "{per_mille}: {found}");
        }
        delays.add(Duration::MAX);
        assert!(delays.longest() > Duration::from_secs(60_000), "what is beyond all counts as the longest");
    }
}
