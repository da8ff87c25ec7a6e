//! Words that must not remain in the drive although they have done their part. No run word of a start that the drive has not
//! followed is left standing: the drive would obey it later. While the reset word may remain, that is remembered across
//! restarts, and the word is cleared as soon as the motor is at standstill and nothing else is ordered.

use super::{DriveWork, Out};
use crate::domain::command::{Order, Reason, RunIntent};
use crate::domain::time::MonoTime;
use crate::gateway::event::LineEffect;
use crate::gateway::execution::CommandExecution;
use crate::gateway::note::DriveNote;
use crate::gateway::waiter::ReportWaiter;
use crate::journal::{JournalEntry, RowNumber};
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

    /// Records whether the reset word may remain from now on, if that has changed. Returns its row.
    pub fn keep_reset(&mut self, out: Out<'_>) -> Option<RowNumber> {
        let resets = |execution: &CommandExecution| *execution.order() == Order::Reset;
        let may_stand = self.reset.stands || self.current.iter().chain(&self.waiting).any(resets);
        if may_stand == self.said_reset {
            return None;
        }
        self.said_reset = may_stand;
        out.keep(self.drive, JournalEntry::ResetWord { may_stand })
    }

    /// A previous run of the gateway may have left the reset word.
    pub(super) fn remember_reset(&mut self, may_stand: bool) {
        self.said_reset = may_stand;
        self.reset.stands = may_stand && self.guard.leaves_a_reset_standing();
    }

    /// Clears the reset word if it may remain and nothing else is in progress. A turning motor is left alone: the reset
    /// word is not what it obeys. In a register of its own the word is cleared before the next order, whether or not the
    /// motor turns: the next trip would be reset by it.
    pub(super) fn take_reset_back(&mut self, now: MonoTime, is_offline: bool, out: Out<'_>) {
        let is_apart = !self.model.replaces_reset(OrderKind::Stop);
        let is_busy = self.latch.is_some()
            || self.current.is_some()
            || !(is_apart || self.waiting.is_empty());
        let is_at_rest =
            self.is_at_standstill() && !matches!(self.guard.intent(), RunIntent::Run(_));
        let may_go = if is_apart { !is_offline } else { is_at_rest };
        if is_busy || !may_go || !self.reset.is_due(now) {
            return;
        }
        self.reset.attempt(now);
        let Some(approved) = self.guard.take_reset_back() else {
            return;
        };
        out.push_back(LineEffect::Note(self.drive, DriveNote::ResetTakenBack));
        self.waiting.push_front(CommandExecution::new(
            approved,
            ReportWaiter::of_nobody(self.drive),
        ));
    }

    /// The word of the order `kind` was written: it replaces the reset word where both are in one register.
    pub(super) fn replaces_reset(&mut self, kind: OrderKind) {
        self.reset.stands &= !self.model.replaces_reset(kind);
    }

    /// The reset's register holds a word other than the reset word.
    pub(super) const fn reset_is_taken_back(&mut self) {
        self.reset.stands = false;
    }
}
