//! A start in several words that the drive has not followed: no run word is left standing that it would obey later.

use super::{DriveWork, Out};
use crate::domain::command::{Order, Reason};
use crate::domain::time::MonoTime;
use crate::gateway::event::LineEffect;
use crate::gateway::execution::CommandExecution;
use crate::gateway::note::DriveNote;
use crate::gateway::waiter::ReportWaiter;
use crate::profile::model::OrderKind;

impl DriveWork {
    /// The next request of `execution` is sent.
    pub(super) fn start_was_sent(&mut self) {
        let starts = self.current.as_ref().is_some_and(CommandExecution::starts);
        if starts && self.model.start_take_back().is_some() {
            self.start.was_sent();
        }
    }

    /// The drive shows that it runs: the effect of the run word, if that was the last word sent.
    pub(super) fn runs_now(&mut self) {
        let runs = |execution: &CommandExecution| matches!(execution.order(), Order::Go(go) if go.run().is_some());
        let shows_it = self
            .current
            .as_ref()
            .is_some_and(|execution| runs(execution) && execution.is_reading_back());
        self.start.stands &= !shows_it;
    }

    /// The word of the order `kind` was written: it replaces that of a start where both are in one register.
    pub(super) fn replaces_start(&mut self, kind: OrderKind) {
        let is_same =
            self.model.order_address(kind) == self.model.order_address(OrderKind::Forward);
        self.start.stands &= !is_same;
    }

    /// The start is taken back.
    pub(super) const fn start_is_taken_back(&mut self) {
        self.start.stands = false;
    }

    /// Takes back a start that has ended without the drive showing that it runs: at once, before everything else but a
    /// stop. What waits behind it would be sent to a drive that is not ready.
    pub(super) fn take_start_back(&mut self, now: MonoTime, is_offline: bool, out: Out<'_>) {
        let is_busy = self.latch.is_some() || self.current.is_some();
        if is_busy || is_offline || !self.start.is_due(now) {
            return;
        }
        self.start.attempt(now);
        self.cut_motion(Reason::NotReady, out);
        let Some(approved) = self.guard.take_start_back(now) else {
            return;
        };
        out.push_back(LineEffect::Note(self.drive, DriveNote::StartTakenBack));
        self.waiting.push_front(CommandExecution::new(
            approved,
            ReportWaiter::of_nobody(self.drive),
        ));
    }
}
