//! Words that must not remain in the drive although they have done their part. No run word of a start that the drive has not
//! followed is left standing: the drive would obey it later. While the reset word may remain, that is remembered across
//! restarts, and the word is cleared as soon as the motor is at standstill and nothing else is ordered.

use super::queue::OrderQueue;
use super::reports::{DriveReports, Out};
use crate::domain::command::Order;
use crate::domain::time::MonoTime;
use crate::gateway::execution::CommandExecution;
use crate::journal::{JournalEntry, RowNumber};
use crate::profile::model::{Model, OrderKind};
use std::time::Duration;

/// Time between two attempts to take it back.
const AGAIN_AFTER: Duration = Duration::from_secs(5);

/// A word that may stand in the drive.
#[derive(Debug, Default)]
struct StandingWord {
    stands: bool,
    /// The earliest moment to take it back.
    again_at: MonoTime,
}

impl StandingWord {
    /// Whether it is to be taken back at `now`: then the attempt begins.
    fn take_back(&mut self, now: MonoTime) -> bool {
        let is_due = self.stands && now >= self.again_at;
        if is_due {
            self.again_at = now + AGAIN_AFTER;
        }
        is_due
    }
}

/// The words that may stand in one drive.
#[derive(Debug, Default)]
pub(super) struct StandingWords {
    /// The reset word.
    reset: StandingWord,
    /// The last recorded state of the reset word.
    said_reset: bool,
    /// A start that the drive has not followed.
    start: StandingWord,
}

impl StandingWords {
    /// The next request of `execution` is sent.
    pub fn was_sent(&mut self, execution: &CommandExecution, model: &Model) {
        self.reset.stands |= execution.leaves_a_reset_standing();
        if execution.starts() && model.start_take_back().is_some() {
            // It may be taken back at once.
            self.start = StandingWord {
                stands: true,
                again_at: MonoTime::ZERO,
            };
        }
    }

    /// The drive shows that it runs: the effect of the run word, if that was the last word sent.
    pub fn runs_now(&mut self, current: Option<&CommandExecution>) {
        let runs = |execution: &CommandExecution| matches!(execution.order(), Order::Go(go) if go.run().is_some());
        let shows_it =
            current.is_some_and(|execution| runs(execution) && execution.is_reading_back());
        self.start.stands &= !shows_it;
    }

    /// The word of the order `kind` was written.
    pub fn replaces(&mut self, kind: OrderKind, model: &Model) {
        self.replaces_reset(kind, model);
        // It replaces that of a start where both are in one register.
        let is_same = model.order_address(kind) == model.order_address(OrderKind::Forward);
        self.start.stands &= !is_same;
    }

    /// The word of the order `kind` was written: it replaces the reset word where both are in one register.
    pub fn replaces_reset(&mut self, kind: OrderKind, model: &Model) {
        self.reset.stands &= !model.replaces_reset(kind);
    }

    /// The start is taken back.
    pub const fn start_is_taken_back(&mut self) {
        self.start.stands = false;
    }

    /// The reset's register holds a word other than the reset word.
    pub const fn reset_is_taken_back(&mut self) {
        self.reset.stands = false;
    }

    /// Whether the start is to be taken back now. If so, the next attempt is later.
    pub fn begin_start_back(&mut self, now: MonoTime) -> bool {
        self.start.take_back(now)
    }

    /// Whether the reset word is to be cleared now. If so, the next attempt is later.
    pub fn begin_reset_back(&mut self, now: MonoTime) -> bool {
        self.reset.take_back(now)
    }

    /// Records whether the reset word may remain from now on, if that has changed. Returns its row.
    pub fn keep_reset(
        &mut self,
        queue: &OrderQueue,
        reports: &DriveReports,
        out: Out<'_>,
    ) -> Option<RowNumber> {
        let resets = |execution: &CommandExecution| *execution.order() == Order::Reset;
        let may_stand = self.reset.stands || queue.iter().any(resets);
        if may_stand == self.said_reset {
            return None;
        }
        self.said_reset = may_stand;
        reports.keep(JournalEntry::ResetWord { may_stand }, out)
    }

    /// A previous run of the gateway may have left the reset word, where a reset of the model `leaves` one until it is cleared.
    pub fn remember(&mut self, may_stand: bool, leaves: bool) {
        self.said_reset = may_stand;
        self.reset.stands = may_stand && leaves;
    }
}
