//! Moments of the wall clock as text: RFC 3339 in UTC with milliseconds, and back.

use super::time::WallTime;

/// A day in milliseconds.
pub const DAY_MS: i64 = 86_400_000;

/// `wall` as RFC 3339 in UTC with milliseconds. Years outside 0 to 9999 cannot be written: they are clamped to the
/// nearest moment that can.
#[must_use]
pub fn rfc3339(wall: WallTime) -> String {
    const FIRST_MS: i64 = -62_167_219_200_000;
    const LAST_MS: i64 = 253_402_300_799_999;
    let unix_ms = wall.unix_ms.clamp(FIRST_MS, LAST_MS);
    let days = unix_ms.div_euclid(DAY_MS);
    let of_day = unix_ms.rem_euclid(DAY_MS);
    let (year, month, day) = civil(days);
    let seconds = of_day / 1000;
    let milli = of_day % 1000;
    let hour = seconds / 3600;
    let minute = seconds / 60 % 60;
    let second = seconds % 60;
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.{milli:03}Z")
}

/// The day of `wall` in UTC, as `2026-01-31`.
#[must_use]
pub fn day(wall: WallTime) -> String {
    let mut text = rfc3339(wall);
    text.truncate("2026-01-31".len());
    text
}

/// Year, month and day of `wall` in UTC.
#[must_use]
pub fn date(wall: WallTime) -> (i32, u8, u8) {
    let (year, month, day) = civil(wall.unix_ms.div_euclid(DAY_MS));
    let year = i32::try_from(year).unwrap_or(if year < 0 { i32::MIN } else { i32::MAX });
    // Months and days of the calendar fit.
    (
        year,
        u8::try_from(month).unwrap_or(1),
        u8::try_from(day).unwrap_or(1),
    )
}

/// Parses a moment in UTC: `2026-01-31`, `2026-01-31T08:00`, `2026-01-31T08:00:00.250Z`. `None` if `text` is not one.
#[must_use]
pub fn parse(text: &str) -> Option<WallTime> {
    let text = text.strip_suffix('Z').unwrap_or(text);
    let (date, time) = text.split_once(['T', ' ']).unwrap_or((text, "00:00"));
    let [year, month, day] = numbers::<3>(date, '-', &[4, 2, 2])?;
    let (time, milli) = match time.split_once('.') {
        Some((time, fraction)) if fraction.len() == 3 => (time, digits(fraction)?),
        Some(_) => return None,
        None => (time, 0),
    };
    let [hour, minute, second] = numbers::<3>(time, ':', &[2, 2, 2])
        .or_else(|| numbers::<2>(time, ':', &[2, 2]).map(|[hour, minute]| [hour, minute, 0]))?;
    let days = days_to(year, month, day);
    let exists = civil(days) == (year, month, day) && hour < 24 && minute < 60 && second < 60;
    let of_day = ((hour * 60 + minute) * 60 + second) * 1000 + milli;
    exists.then_some(WallTime {
        unix_ms: days * DAY_MS + of_day,
    })
}

/// The `N` numbers of `text`, separated by `between`, with the given numbers of digits.
fn numbers<const N: usize>(text: &str, between: char, lengths: &[usize; N]) -> Option<[i64; N]> {
    let mut found = [0; N];
    let mut parts = text.split(between);
    for (place, length) in found.iter_mut().zip(lengths) {
        *place = digits(parts.next().filter(|part| part.len() == *length)?)?;
    }
    parts.next().is_none().then_some(found)
}

fn digits(text: &str) -> Option<i64> {
    text.bytes()
        .all(|byte| byte.is_ascii_digit())
        .then(|| text.parse().ok())?
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
    let month = if month_from_march < 10 {
        month_from_march + 3
    } else {
        month_from_march - 9
    };
    let year = year_of_era + era * 400 + if month <= 2 { 1 } else { 0 };
    (year, month, day)
}

/// The days from 1970-01-01 to a date that exists: the inverse of [`civil`].
const fn days_to(year: i64, month: i64, day: i64) -> i64 {
    let year = if month <= 2 { year - 1 } else { year };
    let era = year.div_euclid(400);
    let of_era = year.rem_euclid(400);
    let from_march = (month + 9) % 12;
    let of_year = (153 * from_march + 2) / 5 + day - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: [(i64, &str); 4] = [
        (0, "1970-01-01T00:00:00.000Z"),
        (951_782_400_123, "2000-02-29T00:00:00.123Z"),
        (1_735_689_599_999, "2024-12-31T23:59:59.999Z"),
        (-1, "1969-12-31T23:59:59.999Z"),
    ];

    #[test]
    fn moments_are_written_in_utc_with_milliseconds_and_read_back() {
        for (unix_ms, text) in TABLE {
            assert_eq!(rfc3339(WallTime { unix_ms }), text);
            assert_eq!(parse(text), Some(WallTime { unix_ms }), "{text}");
        }
        assert_eq!(
            rfc3339(WallTime { unix_ms: i64::MAX }),
            "9999-12-31T23:59:59.999Z"
        );
        assert_eq!(
            rfc3339(WallTime { unix_ms: i64::MIN }),
            "0000-01-01T00:00:00.000Z"
        );
    }

    #[test]
    fn a_moment_may_be_written_shorter() {
        for text in [
            "2000-02-29",
            "2000-02-29T00:00",
            "2000-02-29 00:00:00",
            "2000-02-29T00:00:00Z",
        ] {
            assert_eq!(
                parse(text),
                Some(WallTime {
                    unix_ms: 951_782_400_000
                }),
                "{text}"
            );
        }
    }

    #[test]
    fn what_is_no_moment_is_none() {
        for text in [
            "",
            "2000",
            "2000-2-29",
            "2001-02-29",
            "2000-13-01",
            "2000-00-01",
            "2000-01-00",
            "2000-01-32",
            "2000-01-01T24:00",
            "2000-01-01T00:60",
            "2000-01-01T00",
            "2000-01-01T00:00:00.1",
            "2000-01-01T00:00:00:00",
            "-100-01-01",
            "2000-01-01T+1:00",
            "2000-01-01Tüü:00",
        ] {
            assert_eq!(parse(text), None, "{text}");
        }
    }
}
