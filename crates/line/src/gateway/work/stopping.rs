//! The stop of one drive: the latch that sends it until it takes effect, what was refused, and orders to stop that are
//! repeated: whether readings confirm that there is nothing to stop, and which client keeps stopping it although others start it.

use super::motor::MotorReadings;
use super::queue::{DriveWish, WishRank};
use super::reports::{DriveReports, Out};
use crate::domain::address::Address;
use crate::domain::command::{CommandRequest, Order, Outcome, Owner, Reason, Report, RunIntent};
use crate::domain::control::ControlSettings;
use crate::domain::time::MonoTime;
use crate::drive::view::StoppedAgain;
use crate::gateway::execution::reason_of;
use crate::gateway::note::DriveNote;
use crate::gateway::stop::{BUSY_REST, StopLatch, StopTurn};
use crate::gateway::waiter::ReportWaiter;
use crate::guard::{DriveGuard, StopOrder};
use crate::journal::JournalEntry;
use crate::line::exchange::ExchangeEnding;
use crate::profile::model::{ExceptionKind, IndicatedState, Model, OrderKind, RegisterRole};
use crate::wire::pdu::{Reply, Request};
use std::time::Duration;

/// Number of standstill readings that confirm a stop answered from memory: the first may have been requested before
/// it. A ramp confirms nothing, because the speed of a motor started in the other direction falls as well.
const READINGS: u8 = 2;

/// A stop answered from memory.
#[derive(Clone, Copy, Debug)]
struct AnsweredStop {
    by: Owner,
    coast: bool,
    /// Number of readings still required.
    left: u8,
    /// Since when the drive cannot be read, if so.
    lost_at: Option<MonoTime>,
}

/// The stop of one drive.
#[derive(Debug, Default)]
pub(super) struct DriveStop {
    latch: Option<StopLatch>,
    /// The reads that show whether a stop takes effect, in turn.
    looks: Vec<(Address, u16)>,
    /// The last order given here was a stop, and since then the motor has neither been seen at standstill nor turning in
    /// a way that the ramp of that stop does not explain.
    is_stopping: bool,
    /// The drive has refused a stop, and none has taken effect since.
    is_refused: bool,
    /// When the drive last refused every form of a stop.
    refused_at: Option<MonoTime>,
    /// It was logged that the drive refused a stop.
    is_refusal_reported: bool,
    /// A stop answered from memory, until the drive has confirmed it.
    answered: Option<AnsweredStop>,
    /// The client that stops the drive although others start it.
    again: Option<StoppedAgain>,
}

impl DriveStop {
    /// No stop of a drive of this `model`.
    pub fn none(model: &Model) -> Self {
        Self {
            looks: look_addresses(model),
            ..Self::default()
        }
    }

    /// The stop that is not effective yet.
    pub const fn latch(&self) -> Option<&StopLatch> {
        self.latch.as_ref()
    }

    pub const fn latch_mut(&mut self) -> Option<&mut StopLatch> {
        self.latch.as_mut()
    }

    pub const fn is_pending(&self) -> bool {
        self.latch.is_some()
    }

    /// Whether a stop from here explains that the motor still turns.
    pub const fn is_stopping(&self) -> bool {
        self.is_stopping
    }

    /// Whether the drive has refused a stop, and none has taken effect since.
    pub const fn is_refused(&self) -> bool {
        self.is_refused
    }

    /// The client that stops the drive although others start it.
    pub fn stopped_again(&self) -> Option<StoppedAgain> {
        self.again
            .filter(|again| again.times >= StoppedAgain::TOLD_FROM)
    }

    /// Whether fresh readings show that the motor is not running, or is ramping down because of a stop of ours.
    pub fn rests(&self, motor: &MotorReadings, guard: &DriveGuard, now: MonoTime) -> bool {
        // A refused stop is sent again, but not in every cycle of a controller.
        let waits = |at: MonoTime| {
            guard
                .control()
                .is_some_and(|it| now.since(at) < it.stop_effect_timeout)
        };
        let may_wait = !self.is_refused || self.refused_at.is_some_and(waits);
        let ramps_down = self.is_stopping && self.latch.is_none() && motor.output().falls();
        may_wait && motor.is_fresh(now) && (motor.is_at_standstill() || ramps_down)
    }

    /// Whether the motor runs without an order from this gateway.
    pub fn runs_by_others(&self, motor: &MotorReadings, guard: &DriveGuard) -> bool {
        let is_ordered = matches!(guard.intent(), RunIntent::Run(_));
        motor.is_moving() && !is_ordered && !self.is_stopping && self.latch.is_none()
    }

