//! The commands and stops of a drive: their review, their wishes for the wire, and what follows from the ends of exchanges.

use super::followed::FollowWatch;
use super::queue::{DriveWish, WishRank, moves};
use super::reports::Out;
use super::{COMMANDS_MAX, DriveWork};
use crate::domain::command::{
    CommandRequest, Direction, Order, OrderManner, Outcome, Owner, Reason, Report,
};
use crate::domain::fail_safe::FailSafeRun;
use crate::domain::ids::AskerId;
use crate::domain::time::MonoTime;
use crate::drive::steps::StepPart;
use crate::gateway::execution::{CommandExecution, StepResult};
use crate::gateway::note::DriveNote;
use crate::gateway::waiter::ReportWaiter;
use crate::guard::{Approved, CommandVerdict, DriveFacts, LossAction, StopOrder, VoidApproval};
use crate::journal::{JournalEntry, TriedWrite};
use crate::line::exchange::ExchangeEnding;
use crate::profile::model::OrderKind;
use crate::wire::pdu::Request;

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
        self.mark_changed();
        let is_full = self.queue.waiting() >= COMMANDS_MAX
            && !(command.order.is_stop() || command.order.is_no_attempt());
        let owner = command.origin.owner;
        let tried = || TriedWrite::Order(command.order.clone());
        let runs_by_others = self.stop.runs_by_others(&self.motor, &self.guard);
        let verdict = if is_full {
            Err(Report::refused(Reason::QueueFull))
        } else {
            self.guard.review(command, &facts, now)
        };
        match verdict {
            Err(report) => {
                if !command.order.is_no_attempt() {
                    self.reports.count(&mut waiter);
                    out.attempt_ended(self.reports.drive(), owner, tried(), report);
                }
                self.reports.tell(&mut waiter, report, true, out);
            }
            Ok(CommandVerdict::Unchanged) => {
                let report = Report::new(Outcome::Acknowledged, Reason::Unchanged);
                let repeats =
                    command.origin.manner == OrderManner::Cyclic && command.order != Order::Take;
                if !repeats && !command.order.is_no_attempt() {
                    out.attempt_ended(self.reports.drive(), owner, tried(), report);
                }
                if command.order.is_stop() {
                    self.stop.was_answered(command);
                }
                out.tell(&mut waiter, report, true);
            }
            Ok(CommandVerdict::JoinsStop) => {
                if let Some(latch) = self.stop.latch_mut() {
                    latch.join(waiter, out);
                }
            }
            Ok(CommandVerdict::StopAgain(order)) => self.stop_by(order, Some(waiter), now, out),
            Ok(CommandVerdict::Stop(order)) => {
                if runs_by_others {
                    self.stop.is_stopped_by(owner, &self.reports, now, out);
                }
                self.followed = FollowWatch::default();
                self.reports.count(&mut waiter);
                out.attempt_taken(self.reports.drive(), owner, tried(), &mut waiter);
                self.stop_by(order, Some(waiter), now, out);
            }
            Ok(CommandVerdict::Taken(from)) => {
                self.reports.count(&mut waiter);
                self.taken(from, owner, out);
                let report = Report::new(Outcome::Acknowledged, Reason::None);
                self.reports.tell(&mut waiter, report, true, out);
            }
            Ok(CommandVerdict::Go(approved)) => {
                self.reports.count(&mut waiter);
                out.attempt_taken(self.reports.drive(), owner, tried(), &mut waiter);
                self.go(approved, waiter, now, out);
            }
        }
    }

    /// Puts an approved order in the queue. What was known of an earlier stop no longer explains what the motor does.
    fn go(&mut self, approved: Approved, waiter: ReportWaiter, now: MonoTime, out: Out<'_>) {
        let runs = matches!(approved.order(), Order::Go(go) if go.run().is_some());
        if runs {
            self.stop.ends_stopping();
            // Newer than a stop answered from memory.
            self.stop.answer_is_outdated();
            self.followed = FollowWatch::default();
        }
        self.opening
            .open_lease(runs, &self.guard, &self.reports, now, out);
        let execution = CommandExecution::new(approved, waiter);
        self.queue.push(execution, &mut self.reports, out);
        if let Some(row) = self.words.keep_reset(&self.queue, &self.reports, out) {
            self.opening.opens_behind(row, now);
        }
    }

    /// Stops the drive by `order`, which cancels everything else that was ordered.
    pub(super) fn stop_by(
        &mut self,
        order: StopOrder,
        waiter: Option<ReportWaiter>,
        now: MonoTime,
        out: Out<'_>,
    ) {
        self.cut(now, out);
        self.stop.begin(order, waiter, now, &self.reports, out);
    }

    /// A stop cancels everything else that was ordered.
    fn cut(&mut self, now: MonoTime, out: Out<'_>) {
        let is_on_the_wire = self.queue.is_on_the_wire();
        self.leave_flight(out);
        // A drive that was reset still ignores requests.
        let rest = self
            .queue
            .current()
            .and_then(|execution| execution.rest_to_come(is_on_the_wire));
        self.rest_until = rest.map(|rest| now + rest).or(self.rest_until);
        for mut execution in self.queue.take_all() {
            // The effect of a stop on the motor is known; whether a register took its value is not.
            let is_register = matches!(execution.order(), Order::Go(go) if go.run().is_none() && go.frequency().is_none());
            let outcome = if is_register && execution.has_begun() {
                Outcome::Unknown
            } else {
                Outcome::Superseded
            };
            let report = Report::new(outcome, Reason::Stopped);
            self.reports.tell(execution.waiter(), report, true, out);
        }
    }

    /// Cancels every order to move: it has no owner any more, or the drive cannot follow it.
    pub(super) fn cut_motion(&mut self, reason: Reason, out: Out<'_>) {
        if self.queue.current().is_some_and(moves) {
            self.leave_flight(out);
        }
        let cut = self.queue.take_if(moves);
        self.interrupt(cut, reason, out);
    }

    /// Ends `executions` for a `reason` that says nothing of their effect.
    fn interrupt(
        &mut self,
        executions: impl IntoIterator<Item = CommandExecution>,
        reason: Reason,
        out: Out<'_>,
    ) {
        for mut execution in executions {
            let outcome = if execution.has_begun() {
                Outcome::Unknown
            } else {
                Outcome::Refused
            };
            let report = Report::new(outcome, reason);
            self.reports.tell(execution.waiter(), report, true, out);
        }
    }

    /// The client `asker` is gone: its commands that have not begun are dropped. A stop is not an execution and stays. Returns
    /// the number of dropped commands.
    pub fn withdraw(&mut self, asker: AskerId, out: Out<'_>) -> u64 {
        let report = Report::refused(Reason::CommanderLost);
        self.withdraw_all(|execution| execution.is_of(asker), report, out)
    }

    /// Control was taken over: orders of the previous owner that have not begun are dropped, the rest continues.
    fn taken(&mut self, from: Option<Owner>, by: Owner, out: Out<'_>) {
        self.reports.note(DriveNote::Taken { from, by }, out);
        let is_theirs = |execution: &CommandExecution| Some(execution.owner()) == from;
        self.withdraw_all(is_theirs, Report::held_by(by), out);
    }

    fn withdraw_all(
        &mut self,
        goes: impl Fn(&CommandExecution) -> bool,
        report: Report,
        out: Out<'_>,
    ) -> u64 {
        let goes = |execution: &CommandExecution| goes(execution) && !execution.has_begun();
        let mut count = 0;
        for mut execution in self.queue.take_if(goes) {
            count += 1;
            self.finish(&mut execution, report, out);
        }
        count
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
            self.queue.left_undone(execution, &mut self.guard);
        }
        self.reports.tell(execution.waiter(), report, true, out);
    }

    pub(super) fn void(&mut self, void: VoidApproval, out: Out<'_>) {
        let Some(mut execution) = self.queue.take_current() else {
            return;
        };
        let report = match void {
            VoidApproval::Stopped => Report::new(Outcome::Superseded, Reason::Stopped),
            VoidApproval::TooLate => Report::new(Outcome::Expired, Reason::TooLate),
        };
        self.finish(&mut execution, report, out);
    }

    pub(super) fn fail_safe(&mut self, lost: LossAction, now: MonoTime, out: Out<'_>) {
        self.mark_changed();
        let LossAction {
            owner,
            action,
            cause,
            order,
        } = lost;
        let entry = JournalEntry::FailSafe {
            owner,
            action,
            cause,
        };
        self.reports.keep(entry, out);
        let Some(order) = order else {
            return self.cut_motion(Reason::CommanderLost, out);
        };
        self.stop_by(order, None, now, out);
        if let Some(latch) = self.stop.latch_mut() {
            latch.was_declared(now);
        }
    }

    /// The declared action has come further, if any has.
    fn fail_safe_came(&mut self, run: Option<FailSafeRun>, out: Out<'_>) {
        if let Some(run) = run {
            self.mark_changed();
            self.reports.note(DriveNote::FailSafeCame(run), out);
            self.reports.keep(JournalEntry::FailSafeCame(run), out);
        }
    }

    /// A stop took effect, or is not sent any more.
    pub(super) fn stop_is_over(&mut self, is_effective: bool, out: Out<'_>) {
        let over = self.guard.stop_is_over(is_effective);
        self.fail_safe_came(over, out);
        self.reports
            .keep(JournalEntry::StopOver { is_effective }, out);
    }

    /// A stop that had no effect is not sent any more; those who wait for it get `report`. An equal one is a new one.
    pub(super) fn drop_stop(&mut self, report: Report, out: Out<'_>) {
        let Some(mut latch) = self.stop.drop_latch() else {
            return;
        };
        self.stop_is_over(false, out);
        self.reports.tell_all(latch.waiters(), report, out);
    }

    /// There is no port to send to: clients that wait for a stop are informed at once. The stop stays pending.
    pub fn stop_waits_for_the_line(&mut self, out: Out<'_>) {
        if let Some(latch) = self.stop.latch_mut() {
            let report = Report::new(Outcome::Unknown, Reason::LineDown);
            self.reports.tell_all(latch.waiters(), report, out);
        }
    }

    /// The frame of the stop may have met another one: it is sent again as soon as the line allows.
    pub fn stop_again_at(&mut self, now: MonoTime) {
        if let Some(latch) = self.stop.latch_mut() {
            latch.send_again_at(now);
        }
    }

    /// Its wishes for the wire.
    pub fn wants(&self) -> impl Iterator<Item = DriveWish> + '_ {
        let [stop, look] = self.stop.wants();
        let execution = self.queue.wants(&self.opening);
        let trip = self.trips.wants().map(|(address, count)| DriveWish {
            rank: WishRank::Trip,
            at: MonoTime::ZERO,
            request: Request::Read { address, count },
        });
        [stop, execution, look, trip].into_iter().flatten()
    }

    /// Sends the wish of `rank` at `now`. If its deadline has passed, it is answered and nothing is sent.
    pub fn send(&mut self, rank: WishRank, now: MonoTime, out: Out<'_>) -> bool {
        match rank {
            WishRank::Step | WishRank::Start => {
                let Some(execution) = self.queue.next_to_send() else {
                    return false;
                };
                if let Err(void) = execution.may_go(now, self.guard.stops()) {
                    self.void(void, out);
                    return false;
                }
                execution.was_sent();
                self.words.was_sent(execution, self.motor.model());
            }
            WishRank::FirstStop | WishRank::RepeatedStop | WishRank::Look | WishRank::Trip => {}
        }
        self.queue.was_sent(rank);
        self.mark_changed();
        true
    }

    /// The frame of its stop was handed to the port, which took until `now`. Before `hears_from` the drive may not hear it. A
    /// frame that was only decided on was not sent.
    pub fn stop_was_transmitted(&mut self, now: MonoTime, hears_from: MonoTime, out: Out<'_>) {
        if let Some(latch) = self.stop.latch_mut() {
            latch.was_sent(now, hears_from);
            let sent = self.guard.stop_was_sent();
            self.fail_safe_came(sent, out);
        }
    }

    /// Its stop was broadcast. Returns when the stop was accepted, if it had not been sent before.
    pub fn stop_was_broadcast(&mut self, out: Out<'_>) -> Option<MonoTime> {
        let latch = self.stop.latch_mut()?;
        let is_first = latch.unsent().is_some();
        let accepted_at = latch.was_broadcast(out.now());
        let sent = self.guard.stop_was_sent();
        self.fail_safe_came(sent, out);
        is_first.then_some(accepted_at)
    }

    /// The exchange of `request` for the wish of `rank` is over. `doubt`: its reply may have been a late reply to another
    /// request.
    pub fn ended(
        &mut self,
        rank: WishRank,
        request: &Request,
        ending: &ExchangeEnding,
        doubt: bool,
        now: MonoTime,
        out: Out<'_>,
    ) {
        let is_wanted = self.queue.exchange_ended();
        self.mark_changed();
        match rank {
            // A coast may have replaced the stop that was on the wire: its own frame follows.
            WishRank::FirstStop | WishRank::RepeatedStop if !self.is_latched(request) => {}
            WishRank::FirstStop | WishRank::RepeatedStop => {
                let (model, reports) = (self.motor.model(), &mut self.reports);
                let written = self.stop.ended(ending, doubt, model, now, reports, out);
                if let Some(kind) = written {
                    self.words.replaces(kind, model);
                }
            }
            WishRank::Step | WishRank::Start if is_wanted => self.step_ended(ending, now, out),
            WishRank::Step | WishRank::Start => {}
            WishRank::Look => self.stop.looked(ending, now),
            WishRank::Trip => {
                if !matches!(ending, ExchangeEnding::Reply(_)) {
                    let event = self.trips.read_failed();
                    self.trip(event, out);
                }
            }
        }
    }

    fn is_latched(&self, request: &Request) -> bool {
        self.latch()
            .is_some_and(|latch| latch.frame().1 == *request)
    }

    fn step_ended(&mut self, ending: &ExchangeEnding, now: MonoTime, out: Out<'_>) {
        let Some(mut execution) = self.queue.take_current() else {
            return;
        };
        let written: Vec<StepPart> = execution
            .present_writes()
            .iter()
            .map(|write| write.part)
            .collect();
        let reads_identity = execution.reads_identity();
        let in_question = execution.parts_in_question();
        let mut next = match ending {
            ExchangeEnding::Reply(reply) => execution.answered(reply, now),
            ExchangeEnding::Exception(code) => {
                execution.excepted(*code, self.motor.model().exception_kind(*code))
            }
            ExchangeEnding::Silent => execution
                .silent_as_announced(now)
                .unwrap_or_else(|| execution.unanswered()),
            ExchangeEnding::Garbled => execution.unanswered(),
        };
        if reads_identity
            && matches!(
                (ending, next),
                (ExchangeEnding::Reply(_), StepResult::Goes(_))
            )
        {
            self.guard.was_identified();
        }
        if matches!(ending, ExchangeEnding::Garbled | ExchangeEnding::Silent) {
            for part in &written {
                self.part_in_doubt(*part, out);
            }
        }
        let outcome = match next {
            StepResult::Ends(report) => Some(report.outcome),
            StepResult::Goes(_) => None,
        };
        let (owner, is_sure) = (execution.owner(), execution.is_sure());
        if outcome == Some(Outcome::Confirmed) {
            for part in in_question {
                self.part_taken(part, owner, is_sure, out);
            }
        }
        if matches!(ending, ExchangeEnding::Reply(_)) && outcome != Some(Outcome::Failed) {
            for part in written {
                self.part_taken(part, owner, is_sure, out);
            }
        }
        if let (StepResult::Goes(report), Some((until, is_deaf))) = (next, execution.rest_at(now)) {
            if is_deaf {
                self.rest_until = Some(until);
            }
            next = match execution.rest(until) {
                StepResult::Goes(later) => StepResult::Goes(report.or(later)),
                ends @ StepResult::Ends(_) => ends,
            };
        }
        self.goes_on(execution, next, out);
    }

    /// The execution waits for its next step, or is over.
    fn goes_on(&mut self, mut execution: CommandExecution, next: StepResult, out: Out<'_>) {
        match next {
            StepResult::Goes(report) => {
                if let Some(report) = report {
                    self.reports.tell(execution.waiter(), report, false, out);
                }
                self.queue.goes_on(execution);
            }
            StepResult::Ends(report) => {
                if report.reason == Reason::SetpointUnknown && *execution.order() == Order::Reset {
                    // The reset word is not in the register.
                    self.words.reset_is_taken_back();
                } else if report.reason == Reason::SetpointUnknown {
                    self.reports.note(DriveNote::SetpointOutside, out);
                }
                self.finish(&mut execution, report, out);
            }
        }
    }

    /// Stops waiting for the exchange on the wire; the drive may still execute it.
    fn leave_flight(&mut self, out: Out<'_>) {
        for part in self.queue.leave_flight() {
            self.part_in_doubt(part, out);
        }
    }

    fn part_in_doubt(&mut self, part: StepPart, out: Out<'_>) {
        match part {
            StepPart::Run(direction) => {
                self.starts(out);
                self.guard.run_is_unknown(direction);
            }
            StepPart::Direction(direction) => self.may_turn_round(direction),
            StepPart::Setpoint(_) => self.guard.setpoint_is_unknown(),
            StepPart::SignedSetpoint(_, direction) => {
                self.guard.setpoint_is_unknown();
                self.may_turn_round(direction);
            }
            StepPart::Reset { .. } => self.guard.setpoint_may_be_lost(),
            StepPart::Start
            | StepPart::Register
            | StepPart::Commit
            | StepPart::Release
            | StepPart::TakesBack
            | StepPart::TakesStartBack => {}
        }
    }

    fn part_taken(&mut self, part: StepPart, owner: Owner, is_sure: bool, out: Out<'_>) {
        if let Some(value) = part.setpoint() {
            self.guard
                .setpoint_was_acknowledged(owner, value, out.now());
        }
        match part {
            StepPart::Run(direction) => {
                self.starts(out);
                let model = self.motor.model();
                self.words.replaces_reset(OrderKind::Forward, model);
                self.guard.run_was_acknowledged(direction);
            }
            StepPart::Direction(direction) | StepPart::SignedSetpoint(_, direction) => {
                self.may_turn_round(direction);
            }
            StepPart::Release => {
                let model = self.motor.model();
                self.words.replaces(OrderKind::Release, model);
            }
            StepPart::TakesStartBack => self.words.start_is_taken_back(),
            StepPart::TakesBack => self.words.reset_is_taken_back(),
            StepPart::Reset { ends: true, .. } => {
                self.words.reset_is_taken_back();
                self.guard.setpoint_may_be_lost();
                if is_sure {
                    self.trips.reset_acknowledged();
                }
            }
            StepPart::Setpoint(_)
            | StepPart::Start
            | StepPart::Register
            | StepPart::Commit
            | StepPart::Reset { .. } => {}
        }
    }

    /// The direction, or a setpoint with its sign, was written: a motor that turns follows it at once.
    fn may_turn_round(&mut self, direction: Direction) {
        if self.is_moving() {
            self.guard.run_is_unknown(direction);
        }
    }

    /// RUN was sent: unless the motor turns already, it starts. Out of sight it may do so from now on, whatever a person
    /// confirmed before.
    fn starts(&mut self, out: Out<'_>) {
        self.heard.run_was_sent();
        if !self.motor.output().is_active() {
            self.guard.started(out.now());
        }
        if self.sight.ordered() {
            self.may_still_run(out);
        }
    }

    /// The line is down, or another gateway's, as `reason` says: waiting work is not sent, the exchange on the wire is in doubt.
    /// A stop keeps waiting.
    pub fn line_down(&mut self, now: MonoTime, reason: Reason, out: Out<'_>) {
        self.leave_flight(out);
        // What is ordered is forgotten below. Another gateway that has the line sees the drive.
        if reason == Reason::Standby {
            self.motor.set_turned(false);
        } else {
            self.lose_sight(out);
        }
        self.queue.exchange_ended();
        if let Some(latch) = self.stop.latch_mut() {
            latch.unanswered(now);
        }
        for mut execution in self.queue.take_all() {
            let report = if execution.has_begun() {
                Report::new(Outcome::Unknown, Reason::NoReply)
            } else {
                Report::refused(reason)
            };
            self.finish(&mut execution, report, out);
        }
        self.forget_readings(out);
    }

    /// The line is left: work in progress ends here.
    pub fn end_attempts(&mut self, out: Out<'_>) {
        let all = self.queue.take_all();
        self.interrupt(all, Reason::ShuttingDown, out);
        let unread = self.trips.tell_unread();
        self.trip(unread, out);
        self.usage.keep(out);
        if let Some(latch) = self.stop.latch_mut() {
            let report = latch.late_report();
            self.reports.tell_all(latch.waiters(), report, out);
        }
    }
}
