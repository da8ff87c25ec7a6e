//! How much of a line's time was used recently, and by how many exchanges.

use crate::domain::report::LineCounters;
use crate::domain::time::MonoTime;
use std::collections::VecDeque;
use std::time::Duration;

/// The time over which it is measured.
const SPAN: Duration = Duration::from_secs(10);
/// A shorter time says nothing.
const LEAST: Duration = Duration::from_secs(1);
/// Most counts that are remembered, however often they are noted.
const COUNTS_MAX: usize = 16;

/// What was measured over the last seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineRates {
    /// Per cent of the time in which an exchange was open, 0 to 100.
    pub use_per_cent: f64,
    /// Frames sent a second.
    pub exchanges_per_s: f64,
}

/// The counts of one line over the last seconds.
#[derive(Clone, Debug, Default)]
pub struct LineUse {
    counts: VecDeque<UseCount>,
}

#[derive(Clone, Copy, Debug)]
struct UseCount {
    at: MonoTime,
    busy_us: u64,
    requests: u64,
}

impl LineUse {
    /// Takes the counters as they are `now`.
    pub fn note(&mut self, now: MonoTime, counters: &LineCounters) {
        self.counts.push_back(UseCount {
            at: now,
            busy_us: counters.busy_us,
            requests: counters.requests,
        });
        // One that is as old as the whole span stays, so that the span is covered.
        while self.counts.len() > COUNTS_MAX
            || self
                .counts
                .get(1)
                .is_some_and(|next| now.since(next.at) >= SPAN)
        {
            self.counts.pop_front();
        }
    }

    /// The rates; `None` before a second has passed.
    #[must_use]
    pub fn rates(&self) -> Option<LineRates> {
        let first = self.counts.front()?;
        let last = self.counts.back()?;
        let span = Some(last.at.since(first.at))
            .filter(|span| *span >= LEAST)?
            .as_secs_f64();
        let rise = |from: u64, to: u64| to.saturating_sub(from) as f64 / span;
        Some(LineRates {
            use_per_cent: (rise(first.busy_us, last.busy_us) / 1e4).min(100.0),
            exchanges_per_s: rise(first.requests, last.requests),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_ten_seconds_count_and_no_more() {
        let mut measured = LineUse::default();
        let count = |busy_us, requests| LineCounters {
            busy_us,
            requests,
            ..LineCounters::default()
        };
        measured.note(MonoTime::ZERO, &count(5, 5));
        assert_eq!(measured.rates(), None, "one count says nothing");
        for second in 1..=60_u64 {
            // Idle for half a minute, then busy for half of the time.
            let busy = second.saturating_sub(30);
            measured.note(
                MonoTime::from_millis(second * 1000),
                &count(5 + busy * 500_000, 5 + busy * 20),
            );
        }
        assert_eq!(
            measured.rates(),
            Some(LineRates {
                use_per_cent: 50.0,
                exchanges_per_s: 20.0
            })
        );
        assert!(measured.counts.len() <= COUNTS_MAX);
        for fast in 0..1000 {
            measured.note(MonoTime::from_millis(61_000 + fast), &count(0, 0));
        }
        assert!(measured.counts.len() <= COUNTS_MAX);
    }
}
