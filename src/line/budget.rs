//! What a poll plan costs on the wire, computed before anything is opened.

use super::timing::Timing;
use std::time::Duration;

/// Turnaround that is assumed for a drive whose documents give no processing time. An estimate for people
/// who plan a line, not a limit of anything.
pub const ASSUMED_TURNAROUND: Duration = Duration::from_millis(10);

/// PDU bytes of a read request, of a write and of a write's reply.
const SHORT_PDU_BYTES: usize = 5;

/// One repeated read of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlannedRead {
    /// Words in one frame.
    pub count: u16,
    /// Wanted time between two of them.
    pub period: Duration,
    /// Time the drive takes to answer.
    pub turnaround: Duration,
}

/// What the polls of one line cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// Part of the line's time that the plan takes, 1.0 = all of it. Above that every period stretches.
    pub use_of_line: f64,
    /// By how much every period is stretched: 1.0 while the plan fits.
    pub stretch: f64,
    /// The longest exchange of the plan without its reply missing.
    pub longest_exchange: Duration,
}

/// Time that one exchange takes: silence, request, turnaround, reply.
#[must_use]
pub fn exchange_time(
    timing: &Timing,
    request_pdu_bytes: usize,
    turnaround: Duration,
    reply_pdu_bytes: usize,
) -> Duration {
    let on_wire = |pdu_bytes| timing.on_wire(timing.adu_bytes(pdu_bytes));
    timing.silence + on_wire(request_pdu_bytes) + turnaround + on_wire(reply_pdu_bytes)
}

/// Time that one read of `count` words takes if the drive answers after `turnaround`.
#[must_use]
pub fn read_time(timing: &Timing, count: u16, turnaround: Duration) -> Duration {
    exchange_time(timing, SHORT_PDU_BYTES, turnaround, 2 + 2 * usize::from(count))
}

/// Longest time from the acceptance of a stop to its first bit on a line whose `exchanges` all end with a reply in time
/// or without any: the longest of them that has just begun, and the silence after it. Several stops at once go one
/// after the other: each further one adds a [`write_time`].
#[must_use]
pub fn worst_stop(timing: &Timing, exchanges: impl IntoIterator<Item = Duration>) -> Duration {
    exchanges.into_iter().max().unwrap_or_default() + timing.silence
}

/// Time that one write takes if the drive answers after `turnaround`.
#[must_use]
pub fn write_time(timing: &Timing, turnaround: Duration) -> Duration {
    exchange_time(timing, SHORT_PDU_BYTES, turnaround, SHORT_PDU_BYTES)
}

/// Adds up a plan.
#[must_use]
pub fn of_plan(timing: &Timing, plan: &[PlannedRead]) -> Budget {
    let cost = |read: &PlannedRead| read_time(timing, read.count, read.turnaround);
    let use_of_line = plan.iter().map(|read| cost(read).as_secs_f64() / read.period.as_secs_f64()).sum::<f64>();
    let longest_exchange = plan.iter().map(cost).max().unwrap_or_default();
    Budget { use_of_line, stretch: use_of_line.max(1.0), longest_exchange }
}

#[cfg(test)]
mod tests {
    use super::super::timing::testing::{ASCII, N700};
    use super::*;

    #[test]
    fn one_word_at_9600_takes_32_milliseconds() {
        let read = PlannedRead { count: 1, period: Duration::from_millis(500), turnaround: ASSUMED_TURNAROUND };
        // 4.6875 silence + 8.3333 request + 10 turnaround + 7.2917 reply
        let budget = of_plan(&N700, &[read]);
        assert_eq!(budget.longest_exchange.as_micros(), 30_312);
        assert!((budget.use_of_line - 0.060_625).abs() < 1e-5);
        let full = of_plan(&N700, &[read; 20]);
        assert!((full.stretch - 1.2125).abs() < 1e-3);
    }

    #[test]
    fn ascii_frames_cost_two_characters_for_each_byte() {
        // 10 silence + 17 characters request + 10 turnaround + 15 characters reply
        assert_eq!(read_time(&ASCII, 1, ASSUMED_TURNAROUND).as_micros(), 10_000 + 17_708 + 10_000 + 15_625);
        assert_eq!(write_time(&ASCII, ASSUMED_TURNAROUND).as_micros(), 10_000 + 2 * 17_708 + 10_000);
        // A read of 15 words that stays without an answer, and the silence after it.
        let timeout = Duration::from_millis(200);
        let worst = worst_stop(&ASCII, [15, 1].map(|words| read_time(&ASCII, words, timeout)));
        assert_eq!(worst.as_micros(), 10_000 + 17_708 + 200_000 + 73_958 + 10_000);
    }
}
