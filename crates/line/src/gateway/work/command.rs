//! Commands for a drive: their review, and the fate of queued ones.

use super::WishRank;
use super::{COMMANDS_MAX, DriveWork, Out};
use crate::domain::command::{CommandRequest, Order, OrderManner, Outcome, Owner, Reason, Report};
use crate::domain::fail_safe::FailSafeRun;
use crate::domain::ids::AskerId;
use crate::domain::time::MonoTime;
use crate::drive::steps::StepPart;
use crate::gateway::event::LineEffect;
use crate::gateway::execution::CommandExecution;
use crate::gateway::note::DriveNote;
use crate::gateway::stop::StopLatch;
use crate::gateway::waiter::ReportWaiter;
use crate::guard::{Approved, CommandVerdict, DriveFacts, LossAction, StopOrder};
use crate::journal::{JournalEntry, TriedWrite};
use std::collections::VecDeque;

impl DriveWork {
    /// Handles a command.
    pub fn command(
        &mut self,
        now: MonoTime,
        command: &CommandRequest,
        mut waiter: ReportWaiter,
        facts: DriveFacts,
        out: Out<'_>,
    ) {
        self.has_changed = true;
        let is_full = self.waiting.len() >= COMMANDS_MAX
            && !(command.order.is_stop() || command.order.is_no_attempt());
        let owner = command.origin.owner;
        let tried = || TriedWrite::Order(command.order.clone());
        let runs_by_others = self.runs_by_others();
        let verdict = if is_full {
            Err(Report::refused(Reason::QueueFull))
        } else {
            self.guard.review(command, &facts, now)
        };
        match verdict {
            Err(report) => {
                if !command.order.is_no_attempt() {
                    self.count(&mut waiter);
                    out.attempt_ended(self.drive, owner, tried(), report);
                }
                self.tell(&mut waiter, report, true, out);
            }
            Ok(CommandVerdict::Unchanged) => {
                let report = Report::new(Outcome::Acknowledged, Reason::Unchanged);
                let repeats =
                    command.origin.manner == OrderManner::Cyclic && command.order != Order::Take;
                if !repeats && !command.order.is_no_attempt() {
                    out.attempt_ended(self.drive, owner, tried(), report);
                }
                if command.order.is_stop() {
                    self.was_answered(command);
                }
                out.tell(&mut waiter, report, true);
            }
            Ok(CommandVerdict::JoinsStop) => self.join_stop(waiter, out),
            Ok(CommandVerdict::StopAgain(order)) => {
                self.cut(now, out);
                self.is_stopping = true;
                self.stop(order, Some(waiter), now, out);
            }
            Ok(CommandVerdict::Stop(order)) => {
                if runs_by_others {
                    self.is_stopped_by(owner, now, out);
                }
                self.restart_follow_watch();
                self.count(&mut waiter);
                out.attempt_taken(self.drive, owner, tried(), &mut waiter);
                self.cut(now, out);
                self.is_stopping = true;
                self.stop(order, Some(waiter), now, out);
            }
            Ok(CommandVerdict::Taken(from)) => {
                self.count(&mut waiter);
                self.taken(from, command.origin.owner, out);
                self.tell(
                    &mut waiter,
                    Report::new(Outcome::Acknowledged, Reason::None),
                    true,
                    out,
                );
            }
            Ok(CommandVerdict::Go(approved)) => {
                self.count(&mut waiter);
                out.attempt_taken(self.drive, owner, tried(), &mut waiter);
                self.go(approved, waiter, now, out);
            }
        }
    }

    /// Puts an approved order in the queue. What was known of an earlier stop no longer explains what the motor does.
    fn go(&mut self, approved: Approved, waiter: ReportWaiter, now: MonoTime, out: Out<'_>) {
        let runs = matches!(approved.order(), Order::Go(go) if go.run().is_some());
        self.is_stopping &= !runs;
        if runs {
            // Newer than a stop answered from memory.
            self.answered = None;
            self.restart_follow_watch();
        }
        self.open_lease(runs, now, out);
        self.push(CommandExecution::new(approved, waiter), out);
        if let Some(row) = self.keep_reset(out) {
            self.opens_behind(row, now);
        }
    }

