//! A drive's wishes for the wire, and the consequences of its own exchanges.

use super::{DriveWish, DriveWork, Out, WishRank};
use crate::domain::command::{Direction, Order, Outcome, Owner, Reason, Report};
use crate::domain::time::MonoTime;
use crate::drive::steps::StepPart;
use crate::gateway::ended::BUSY_REST;
use crate::gateway::event::LineEffect;
use crate::gateway::execution::{CommandExecution, StepResult, reason_of};
use crate::gateway::note::DriveNote;
use crate::gateway::stop::StopLatch;
use crate::line::exchange::ExchangeEnding;
use crate::profile::model::{ExceptionKind, OrderKind};
use crate::wire::pdu::{Reply, Request};

impl DriveWork {
    /// Its wishes for the wire.
    pub fn wants(&self) -> impl Iterator<Item = DriveWish> + '_ {
        let stop = self.latch.as_ref().map(|latch| {
            let (at, request) = latch.frame();
            let rank = if latch.is_first() {
                WishRank::FirstStop
            } else {
                WishRank::RepeatedStop
            };
            DriveWish { rank, at, request }
        });
        let execution = self
            .current
            .as_ref()
            .or(self.waiting.front())
            .and_then(|execution| {
                let rank = if execution.is_new() {
                    WishRank::Start
                } else {
                    WishRank::Step
                };
                let (at, request) = execution.request()?;
                Some(DriveWish {
                    rank,
                    at: at.max(self.opens_at(execution)),
                    request,
                })
            });
        let look = self
            .latch
            .as_ref()
            .filter(|latch| latch.look_at() < MonoTime::NEVER)
            .and_then(|latch| {
                let (address, count) = self
                    .looks
                    .get(latch.looks() % self.looks.len().max(1))
                    .copied()?;
                let request = Request::Read { address, count };
                Some(DriveWish {
                    rank: WishRank::Look,
                    at: latch.look_at(),
                    request,
                })
            });
        let trip = self.trips.wants().map(|(address, count)| DriveWish {
            rank: WishRank::Trip,
            at: MonoTime::ZERO,
            request: Request::Read { address, count },
        });
        [stop, execution, look, trip].into_iter().flatten()
    }

    /// Whether a stop is not effective yet, or a command has not ended.
    #[must_use]
    pub fn has_orders(&self) -> bool {
        self.latch.is_some() || self.current.is_some() || !self.waiting.is_empty()
    }

    /// Sends the wish of `rank` at `now`. If its deadline has passed, it is answered and nothing is sent.
    pub fn send(&mut self, rank: WishRank, now: MonoTime, out: Out<'_>) -> bool {
        match rank {
            WishRank::Step | WishRank::Start => {
                if self.current.is_none() {
                    self.current = self.waiting.pop_front();
                }
                let Some(execution) = &mut self.current else {
                    return false;
                };
                if let Err(void) = execution.may_go(now, self.guard.stops()) {
                    self.void(void, out);
                    return false;
                }
                execution.was_sent();
                self.reset.stands |= execution.leaves_a_reset_standing();
                self.start_was_sent();
            }
            WishRank::FirstStop | WishRank::RepeatedStop | WishRank::Look | WishRank::Trip => {}
        }
        self.flight = Some(rank);
        self.has_changed = true;
        true
    }

    /// The frame of its stop was handed to the port, which took until `now`. One that was only decided on was not sent.
    pub fn stop_was_transmitted(&mut self, now: MonoTime, out: Out<'_>) {
        let Some(latch) = &mut self.latch else { return };
        latch.was_sent(now, self.deaf_until);
        let sent = self.guard.stop_was_sent();
        self.fail_safe_came(sent, out);
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
        let is_wanted = self.flight.take().is_some();
        self.has_changed = true;
        match rank {
            // A coast may have replaced the stop that was on the wire: its own frame follows.
            WishRank::FirstStop | WishRank::RepeatedStop if !self.is_latched(request) => {}
            WishRank::FirstStop | WishRank::RepeatedStop => {
                self.stop_ended(ending, doubt, now, out)
            }
            WishRank::Step | WishRank::Start if is_wanted => self.step_ended(ending, now, out),
            WishRank::Step | WishRank::Start => {}
            WishRank::Look => {
                let was_answered = matches!(
                    ending,
                    ExchangeEnding::Reply(_) | ExchangeEnding::Exception(_)
                );
                match &mut self.latch {
                    Some(latch) if was_answered => latch.was_looked_at(now),
                    Some(latch) => latch.look_failed(now),
                    None => {}
                }
            }
            WishRank::Trip => {
                if !matches!(ending, ExchangeEnding::Reply(_)) {
                    let event = self.trips.read_failed();
                    self.trip(event, out);
                }
            }
        }
    }

    /// The drive hears nothing until `moment`: a stop that is sent before is sent again then.
    pub fn is_deaf_until(&mut self, moment: MonoTime) {
        self.deaf_until = self.deaf_until.max(moment);
    }

    /// The stop that this drive waits for, if it has not been sent yet.
    #[must_use]
    pub fn unsent_stop(&self) -> Option<Request> {
        self.latch.as_ref().and_then(StopLatch::unsent)
    }

    /// The frame of the stop that is not effective yet, unless the drive is left to its watchdog at `now`.
    #[must_use]
    pub fn stop_frame(&self, now: MonoTime) -> Option<Request> {
        self.latch
            .as_ref()
            .filter(|latch| !latch.is_silent(now))
            .map(|latch| latch.frame().1)
    }

    /// Its stop was broadcast. Returns when the stop was accepted, if it had not been sent before.
    pub fn stop_was_broadcast(&mut self, out: Out<'_>) -> Option<MonoTime> {
        let latch = self.latch.as_mut()?;
        let is_first = latch.unsent().is_some();
        let accepted_at = latch.was_broadcast(out.now());
        let sent = self.guard.stop_was_sent();
        self.fail_safe_came(sent, out);
        is_first.then_some(accepted_at)
    }

    fn is_latched(&self, request: &Request) -> bool {
        self.latch
            .as_ref()
            .is_some_and(|latch| latch.frame().1 == *request)
    }

    /// The line is down, or another gateway's, as `reason` says: waiting work is not sent, the exchange on the wire is in doubt. A stop keeps waiting.
    pub fn line_down(&mut self, now: MonoTime, reason: Reason, out: Out<'_>) {
        self.leave_flight(out);
        // What is ordered is forgotten below. Another gateway that has the line sees the drive.
        if reason == Reason::Standby {
            self.has_turned = false;
        } else {
            self.lose_sight(out);
        }
        self.flight = None;
        if let Some(latch) = &mut self.latch {
            latch.unanswered(now);
        }
        for mut execution in self
            .current
            .take()
            .into_iter()
            .chain(std::mem::take(&mut self.waiting))
        {
            let report = if execution.has_begun() {
                Report::new(Outcome::Unknown, Reason::NoReply)
            } else {
                Report::refused(reason)
            };
            self.finish(&mut execution, report, out);
        }
        self.forget_readings(out);
    }

    pub(super) fn stop_ended(
        &mut self,
        ending: &ExchangeEnding,
        doubt: bool,
        now: MonoTime,
        out: Out<'_>,
    ) {
        let Some(latch) = &mut self.latch else { return };
        let failed = Report::new(Outcome::Failed, Reason::KeptOldValue);
        let refused = match ending {
            ExchangeEnding::Reply(Reply::Holds { value: held })
                if *held != latch.order().word() =>
            {
                Some(Report {
                    held: Some(*held),
                    ..failed
                })
            }
            // A busy drive has refused nothing.
            ExchangeEnding::Exception(code)
                if self.model.exception_kind(*code) == Some(ExceptionKind::Busy) =>
            {
                return latch.is_busy(now + BUSY_REST, now);
            }
            ExchangeEnding::Exception(code) => {
                let reason = reason_of(self.model.exception_kind(*code));
                Some(Report {
                    exception: Some(*code),
                    reason,
                    ..failed
                })
            }
            _ => None,
        };
        let kind = if latch.order().is_coast() {
            OrderKind::Coast
        } else {
            OrderKind::Stop
        };
        let (report, is_final) = match ending {
            _ if refused.is_some() => {
                self.is_stop_refused = true;
                let report = if latch.refused(now) { refused } else { None };
                (report, true)
            }
            ExchangeEnding::Reply(_) => {
                if !doubt {
                    self.replaces(kind);
                }
                let report = self
                    .latch
                    .as_mut()
                    .and_then(|latch| latch.echoed(now, doubt));
                (report, false)
            }
            ExchangeEnding::Exception(_) | ExchangeEnding::Garbled | ExchangeEnding::Silent => {
                latch.unanswered(now);
                (None, false)
            }
        };
        let Some(report) = report else { return };
        if is_final {
            self.stop_was_refused(now, out);
        }
        let Some(latch) = &mut self.latch else { return };
        let waiters = std::mem::take(latch.waiters());
        for mut waiter in waiters {
            self.tell(&mut waiter, report, is_final, out);
            let goes_on = !is_final && !waiter.is_done();
            if let (true, Some(latch)) = (goes_on, &mut self.latch) {
                latch.waiters().push(waiter);
            }
        }
    }

    /// The drive refuses every form of the stop that its model declares: reported at once, and only once.
    fn stop_was_refused(&mut self, now: MonoTime, out: Out<'_>) {
        self.stop_refused_at = Some(now);
        if !std::mem::replace(&mut self.is_refusal_reported, true) {
            out.push_back(LineEffect::Note(self.drive, DriveNote::StopRefused));
        }
    }

    pub(super) fn step_ended(&mut self, ending: &ExchangeEnding, now: MonoTime, out: Out<'_>) {
        let Some(mut execution) = self.current.take() else {
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
                execution.excepted(*code, self.model.exception_kind(*code))
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
            written
                .iter()
                .for_each(|part| self.part_in_doubt(*part, out));
        }
        if matches!(
            next,
            StepResult::Ends(Report {
                outcome: Outcome::Confirmed,
                ..
            })
        ) {
            in_question.into_iter().for_each(|part| {
                self.part_taken(part, execution.owner(), execution.is_sure(), out)
            });
        }
        let refused = matches!(
            next,
            StepResult::Ends(Report {
                outcome: Outcome::Failed,
                ..
            })
        );
        if matches!(ending, ExchangeEnding::Reply(_)) && !refused {
            written.into_iter().for_each(|part| {
                self.part_taken(part, execution.owner(), execution.is_sure(), out)
            });
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
                    self.tell(execution.waiter(), report, false, out);
                }
                self.current = Some(execution);
            }
            StepResult::Ends(report) => {
                if report.reason == Reason::SetpointUnknown && *execution.order() == Order::Reset {
                    // The reset word is not in the register.
                    self.reset_is_taken_back();
                } else if report.reason == Reason::SetpointUnknown {
                    out.push_back(LineEffect::Note(self.drive, DriveNote::SetpointOutside));
                }
                self.finish(&mut execution, report, out);
            }
        }
    }

    /// Stops waiting for the exchange on the wire; the drive may still execute it.
    pub(super) fn leave_flight(&mut self, out: Out<'_>) {
        if !matches!(self.flight, Some(WishRank::Step | WishRank::Start)) {
            return;
        }
        self.flight = None;
        let execution = self.current.as_ref();
        let written: Vec<StepPart> = execution
            .into_iter()
            .flat_map(|execution| execution.present_writes())
            .map(|it| it.part)
            .collect();
        written
            .into_iter()
            .for_each(|part| self.part_in_doubt(part, out));
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

    /// The word of the order `kind` was written.
    fn replaces(&mut self, kind: OrderKind) {
        self.replaces_reset(kind);
        self.replaces_start(kind);
    }

    /// The direction, or a setpoint with its sign, was written: a motor that turns follows it at once.
    fn may_turn_round(&mut self, direction: Direction) {
        if self.is_moving() {
            self.guard.run_is_unknown(direction);
        }
    }

    /// RUN was sent: unless the motor turns already, it starts.
    fn starts(&mut self, out: Out<'_>) {
        self.may_run_on = true;
        if !self.output.is_active() {
            self.guard.started(out.now());
        }
        self.ordered_out_of_sight(out);
    }

    fn part_taken(&mut self, part: StepPart, owner: Owner, is_sure: bool, out: Out<'_>) {
        match part {
            StepPart::Setpoint(value) => {
                self.guard
                    .setpoint_was_acknowledged(owner, value, out.now())
            }
            StepPart::SignedSetpoint(value, direction) => {
                self.guard
                    .setpoint_was_acknowledged(owner, value, out.now());
                self.may_turn_round(direction);
            }
            StepPart::Run(direction) => {
                self.starts(out);
                self.replaces_reset(OrderKind::Forward);
                self.guard.run_was_acknowledged(direction);
            }
            StepPart::Direction(direction) => self.may_turn_round(direction),
            StepPart::Release => self.replaces(OrderKind::Release),
            StepPart::TakesStartBack => self.start_is_taken_back(),
            StepPart::TakesBack => self.reset_is_taken_back(),
            StepPart::Reset { ends: true, .. } => {
                self.reset_is_taken_back();
                self.guard.setpoint_may_be_lost();
                if is_sure {
                    self.trips.reset_acknowledged();
                }
            }
            StepPart::Start | StepPart::Register | StepPart::Commit | StepPart::Reset { .. } => {}
        }
    }
}
