//! When a command was issued, by the clock of its client.
//!
//! That clock may be ahead of ours. By how much shows when a command arrives before its own moment, and is subtracted
//! from later moments: a command that arrives a second time then has the moment at which it first arrived, and is older
//! than a stop in between. This is as good as the clocks: a clock that is ahead without ever having shown it is
//! believed.
//!
//! Our clock may be set back. A moment that arrives a second time is therefore never younger than on its first arrival.

use crate::domain::command::Reason;
use crate::domain::time::MonoTime;
use crate::north::clock::ClockMoment;
use crate::north::command_words::RefusedCommand;
use std::collections::VecDeque;
use std::time::Duration;

/// How far the clock of a client may be ahead of ours.
const AHEAD_MAX_MS: i64 = 2_000;
/// Smallest difference of the clocks that is reported, in milliseconds.
const TOLD_FROM_MS: i64 = 100;
/// A difference not seen for this long has been corrected. No command is that old.
const SEEN_FOR: Duration = Duration::from_secs(600);
/// Most refused moments that are remembered.
const REFUSED_MAX: usize = 64;
/// Most accepted moments that are remembered.
const TAKEN_MAX: usize = 1024;

/// What is known about the clocks of the clients.
#[derive(Debug, Default)]
pub(in crate::north) struct ClientClocks {
    /// The largest lead seen, in milliseconds, and when it was last seen.
    lead: Option<(i64, MonoTime)>,
    /// Moments that were too far ahead, newest last. They stay refused once that time is reached, so they have a list
    /// of their own: accepted commands displace none of them.
    refused: VecDeque<i64>,
    /// Accepted moments, newest last, with the first arrival of each.
    taken: VecDeque<(i64, MonoTime)>,
}

/// When one command was issued.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::north) struct IssueTime {
    /// Its age, at least. No command is issued after its arrival.
    pub(in crate::north) age: Duration,
    /// The moment on our clock that counts against stops, trips and lost leases.
    pub(in crate::north) moment: MonoTime,
    /// A remark for people that the clock is ahead.
    pub(in crate::north) remark: Option<String>,
}

impl ClientClocks {
    /// Takes a command that arrived `at`, and was issued at `issued_at` in milliseconds since 1970.
    ///
    /// # Errors
    /// Its moment is too far ahead, or was when it first arrived.
    pub(in crate::north) fn take(
        &mut self,
        at: ClockMoment,
        issued_at: i64,
    ) -> Result<IssueTime, RefusedCommand> {
        let ahead_ms = issued_at.saturating_sub(at.wall.unix_ms);
        if ahead_ms > AHEAD_MAX_MS {
            self.remember_refused(issued_at);
            return Err(RefusedCommand::new(
                Reason::ClockAhead,
                format!("{}; at most 2 s are taken", ahead(ahead_ms)),
            ));
        }
        if self.refused.contains(&issued_at) {
            let why =
                "this moment was refused before, when it was too far ahead of the gateway's clock";
            return Err(RefusedCommand::new(Reason::ClockAhead, why));
        }
        let came_first = self.came_first(at.mono, issued_at);
        let known = self
            .lead
            .filter(|(_, seen)| at.mono.since(*seen) < SEEN_FOR)
            .map_or(0, |(lead, _)| lead);
        let lead = known.max(ahead_ms);
        if ahead_ms > 0 && ahead_ms >= known || lead == 0 {
            self.lead = (lead > 0).then_some((lead, at.mono));
        }
        let remark = (ahead_ms >= TOLD_FROM_MS).then(|| ahead(ahead_ms));
        Ok(IssueTime {
            age: millis(ahead_ms.saturating_neg()).max(at.mono.since(came_first)),
            moment: at
                .mono
                .before(millis(lead.saturating_sub(ahead_ms)))
                .min(came_first),
            remark,
        })
    }

    fn remember_refused(&mut self, issued_at: i64) {
        if !self.refused.contains(&issued_at) {
            bounded_push(&mut self.refused, REFUSED_MAX, issued_at);
        }
    }

    /// When this moment first arrived: now, unless it is remembered.
    fn came_first(&mut self, now: MonoTime, issued_at: i64) -> MonoTime {
        if let Some((_, came_first)) = self.taken.iter().find(|(it, _)| *it == issued_at) {
            return *came_first;
        }
        bounded_push(&mut self.taken, TAKEN_MAX, (issued_at, now));
        now
    }
}

/// Appends an item, and drops the oldest one when there are `max`.
fn bounded_push<T>(items: &mut VecDeque<T>, max: usize, item: T) {
    if items.len() >= max {
        items.pop_front();
    }
    items.push_back(item);
}

/// How far a moment is ahead, for people.
fn ahead(ahead_ms: i64) -> String {
    #[allow(clippy::cast_precision_loss, reason = "shown to people with one digit")]
    let seconds = ahead_ms as f64 / 1000.0;
    format!("its moment of issue is {seconds:.1} s ahead of the gateway's clock: set both clocks")
}

