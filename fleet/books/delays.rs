//! A histogram of times that many threads add to, with buckets that grow with the time.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use vfd_gateway::domain::buckets::BucketDivision;

/// Buckets in microseconds, at most one thirty-second wide relative to their times, up to 19 hours.
const BUCKETS: BucketDivision = BucketDivision::new(5, 36);

/// Times with a resolution of a microsecond or one thirty-second of the time.
#[derive(Debug)]
pub struct Delays {
    counts: Vec<AtomicU64>,
    longest_us: AtomicU64,
}

impl Default for Delays {
    fn default() -> Self {
        Self {
            counts: std::iter::repeat_with(AtomicU64::default)
                .take(BUCKETS.count())
                .collect(),
            longest_us: AtomicU64::new(0),
        }
    }
}

impl Delays {
    /// Counts `time`.
    pub fn add(&self, time: Duration) {
        let micros = u64::try_from(time.as_micros())
            .unwrap_or(u64::MAX)
            .min(BUCKETS.number_max());
        if let Some(count) = self.counts.get(BUCKETS.place(micros)) {
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
        let counts: Vec<_> = self
            .counts
            .iter()
            .map(|count| count.load(Ordering::Relaxed))
            .collect();
        let wanted = (counts.iter().sum::<u64>() * u64::from(per_mille)).div_ceil(1000);
        let mut seen = 0;
        for (place, count) in counts.iter().enumerate() {
            seen += count;
            if seen >= wanted && seen > 0 {
                return Duration::from_micros(BUCKETS.upper_end(place)).min(self.longest());
            }
        }
        Duration::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_reported() {
        let delays = Delays::default();
        assert_eq!(
            (delays.within(500), delays.longest()),
            (Duration::ZERO, Duration::ZERO)
        );
        (1..=1000).for_each(|millis| delays.add(Duration::from_millis(millis)));
        for (per_mille, millis) in [(0, 1), (500, 500), (990, 990), (1000, 1000)] {
            let found = delays.within(per_mille).as_secs_f64() * 1e3;
            assert!(
                (f64::from(millis)..=f64::from(millis) * 1.032).contains(&found),
                "{per_mille}: {found}"
            );
        }
        delays.add(Duration::MAX);
        assert!(
            delays.longest() > Duration::from_secs(60_000),
            "what is beyond all counts as the longest"
        );
    }
}
