//! When a gateway that may not send puts a single stop between the frames of the master that does.

use crate::domain::time::MonoTime;
use std::time::Duration;

/// How long after a complete exchange of the other master its next request is still to come.
const BEHIND: Duration = Duration::from_millis(50);
/// Silence after which nobody is sending: a gateway that is active sends at least every half second.
const QUIET: Duration = Duration::from_millis(750);
/// How long a stop waits for such a moment. Then any silence between two frames serves.
const PATIENCE: Duration = Duration::from_secs(1);
/// A frame that is handed to the port later than this after it was decided on might meet something else on the line.
const HAND_OVER_MAX: Duration = Duration::from_millis(100);
/// Least time before a stop is sent again, apart from once at once.
const AGAIN_AFTER: Duration = Duration::from_millis(500);
/// How often a read is sent that shows whether the stop takes effect, where nobody else reads that.
const LOOK_EVERY: Duration = Duration::from_millis(300);

/// The gaps between the frames of another master.
#[derive(Clone, Copy, Debug, Default)]
pub struct Gap {
    /// When its last exchange ended, if nothing was received since.
    ended_at: Option<MonoTime>,
    /// When a stop was last sent, and when a read was.
    stopped_at: Option<MonoTime>,
    looked_at: Option<MonoTime>,
    /// A frame was decided on, and may be handed to the port until then.
    open_until: Option<MonoTime>,
    /// The last frame was sent again at once, because it may have met another one.
    was_repeated: bool,
}

impl Gap {
    /// An exchange of the other master ended at `at`.
    pub const fn exchange_ended(&mut self, at: MonoTime) {
        self.ended_at = Some(at);
    }

    /// Something else was received: the other master may be sending.
    pub const fn is_over(&mut self) {
        self.ended_at = None;
    }

    /// When a stop that was sent before, and is due at `due`, may be sent again.
    #[must_use]
    pub fn again_at(&self, due: MonoTime, last_byte_at: MonoTime, now: MonoTime) -> MonoTime {
        let again_at = self.stopped_at.filter(|_| !self.was_repeated).map_or(due, |at| at + AGAIN_AFTER);
        self.stop_at(due.max(again_at), last_byte_at, now)
    }

    /// When a stop that is due at `due` may be sent, as known at `now`, if nothing more is received. The last byte was
    /// received at `last_byte_at`.
    #[must_use]
    pub fn stop_at(&self, due: MonoTime, last_byte_at: MonoTime, now: MonoTime) -> MonoTime {
        let behind = self.ended_at.filter(|at| due.max(now) <= *at + BEHIND).map(|at| due.max(at));
        let any = (due + PATIENCE).min(due.max(last_byte_at + QUIET));
        behind.map_or(any, |behind| behind.min(any))
    }

    /// The same for a read.
    #[must_use]
    pub fn look_at(&self, due: MonoTime, last_byte_at: MonoTime, now: MonoTime) -> MonoTime {
        let due = self.looked_at.map_or(due, |at| due.max(at + LOOK_EVERY));
        self.stop_at(due, last_byte_at, now)
    }

    /// A frame is decided on at `now`: a stop, or a read.
    pub fn decided(&mut self, now: MonoTime, is_stop: bool) {
        (self.ended_at, self.open_until) = (None, Some(now + HAND_OVER_MAX));
        let at = if is_stop { &mut self.stopped_at } else { &mut self.looked_at };
        *at = Some(now);
    }

    /// Whether that frame may be handed to the port at `now`. Answers once.
    pub fn take_frame(&mut self, now: MonoTime) -> bool {
        self.open_until.take().is_some_and(|until| now < until)
    }

    /// The last frame was not answered: it may have met a frame of the other master, which now waits for its own reply in
    /// vain. Returns whether it is to be sent again at once; that helps only once.
    pub fn may_repeat(&mut self, now: MonoTime) -> bool {
        self.was_repeated = !self.was_repeated;
        if self.was_repeated {
            self.ended_at = Some(now);
        }
        self.was_repeated
    }

    /// The last frame was answered.
    pub const fn answered(&mut self) {
        self.was_repeated = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: fn(u64) -> MonoTime = MonoTime::from_millis;

    #[test]
    fn a_stop_goes_behind_an_exchange_or_into_a_long_silence_or_after_a_second() {
        let mut gap = Gap::default();
        assert_eq!(gap.stop_at(MS(1000), MS(990), MS(1000)), MS(1740), "nothing is heard any more");
        assert_eq!(gap.stop_at(MS(1000), MS(1900), MS(1900)), MS(2000), "frames without an end");
        gap.exchange_ended(MS(1100));
        assert_eq!(gap.stop_at(MS(1000), MS(1100), MS(1100)), MS(1100));
        assert_eq!(gap.stop_at(MS(1120), MS(1100), MS(1120)), MS(1120));
        assert_eq!(gap.stop_at(MS(1160), MS(1100), MS(1160)), MS(1850), "the next request may be on its way");
        gap.is_over();
        assert_eq!(gap.stop_at(MS(1000), MS(1110), MS(1110)), MS(1860));
    }

    #[test]
    fn a_frame_that_may_have_met_another_one_is_repeated_once() {
        let mut gap = Gap::default();
        gap.decided(MS(1000), true);
        assert!(gap.take_frame(MS(1099)) && !gap.take_frame(MS(1099)));
        assert!(gap.may_repeat(MS(1100)));
        assert_eq!(gap.stop_at(MS(1100), MS(1000), MS(1100)), MS(1100));
        gap.decided(MS(1105), true);
        assert!(!gap.take_frame(MS(1205)), "too late");
        assert!(!gap.may_repeat(MS(1300)));
        assert_eq!(gap.again_at(MS(1300), MS(1290), MS(1300)), MS(2040), "nothing is heard");
        gap.exchange_ended(MS(1600));
        assert_eq!(gap.again_at(MS(1300), MS(1600), MS(1600)), MS(1605), "half a second after the last one");
        gap.decided(MS(1605), false);
        assert_eq!(gap.look_at(MS(1605), MS(1700), MS(1700)), MS(2450));
        gap.decided(MS(2000), true);
        assert!(gap.may_repeat(MS(2100)), "the next one is");
    }
}
