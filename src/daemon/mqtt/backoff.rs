//! How long to wait before the next connection.

use std::time::Duration;

const FIRST: Duration = Duration::from_millis(200);
const LONGEST: Duration = Duration::from_secs(3);
/// A connection that lived this long was a good one: the next wait is the first again.
const GOOD_LIFE: Duration = Duration::from_secs(5);

/// Waits that double from 0.2 s to 10 s, each with a jitter of a quarter, so that gateways do not come back in step.
#[derive(Debug)]
pub struct BackOff {
    next: Duration,
    random: fastrand::Rng,
}

impl BackOff {
    /// Begins with the shortest wait.
    pub fn new(seed: u64) -> Self {
        Self { next: FIRST, random: fastrand::Rng::with_seed(seed) }
    }

    /// The wait after a connection that lived for `life`.
    pub fn wait_after(&mut self, life: Duration) -> Duration {
        if life >= GOOD_LIFE {
            self.next = FIRST;
        }
        let wait = self.next;
        self.next = (wait * 2).min(LONGEST);
        wait.mul_f64(0.75 + self.random.f64() / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_about(wait: Duration, millis: u64) -> bool {
        let middle = Duration::from_millis(millis);
        wait >= middle * 3 / 4 && wait <= middle * 5 / 4
    }

    #[test]
    fn waits_double_up_to_a_limit_and_start_anew_after_a_good_life() {
        let mut back_off = BackOff::new(1);
        for millis in [200, 400, 800, 1600, 3000, 3000] {
            let wait = back_off.wait_after(Duration::from_secs(4));
            assert!(is_about(wait, millis), "{wait:?} for {millis} ms");
        }
        assert!(is_about(back_off.wait_after(Duration::from_secs(5)), 200));
    }
}
