//! How long to wait before the next connection.

use std::time::Duration;

const FIRST: Duration = Duration::from_millis(200);
/// The longest wait while there is no broker: an attempt costs a packet or two, and its return should be noticed at
/// once.
const AWAY_MAX: Duration = Duration::from_secs(1);
const BROKEN_MAX: Duration = Duration::from_secs(3);
/// The first wait because of another client with the same identifier, which may have connected only once.
const CONTESTED_FIRST: Duration = Duration::from_secs(1);
const CONTESTED_MAX: Duration = Duration::from_secs(30);
/// The longest wait if there may be another client, or a broker that restarts repeatedly.
const SUSPECTED_MAX: Duration = Duration::from_secs(2);
/// A connection that lived this long was a good one: the next wait is the first again.
const GOOD_LIFE: Duration = Duration::from_secs(5);
/// How long a connection must live to count as good if another client uses the identifier: longer than the intervals at
/// which the two take turns.
pub const SETTLED_LIFE: Duration = Duration::from_secs(60);

/// How a connection ended, as far as the next wait depends on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConnectionEnding {
    /// There was no broker.
    Away,
    /// The broker closed it, this long after it had accepted it. It is probably restarting.
    Closed(Duration),
    /// The connection broke otherwise, this long after the broker had accepted it; zero if it had not.
    Broken(Duration),
    /// The connection ended after this time because another client has the same identifier.
    Contested(Duration),
    /// The connection ended after this time as if another client had the same identifier.
    Suspected(Duration),
}

/// Waits that double, separately for each kind, with a jitter of a quarter, so that gateways do not reconnect in step.
#[derive(Debug)]
pub struct BackOff {
    away: Duration,
    broken: Duration,
    contested: Duration,
    random: fastrand::Rng,
}

impl BackOff {
    /// Begins with the shortest waits.
    pub fn new(seed: u64) -> Self {
        Self {
            away: FIRST,
            broken: FIRST,
            contested: CONTESTED_FIRST,
            random: fastrand::Rng::with_seed(seed),
        }
    }

    /// The wait after a connection that ended so.
    pub fn wait_after(&mut self, ended: ConnectionEnding) -> Duration {
        let (ConnectionEnding::Closed(life)
        | ConnectionEnding::Broken(life)
        | ConnectionEnding::Contested(life)
        | ConnectionEnding::Suspected(life)) = ended
        else {
            // The absence of the broker explains the earlier ends.
            self.broken = FIRST;
            return self.doubling(|it| &mut it.away, AWAY_MAX);
        };
        self.away = FIRST;
        if life >= GOOD_LIFE {
            self.broken = FIRST;
        }
        if life >= SETTLED_LIFE {
            self.contested = CONTESTED_FIRST;
        }
        match ended {
            ConnectionEnding::Contested(_) => self.doubling(|it| &mut it.contested, CONTESTED_MAX),
            ConnectionEnding::Suspected(_) => self.with_jitter(SUSPECTED_MAX),
            ConnectionEnding::Closed(_) => self.with_jitter(FIRST),
            _ => self.doubling(|it| &mut it.broken, BROKEN_MAX),
        }
    }

    fn doubling(&mut self, of: fn(&mut Self) -> &mut Duration, longest: Duration) -> Duration {
        let next = of(self);
        let wait = *next;
        *next = (wait * 2).min(longest);
        self.with_jitter(wait)
    }

    fn with_jitter(&mut self, wait: Duration) -> Duration {
        wait.mul_f64(0.75 + self.random.f64() / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn assert_waits(back_off: &mut BackOff, ended: ConnectionEnding, all_millis: &[u64]) {
        for millis in all_millis {
            let wait = back_off.wait_after(ended);
            let middle = Duration::from_millis(*millis);
            assert!(
                wait >= middle * 3 / 4 && wait <= middle * 5 / 4,
                "{ended:?}: {wait:?} for {millis} ms"
            );
        }
    }

    #[test]
    fn waits_double_up_to_a_limit_and_start_again_after_a_good_life() {
        let mut back_off = BackOff::new(1);
        assert_waits(
            &mut back_off,
            ConnectionEnding::Broken(SECOND * 4),
            &[200, 400, 800, 1600, 3000, 3000],
        );
        assert_waits(&mut back_off, ConnectionEnding::Broken(SECOND * 5), &[200]);
    }

    #[test]
    fn a_broker_that_is_away_is_asked_for_every_second_and_explains_what_broke_before() {
        let mut back_off = BackOff::new(2);
        assert_waits(
            &mut back_off,
            ConnectionEnding::Broken(SECOND),
            &[200, 400, 800],
        );
        assert_waits(
            &mut back_off,
            ConnectionEnding::Away,
            &[200, 400, 800, 1000, 1000],
        );
        assert_waits(&mut back_off, ConnectionEnding::Broken(SECOND), &[200]);
        assert_waits(&mut back_off, ConnectionEnding::Away, &[200]);
    }

    #[test]
    fn a_broker_that_closes_connections_is_asked_for_at_once_whenever_it_does() {
        let mut back_off = BackOff::new(4);
        assert_waits(&mut back_off, ConnectionEnding::Broken(SECOND), &[200, 400]);
        assert_waits(
            &mut back_off,
            ConnectionEnding::Closed(SECOND),
            &[200, 200, 200],
        );
        assert_waits(&mut back_off, ConnectionEnding::Broken(SECOND), &[800]);
    }

    #[test]
    fn a_broker_that_may_only_start_again_is_asked_for_soon() {
        let mut back_off = BackOff::new(5);
        assert_waits(
            &mut back_off,
            ConnectionEnding::Suspected(SECOND),
            &[2000, 2000, 2000],
        );
        assert_waits(&mut back_off, ConnectionEnding::Contested(SECOND), &[1000]);
    }

    #[test]
    fn who_fights_for_the_identifier_waits_longer_until_a_connection_lived_for_a_minute() {
        let mut back_off = BackOff::new(3);
        assert_waits(
            &mut back_off,
            ConnectionEnding::Contested(SECOND),
            &[1000, 2000, 4000, 8000],
        );
        assert_waits(&mut back_off, ConnectionEnding::Away, &[200]);
        assert_waits(
            &mut back_off,
            ConnectionEnding::Contested(SECOND * 59),
            &[16_000, 30_000, 30_000],
        );
        assert_waits(
            &mut back_off,
            ConnectionEnding::Contested(SECOND * 60),
            &[1000],
        );
    }
}