/// This many milliseconds; zero if negative.
fn millis(span: i64) -> Duration {
    Duration::from_millis(u64::try_from(span).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::time::WallTime;

    const EPOCH: i64 = 1_767_225_600_000;

    fn at(millis: u64) -> ClockMoment {
        let wall = WallTime {
            unix_ms: EPOCH + i64::try_from(millis).unwrap(),
        };
        ClockMoment {
            mono: MonoTime::from_millis(millis),
            wall,
        }
    }

    fn reason(taken: Result<IssueTime, RefusedCommand>) -> Reason {
        taken.expect_err("a refusal").reason
    }

    #[test]
    fn a_moment_in_the_past_is_what_it_says() {
        let mut issued = ClientClocks::default();
        let issue = issued.take(at(50_000), EPOCH + 49_000).unwrap();
        assert_eq!(
            issue,
            IssueTime {
                age: Duration::from_secs(1),
                moment: at(49_000).mono,
                remark: None
            }
        );
        assert!(issued.take(at(50_000), i64::MIN).unwrap().age > Duration::from_secs(3600));
    }

    #[test]
    fn a_moment_ahead_counts_as_now_and_comes_again_as_that_one() {
        for ahead in [1, 500, 2_000] {
            let mut issued = ClientClocks::default();
            let first = issued.take(at(50_000), EPOCH + 50_000 + ahead).unwrap();
            assert_eq!(
                (first.age, first.moment),
                (Duration::ZERO, at(50_000).mono),
                "{ahead}"
            );
            assert_eq!(first.remark.is_some(), ahead >= 100);
            for later in [1, 400, 1_999, 30_000] {
                let again = issued
                    .take(at(50_000 + later), EPOCH + 50_000 + ahead)
                    .unwrap();
                assert_eq!(again.moment, at(50_000).mono, "{ahead} {later}");
            }
            let new = issued.take(at(51_000), EPOCH + 51_000 + ahead).unwrap();
            assert_eq!(
                new.moment,
                at(51_000).mono,
                "a new command of the same clock"
            );
        }
    }

    #[test]
    fn a_moment_too_far_ahead_is_refused_with_the_difference_and_stays_refused() {
        let mut issued = ClientClocks::default();
        let far = issued.take(at(50_000), EPOCH + 100_000).unwrap_err();
        assert_eq!(far.reason, Reason::ClockAhead);
        assert!(far.message.contains("50.0 s ahead"), "{}", far.message);
        assert_eq!(
            reason(issued.take(at(50_000), EPOCH + 52_001)),
            Reason::ClockAhead
        );
        assert_eq!(
            reason(issued.take(at(50_000), i64::MAX)),
            Reason::ClockAhead
        );
        assert_eq!(
            reason(issued.take(at(99_500), EPOCH + 100_000)),
            Reason::ClockAhead,
            "when it has come"
        );
        assert!(
            issued.take(at(99_500), EPOCH + 99_400).is_ok(),
            "others are taken"
        );
    }

    #[test]
    fn a_refused_moment_stays_refused_however_many_commands_come_in_between() {
        let mut issued = ClientClocks::default();
        assert_eq!(
            reason(issued.take(at(50_000), EPOCH + 100_000)),
            Reason::ClockAhead
        );
        for number in 0..2_000 {
            assert!(
                issued
                    .take(
                        at(50_001 + number * 10),
                        EPOCH + 50_001 + i64::try_from(number).unwrap() * 10
                    )
                    .is_ok()
            );
        }
        assert_eq!(
            reason(issued.take(at(99_500), EPOCH + 100_000)),
            Reason::ClockAhead
        );
    }

    #[test]
    fn a_moment_that_comes_again_is_no_younger_where_the_clock_was_set_back() {
        let mut issued = ClientClocks::default();
        let set_back = |millis| ClockMoment {
            wall: at(millis - 24_500).wall,
            ..at(millis)
        };
        assert!(issued.take(at(50_000), EPOCH + 49_900).is_ok());
        let again = issued.take(set_back(73_000), EPOCH + 49_900).unwrap();
        assert_eq!(
            (again.age, again.moment),
            (Duration::from_secs(23), at(50_000).mono)
        );
        let new = issued.take(set_back(73_000), EPOCH + 48_400).unwrap();
        assert_eq!(
            new.age,
            Duration::from_millis(100),
            "a new command of a clock like ours"
        );
    }

    #[test]
    fn what_is_remembered_of_clocks_is_bounded_and_forgotten() {
        let mut issued = ClientClocks::default();
        for number in 0..2_000 {
            assert!(issued.take(at(0), EPOCH + 1_000_000 + number).is_err());
        }
        assert_eq!(issued.refused.len(), REFUSED_MAX);
        for number in 0..2_000 {
            assert!(issued.take(at(0), EPOCH - number).is_ok());
        }
        assert_eq!(issued.taken.len(), TAKEN_MAX);
        issued.take(at(0), EPOCH + 1_500).unwrap();
        assert_eq!(
            issued.take(at(599_000), EPOCH + 599_000).unwrap().moment,
            at(597_500).mono
        );
        assert_eq!(
            issued.take(at(601_000), EPOCH + 601_000).unwrap().moment,
            at(601_000).mono
        );
    }
}
