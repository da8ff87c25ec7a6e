//! The silence that a station owes after a frame that nothing explains: another one may follow.

use crate::domain::time::MonoTime;
use std::time::Duration;

/// The shortest silence required of a station after an unexplained frame.
pub const QUIET_LEAST: Duration = Duration::from_millis(100);
/// The longest such silence: later replies are not considered.
pub const QUIET_MAX: Duration = Duration::from_secs(30);
/// Consecutive exchanges without such a frame after which no silence is required any more.
pub const QUIET_EXCHANGES: u8 = 8;

/// The silence that is required of one station.
#[derive(Debug)]
pub struct StationSilence {
    /// The greatest lateness of a reply beyond the declared one, since its request.
    latest: Duration,
    /// The silence currently required after each frame of the station.
    required: Duration,
    until: MonoTime,
    /// Exchanges since the last unexplained frame.
    exchanges: u8,
}

impl StationSilence {
    /// No silence is required.
    pub const NONE: Self = Self {
        latest: Duration::ZERO,
        required: Duration::ZERO,
        until: MonoTime::ZERO,
        exchanges: 0,
    };

    /// Until when the station has to be silent. A moment in the past means that it has been.
    #[must_use]
    pub const fn until(&self) -> MonoTime {
        self.until
    }

    /// Whether replies of the station may belong to other requests, or to another drive.
    #[must_use]
    pub fn is_required(&self) -> bool {
        self.required > Duration::ZERO
    }

    /// How late a reply may arrive: `declared`, or more if that was observed.
    #[must_use]
    pub fn lateness(&self, declared: Duration) -> Duration {
        declared.max(with_margin(self.latest))
    }

    /// The line was opened: what was observed before is no longer relevant.
    pub const fn forget(&mut self) {
        self.latest = Duration::ZERO;
        self.required = Duration::ZERO;
    }

    /// A reply arrived `late` after its request, beyond the declared lateness.
    pub fn observed(&mut self, late: Duration) {
        self.latest = self.latest.max(late).min(QUIET_MAX);
    }

    /// A frame arrived at `now` that nothing explains, `late` after the newest request.
    pub fn unexplained(&mut self, late: Duration, now: MonoTime) {
        self.required = self.required.max(with_margin(late)).max(QUIET_LEAST);
        self.exchanges = 0;
        self.heard(now);
    }

    /// A frame of the station was received at `now`: a required silence starts over.
    pub fn heard(&mut self, now: MonoTime) {
        if self.is_required() {
            self.until = self.until.max(now + self.required);
        }
    }

    /// One short silence from `now` on shows whether another frame follows.
    pub fn look(&mut self, now: MonoTime) {
        self.until = self.until.max(now + QUIET_LEAST);
    }

    /// An exchange was over at `now` without an unexplained frame.
    pub fn exchange_ended(&mut self, now: MonoTime) {
        self.exchanges = self.exchanges.saturating_add(1);
        if self.exchanges >= QUIET_EXCHANGES {
            self.required = Duration::ZERO;
        }
        self.heard(now);
    }
}

/// An observed `time` with a margin: the next one may take longer.
fn with_margin(time: Duration) -> Duration {
    (time + time / 2).min(QUIET_MAX)
}