    /// Runs the declared action because the gateway shuts down.
    pub fn shut_down(&mut self, now: MonoTime, out: Out<'_>) {
        if let Some(lost) = self.guard.shut_down(now) {
            out.push_back(LineEffect::Note(
                self.drive,
                DriveNote::ShuttingDown(lost.action),
            ));
            self.fail_safe(lost, now, out);
        }
    }

    pub(super) fn push(&mut self, execution: CommandExecution, out: Out<'_>) {
        while let Some(at) = self
            .waiting
            .iter()
            .position(|old| old.is_replaced_by(&execution))
        {
            if let Some(mut old) = self.waiting.remove(at) {
                self.tell(
                    old.waiter(),
                    Report::new(Outcome::Superseded, Reason::Newer),
                    true,
                    out,
                );
            }
        }
        self.waiting.push_back(execution);
    }

    pub(super) fn join_stop(&mut self, waiter: ReportWaiter, out: Out<'_>) {
        if let Some(latch) = &mut self.latch {
            latch.join(waiter, out);
        }
    }

    /// There is no port to send to: clients that wait for a stop are informed at once. The stop stays pending.
    pub fn stop_waits_for_the_line(&mut self, out: Out<'_>) {
        let waiters = self
            .latch
            .as_mut()
            .map(|latch| std::mem::take(latch.waiters()));
        for mut waiter in waiters.into_iter().flatten() {
            self.tell(
                &mut waiter,
                Report::new(Outcome::Unknown, Reason::LineDown),
                true,
                out,
            );
        }
    }

    /// Cancels every order to move: it has no owner any more, or the drive cannot follow it.
    pub(super) fn cut_motion(&mut self, reason: Reason, out: Out<'_>) {
        let moves = |execution: &CommandExecution| matches!(execution.order(), Order::Go(go) if go.run().is_some() || go.frequency().is_some());
        let is_current = self.current.as_ref().is_some_and(moves);
        if is_current {
            self.leave_flight(out);
        }
        let current = if is_current {
            self.current.take()
        } else {
            None
        };
        let (cut, kept) = std::mem::take(&mut self.waiting)
            .into_iter()
            .partition::<VecDeque<_>, _>(moves);
        self.waiting = kept;
        for mut execution in current.into_iter().chain(cut) {
            let outcome = if execution.has_begun() {
                Outcome::Unknown
            } else {
                Outcome::Refused
            };
            self.tell(execution.waiter(), Report::new(outcome, reason), true, out);
        }
    }

    /// The client `asker` is gone: its commands that have not begun are dropped. A stop is not an execution and stays. Returns
    /// the number of dropped commands.
    pub fn withdraw(&mut self, asker: AskerId, out: Out<'_>) -> u64 {
        self.withdraw_all(
            |execution| execution.is_of(asker),
            Report::refused(Reason::CommanderLost),
            out,
        )
    }

    /// Control was taken over: orders of the previous owner that have not begun are dropped, the rest continues.
    fn taken(&mut self, from: Option<Owner>, by: Owner, out: Out<'_>) {
        out.push_back(LineEffect::Note(self.drive, DriveNote::Taken { from, by }));
        self.withdraw_all(
            |execution| Some(execution.owner()) == from,
            Report::held_by(by),
            out,
        );
    }

    fn withdraw_all(
        &mut self,
        goes: impl Fn(&CommandExecution) -> bool,
        report: Report,
        out: Out<'_>,
    ) -> u64 {
        let goes = |execution: &CommandExecution| goes(execution) && !execution.has_begun();
        let current = self.current.take_if(|execution| goes(execution));
        if current.is_some() && matches!(self.flight, Some(WishRank::Step | WishRank::Start)) {
            self.flight = None;
        }
        let (gone, kept) = std::mem::take(&mut self.waiting)
            .into_iter()
            .partition::<VecDeque<_>, _>(goes);
        self.waiting = kept;
        let mut count = 0;
        for mut execution in current.into_iter().chain(gone) {
            count += 1;
            self.finish(&mut execution, report, out);
        }
        count
    }

