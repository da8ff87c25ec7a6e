//! How long one station takes before its replies begin, learned from those received.

use super::histogram::Histogram;
use super::timeouts::RequestClass;
use std::time::Duration;

/// Replies of a class before they are used: with a thousand the 99.9th percentile is no longer just the longest of
/// them.
pub const ENOUGH: u16 = 1000;
/// Replies after which the percentile is recomputed, or sooner if one exceeds it.
const LOOK_EVERY: u8 = 64;

/// The reply times of one station.
#[derive(Clone, Debug, Default)]
pub struct ReplyTimes {
    classes: [LearnedTimes; RequestClass::ALL.len()],
}

#[derive(Clone, Debug, Default)]
struct LearnedTimes {
    times: Histogram,
    /// The 99.9th percentile, once there are enough.
    usual: Option<Duration>,
    /// Replies since it was computed.
    since: u8,
}

impl ReplyTimes {
    /// Counts a reply to a request of `class` that began `time` after the end of the request. Late replies count like
    /// any other, so that the wait adapts to a drive that has become slower. Silence is not counted.
    pub fn add(&mut self, class: RequestClass, time: Duration) {
        let learned = self.of_mut(class);
        learned.times.add(time);
        learned.since += 1;
        let exceeds = learned.usual.is_none_or(|usual| time > usual);
        if learned.times.total() >= ENOUGH && (exceeds || learned.since >= LOOK_EVERY) {
            learned.usual = Some(learned.times.all_but(1));
        }
        learned.since %= LOOK_EVERY;
    }

    /// Discards all times: another station may be there.
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    /// Twice the 99.9th percentile of `class`; `None` before there are enough.
    #[must_use]
    pub fn wait(&self, class: RequestClass) -> Option<Duration> {
        self.of(class).usual.map(|usual| usual * 2)
    }

    /// The longest time of `class` in the last few thousand; `None` before there are enough.
    #[must_use]
    pub fn worst(&self, class: RequestClass) -> Option<Duration> {
        self.of(class)
            .usual
            .map(|usual| usual.max(self.times(class).longest()))
    }

    /// The times of `class`.
    #[must_use]
    pub fn times(&self, class: RequestClass) -> &Histogram {
        &self.of(class).times
    }

    const fn of(&self, class: RequestClass) -> &LearnedTimes {
        let [read, write, stored] = &self.classes;
        match class {
            RequestClass::Read => read,
            RequestClass::Write => write,
            RequestClass::StoredWrite => stored,
        }
    }

    const fn of_mut(&mut self, class: RequestClass) -> &mut LearnedTimes {
        let [read, write, stored] = &mut self.classes;
        match class {
            RequestClass::Read => read,
            RequestClass::Write => write,
            RequestClass::StoredWrite => stored,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    fn after(count: u16, time: Duration) -> ReplyTimes {
        let mut times = ReplyTimes::default();
        (0..count).for_each(|_| times.add(RequestClass::Read, time));
        times
    }

    #[test]
    fn a_few_replies_prove_nothing() {
        let mut times = after(ENOUGH - 1, ms(4));
        assert_eq!(
            (
                times.wait(RequestClass::Read),
                times.worst(RequestClass::Read)
            ),
            (None, None)
        );
        times.add(RequestClass::Read, ms(4));
        assert_eq!(
            (
                times.wait(RequestClass::Read),
                times.worst(RequestClass::Read)
            ),
            (Some(ms(8)), Some(ms(4)))
        );
        assert_eq!(
            times.wait(RequestClass::Write),
            None,
            "each class by itself"
        );
        times.forget();
        assert_eq!(times.wait(RequestClass::Read), None);
    }

    #[test]
    fn a_drive_that_becomes_slower_is_learned_by_a_few_late_replies() {
        let mut times = after(8000, ms(4));
        let mut late = 0;
        while times.wait(RequestClass::Read) < Some(ms(120)) {
            times.add(RequestClass::Read, ms(60));
            late += 1;
        }
        assert!(late <= 9, "{late}");
        assert_eq!(times.worst(RequestClass::Read), Some(ms(60)));
    }

    #[test]
    fn what_was_usual_for_long_is_not_given_up_at_once() {
        let mut times = after(4000, ms(50));
        (0..20_000).for_each(|_| times.add(RequestClass::Read, ms(2)));
        assert!(
            times.wait(RequestClass::Read) >= Some(ms(100))
                && times.worst(RequestClass::Read) >= Some(ms(50))
        );
    }

    #[test]
    fn one_slow_reply_in_thousands_moves_the_worst_and_not_the_wait() {
        let mut times = after(5000, ms(4));
        times.add(RequestClass::Read, ms(90));
        assert_eq!(
            times.wait(RequestClass::Read),
            Some(ms(4) * 2 + Duration::from_micros(190))
        );
        assert_eq!(times.worst(RequestClass::Read), Some(ms(90)));
    }
}
