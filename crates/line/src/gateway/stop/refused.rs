//! A stop that the drive refuses, or that it is too busy for.

use super::StopLatch;
use crate::domain::time::MonoTime;

impl StopLatch {
    /// The drive refused it in its current form: the next form that its model declares is sent at once. If it has refused
    /// all of them, the stop is repeated as usual; meanwhile the drive is read, and at standstill there is nothing left to
    /// stop. Returns whether no other form is left.
    pub fn refused(&mut self, now: MonoTime) -> bool {
        self.look_at = now;
        self.form = (self.form + 1) % self.order.forms();
        self.refusals = self.refusals.saturating_add(1);
        if self.refusals < self.order.forms() {
            self.send_at = now;
            return false;
        }
        self.was_refused = true;
        true
    }

    /// Whether the drive has refused every form of it and acknowledged none.
    #[must_use]
    pub const fn is_refused(&self) -> bool {
        self.was_refused && !self.is_acknowledged
    }

    /// The drive is busy at `now`: the stop is sent again `at` that moment, or as soon as the drive shows that it is not.
    pub fn is_busy(&mut self, at: MonoTime, now: MonoTime) {
        self.unanswered(now);
        self.send_at = self.send_at.min(at);
    }
}
