//! One drive's own work apart from polls and native reads: its stop, its commands, its trips, and their view.

mod again;
mod between;
mod command;
mod durable;
mod exchange;
mod follow_watch;
mod followed;
mod heard;
mod heard_order;
mod leaving;
mod looks;
mod outside;
mod outside_watch;
mod pass;
mod readings;
mod remembered;
mod rows;
mod sight;
mod standing;
mod taken_back;
mod usage;

use super::execution::CommandExecution;
use super::outbox::EffectOutbox;
use super::stop::StopLatch;
use super::waiter::ReportWaiter;
use crate::domain::address::Address;
use crate::domain::command::{Direction, Order, Owner, Report};
use crate::domain::control::{BusFunctions, ControlSettings};
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::drive::output::OutputRegister;
use crate::drive::plan::PollPace;
use crate::drive::run_state::OutputWatch;
use crate::drive::sight::DriveSight;
use crate::drive::status::StatusWatch;
use crate::drive::trips::TripWatch;
use crate::drive::usage::UsageView;
use crate::drive::view::{ControlView, RunState, StatusView, StoppedAgain};
use crate::drive::watchdog::{WatchdogRange, WatchdogWatch};
use crate::guard::{DriveFacts, DriveGuard};
use crate::profile::model::{IndicatedState, Model};
use crate::wire::pdu::Request;
use again::AnsweredStop;
use follow_watch::FollowWatch;
use heard_order::{HeardOrder, UnsettledMotion};
use outside_watch::OutsideWatch;
pub use readings::WordsOrigin;
use rows::{DurableTrips, OpeningOrder};
use standing::StandingWord;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;
use usage::UsageSums;

/// Maximum number of commands per drive that wait for the one in execution.
pub const COMMANDS_MAX: usize = 8;

/// The kinds of a drive's wishes, most urgent first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum WishRank {
    /// A stop that has never been sent.
    FirstStop,
    /// A stop without effect so far.
    RepeatedStop,
    /// The next step of a command that has begun, including read-back.
    Step,
    /// A read that shows whether a stop takes effect.
    Look,
    /// A trip record.
    Trip,
    /// The first step of a command.
    Start,
}

/// One wish.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveWish {
    /// How urgent it is.
    pub rank: WishRank,
    /// The earliest moment to send it.
    pub at: MonoTime,
    /// The request.
    pub request: Request,
}

/// A drive's own work.
#[derive(Debug)]
pub struct DriveWork {
    drive: DriveIndex,
    model: Arc<Model>,
    guard: DriveGuard,
    latch: Option<StopLatch>,
    current: Option<CommandExecution>,
    waiting: VecDeque<CommandExecution>,
    /// Its exchange on the wire, and whether the result still matters.
    flight: Option<WishRank>,
    trips: TripWatch,
    /// Its trips as far as they are kept.
    kept: DurableTrips,
    /// A run order that opened the lease and waits for its row.
    opening: Option<OpeningOrder>,
    /// The last recorded owner of the lease, and whether it is awaited since before a restart.
    said_owner: Option<(Owner, bool)>,
    output: OutputWatch,
    output_register: Option<OutputRegister>,
    /// A full scale has changed, and is to be read again before it is believed.
    changed_basis: Option<Address>,
    status: StatusWatch,
    /// When a reading last showed whether the drive is ordered to run.
    status_at: Option<MonoTime>,
    /// Whether the drive showed reverse when the last stop took effect.
    ramps_reverse: Option<bool>,
    /// How often it is polled.
    pace: PollPace,
    watchdog: WatchdogWatch,
    /// The reads that show whether a stop takes effect, in turn.
    looks: Vec<(Address, u16)>,
    /// Up to this moment the drive hears nothing; taken by the line.
    rest_until: Option<MonoTime>,
    /// Up to this moment a stop may not be heard.
    deaf_until: MonoTime,
    /// The last order given here was a stop, and since then the motor has neither been seen at standstill nor turning in
    /// a way that the ramp of that stop does not explain.
    is_stopping: bool,
    /// The motor turned, and has not stood for certain since.
    has_turned: bool,
    /// The reset word.
    reset: StandingWord,
    /// The last recorded state of the reset word.
    said_reset: bool,
    /// A start that the drive has not followed.
    start: StandingWord,
    /// The drive has refused a stop, and none has taken effect since.
    is_stop_refused: bool,
    /// When the drive last refused every form of a stop.
    stop_refused_at: Option<MonoTime>,
    /// It was logged that the drive refused a stop.
    is_refusal_reported: bool,
    /// A stop answered from memory, until the drive has confirmed it.
    answered: Option<AnsweredStop>,
    /// The client that stops the drive although others start it.
    again: Option<StoppedAgain>,
    /// The latest report of the newest command.
    last: Option<Report>,
    /// Number of commands so far, which is the number of the newest.
    commands: u16,
    /// The last order of another gateway of the line.
    heard: HeardOrder,
    /// When another gateway or master last read the drive.
    overheard_at: Option<MonoTime>,
    /// The drive was sent an order to run, and has since neither been seen at standstill without one nor stopped from here.
    may_run_on: bool,
    /// This gateway has taken the line, and does not know yet whether the drive is ordered to run.
    unsettled: Option<UnsettledMotion>,
    /// Whether the drive is in sight, and what was last seen of it.
    sight: DriveSight,
    /// Whether the drive follows its order to run.
    followed: FollowWatch,
    /// The drive has stopped following its last order to run.
    is_stopped_elsewhere: bool,
    /// The output, held against what was ordered.
    outside: OutsideWatch,
    /// What the drive has used.
    usage: UsageSums,
    has_changed: bool,
}

