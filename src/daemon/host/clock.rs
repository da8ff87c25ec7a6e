//! The clocks. No other file reads one.

use crate::domain::time::{MonoTime, WallTime};
use crate::north::clock::ClockMoment;
use rustix::time::{ClockId, clock_gettime};
use std::time::SystemTime;

/// Now, on the monotonic clock that also counts while the machine is suspended, so that a suspend expires
/// deadlines instead of stretching them.
#[must_use]
pub fn now() -> MonoTime {
    let time = clock_gettime(ClockId::Boottime);
    let seconds = u64::try_from(time.tv_sec).unwrap_or(0);
    let nanos = u64::try_from(time.tv_nsec).unwrap_or(0);
    MonoTime::from_nanos(seconds.saturating_mul(1_000_000_000).saturating_add(nanos))
}

/// Now, on the wall clock. It is used for labels, never for decisions.
#[must_use]
pub fn wall() -> WallTime {
    let since_1970 = SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .unwrap_or_default();
    WallTime {
        unix_ms: i64::try_from(since_1970.as_millis()).unwrap_or(i64::MAX),
    }
}

/// The time on the wall clock, in microseconds since 1970-01-01 UTC.
#[must_use]
pub fn wall_micros() -> i64 {
    let since_1970 = SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .unwrap_or_default();
    i64::try_from(since_1970.as_micros()).unwrap_or(i64::MAX)
}

/// Now, on both clocks.
#[must_use]
pub fn moment() -> ClockMoment {
    ClockMoment {
        mono: now(),
        wall: wall(),
    }
}
