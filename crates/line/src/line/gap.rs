//! When a gateway that may not send puts a single stop between the frames of the master that does.

use super::standby::random;
use crate::domain::time::MonoTime;
use std::time::Duration;

/// How long after a complete exchange of the other master its next request is still to come.
const BEHIND: Duration = Duration::from_millis(50);
/// Silence after which no gateway is sending: a gateway that is active sends at least every half second.
const QUIET: Duration = Duration::from_millis(750);
/// How long a stop waits for such a moment. Then any silence between two frames serves.
const PATIENCE: Duration = Duration::from_secs(1);
/// A frame that is handed to the port later than this after it was decided on might meet something else on the line.
const HAND_OVER_MAX: Duration = Duration::from_millis(100);
/// Least time before a stop is sent again, apart from once at once.
const AGAIN_AFTER: Duration = Duration::from_millis(500);
/// How often a read is sent that shows whether the stop takes effect, where no other gateway reads that.
const LOOK_EVERY: Duration = Duration::from_millis(300);

/// Longest random wait before the next frame while the last one was not answered: two gateways that stop the same drives, or
/// this one and the master, must not meet each time.
const SPREAD: Duration = Duration::from_millis(100);
/// How long the stops last between which room is left for another gateway to take the line.
const BURST: Duration = Duration::from_secs(1);

/// The gaps between the frames of another master.
#[derive(Clone, Copy, Debug, Default)]
pub struct MasterGaps {
    /// When the last exchange of the other master ended, if nothing was received since.
    ended_at: Option<MonoTime>,
    /// When a stop was last sent, and when a read was.
    stopped_at: Option<MonoTime>,
    looked_at: Option<MonoTime>,
    /// A frame was decided on, and may be handed to the port until this moment.
    open_until: Option<MonoTime>,
    /// The last frame was sent again at once, because it may have met another one.
    was_repeated: bool,
    /// How much later than possible the next frame is sent.
    wait: Duration,
    /// How much later a frame that waits for a silence is sent: another gateway may wait for the same silence.
    slot: Duration,
    seed: u64,
    /// A request was received at this moment, and neither its answer nor anything else since.
    asked_at: Option<MonoTime>,
    /// Until this moment another gateway counts as active: it would have said so again by then.
    led_until: MonoTime,
    /// When the present or last burst began.
    burst_from: Option<MonoTime>,
}

impl MasterGaps {
    /// Nothing was heard. `slot` differs between the ranks, and `seed` between all gateways.
    #[must_use]
    pub fn new(slot: Duration, seed: u64) -> Self {
        Self {
            slot,
            seed,
            ..Self::default()
        }
    }

    /// An exchange of the other master ended at `at`.
    pub const fn exchange_ended(&mut self, at: MonoTime) {
        (self.ended_at, self.asked_at) = (Some(at), None);
    }

    /// Something else was received: the other master may be sending.
    pub const fn is_over(&mut self) {
        (self.ended_at, self.asked_at) = (None, None);
    }

    /// A request of the other master was received at `at`: its answer follows.
    pub const fn asked(&mut self, at: MonoTime) {
        (self.ended_at, self.asked_at) = (None, Some(at));
    }

    /// Another gateway is active, as far as is known up to `until`.
    pub const fn led(&mut self, until: MonoTime) {
        self.led_until = until;
    }

    /// Whether another gateway is active, which reads its drives and sees the effect of a stop.
    #[must_use]
    pub fn is_led(&self, now: MonoTime) -> bool {
        now < self.led_until
    }

    /// When a frame that may be sent `at` some moment is sent, if the line is left silent for `room` after each burst.
    #[must_use]
    pub fn in_burst(&self, at: MonoTime, room: Duration) -> MonoTime {
        let Some(end) = self.burst_from.map(|from| from + BURST) else {
            return at;
        };
        if at >= end { at.max(end + room) } else { at }
    }

    /// When a stop that was sent before, and is due at `due`, may be sent again.
    #[must_use]
    pub fn again_at(&self, due: MonoTime, last_byte_at: MonoTime, now: MonoTime) -> MonoTime {
        let again_at = match self.stopped_at {
            Some(at) if !self.was_repeated => at + AGAIN_AFTER,
            _ => due,
        };
        self.stop_at(due.max(again_at), last_byte_at, now)
    }

    /// When a stop that is due at `due` may be sent, as known at `now`, if nothing more is received. The last byte was
    /// received at `last_byte_at`.
    #[must_use]
    pub fn stop_at(&self, due: MonoTime, last_byte_at: MonoTime, now: MonoTime) -> MonoTime {
        let fits = |at: &MonoTime| due <= *at + BEHIND && now <= *at + BEHIND + self.wait;
        let behind = self.ended_at.filter(fits).map(|at| due.max(at) + self.wait);
        // A stop in place of an answer would cost both.
        let answered_at = self
            .asked_at
            .map_or(due, |at| at + BEHIND)
            .min(due + PATIENCE * 2);
        let any = (due + PATIENCE)
            .max(answered_at)
            .min(due.max(last_byte_at + QUIET))
            + self.slot
            + self.wait;
        behind.map_or(any, |behind| behind.min(any))
    }

    /// When a read that is due at `due` may be sent, as known at `now`, if nothing more is received. The last byte was
    /// received at `last_byte_at`.
    #[must_use]
    pub fn look_at(&self, due: MonoTime, last_byte_at: MonoTime, now: MonoTime) -> MonoTime {
        let due = self.looked_at.map_or(due, |at| due.max(at + LOOK_EVERY));
        self.stop_at(due, last_byte_at, now)
    }