type Out<'a> = &'a mut EffectOutbox;

impl DriveWork {
    /// Creates the work of a drive that was added at `now`.
    #[must_use]
    pub fn new(
        drive: DriveIndex,
        model: &Arc<Model>,
        control: Option<Arc<ControlSettings>>,
        epoch: u64,
        now: MonoTime,
    ) -> Self {
        Self {
            drive,
            model: Arc::clone(model),
            guard: DriveGuard::new(Arc::clone(model), control, epoch, now),
            latch: None,
            current: None,
            waiting: VecDeque::new(),
            flight: None,
            trips: TripWatch::new(model),
            kept: DurableTrips::default(),
            opening: None,
            said_owner: None,
            output: OutputWatch::default(),
            output_register: OutputRegister::of(model),
            changed_basis: None,
            status: StatusWatch::new(model),
            status_at: None,
            ramps_reverse: None,
            pace: PollPace::new(Duration::ZERO, 1.0),
            watchdog: WatchdogWatch::new(Arc::clone(model), WatchdogRange::ANY),
            looks: looks::look_addresses(model),
            rest_until: None,
            deaf_until: MonoTime::ZERO,
            is_stopping: false,
            has_turned: false,
            reset: StandingWord::NONE,
            said_reset: false,
            start: StandingWord::NONE,
            is_stop_refused: false,
            stop_refused_at: None,
            is_refusal_reported: false,
            answered: None,
            again: None,
            last: None,
            commands: 0,
            heard: HeardOrder::Nothing,
            overheard_at: None,
            may_run_on: false,
            unsettled: None,
            sight: DriveSight::default(),
            followed: FollowWatch::default(),
            is_stopped_elsewhere: false,
            outside: OutsideWatch::default(),
            usage: UsageSums::new(drive, model, PollPace::new(Duration::ZERO, 1.0)),
            has_changed: true,
        }
    }

    /// Control of the drive, and the current order.
    #[must_use]
    pub const fn guard(&self) -> &DriveGuard {
        &self.guard
    }

    /// Its trips.
    #[must_use]
    pub const fn trips(&self) -> &TripWatch {
        &self.trips
    }

    /// Whether the view has changed since the last call.
    pub const fn take_changed(&mut self) -> bool {
        std::mem::replace(&mut self.has_changed, false)
    }

    /// Marks the view as changed.
    pub const fn mark_changed(&mut self) {
        self.has_changed = true;
    }

    /// Whether the motor is known to turn.
    #[must_use]
    pub fn is_moving(&self) -> bool {
        self.output.is_active() || self.status.is_running() == Some(true)
    }

    /// Whether the motor is known to be at standstill: the output is zero, and the drive shows no order to run.
    #[must_use]
    pub fn is_at_standstill(&self) -> bool {
        self.output.is_at_standstill() && self.status.is_running() != Some(true)
    }

    /// Whether the motor is at standstill for certain: one that turned, and was not stopped from here, has been so for long.
    pub(super) fn stands(&self) -> bool {
        self.is_at_standstill() && (!self.has_turned || self.is_stopping || self.output.has_stood())
    }

    /// The direction in which the motor turns, if the drive shows it.
    fn turns(&self) -> Option<Direction> {
        if self.is_moving() {
            self.shown_direction()
        } else {
            None
        }
    }

    /// The direction that the status shows, whether or not the motor turns.
    fn shown_direction(&self) -> Option<Direction> {
        let is_reverse = self.status.get(IndicatedState::Reverse)?;
        Some(if is_reverse {
            Direction::Reverse
        } else {
            Direction::Forward
        })
    }

    /// Status flags other than the run state.
    #[must_use]
    pub fn status_view(&self) -> StatusView {
        let bus = self
            .guard
            .control()
            .map_or(BusFunctions::Both, |control| control.bus);
        self.status.view().of(bus)
    }

    /// The run state of the drive.
    #[must_use]
    pub fn run_state(&self, is_offline: bool) -> RunState {
        if is_offline {
            RunState::Offline
        } else if self.trips.is_contradicted() {
            RunState::Unknown
        } else if self.trips.view().active == Some(true) {
            RunState::Tripped
        } else {
            self.output
                .run_state(&self.status, self.ordered(), self.is_stopping)
        }
    }

