//! Whether another gateway listens on a line: the active one asks now and then, and a listener answers.
//!
//! A listener sends nothing else, so without this its loss would go unnoticed until it is needed. A question is asked so
//! rarely that it costs the line nothing.

use crate::domain::time::MonoTime;
use std::time::Duration;

/// How long after a take-over the first question is asked.
const FIRST_AFTER: Duration = Duration::from_secs(2);
/// How often a question is asked.
const ASK_EVERY: Duration = Duration::from_secs(60);
/// How often a question is asked while the last one was not answered, or before the first one.
const ASK_AGAIN_AFTER: Duration = Duration::from_millis(500);
/// How long the line is left silent for an answer, except for stops.
const ANSWER_WITHIN: Duration = Duration::from_millis(300);
/// An answer that is sent later than this after its question might meet something else on the line.
const ANSWER_MAX: Duration = Duration::from_millis(100);
/// Unanswered questions in a row after which there is no listener.
const MISSES_MAX: u8 = 3;

/// The questions of an active gateway.
#[derive(Clone, Copy, Debug)]
pub struct RollCall {
    ask_at: MonoTime,
    /// Until when an answer may come.
    open_until: Option<MonoTime>,
    misses: u8,
    listener: Option<bool>,
}

impl RollCall {
    /// The questions of a gateway that becomes active at `now`.
    #[must_use]
    pub fn new(now: MonoTime) -> Self {
        Self {
            ask_at: now + FIRST_AFTER,
            open_until: None,
            misses: 0,
            listener: None,
        }
    }

    /// Whether another gateway listens has to be known at once: what is known at `now` may be out of date.
    pub const fn ask_again(&mut self, now: MonoTime) {
        self.ask_at = now;
        self.misses = 0;
        self.listener = None;
    }

    /// Whether another gateway listens; `None` while that is not known.
    #[must_use]
    pub const fn listener(&self) -> Option<bool> {
        self.listener
    }

    /// When the next question is due; `None` while an answer is awaited.
    #[must_use]
    pub const fn ask_at(&self) -> Option<MonoTime> {
        match self.open_until {
            Some(_) => None,
            None => Some(self.ask_at),
        }
    }

    /// Until when an answer is awaited; `None` if none is.
    #[must_use]
    pub const fn open_until(&self) -> Option<MonoTime> {
        self.open_until
    }

    /// A question was handed to the port; its last character leaves at `end`.
    pub fn asked(&mut self, end: MonoTime) {
        self.open_until = Some(end + ANSWER_WITHIN);
    }

    /// A listener was heard at `now`.
    pub fn answered(&mut self, now: MonoTime) {
        self.open_until = None;
        self.misses = 0;
        self.listener = Some(true);
        self.ask_at = now + ASK_EVERY;
    }

    /// Time has passed up to `now`.
    pub fn pass(&mut self, now: MonoTime) {
        if self.open_until.is_none_or(|until| now < until) {
            return;
        }
        self.open_until = None;
        self.misses = self.misses.saturating_add(1).min(MISSES_MAX);
        let is_missing = self.misses == MISSES_MAX;
        if is_missing {
            self.listener = Some(false);
        }
        self.ask_at = now
            + if is_missing {
                ASK_EVERY
            } else {
                ASK_AGAIN_AFTER
            };
    }
}

/// What a listener owes: the answer to a question that was heard.
#[derive(Clone, Copy, Debug)]
pub struct OwedAnswer {
    at: MonoTime,
    until: MonoTime,
}

impl OwedAnswer {
    /// The answer to a question that was heard at `now` and ended at `end`, by a gateway that waits for `slot`, so that
    /// several listeners do not answer at once.
    #[must_use]
    pub fn to_question(now: MonoTime, end: MonoTime, slot: Duration) -> Self {
        Self {
            at: now + slot,
            until: end + slot + ANSWER_MAX,
        }
    }

    /// When the answer is due.
    #[must_use]
    pub const fn at(&self) -> MonoTime {
        self.at
    }

    /// Whether the answer may be handed to the port at `now`.
    #[must_use]
    pub fn may_be_sent(&self, now: MonoTime) -> bool {
        now >= self.at && now < self.until
    }

    /// Whether it is too late for the answer at `now`.
    #[must_use]
    pub fn is_over(&self, now: MonoTime) -> bool {
        now >= self.until
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: fn(u64) -> MonoTime = MonoTime::from_millis;

    #[test]
    fn a_listener_is_known_by_its_answer_and_missing_after_three_questions() {
        let mut call = RollCall::new(MS(1000));
        assert_eq!(
            (call.listener(), call.ask_at(), call.open_until()),
            (None, Some(MS(3000)), None)
        );
        call.asked(MS(3010));
        assert_eq!((call.ask_at(), call.open_until()), (None, Some(MS(3310))));
        call.pass(MS(3309));
        call.answered(MS(3309));
        assert_eq!(
            (call.listener(), call.ask_at(), call.open_until()),
            (Some(true), Some(MS(63_309)), None)
        );
        let mut now = MS(63_309);
        for (misses, listener) in [
            (1, Some(true)),
            (2, Some(true)),
            (3, Some(false)),
            (4, Some(false)),
        ] {
            call.asked(now);
            now = now + ANSWER_WITHIN;
            call.pass(now);
            assert_eq!(call.listener(), listener, "{misses}");
            let wait = if misses < 3 {
                ASK_AGAIN_AFTER
            } else {
                ASK_EVERY
            };
            assert_eq!(call.ask_at(), Some(now + wait), "{misses}");
            now = now + wait;
        }
        call.ask_again(now);
        assert_eq!((call.listener(), call.ask_at()), (None, Some(now)));
    }

    #[test]
    fn an_answer_that_is_late_is_not_sent() {
        let answer = OwedAnswer::to_question(MS(120), MS(100), Duration::from_millis(40));
        assert_eq!(answer.at(), MS(160));
        assert!(
            !answer.may_be_sent(MS(159))
                && answer.may_be_sent(MS(160))
                && answer.may_be_sent(MS(239))
        );
        assert!(
            !answer.may_be_sent(MS(240)) && answer.is_over(MS(240)) && !answer.is_over(MS(239))
        );
    }
}
