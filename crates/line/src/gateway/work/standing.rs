//! A word that may stand in the drive although it has done its part, and the attempts to take it back.

use crate::domain::time::MonoTime;
use std::time::Duration;

/// Time between two attempts to take it back.
const AGAIN_AFTER: Duration = Duration::from_secs(5);

/// A word that may stand in the drive.
#[derive(Debug)]
pub(super) struct StandingWord {
    pub stands: bool,
    /// The earliest moment to take it back.
    again_at: MonoTime,
}

impl StandingWord {
    /// No word stands.
    pub const NONE: Self = Self {
        stands: false,
        again_at: MonoTime::ZERO,
    };

    /// It was sent: it may be taken back at once.
    pub const fn was_sent(&mut self) {
        *self = Self {
            stands: true,
            ..Self::NONE
        };
    }

    /// Whether it is to be taken back at `now`.
    pub fn is_due(&self, now: MonoTime) -> bool {
        self.stands && now >= self.again_at
    }

    /// An attempt to take it back begins at `now`.
    pub fn attempt(&mut self, now: MonoTime) {
        self.again_at = now + AGAIN_AFTER;
    }
}
