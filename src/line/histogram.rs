//! Times counted in buckets that grow with them: bounded, without allocation, and old ones fade.

use std::time::Duration;

/// Buckets of each octave: a bucket is at most a sixteenth wider than the times in it.
const SUB_BITS: u32 = 4;
/// Times are counted below two minutes: more than any reply may need and be late.
const TOP_BITS: u32 = 27;
const BUCKETS: usize = ((TOP_BITS - SUB_BITS + 1) << SUB_BITS) as usize;
/// With so many times all counts are halved, so that what a station did long ago fades.
pub const FADES_AT: u16 = 8192;

/// Times in microseconds, the newest few thousand of them.
#[derive(Clone, Debug)]
pub struct Histogram {
    counts: [u16; BUCKETS],
    total: u16,
    /// The longest since the last halving, and between the one before and that.
    longest: [u32; 2],
}

impl Default for Histogram {
    fn default() -> Self {
        Self { counts: [0; BUCKETS], total: 0, longest: [0; 2] }
    }
}

impl Histogram {
    /// Counts `time`.
    pub fn add(&mut self, time: Duration) {
        let micros = u32::try_from(time.as_micros()).unwrap_or(u32::MAX).min((1 << TOP_BITS) - 1);
        let [longest, _] = &mut self.longest;
        *longest = micros.max(*longest);
        if let Some(count) = self.counts.get_mut(place(micros)) {
            *count += 1;
            self.total += 1;
        }
        if self.total >= FADES_AT {
            self.fade();
        }
    }

    /// How many times are counted.
    #[must_use]
    pub const fn total(&self) -> u16 {
        self.total
    }

    /// The longest of the newest times: at least of the newest half of them.
    #[must_use]
    pub fn longest(&self) -> Duration {
        let [newer, older] = self.longest;
        micros(newer.max(older))
    }

    /// A time that all but `above` in a thousand do not exceed, up to a sixteenth longer than it was; zero if there is
    /// none.
    #[must_use]
    pub fn all_but(&self, above: u16) -> Duration {
        let spared = u32::from(self.total) * u32::from(above) / 1000;
        let mut seen = 0;
        for (place, count) in self.counts.iter().enumerate().rev() {
            seen += u32::from(*count);
            if seen > spared {
                let [newer, older] = self.longest;
                let longest = newer.max(older);
                return micros(if self::place(longest) == place { longest } else { upper_end(place) });
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

/// The bucket of a time.
const fn place(micros: u32) -> usize {
    let octave = u32::BITS - (micros >> SUB_BITS).leading_zeros();
    let sub = (micros >> octave.saturating_sub(1)) & ((1 << SUB_BITS) - 1);
    ((octave << SUB_BITS) | sub) as usize
}

/// The longest time in the bucket at `place`.
const fn upper_end(place: usize) -> u32 {
    let (octave, sub) = (place as u32 >> SUB_BITS, place as u32 & ((1 << SUB_BITS) - 1));
    match octave.checked_sub(1) {
        None => sub,
        Some(shift) => (((1 << SUB_BITS) + sub + 1) << shift) - 1,
    }
}

fn micros(micros: u32) -> Duration {
    Duration::from_micros(micros.into())
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
        for micros in (1..1 << TOP_BITS).step_by(9973) {
            let end = upper_end(place(micros));
            assert!(micros <= end && end - micros <= micros / 16, "{micros}");
        }
    }

    #[test]
    fn percentiles_count_from_the_longest() {
        let mut times = Histogram::default();
        assert_eq!((times.all_but(1), times.longest()), (Duration::ZERO, Duration::ZERO));
        (1..=1000).for_each(|millis| times.add(Duration::from_millis(millis)));
        for (above, millis) in [(500, 500), (100, 900), (10, 990), (1, 999), (0, 1000)] {
            let found = times.all_but(above).as_secs_f64() * 1e3;
            assert!((f64::from(millis)..=f64::from(millis) * 1.0626).contains(&found), "{above}: {found}");
        }
        assert_eq!(times.longest(), Duration::from_secs(1));
        times.add(Duration::MAX);
        assert!(times.longest() > Duration::from_secs(130), "what is beyond all counts as the longest");
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
        assert!(times.total() >= FADES_AT / 2 - BUCKETS as u16);
    }
}
