//! What a gateway that may not send knows of the line: whether what it receives came just now, and whether it would have heard
//! another gateway take the line.

use super::times::{LOOK_MAX, SIGNALS_WITHIN};
use crate::domain::time::MonoTime;
use std::time::Duration;

/// What a listener knows of the line.
#[derive(Clone, Copy, Debug)]
pub struct StandbyKnowledge {
    /// From this moment on what is received while listening is known to have come just now.
    attentive_from: MonoTime,
    /// From this moment on another gateway that has taken the line would have been heard to say so.
    informed_from: MonoTime,
}

impl StandbyKnowledge {
    /// Nothing was missed.
    pub(super) const NEW: Self = Self {
        attentive_from: MonoTime::ZERO,
        informed_from: MonoTime::ZERO,
    };

    /// Whether what it receives at `now` came just now.
    pub(super) fn is_attentive(&self, now: MonoTime) -> bool {
        now >= self.attentive_from
    }

    /// Whether it would have heard another gateway that has taken the line.
    #[must_use]
    pub fn is_informed(&self, now: MonoTime) -> bool {
        now >= self.informed_from
    }

    /// From when on it knows enough to put a stop between the frames of another: one that is declared also needs to know that no
    /// other gateway is there to see to it.
    #[must_use]
    pub fn stops_from(&self, is_declared: bool) -> MonoTime {
        if is_declared {
            self.attentive_from.max(self.informed_from)
        } else {
            self.attentive_from
        }
    }

    /// The gateway begins to listen at `now`: what it receives first may have waited.
    pub(super) fn begins(&mut self, now: MonoTime) {
        self.attentive_from = now + LOOK_MAX;
    }

    /// The gateway has heard all up to `now`, if there was anything to hear.
    pub(super) const fn is_complete(&mut self, now: MonoTime) {
        (self.attentive_from, self.informed_from) = (now, now);
    }

    /// The gateway may have missed what was sent up to `now`. The line was last in use at `used_at`, and another gateway takes it only
    /// after more silence than `silent_at_most`.
    pub(super) fn missed(
        &mut self,
        used_at: Option<MonoTime>,
        now: MonoTime,
        silent_at_most: Duration,
    ) {
        if used_at.is_none_or(|at| now.since(at) >= silent_at_most) {
            self.informed_from = now + SIGNALS_WITHIN;
        }
    }
}
