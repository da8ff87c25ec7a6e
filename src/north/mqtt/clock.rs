//! Moments as they stand in payloads: the monotonic clock decides, the wall clock labels.

use super::types::Moment;
use crate::domain::time::{MonoTime, WallTime};

/// How far the wall clock may drift from where it is expected before labels follow it. Small drift is ignored, so
/// that the label of one moment stays the same text.
const DRIFT_MAX_MS: i64 = 1_000;

/// Turns monotonic moments into labels. It follows a wall clock that is set, as it is on machines that get the
/// time of day from the network some while after they start.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    anchor: Moment,
}

impl Clock {
    pub(super) const fn new(started: Moment) -> Self {
        Self { anchor: started }
    }

    /// Takes notice of the present.
    pub(super) fn see(&mut self, at: Moment) {
        let expected = self.wall(at.mono).unix_ms;
        if expected.saturating_sub(at.wall.unix_ms).saturating_abs() > DRIFT_MAX_MS {
            self.anchor = at;
        }
    }

    /// The wall-clock moment of `mono`.
    pub(super) fn wall(&self, mono: MonoTime) -> WallTime {
        let millis = |from: MonoTime, to: MonoTime| i64::try_from(to.since(from).as_millis()).unwrap_or(i64::MAX);
        let (after, before) = (millis(self.anchor.mono, mono), millis(mono, self.anchor.mono));
        WallTime { unix_ms: self.anchor.wall.unix_ms.saturating_add(after).saturating_sub(before) }
    }

    /// `mono` as RFC 3339 in UTC with milliseconds.
    pub(super) fn text(&self, mono: MonoTime) -> String {
        rfc3339(self.wall(mono))
    }
}

/// `wall` as RFC 3339 in UTC with milliseconds. Years outside 0 to 9999 cannot be written and become the nearest
/// moment that can.
fn rfc3339(wall: WallTime) -> String {
    const FIRST_MS: i64 = -62_167_219_200_000;
    const LAST_MS: i64 = 253_402_300_799_999;
    let unix_ms = wall.unix_ms.clamp(FIRST_MS, LAST_MS);
    let (days, of_day) = (unix_ms.div_euclid(86_400_000), unix_ms.rem_euclid(86_400_000));
    let (year, month, day) = civil(days);
    let (seconds, milli) = (of_day / 1000, of_day % 1000);
    let (hour, minute, second) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.{milli:03}Z")
}

/// Year, month and day of the Gregorian calendar, `days` after 1970-01-01. Years are counted from March, so that the
/// leap day is the last day of a year.
const fn civil(days: i64) -> (i64, i64, i64) {
    let from_march_0000 = days + 719_468;
    let era = from_march_0000.div_euclid(146_097);
    let of_era = from_march_0000.rem_euclid(146_097);
    let year_of_era = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = year_of_era + era * 400 + if month <= 2 { 1 } else { 0 };
    (year, month, day)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_written_in_utc_with_milliseconds() {
        let table = [
            (0, "1970-01-01T00:00:00.000Z"),
            (951_782_400_123, "2000-02-29T00:00:00.123Z"),
            (1_735_689_599_999, "2024-12-31T23:59:59.999Z"),
            (-1, "1969-12-31T23:59:59.999Z"),
            (i64::MAX, "9999-12-31T23:59:59.999Z"),
            (i64::MIN, "0000-01-01T00:00:00.000Z"),
        ];
        for (unix_ms, text) in table {
            assert_eq!(rfc3339(WallTime { unix_ms }), text);
        }
    }

    #[test]
    fn labels_stay_until_the_wall_clock_is_set() {
        let moment = |mono, unix_ms| Moment { mono: MonoTime::from_millis(mono), wall: WallTime { unix_ms } };
        let mut clock = Clock::new(moment(1_000, 50_000));
        clock.see(moment(2_000, 51_400));
        assert_eq!(clock.wall(MonoTime::from_millis(2_000)).unix_ms, 51_000, "small drift is ignored");
        assert_eq!(clock.wall(MonoTime::ZERO).unix_ms, 49_000, "also before the start");
        clock.see(moment(3_000, 1_000_000));
        assert_eq!(clock.wall(MonoTime::from_millis(2_000)).unix_ms, 999_000);
    }
}
