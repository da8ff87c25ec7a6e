//! Repeated orders to stop: whether the drive's readings confirm that there is nothing to stop, and which client keeps
//! stopping it although others start it.

use super::usage::UsageSums;
use super::{DriveWork, Out};
use crate::domain::address::Address;
use crate::domain::command::{CommandRequest, Order, Owner, RunIntent};
use crate::domain::time::MonoTime;
use crate::drive::description::STALE_PERIODS;
use crate::drive::plan::PollPace;
use crate::drive::view::StoppedAgain;
use crate::gateway::event::LineEffect;
use crate::gateway::note::DriveNote;
use crate::gateway::waiter::ReportWaiter;
use crate::journal::TriedWrite;
use crate::profile::model::{IndicatedState, PollClass};
use std::time::Duration;

/// Number of standstill readings that confirm a stop answered from memory: the first may have been requested before
/// it. A ramp confirms nothing, because the speed of a motor started in the other direction falls as well.
const READINGS: u8 = 2;

/// A stop answered from memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct AnsweredStop {
    by: Owner,
    coast: bool,
    /// Number of readings still required.
    left: u8,
    /// Since when the drive cannot be read, if so.
    lost_at: Option<MonoTime>,
}

impl AnsweredStop {
    /// The drive cannot be read at `now`: earlier readings confirm nothing any more.
    pub(super) fn out_of_sight(&mut self, now: MonoTime) {
        self.left = READINGS;
        self.lost_at.get_or_insert(now);
    }
}

impl DriveWork {
    /// Sets the drive's poll pace.
    #[must_use]
    pub fn polled(self, pace: PollPace) -> Self {
        let usage = UsageSums::new(self.drive, &self.model, pace);
        let mut polled = Self {
            pace,
            usage,
            ..self
        };
        polled
            .guard
            .bases_stale_after(pace.period(PollClass::Slow) * STALE_PERIODS);
        polled
    }

    /// Whether fresh readings show that the motor is not running, or is ramping down because of a stop of ours.
    pub(super) fn rests(&self, now: MonoTime) -> bool {
        // A refused stop is sent again, but not in every cycle of a controller.
        let waits = |at: MonoTime| {
            self.guard
                .control()
                .is_some_and(|it| now.since(at) < it.stop_effect_timeout)
        };
        let may_wait = !self.is_stop_refused || self.stop_refused_at.is_some_and(waits);
        let ramps_down = self.is_stopping && self.latch.is_none() && self.output.falls();
        may_wait && self.is_fresh(now) && (self.is_at_standstill() || ramps_down)
    }

    /// Whether the readings of the motor are fresh.
    pub(super) fn is_fresh(&self, now: MonoTime) -> bool {
        let is_fresh = |address: Address, at: Option<MonoTime>| {
            at.is_some_and(|at| now.since(at) < self.stale_after(address))
        };
        let output = self
            .output_register
            .as_ref()
            .is_none_or(|it| is_fresh(it.address(), self.output.at()));
        let status = self.model.status_flag(IndicatedState::Running);
        output && status.is_none_or(|flag| is_fresh(flag.address, self.status_at))
    }

    /// A reading of the register at `address` is stale after this time.
    pub(super) fn stale_after(&self, address: Address) -> Duration {
        let class = self
            .model
            .register_at(address)
            .and_then(|register| register.poll);
        self.pace.period(class.unwrap_or(PollClass::Fast)) * STALE_PERIODS
    }

    /// Whether the motor runs without an order from this gateway.
    pub(super) fn runs_by_others(&self) -> bool {
        let is_ordered = matches!(self.guard.intent(), RunIntent::Run(_));
        self.is_moving() && !is_ordered && !self.is_stopping && self.latch.is_none()
    }

    /// `command` was a stop and was answered from memory.
    pub(super) const fn was_answered(&mut self, command: &CommandRequest) {
        let coast = matches!(command.order, Order::Coast);
        self.answered = Some(AnsweredStop {
            by: command.origin.owner,
            coast,
            left: READINGS,
            lost_at: None,
        });
    }

    /// Takes a new reading. If the drive runs although a stop was just answered from memory, the stop is sent after all.
    pub(super) fn bear_out(&mut self, shows_output: bool, now: MonoTime, out: Out<'_>) {
        let Some(answered) = &mut self.answered else {
            return;
        };
        let pending_for = self
            .guard
            .control()
            .map_or(Duration::ZERO, |it| it.stop_pending_for);
        // A drive that is unreadable for longer than a stop waits for it may be started like any other.
        let is_late = answered
            .lost_at
            .take()
            .is_some_and(|at| now.since(at) >= pending_for);
        let is_over =
            is_late || self.latch.is_some() || matches!(self.guard.intent(), RunIntent::Run(_));
        let by_reading = shows_output && self.output.is_at_standstill();
        answered.left -= u8::from(by_reading).min(answered.left);
        let AnsweredStop {
            by, coast, left, ..
        } = *answered;
        if is_over || left == 0 || self.runs_by_others() {
            self.answered = None;
        }
        if is_over || !self.runs_by_others() {
            return;
        }
        self.is_stopped_by(by, now, out);
        let Some(order) = self.guard.stop_after_all(by, coast, now) else {
            return;
        };
        let mut waiter = ReportWaiter::of_nobody(self.drive);
        let tried = if coast {
            Order::Coast
        } else {
            Order::Stop { setpoint: None }
        };
        self.count(&mut waiter);
        out.attempt_taken(self.drive, by, TriedWrite::Order(tried), &mut waiter);
        self.cut(now, out);
        self.is_stopping = true;
        self.stop(order, Some(waiter), now, out);
    }

    /// `by` stops the drive, which runs by an order from elsewhere.
    pub(super) fn is_stopped_by(&mut self, by: Owner, now: MonoTime, out: Out<'_>) {
        let before = self
            .again
            .filter(|it| it.by == by && now.since(it.at) < StoppedAgain::WITHIN);
        let times = before.map_or(0, |it| it.times).saturating_add(1);
        self.again = Some(StoppedAgain { by, times, at: now });
        if times == StoppedAgain::TOLD_FROM {
            out.push_back(LineEffect::Note(self.drive, DriveNote::StoppedAgain { by }));
        }
    }
}
