//! How long others have been sending without a silence in which we could have sent.

use crate::domain::time::MonoTime;

/// Since when others have been sending.
#[derive(Clone, Copy, Debug)]
pub struct LineOccupancy {
    since: MonoTime,
    /// One of our frames was sent while they were sending, and no other may be sent until then: a silence before that is not
    /// one in which we could have sent.
    holds_until: MonoTime,
}

impl LineOccupancy {
    /// The state when the port is opened at `now`.
    pub const fn new(now: MonoTime) -> Self {
        Self {
            since: now,
            holds_until: MonoTime::ZERO,
        }
    }

    /// When the others began to send.
    pub const fn since(&self) -> MonoTime {
        self.since
    }

    /// Bytes were read at `now`. The silence after the preceding ones ended at `pause_at`.
    pub fn heard(&mut self, now: MonoTime, pause_at: MonoTime) {
        if now >= pause_at.max(self.holds_until) {
            self.since = now;
        }
    }

    /// One of our frames was sent at `now`, and no other may be sent before `free_at`.
    pub fn sent(&mut self, now: MonoTime, pause_at: MonoTime, free_at: MonoTime) {
        self.holds_until = if now < pause_at {
            free_at
        } else {
            MonoTime::ZERO
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> MonoTime {
        MonoTime::from_millis(ms)
    }

    #[test]
    fn a_silence_ends_a_talk_unless_a_frame_of_ours_took_it_up() {
        let mut occupancy = LineOccupancy::new(at(0));
        occupancy.heard(at(10), at(9));
        assert_eq!(occupancy.since(), at(10));
        occupancy.heard(at(14), at(15));
        assert_eq!(occupancy.since(), at(10), "no silence between");
        occupancy.sent(at(16), at(19), at(100));
        occupancy.heard(at(90), at(19));
        assert_eq!(occupancy.since(), at(10), "we waited for our own frame");
        occupancy.heard(at(101), at(95));
        assert_eq!(occupancy.since(), at(101));
    }

    #[test]
    fn a_frame_that_was_sent_in_silence_holds_nothing() {
        let mut occupancy = LineOccupancy::new(at(0));
        occupancy.sent(at(20), at(19), at(100));
        occupancy.heard(at(40), at(19));
        assert_eq!(occupancy.since(), at(40));
    }
}