    /// A stop cancels everything else that was ordered.
    pub(super) fn cut(&mut self, now: MonoTime, out: Out<'_>) {
        let is_on_the_wire = matches!(self.flight, Some(WishRank::Step | WishRank::Start));
        self.leave_flight(out);
        // A drive that was reset still ignores requests.
        let rest = self
            .current
            .as_ref()
            .and_then(|execution| execution.rest_to_come(is_on_the_wire));
        self.rest_until = rest.map(|rest| now + rest).or(self.rest_until);
        for mut execution in self
            .current
            .take()
            .into_iter()
            .chain(std::mem::take(&mut self.waiting))
        {
            // The effect of a stop on the motor is known; whether a register took its value is not.
            let is_register = matches!(execution.order(), Order::Go(go) if go.run().is_none() && go.frequency().is_none());
            let outcome = if is_register && execution.has_begun() {
                Outcome::Unknown
            } else {
                Outcome::Superseded
            };
            self.tell(
                execution.waiter(),
                Report::new(outcome, Reason::Stopped),
                true,
                out,
            );
        }
    }

    pub(super) fn fail_safe(&mut self, lost: LossAction, now: MonoTime, out: Out<'_>) {
        self.has_changed = true;
        let LossAction {
            owner,
            action,
            cause,
            ..
        } = lost;
        out.keep(
            self.drive,
            JournalEntry::FailSafe {
                owner,
                action,
                cause,
            },
        );
        let Some(order) = lost.order else {
            return self.cut_motion(Reason::CommanderLost, out);
        };
        self.cut(now, out);
        self.is_stopping = true;
        self.stop(order, None, now, out);
        if let Some(latch) = &mut self.latch {
            latch.was_declared(now);
        }
    }

    /// The declared action has come further, if any has.
    pub(super) fn fail_safe_came(&mut self, run: Option<FailSafeRun>, out: Out<'_>) {
        if let Some(run) = run {
            self.has_changed = true;
            out.push_back(LineEffect::Note(self.drive, DriveNote::FailSafeCame(run)));
            out.keep(self.drive, JournalEntry::FailSafeCame(run));
        }
    }

    pub(super) fn stop(
        &mut self,
        order: StopOrder,
        waiter: Option<ReportWaiter>,
        now: MonoTime,
        out: Out<'_>,
    ) {
        let coast = order.is_coast();
        let is_new = match &mut self.latch {
            Some(latch) => latch.also(order, waiter, now, out),
            latch @ None => {
                *latch = Some(StopLatch::new(order, waiter, now));
                true
            }
        };
        if is_new {
            out.keep(self.drive, JournalEntry::StopPending { coast });
        }
    }

    /// The execution is over: unfinished orders are no longer part of the intent.
    pub(super) fn finish(
        &mut self,
        execution: &mut CommandExecution,
        report: Report,
        out: Out<'_>,
    ) {
        if matches!(
            report.outcome,
            Outcome::Refused | Outcome::Expired | Outcome::Failed | Outcome::Superseded
        ) {
            for part in execution.parts_left() {
                match part {
                    StepPart::Run(direction) => {
                        let still_ordered = self.last_left(|_, part| match part {
                            StepPart::Run(direction) => Some(direction),
                            _ => None,
                        });
                        self.guard.run_failed(direction, still_ordered);
                    }
                    StepPart::Setpoint(value) | StepPart::SignedSetpoint(value, _) => {
                        let still_ordered = self.last_left(|execution, part| {
                            Some((execution.owner(), part.setpoint()?))
                        });
                        self.guard.setpoint_failed(value, still_ordered);
                    }
                    StepPart::Start
                    | StepPart::Direction(_)
                    | StepPart::TakesStartBack
                    | StepPart::Register
                    | StepPart::Commit
                    | StepPart::Reset { .. }
                    | StepPart::Release
                    | StepPart::TakesBack => {}
                }
            }
        }
        self.tell(execution.waiter(), report, true, out);
    }

    /// The newest value that `of` finds in the orders still to be sent.
    fn last_left<T>(&self, of: impl Fn(&CommandExecution, StepPart) -> Option<T>) -> Option<T> {
        let executions = self.current.iter().chain(&self.waiting);
        executions.rev().find_map(|execution| {
            execution
                .parts_left()
                .filter_map(|part| of(execution, part))
                .last()
        })
    }
}
