//! What the line remembers of one station: replies that may still come late, and how long it has been silent.

use crate::domain::time::MonoTime;
use crate::wire::pdu::Request;
use std::time::Duration;

/// Missing replies that are remembered for one station. When so many are out, nothing more is asked of it
/// until the oldest can no longer come.
pub const MISSING_MAX: usize = 8;
/// Silences in a row after which a station counts as known to be silent.
pub const KNOWN_SILENT_AFTER: u32 = 2;
/// The wait before a station that is known to be silent is asked again; doubled with each silence.
pub const BACK_OFF_FIRST: Duration = Duration::from_secs(1);
/// The longest such wait.
pub const BACK_OFF_MAX: Duration = Duration::from_secs(30);
/// How long a station that is known to be silent is waited for: it shall cost the others little. A drive
/// that needs longer is noticed by its late reply and then given its full time-out again.
pub const PROBE_TIMEOUT: Duration = Duration::from_millis(100);

/// A request whose reply did not come in time.
#[derive(Debug)]
struct Missing {
    request: Request,
    /// After this moment the reply can no longer come.
    until: MonoTime,
}

/// What the line remembers of one station.
#[derive(Debug, Default)]
pub struct StationState {
    missing: Vec<Missing>,
    silent_in_a_row: u32,
    ask_again_at: MonoTime,
}

impl StationState {
    /// Whether a late reply may still come at `now`.
    #[must_use]
    pub fn is_dirty(&self, now: MonoTime) -> bool {
        self.missing.iter().any(|missing| now < missing.until)
    }

    /// When a late answer can no longer be mistaken for the answer to `request`. A moment that has passed
    /// means now.
    #[must_use]
    pub fn unmistakable_at(&self, request: &Request) -> MonoTime {
        if self.missing.len() >= MISSING_MAX {
            return self.missing.iter().map(|missing| missing.until).min().unwrap_or(MonoTime::ZERO);
        }
        let mistakable = self.missing.iter().filter(|missing| is_mistakable(&missing.request, request));
        mistakable.map(|missing| missing.until).max().unwrap_or(MonoTime::ZERO)
    }

    /// Whether an exception, or a write's reply with another value, could be a late one of `function`.
    #[must_use]
    pub fn misses_function(&self, function: u8, now: MonoTime) -> bool {
        self.missing.iter().any(|missing| now < missing.until && missing.request.function() == function)
    }

    /// Before this moment the station is not asked, because it has been silent.
    #[must_use]
    pub const fn ask_again_at(&self) -> MonoTime {
        self.ask_again_at
    }

    /// Whether it has been silent so often that it is only probed.
    #[must_use]
    pub const fn is_known_silent(&self) -> bool {
        self.silent_in_a_row >= KNOWN_SILENT_AFTER
    }

    /// A request stays without an answer at `now`; it may still come within `max_lateness`.
    pub fn reply_missing(&mut self, request: Request, now: MonoTime, max_lateness: Duration) {
        self.missing.retain(|missing| now < missing.until);
        self.missing.push(Missing { request, until: now + max_lateness });
    }

    /// The station was silent; it is asked less and less often.
    pub fn silent(&mut self, now: MonoTime) {
        self.silent_in_a_row = self.silent_in_a_row.saturating_add(1);
        if self.is_known_silent() {
            let doublings = (self.silent_in_a_row - KNOWN_SILENT_AFTER).min(16);
            self.ask_again_at = now + (BACK_OFF_FIRST * (1 << doublings)).min(BACK_OFF_MAX);
        }
    }

    /// A right answer came to a request that no missing reply could be mistaken for. Drives answer in the
    /// order they are asked, so nothing of what is missing can follow.
    pub fn answered(&mut self) {
        self.missing.clear();
        self.is_there();
    }

    /// A frame of the station was heard that was not the answer: it is there, but slow.
    pub fn is_there(&mut self) {
        self.silent_in_a_row = 0;
        self.ask_again_at = MonoTime::ZERO;
    }
}

/// Whether the reply to `missing` would be accepted as the reply to `request`.
fn is_mistakable(missing: &Request, request: &Request) -> bool {
    match (missing, request) {
        (Request::ReadHolding { count: a, .. }, Request::ReadHolding { count: b, .. }) => a == b,
        // Whatever the values are: a refused write may be answered with any value.
        (Request::WriteSingle { address: a, .. }, Request::WriteSingle { address: b, .. }) => a == b,
        (Request::Loopback { data: a }, Request::Loopback { data: b }) => a == b,
        (Request::WriteMultiple { address: a, values: of_a }, Request::WriteMultiple { address: b, values: of_b }) => {
            a == b && of_a.len() == of_b.len()
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LATENESS: Duration = Duration::from_millis(500);

    fn read(address: u16, count: u16) -> Request {
        Request::ReadHolding { address, count }
    }

    #[test]
    fn only_what_cannot_be_mistaken_may_go_to_a_dirty_station() {
        let mut station = StationState::default();
        let now = MonoTime::from_millis(1000);
        station.reply_missing(read(0x0101, 1), now, LATENESS);
        assert_eq!(station.unmistakable_at(&read(0x0201, 1)), now + LATENESS, "same count, other address");
        assert_eq!(station.unmistakable_at(&read(0x0101, 2)), MonoTime::ZERO, "another count");
        let write = |address, value| Request::WriteSingle { address, value };
        assert_eq!(station.unmistakable_at(&write(2, 0)), MonoTime::ZERO, "another function");
        station.reply_missing(write(2, 0), now, LATENESS);
        assert_eq!(station.unmistakable_at(&write(2, 1)), now + LATENESS, "a kept old value looks the same");
        assert_eq!(station.unmistakable_at(&write(4, 1)), MonoTime::ZERO);
        assert!(station.misses_function(6, now) && !station.misses_function(8, now));
        assert!(!station.is_dirty(now + LATENESS));
    }

    #[test]
    fn an_answer_that_cannot_be_mistaken_proves_that_none_follows() {
        let mut station = StationState::default();
        station.reply_missing(read(1, 1), MonoTime::ZERO, LATENESS);
        station.answered();
        assert_eq!(station.unmistakable_at(&read(1, 1)), MonoTime::ZERO);
    }

    #[test]
    fn what_is_missing_is_bounded() {
        let mut station = StationState::default();
        for count in 1..=MISSING_MAX as u16 {
            station.reply_missing(read(1, count), MonoTime::from_millis(u64::from(count)), LATENESS);
        }
        let first_gone = MonoTime::from_millis(1) + LATENESS;
        assert_eq!(station.unmistakable_at(&read(1, 100)), first_gone);
        station.reply_missing(read(1, 100), first_gone, LATENESS);
        assert_eq!(station.missing.len(), MISSING_MAX);
    }

    #[test]
    fn a_dead_station_is_asked_less_and_less() {
        let mut station = StationState::default();
        let now = MonoTime::from_millis(10);
        station.silent(now);
        assert_eq!(station.ask_again_at(), MonoTime::ZERO, "one silence is no death");
        let mut waits = Vec::new();
        for _ in 0..7 {
            station.silent(now);
            waits.push(station.ask_again_at().since(now).as_secs());
        }
        assert_eq!(waits, [1, 2, 4, 8, 16, 30, 30]);
        station.is_there();
        assert!(!station.is_known_silent());
        assert_eq!(station.ask_again_at(), MonoTime::ZERO);
    }
}