    /// Control, as shown to clients; `None` without a control section.
    #[must_use]
    pub fn control_view(&self) -> Option<ControlView> {
        let guard = &self.guard;
        guard.control()?;
        Some(ControlView {
            lease: guard.lease(),
            intent: guard.intent(),
            setpoint: guard.setpoint(),
            start_inhibited: guard.is_start_inhibited(),
            command_pending: self.has_orders(),
            stop_pending: self.latch.is_some(),
            not_effective: self
                .latch
                .as_ref()
                .is_some_and(|latch| latch.is_late() || latch.is_refused()),
            output_outside: self.outside.is_reported,
            stopped_elsewhere: self.is_stopped_elsewhere,
            failsafe: guard.fail_safe(),
            epoch: guard.epoch(),
            last: self.last,
            commands: self.commands,
            stopped_again: self
                .again
                .filter(|again| again.times >= StoppedAgain::TOLD_FROM),
        })
    }

    /// What it has used, as it is shown.
    #[must_use]
    pub const fn usage_view(&self) -> UsageView {
        self.usage.view()
    }

    /// Sets all sums of what it has used back to 0, because `owner` has requested it.
    pub fn reset_usage(&mut self, owner: Owner, out: Out<'_>) {
        self.usage.reset(owner, out);
        self.has_changed = true;
    }

    /// A full scale that is to be read again, if it has just changed.
    pub const fn take_changed_basis(&mut self) -> Option<Address> {
        self.changed_basis.take()
    }

    /// Until when the drive ignores requests, if that has just begun.
    pub const fn take_rest(&mut self) -> Option<MonoTime> {
        self.rest_until.take()
    }

    /// Whether a stop waits that has never been sent.
    #[must_use]
    pub fn has_new_stop(&self) -> bool {
        self.latch.as_ref().is_some_and(StopLatch::is_first)
    }

    /// Whether the stop that is not effective yet was sent; `None` without one.
    #[must_use]
    pub fn open_stop(&self) -> Option<bool> {
        self.latch.as_ref().map(|latch| !latch.is_unsent())
    }

    /// Whether a stop is not effective yet.
    #[must_use]
    pub const fn has_stop(&self) -> bool {
        self.latch.is_some()
    }

    /// Number of commands in progress, stops excluded.
    #[must_use]
    pub fn commands_open(&self) -> usize {
        self.waiting.len() + usize::from(self.current.is_some())
    }

    /// Whether a stop is not effective yet, or a reset has begun but not ended: its last word clears it.
    #[must_use]
    pub fn must_go_on(&self) -> bool {
        let resets = |execution: &CommandExecution| {
            *execution.order() == Order::Reset && execution.has_begun()
        };
        self.latch.is_some() || self.current.as_ref().is_some_and(resets)
    }

    /// The connection of a client is open. That renews nothing unless the drive `is_reached`, as an order would not.
    pub fn path_alive(&mut self, way: Owner, is_reached: bool, now: MonoTime) {
        let holder = self.guard.lease().map(|(owner, _)| owner);
        if let Some(holder) = holder.filter(|holder| holder.comes_by(way)) {
            if is_reached {
                self.guard.path_alive(holder, now);
            } else {
                self.guard.was_out_of_reach(holder, now);
            }
            self.has_changed = true;
        }
    }

    /// Nothing that was sent before `now` starts the drive.
    pub fn inhibit(&mut self, now: MonoTime) {
        self.guard.inhibit(now);
    }

    /// The connection of clients was reopened.
    pub fn new_epoch(&mut self) {
        self.guard.new_epoch();
        self.has_changed = true;
    }

    /// Facts for the review.
    #[must_use]
    pub fn facts(&self, line_is_up: bool, is_offline: bool, now: MonoTime) -> DriveFacts {
        // Stale readings decide nothing: the motor may have been started since.
        let is_fresh = self.is_fresh(now);
        DriveFacts {
            line_is_up,
            listens: false,
            line_is_bad: false,
            is_offline,
            is_implausible: false,
            stop_pending: self.latch.is_some(),
            tripped: self.trips.view().active,
            at_standstill: is_fresh && self.is_at_standstill(),
            rests: line_is_up && !is_offline && self.rests(now),
            stop_refused: self.is_stop_refused,
            output: self.output_frequency().filter(|_| is_fresh),
            turns: self.turns(),
            is_local: self.status_view().is_local(),
            is_watched: self.watchdog.view().is_some_and(|view| view.is_in_order()),
        }
    }

    pub(super) fn tell(
        &mut self,
        waiter: &mut ReportWaiter,
        report: Report,
        is_final: bool,
        out: Out<'_>,
    ) {
        if waiter.number() == Some(self.commands) {
            self.last = Some(report);
        }
        self.has_changed = true;
        out.tell(waiter, report, is_final);
    }

    pub(super) fn count(&mut self, waiter: &mut ReportWaiter) {
        self.commands = self.commands.wrapping_add(1);
        waiter.set_number(self.commands);
    }
}