    /// A frame is decided on at `now`: a stop, or a read.
    pub fn decided(&mut self, now: MonoTime, is_stop: bool) {
        (self.ended_at, self.asked_at, self.open_until) = (None, None, Some(now + HAND_OVER_MAX));
        if self.burst_from.is_none_or(|from| now >= from + BURST) {
            self.burst_from = Some(now);
        }
        let at = if is_stop {
            &mut self.stopped_at
        } else {
            &mut self.looked_at
        };
        *at = Some(now);
    }

    /// Whether the frame that was decided on may be handed to the port at `now`. Answers once.
    pub fn take_frame(&mut self, now: MonoTime) -> bool {
        self.open_until.take().is_some_and(|until| now < until)
    }

    /// The last frame was not answered: it may have met another one.
    pub fn unanswered(&mut self) {
        self.wait = random(&mut self.seed, SPREAD);
    }

    /// The last stop was not answered: if it met a frame of the other master, that one now waits for its own reply in
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
        (self.was_repeated, self.wait) = (false, Duration::ZERO);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: fn(u64) -> MonoTime = MonoTime::from_millis;

    #[test]
    fn a_stop_goes_behind_an_exchange_or_into_a_long_silence_or_after_a_second() {
        let mut gap = MasterGaps::default();
        assert_eq!(
            gap.stop_at(MS(1000), MS(990), MS(1000)),
            MS(1740),
            "nothing is heard any more"
        );
        let second = MasterGaps::new(Duration::from_millis(30), 0);
        assert_eq!(
            second.stop_at(MS(1000), MS(990), MS(1000)),
            MS(1770),
            "the first rank is heard before"
        );
        assert_eq!(
            gap.stop_at(MS(1000), MS(1900), MS(1900)),
            MS(2000),
            "frames without an end"
        );
        gap.exchange_ended(MS(1100));
        assert_eq!(gap.stop_at(MS(1000), MS(1100), MS(1100)), MS(1100));
        assert_eq!(gap.stop_at(MS(1120), MS(1100), MS(1120)), MS(1120));
        assert_eq!(
            gap.stop_at(MS(1160), MS(1100), MS(1160)),
            MS(1850),
            "the next request may be on its way"
        );
        gap.is_over();
        assert_eq!(gap.stop_at(MS(1000), MS(1110), MS(1110)), MS(1860));
        gap.asked(MS(1990));
        assert_eq!(
            gap.stop_at(MS(1000), MS(1990), MS(1990)),
            MS(2040),
            "not in place of an answer"
        );
        gap.asked(MS(2970));
        assert_eq!(
            gap.stop_at(MS(1000), MS(2970), MS(2970)),
            MS(3000),
            "but not without end"
        );
    }

    #[test]
    fn two_that_were_not_answered_wait_for_different_times_until_they_are() {
        let at = |seed| {
            let mut gap = MasterGaps::new(Duration::ZERO, seed);
            gap.decided(MS(1000), true);
            gap.unanswered();
            assert!(gap.may_repeat(MS(1100)));
            let at = gap.stop_at(MS(1100), MS(1000), MS(1100));
            assert!(at >= MS(1100) && at <= MS(1100) + SPREAD);
            assert_eq!(
                gap.stop_at(MS(1100), MS(1000), at),
                at,
                "it is still time for it then"
            );
            gap.answered();
            gap.exchange_ended(MS(2000));
            assert_eq!(gap.stop_at(MS(1100), MS(2000), MS(2000)), MS(2000));
            at
        };
        assert_ne!(at(1), at(1_000_001));
    }

    #[test]
    fn stops_that_leave_room_come_in_bursts() {
        let room = Duration::from_secs(4);
        let mut gap = MasterGaps::default();
        assert_eq!(gap.in_burst(MS(1000), room), MS(1000));
        gap.decided(MS(1000), true);
        assert_eq!(gap.in_burst(MS(1999), room), MS(1999));
        assert_eq!(gap.in_burst(MS(2000), room), MS(6000));
        gap.decided(MS(6000), true);
        assert_eq!(
            (gap.in_burst(MS(6500), room), gap.in_burst(MS(7000), room)),
            (MS(6500), MS(11_000))
        );
    }

    #[test]
    fn a_frame_that_may_have_met_another_one_is_repeated_once() {
        let mut gap = MasterGaps::default();
        gap.decided(MS(1000), true);
        assert!(gap.take_frame(MS(1099)) && !gap.take_frame(MS(1099)));
        assert!(gap.may_repeat(MS(1100)));
        assert_eq!(gap.stop_at(MS(1100), MS(1000), MS(1100)), MS(1100));
        gap.decided(MS(1105), true);
        assert!(!gap.take_frame(MS(1205)), "too late");
        assert!(!gap.may_repeat(MS(1300)));
        assert_eq!(
            gap.again_at(MS(1300), MS(1290), MS(1300)),
            MS(2040),
            "nothing is heard"
        );
        gap.exchange_ended(MS(1600));
        assert_eq!(
            gap.again_at(MS(1300), MS(1600), MS(1600)),
            MS(1605),
            "half a second after the last one"
        );
        gap.decided(MS(1605), false);
        assert_eq!(gap.look_at(MS(1605), MS(1700), MS(1700)), MS(2450));
        gap.decided(MS(2000), true);
        assert!(gap.may_repeat(MS(2100)), "the next one is");
    }
}
