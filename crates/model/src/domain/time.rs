//! Moments: monotonic time for decisions, wall-clock time for labels only. Neither clock can be read here.

use std::fmt;
use std::ops::Add;
use std::time::Duration;

/// A moment on the monotonic clock that also runs while the machine is suspended
/// (`CLOCK_BOOTTIME`), in nanoseconds. It has no `now()`: the time is always passed in.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct MonoTime {
    nanos: u64,
}

impl MonoTime {
    /// The start of the clock.
    pub const ZERO: Self = Self { nanos: 0 };
    /// A moment that never comes.
    pub const NEVER: Self = Self { nanos: u64::MAX };

    /// The moment `nanos` nanoseconds after the start of the clock.
    #[must_use]
    pub const fn from_nanos(nanos: u64) -> Self {
        Self { nanos }
    }

    /// The moment `micros` microseconds after the start of the clock.
    #[must_use]
    pub const fn from_micros(micros: u64) -> Self {
        Self {
            nanos: micros.saturating_mul(1_000),
        }
    }

    /// The moment `millis` milliseconds after the start of the clock.
    #[must_use]
    pub const fn from_millis(millis: u64) -> Self {
        Self {
            nanos: millis.saturating_mul(1_000_000),
        }
    }

    /// Nanoseconds since the start of the clock.
    #[must_use]
    pub const fn as_nanos(self) -> u64 {
        self.nanos
    }

    /// Time that has passed since `earlier`; zero if `earlier` is later.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.nanos.saturating_sub(earlier.nanos))
    }

    /// This moment moved back by `span`, at most to the start of the clock.
    #[must_use]
    pub fn before(self, span: Duration) -> Self {
        Self {
            nanos: self.nanos.saturating_sub(nanos_of(span)),
        }
    }
}

impl Add<Duration> for MonoTime {
    type Output = Self;

    fn add(self, span: Duration) -> Self {
        Self {
            nanos: self.nanos.saturating_add(nanos_of(span)),
        }
    }
}

impl fmt::Debug for MonoTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}.{:06} ms",
            self.nanos / 1_000_000,
            self.nanos % 1_000_000
        )
    }
}

fn nanos_of(span: Duration) -> u64 {
    u64::try_from(span.as_nanos()).unwrap_or(u64::MAX)
}

/// A moment on the wall clock, in milliseconds since 1970-01-01 UTC. It labels records and decides nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct WallTime {
    /// Milliseconds since 1970-01-01 UTC.
    pub unix_ms: i64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_and_differences_never_wrap() {
        assert_eq!(MonoTime::NEVER + Duration::from_secs(1), MonoTime::NEVER);
        assert_eq!(
            MonoTime::ZERO.since(MonoTime::from_millis(5)),
            Duration::ZERO
        );
        assert_eq!(
            MonoTime::from_millis(3).before(Duration::from_secs(1)),
            MonoTime::ZERO
        );
        assert_eq!(
            (MonoTime::from_millis(7) + Duration::MAX).as_nanos(),
            u64::MAX
        );
    }

    #[test]
    fn is_shown_in_milliseconds() {
        assert_eq!(format!("{:?}", MonoTime::from_micros(1_500)), "1.500000 ms");
    }
}