    /// Its wishes for the wire: its frame, and a read that shows whether it takes effect.
    pub fn wants(&self) -> [Option<DriveWish>; 2] {
        let stop = self.latch.as_ref().map(|latch| {
            let (at, request) = latch.frame();
            let rank = if latch.is_first() {
                WishRank::FirstStop
            } else {
                WishRank::RepeatedStop
            };
            DriveWish { rank, at, request }
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
        [stop, look]
    }

    /// Stops the drive by `order`.
    pub fn begin(
        &mut self,
        order: StopOrder,
        waiter: Option<ReportWaiter>,
        now: MonoTime,
        reports: &DriveReports,
        out: Out<'_>,
    ) {
        self.is_stopping = true;
        let coast = order.is_coast();
        let is_new = match &mut self.latch {
            Some(latch) => latch.also(order, waiter, now, out),
            latch @ None => {
                *latch = Some(StopLatch::new(order, waiter, now));
                true
            }
        };
        if is_new {
            reports.keep(JournalEntry::StopPending { coast }, out);
        }
    }

    /// An earlier process accepted a stop by `order` that was not seen to take effect.
    pub fn remember(&mut self, order: StopOrder, now: MonoTime) {
        self.is_stopping = true;
        self.latch = Some(StopLatch::remembered(order, now));
    }

    /// The exchange of its frame is over. Returns the kind of the order whose word was written beyond doubt.
    pub fn ended(
        &mut self,
        ending: &ExchangeEnding,
        doubt: bool,
        model: &Model,
        now: MonoTime,
        reports: &mut DriveReports,
        out: Out<'_>,
    ) -> Option<OrderKind> {
        let latch = self.latch.as_mut()?;
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
                if model.exception_kind(*code) == Some(ExceptionKind::Busy) =>
            {
                latch.is_busy(now + BUSY_REST, now);
                return None;
            }
            ExchangeEnding::Exception(code) => {
                let reason = reason_of(model.exception_kind(*code));
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
        let mut written = None;
        let (report, is_final) = match ending {
            _ if refused.is_some() => {
                self.is_refused = true;
                let report = if latch.refused(now) { refused } else { None };
                (report, true)
            }
            ExchangeEnding::Reply(_) => {
                written = (!doubt).then_some(kind);
                (latch.echoed(now, doubt), false)
            }
            ExchangeEnding::Exception(_) | ExchangeEnding::Garbled | ExchangeEnding::Silent => {
                latch.unanswered(now);
                (None, false)
            }
        };
        let Some(report) = report else {
            return written;
        };
        let waiters = std::mem::take(latch.waiters());
        if is_final {
            self.was_refused(now, reports, out);
        }
        for mut waiter in waiters {
            reports.tell(&mut waiter, report, is_final, out);
            let goes_on = !is_final && !waiter.is_done();
            if let (true, Some(latch)) = (goes_on, &mut self.latch) {
                latch.waiters().push(waiter);
            }
        }
        written
    }

    /// The drive refuses every form of the stop that its model declares: reported at once, and only once.
    fn was_refused(&mut self, now: MonoTime, reports: &DriveReports, out: Out<'_>) {
        self.refused_at = Some(now);
        if !std::mem::replace(&mut self.is_refusal_reported, true) {
            reports.note(DriveNote::StopRefused, out);
        }
    }

    /// The read that shows whether it takes effect is over.
    pub fn looked(&mut self, ending: &ExchangeEnding, now: MonoTime) {
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

    /// Takes a reading of the status: whether the drive is ordered to run, and whether it was started again, which was not
    /// from here. Returns whether the stop is effective.
    pub fn shows(&mut self, running: bool, is_started: bool, now: MonoTime) -> bool {
        self.is_stopping &= self.latch.is_some() || !is_started;
        self.latch
            .as_mut()
            .is_some_and(|latch| latch.shows(running, now))
    }

    /// What the motor does is no longer explained by a stop from here.
    pub const fn ends_stopping(&mut self) {
        self.is_stopping = false;
    }

    /// The motor turns behind a stop that took effect. Where it becomes faster, it was started from elsewhere. Where it keeps a
    /// speed, it may never have obeyed, and only ramped to its setpoint: the stop is sent again by what is returned.
    pub fn held_against(
        &mut self,
        motor: &MotorReadings,
        guard: &mut DriveGuard,
    ) -> Option<StopOrder> {
        let is_over = motor.status().is_running() == Some(false);
        if !self.is_stopping || self.latch.is_some() || is_over {
            return None;
        }
        let within = guard.control()?.stop_effect_timeout;
        if motor
            .output()
            .has_risen(motor.steps_per_hertz(guard.bases()))
        {
            self.is_stopping = false;
            return None;
        }
        if motor.output().has_settled(within) {
            guard.stop_again()
        } else {
            None
        }
    }

    /// What the motor does is not known from `now` on: no ramp of a stop from here explains what is seen of it later, and
    /// earlier readings confirm nothing any more.
    pub fn motion_out_of_sight(&mut self, now: MonoTime) {
        self.is_stopping &= self.latch.is_some();
        if let Some(answered) = &mut self.answered {
            answered.left = READINGS;
            answered.lost_at.get_or_insert(now);
        }
    }

    /// `command` was a stop and was answered from memory.
    pub const fn was_answered(&mut self, command: &CommandRequest) {
        let coast = matches!(command.order, Order::Coast);
        self.answered = Some(AnsweredStop {
            by: command.origin.owner,
            coast,
            left: READINGS,
            lost_at: None,
        });
    }

    /// Another order is newer than a stop answered from memory.
    pub const fn answer_is_outdated(&mut self) {
        self.answered = None;
    }

    /// Takes a new reading. If the drive runs although a stop was just answered from memory, returns who is to stop it after
    /// all, and whether by a coast.
    pub fn bear_out(
        &mut self,
        shows_output: bool,
        motor: &MotorReadings,
        guard: &DriveGuard,
        now: MonoTime,
    ) -> Option<(Owner, bool)> {
        let runs_by_others = self.runs_by_others(motor, guard);
        let answered = self.answered.as_mut()?;
        let pending_for = guard
            .control()
            .map_or(Duration::ZERO, |it| it.stop_pending_for);
        // A drive that is unreadable for longer than a stop waits for it may be started like any other.
        let is_late = answered
            .lost_at
            .take()
            .is_some_and(|at| now.since(at) >= pending_for);
        let is_over =
            is_late || self.latch.is_some() || matches!(guard.intent(), RunIntent::Run(_));
        let by_reading = shows_output && motor.output().is_at_standstill();
        answered.left -= u8::from(by_reading).min(answered.left);
        let AnsweredStop {
            by, coast, left, ..
        } = *answered;
        if is_over || left == 0 || runs_by_others {
            self.answered = None;
        }
        (runs_by_others && !is_over).then_some((by, coast))
    }

    /// `by` stops the drive, which runs by an order from elsewhere.
    pub fn is_stopped_by(
        &mut self,
        by: Owner,
        reports: &DriveReports,
        now: MonoTime,
        out: Out<'_>,
    ) {
        let before = self
            .again
            .filter(|it| it.by == by && now.since(it.at) < StoppedAgain::WITHIN);
        let times = before.map_or(0, |it| it.times).saturating_add(1);
        self.again = Some(StoppedAgain { by, times, at: now });
        if times == StoppedAgain::TOLD_FROM {
            reports.note(DriveNote::StoppedAgain { by }, out);
        }
    }

    /// Changes caused by time alone. Returns the last report of a stop that is to be dropped.
    pub fn pass(
        &mut self,
        now: MonoTime,
        is_offline: bool,
        control: &ControlSettings,
        reports: &mut DriveReports,
        out: Out<'_>,
    ) -> Option<Report> {
        let latch = self.latch.as_mut()?;
        let turn = latch.pass(now, is_offline, control);
        let note = match turn {
            StopTurn::None => return None,
            StopTurn::NotEffective => DriveNote::NotEffective,
            StopTurn::NotSent => DriveNote::StopNotSent,
            StopTurn::Dropped => DriveNote::StopDropped,
        };
        reports.mark_changed();
        reports.note(note, out);
        let report = latch.late_report();
        if turn == StopTurn::Dropped {
            return Some(report);
        }
        reports.tell_all(latch.waiters(), report, out);
        None
    }

    /// Ends the stop without effect: it is not sent any more. An equal one is a new one.
    pub fn drop_latch(&mut self) -> Option<StopLatch> {
        let latch = self.latch.take()?;
        self.is_stopping = false;
        Some(latch)
    }

    /// Ends the stop, which took effect. Returns it, and whether it was reported that it did not.
    pub fn end(&mut self) -> Option<(StopLatch, bool)> {
        let latch = self.latch.take()?;
        if latch.is_acknowledged() {
            self.is_refused = false;
            self.refused_at = None;
        }
        let was_reported = latch.is_reported() || (self.is_refusal_reported && !self.is_refused);
        self.is_refusal_reported &= self.is_refused;
        Some((latch, was_reported))
    }
}

/// The output frequency, and the status register where that tells whether the drive is ordered to run: in one read if
/// the model allows it.
fn look_addresses(model: &Model) -> Vec<(Address, u16)> {
    let output = model
        .register_for(RegisterRole::OutputFrequency)
        .map(|register| (register.address, register.form.words()));
    let status = model
        .status_flag(IndicatedState::Running)
        .map(|flag| flag.address);
    let (Some((output, words)), Some(status)) = (output, status) else {
        return output
            .or(status.map(|address| (address, 1)))
            .into_iter()
            .collect();
    };
    let first = output.min(status);
    let last = output.saturating_add(words - 1).max(status);
    let count = last
        .offset_from(first)
        .and_then(|offset| offset.checked_add(1))
        .unwrap_or(u16::MAX);
    let is_known = |it| model.readable_at(it).is_some() || model.is_readable_hole(it);
    let all_known = || first.onwards().take(count.into()).all(is_known);
    if count <= model.words_in_one_read(first) && all_known() {
        vec![(first, count)]
    } else {
        vec![(status, 1), (output, words)]
    }
}
