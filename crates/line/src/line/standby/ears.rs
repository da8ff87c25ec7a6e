//! Whether a gateway that sends hears anything: one whose receiver is dead must leave the line to another.

use super::times::{DEAF_AFTER, DEAF_WAITS};
use crate::domain::time::MonoTime;
use std::time::Duration;

/// Requests in a row without a sound reply before the receiver may be dead.
const MISSES: u8 = 3;
/// The wait doubles up to this many times.
const DOUBLINGS: u8 = 2;

/// What this gateway has heard while it sends.
#[derive(Clone, Copy, Debug)]
pub(super) struct SenderEars {
    /// When a drive last answered, or the line was taken.
    sound_at: MonoTime,
    /// Requests since then that were not answered.
    misses: u8,
    /// How often it fell silent since a drive last answered.
    silences: u8,
    /// The gateway has heard a valid frame since it last fell silent: its receiver works, and the drives are off.
    is_proven: bool,
}

impl SenderEars {
    /// Nothing is known.
    pub const NEW: Self = Self {
        sound_at: MonoTime::ZERO,
        misses: 0,
        silences: 0,
        is_proven: false,
    };

    /// The line was taken at `now`.
    pub const fn taken(&mut self, now: MonoTime) {
        (self.sound_at, self.misses) = (now, 0);
    }

    /// A drive has answered at `now`.
    pub const fn answered(&mut self, now: MonoTime) {
        *self = Self {
            sound_at: now,
            misses: 0,
            silences: 0,
            is_proven: true,
        };
    }

    /// A sound frame of others was heard.
    pub const fn heard(&mut self) {
        self.is_proven = true;
    }

    /// A request had no sound reply.
    pub const fn missed(&mut self) {
        self.misses = self.misses.saturating_add(1);
    }

    /// When it must fall silent, unless a drive answers before. It goes on alone if it is known to hear, and did so already.
    pub fn silent_at(&self) -> Option<MonoTime> {
        let goes_on = self.silences > 0 && self.is_proven;
        // Silent drives are asked less and less often: once it is in doubt, it does not wait for that.
        ((self.misses >= MISSES || self.are_in_doubt()) && !goes_on)
            .then(|| self.sound_at + DEAF_AFTER)
    }

    /// The gateway falls silent. Returns the least time of that; `take_over_after` is the silence before a take-over.
    pub fn fall_silent(&mut self, take_over_after: Duration) -> Duration {
        let wait = take_over_after * DEAF_WAITS * (1 << self.silences.min(DOUBLINGS));
        (self.silences, self.is_proven) = (self.silences.saturating_add(1), false);
        wait
    }

    /// Whether it fell silent and has heard nothing since.
    pub const fn are_in_doubt(&self) -> bool {
        self.silences > 0 && !self.is_proven
    }
}
