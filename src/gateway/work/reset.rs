//! The reset word must not remain in the drive's run command. While it may, that is remembered across restarts, and the
//! word is cleared as soon as the motor is at standstill and nothing else is ordered.

use super::{DriveWork, Out};
use crate::domain::command::{Order, RunIntent};
use crate::domain::time::MonoTime;
use crate::gateway::event::LineEffect;
use crate::gateway::execution::CommandExecution;
use crate::gateway::note::DriveNote;
use crate::gateway::waiter::ReportWaiter;
use crate::journal::{JournalEntry, RowNumber};
use crate::profile::model::OrderKind;

impl DriveWork {
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
