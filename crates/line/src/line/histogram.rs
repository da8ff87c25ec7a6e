//! A histogram of times in logarithmic buckets: bounded, without allocation, and old times fade.

use crate::domain::buckets::BucketDivision;
use std::time::Duration;

/// Buckets of microseconds, at most a sixteenth as wide as their times, up to two minutes: more than any late reply
/// takes.
const BUCKETS: BucketDivision = BucketDivision::new(4, 27);
/// At this total all counts are halved, so that what a station did long ago fades.
pub const FADES_AT: u16 = 8192;

/// Times in microseconds, the newest few thousand of them.
#[derive(Clone, Debug)]
pub struct Histogram {
    counts: [u16; BUCKETS.count()],
    total: u16,
    /// The longest since the last halving, and between the two last halvings.
    longest: [u64; 2],
}

impl Default for Histogram {
    fn default() -> Self {
        Self {
            counts: [0; BUCKETS.count()],
            total: 0,
            longest: [0; 2],
        }
    }
}

impl Histogram {
    /// Counts `time`.
    pub fn add(&mut self, time: Duration) {
        let micros = u64::try_from(time.as_micros())
            .unwrap_or(u64::MAX)
            .min(BUCKETS.number_max());
        let [longest, _] = &mut self.longest;
        *longest = micros.max(*longest);
        if let Some(count) = self.counts.get_mut(BUCKETS.place(micros)) {
            *count += 1;
            self.total += 1;
        }
        if self.total >= FADES_AT {
            self.fade();
        }
    }

    /// The number of counted times.
    #[must_use]
    pub const fn total(&self) -> u16 {
        self.total
    }

    /// The longest of the newest times, at least of the newest half.
    #[must_use]
    pub fn longest(&self) -> Duration {
        let [newer, older] = self.longest;
        Duration::from_micros(newer.max(older))
    }

    /// The time that only `above` in a thousand exceed, rounded up by at most a sixteenth; zero if there is none.
    #[must_use]
    pub fn all_but(&self, above: u16) -> Duration {
        let spared = u32::from(self.total) * u32::from(above) / 1000;
        let mut seen = 0;
        for (place, count) in self.counts.iter().enumerate().rev() {
            seen += u32::from(*count);
            if seen > spared {
                let [newer, older] = self.longest;
                let longest = newer.max(older);
                let is_in_it = BUCKETS.place(longest) == place;
                return Duration::from_micros(if is_in_it {
                    longest
                } else {
                    BUCKETS.upper_end(place)
                });
            }
        }
        Duration::ZERO
    }

    fn fade(&mut self) {
        self.counts.iter_mut().for_each(|count| *count /= 2);
        self.total = self.counts.iter().sum();
        self.longest = [0, self.longest[0]];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_count_from_the_longest() {
        let mut times = Histogram::default();
        assert_eq!(
            (times.all_but(1), times.longest()),
            (Duration::ZERO, Duration::ZERO)
        );
        (1..=1000).for_each(|millis| times.add(Duration::from_millis(millis)));
        for (above, millis) in [(500, 500), (100, 900), (10, 990), (1, 999), (0, 1000)] {
            let found = times.all_but(above).as_secs_f64() * 1e3;
            assert!(
                (f64::from(millis)..=f64::from(millis) * 1.0626).contains(&found),
                "{above}: {found}"
            );
        }
        assert_eq!(times.longest(), Duration::from_secs(1));
        times.add(Duration::MAX);
        assert!(
            times.longest() > Duration::from_secs(130),
            "what is beyond all counts as the longest"
        );
    }

    #[test]
    fn old_times_fade() {
        let mut times = Histogram::default();
        for _ in 0..4000 {
            times.add(Duration::from_millis(50));
        }
        let mut added = 0;
        while times.all_but(1) > Duration::from_millis(3) {
            times.add(Duration::from_millis(2));
            added += 1;
        }
        assert!((20_000..80_000).contains(&added), "{added}");
        assert_eq!(times.longest(), Duration::from_millis(2));
        assert!(times.total() >= FADES_AT / 2 - BUCKETS.count() as u16);
    }
}
