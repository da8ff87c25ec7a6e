//! Moments as written in payloads: the monotonic clock decides, the wall clock labels.

use crate::domain::calendar::rfc3339;
use crate::domain::time::{MonoTime, WallTime};

/// How far the wall clock may drift from its expected time before labels follow it. Small drift is ignored, so that the
/// label of one moment stays the same.
const DRIFT_MAX_MS: i64 = 1_000;

/// The present, on both clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockMoment {
    /// Decides.
    pub mono: MonoTime,
    /// Labels, and is compared with moments that clients name.
    pub wall: WallTime,
}

/// Turns monotonic moments into labels. It follows a wall clock that is set, as on machines that get the time of day
/// from the network some time after they start.
#[derive(Clone, Copy, Debug)]
pub struct LabelClock {
    anchor: ClockMoment,
}

impl LabelClock {
    /// A clock that was right when the gateway `started`.
    #[must_use]
    pub const fn new(started: ClockMoment) -> Self {
        Self { anchor: started }
    }

    /// Updates the clock with the present.
    pub fn see(&mut self, at: ClockMoment) {
        let expected = self.wall(at.mono).unix_ms;
        if expected.saturating_sub(at.wall.unix_ms).saturating_abs() > DRIFT_MAX_MS {
            self.anchor = at;
        }
    }

    /// The wall-clock moment of `mono`.
    #[must_use]
    pub fn wall(&self, mono: MonoTime) -> WallTime {
        let millis = |from: MonoTime, to: MonoTime| {
            i64::try_from(to.since(from).as_millis()).unwrap_or(i64::MAX)
        };
        let after = millis(self.anchor.mono, mono);
        let before = millis(mono, self.anchor.mono);
        WallTime {
            unix_ms: self
                .anchor
                .wall
                .unix_ms
                .saturating_add(after)
                .saturating_sub(before),
        }
    }

    /// `mono` as RFC 3339 in UTC with milliseconds.
    #[must_use]
    pub fn text(&self, mono: MonoTime) -> String {
        rfc3339(self.wall(mono))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_stay_until_the_wall_clock_is_set() {
        let moment = |mono, unix_ms| ClockMoment {
            mono: MonoTime::from_millis(mono),
            wall: WallTime { unix_ms },
        };
        let mut clock = LabelClock::new(moment(1_000, 50_000));
        clock.see(moment(2_000, 51_400));
        assert_eq!(
            clock.wall(MonoTime::from_millis(2_000)).unix_ms,
            51_000,
            "small drift is ignored"
        );
        assert_eq!(
            clock.wall(MonoTime::ZERO).unix_ms,
            49_000,
            "also before the start"
        );
        clock.see(moment(3_000, 1_000_000));
        assert_eq!(clock.wall(MonoTime::from_millis(2_000)).unix_ms, 999_000);
    }
}
