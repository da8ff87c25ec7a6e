//! Measurements of one line: reply times, gaps, ages, and waiting times of stops.

use super::setup::DriveSetup;
use crate::domain::counts::{ExchangeCounts, ReplyCounts};
use crate::domain::report::{LineMeasured, ReplyReport};
use crate::domain::time::MonoTime;
use crate::line::histogram::Histogram;
use crate::line::reply_times::ReplyTimes;
use crate::line::timeouts::{self, RequestClass};
use std::time::Duration;

/// Minimum number of replies for a suggested time-out: the longest of fewer may be far below what the drive can need.
const SUGGESTED_FROM: u16 = 100;
/// How often a drive's report is renewed.
pub const STATION_EVERY: Duration = Duration::from_secs(1);
/// Ages are kept for at least this long, and at most twice as long.
const AGES_FOR: Duration = Duration::from_secs(60);
/// Frames between two updates of the median gap.
const GAPS_EVERY: u8 = 64;

/// All measurements of one line.
#[derive(Debug, Default)]
pub(super) struct LineMeasurements {
    /// What the line's report shows.
    pub(super) line: LineMeasured,
    gaps: Histogram,
    gaps_since: u8,
    opened_at: MonoTime,
    /// The drive whose report is next, and the earliest moment for it.
    next: usize,
    next_at: MonoTime,
}

/// Measurements of one drive.
#[derive(Debug, Default)]
pub(super) struct DriveMeasured {
    pub(super) reply_times: ReplyTimes,
    /// The maximum age of a fast value in the current span, and in the previous one.
    ages: [Duration; 2],
    ages_since: MonoTime,
    pub(super) planned_age: Option<Duration>,
    pub(super) reply_counts: [ReplyCounts; RequestClass::ALL.len()],
    pub(super) exchanges: ExchangeCounts,
}

impl LineMeasurements {
    /// The port was opened at `now`.
    pub(super) const fn port_opened(&mut self, now: MonoTime) {
        self.opened_at = now;
    }

    /// A frame of ours is sent `gap` later than the silence before it requires.
    pub(super) fn sent(&mut self, gap: Duration) {
        self.gaps.add(gap);
        self.line.shortest_gap = Some(
            self.line
                .shortest_gap
                .map_or(gap, |shortest| shortest.min(gap)),
        );
        if self.gaps_since == 0 {
            self.line.median_gap = self.gaps.all_but(500);
        }
        self.gaps_since = (self.gaps_since + 1) % GAPS_EVERY;
    }

    /// A stop that was accepted at `accepted` is sent for the first time at `now`.
    pub(super) fn stop_sent(&mut self, accepted: MonoTime, now: MonoTime) {
        let waited = now.since(accepted.max(self.opened_at));
        self.line.longest_stop = self.line.longest_stop.max(waited);
    }

    /// The index of the drive, of `count`, whose report is due at `now`: each once per [`STATION_EVERY`], so that no round
    /// makes many.
    pub(super) fn report_due(&mut self, count: usize, now: MonoTime) -> Option<usize> {
        if now < self.next_at || count == 0 {
            return None;
        }
        let place = self.next;
        self.next = (place + 1) % count;
        self.next_at = now + STATION_EVERY / u32::try_from(count).unwrap_or(u32::MAX);
        Some(place)
    }
}

impl DriveMeasured {
    /// Creates empty measurements for a drive whose fast values become at most `planned_age` old.
    pub(super) fn planned(planned_age: Option<Duration>) -> Self {
        Self {
            planned_age,
            ..Self::default()
        }
    }

    /// The port was opened. Another drive may have replaced the known one, so the first waits are conservative.
    pub(super) fn port_opened(&mut self) {
        self.reply_times.forget();
    }

    /// A reply began `time` after the end of its request.
    pub(super) fn reply_came(&mut self, class: RequestClass, time: Duration) {
        self.reply_times.add(class, time);
        let counts = RequestClass::ALL
            .iter()
            .position(|it| *it == class)
            .and_then(|at| self.reply_counts.get_mut(at));
        counts.into_iter().for_each(|counts| counts.add(time));
    }

    /// A fast value of this age is refreshed at `now`.
    pub(super) fn aged(&mut self, age: Duration, now: MonoTime) {
        if now.since(self.ages_since) >= AGES_FOR {
            self.ages = [Duration::ZERO, self.ages[0]];
            self.ages_since = now;
        }
        self.ages[0] = self.ages[0].max(age);
    }

    /// The recent maximum age of a fast value.
    pub(super) fn oldest_age(&self) -> Duration {
        self.ages[0].max(self.ages[1])
    }

    /// The reply times of one class of requests, and the time-out that they suggest.
    pub(super) fn replies(&self, class: RequestClass, setup: &DriveSetup) -> ReplyReport {
        let times = self.reply_times.times(class);
        let is_known = times.total() >= SUGGESTED_FROM;
        ReplyReport {
            count: times.total(),
            p50: times.all_but(500),
            p90: times.all_but(100),
            p99: times.all_but(10),
            p999: times.all_but(1),
            max: times.longest(),
            timeout: setup.timeouts.in_force(
                class,
                &setup.model.timing,
                self.reply_times.wait(class),
            ),
            suggested: is_known
                .then(|| timeouts::suggested(class, &setup.model.timing, times.all_but(1))),
        }
    }
}
