//! One drive's own work apart from polls and native reads: its stop, its commands, its trips, and their view.
//!
//! [`DriveWork`] is made of parts, each with fields that no other file can touch:
//!
//! | file | what it keeps |
//! | --- | --- |
//! | `motor` | what was read of the motor |
//! | `stopping` | the stop that is not effective yet, and stops that were refused, answered from memory or repeated |
//! | `queue` | the commands that have not ended |
//! | `taken_back` | words that must not remain in the drive |
//! | `heard` | what other gateways ordered, and what this one left |
//! | `followed`, `outside` | whether the drive does what it was ordered |
//! | `durable` | what waits for the journal |
//! | `usage` | what the drive has used |
//! | `reports` | what is reported, and the newest outcome |
//!
//! It passes events between them: here what is asked of it and what time alone changes, in `orders` commands and the ends of
//! exchanges, in `readings` what was read, heard, and left by an earlier process.

mod durable;
mod followed;
mod heard;
mod motor;
mod orders;
mod outside;
mod queue;
mod readings;
mod reports;
mod stopping;
mod taken_back;
mod usage;

use super::execution::CommandExecution;
use super::note::DriveNote;
use super::stop::StopLatch;
use crate::domain::command::{Order, Outcome, Owner, Reason, Report, RunIntent};
use crate::domain::control::{BusFunctions, ControlSettings};
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::drive::description::STALE_PERIODS;
use crate::drive::plan::PollPace;
use crate::drive::sight::{DriveSight, SightView};
use crate::drive::trips::TripWatch;
use crate::drive::usage::UsageView;
use crate::drive::view::{ControlView, KeptTrips, RunState, StatusView};
use crate::drive::watchdog::{WatchdogRange, WatchdogWatch};
use crate::guard::{DriveFacts, DriveGuard, VoidApproval};
use crate::journal::{FailSafeCause, RowNumber};
use crate::profile::model::{Model, OrderKind, PollClass};
use durable::{DurableTrips, OpeningRows};
use followed::FollowWatch;
use heard::HeardOrders;
use motor::MotorReadings;
use outside::OutsideWatch;
use queue::OrderQueue;
pub use queue::{DriveWish, WishRank};
pub use readings::WordsOrigin;
use reports::{DriveReports, Out};
use std::sync::Arc;
use std::time::Duration;
use stopping::DriveStop;
use taken_back::StandingWords;
use usage::UsageSums;

/// Maximum number of commands per drive that wait for the one in execution.
pub const COMMANDS_MAX: usize = 8;
/// How much longer than its watchdog time nothing is sent to a drive: its clock differs from ours.
const MARGIN: Duration = Duration::from_secs(1);

/// A drive's own work.
#[derive(Debug)]
pub struct DriveWork {
    guard: DriveGuard,
    motor: MotorReadings,
    stop: DriveStop,
    queue: OrderQueue,
    words: StandingWords,
    heard: HeardOrders,
    followed: FollowWatch,
    outside: OutsideWatch,
    opening: OpeningRows,
    trips: TripWatch,
    kept: DurableTrips,
    usage: UsageSums,
    watchdog: WatchdogWatch,
    /// Whether the drive is in sight, and what was last seen of it.
    sight: DriveSight,
    reports: DriveReports,
    /// Up to this moment the drive hears nothing; taken by the line.
    rest_until: Option<MonoTime>,
}

impl DriveWork {
    /// Creates the work of a drive that was added at `now`.
    pub fn new(
        drive: DriveIndex,
        model: &Arc<Model>,
        control: Option<Arc<ControlSettings>>,
        epoch: u64,
        now: MonoTime,
    ) -> Self {
        Self {
            guard: DriveGuard::new(Arc::clone(model), control, epoch, now),
            motor: MotorReadings::new(model),
            stop: DriveStop::none(model),
            queue: OrderQueue::default(),
            words: StandingWords::default(),
            heard: HeardOrders::default(),
            followed: FollowWatch::default(),
            outside: OutsideWatch::default(),
            opening: OpeningRows::default(),
            trips: TripWatch::new(model),
            kept: DurableTrips::default(),
            usage: UsageSums::new(drive, model, PollPace::new(Duration::ZERO, 1.0)),
            watchdog: WatchdogWatch::new(Arc::clone(model), WatchdogRange::ANY),
            sight: DriveSight::default(),
            reports: DriveReports::new(drive),
            rest_until: None,
        }
    }

    /// Sets the drive's poll pace.
    pub fn polled(mut self, pace: PollPace) -> Self {
        self.usage = UsageSums::new(self.reports.drive(), self.motor.model(), pace);
        self.motor.polled(pace);
        self.guard
            .bases_stale_after(pace.period(PollClass::Slow) * STALE_PERIODS);
        self
    }

    /// Sets the suitable range of watchdog times.
    pub fn watched(mut self, range: WatchdogRange) -> Self {
        self.watchdog = WatchdogWatch::new(Arc::clone(self.motor.model()), range);
        self
    }

    /// Control of the drive, and the current order.
    pub const fn guard(&self) -> &DriveGuard {
        &self.guard
    }

    /// Its stop that is not effective yet.
    pub const fn latch(&self) -> Option<&StopLatch> {
        self.stop.latch()
    }

    /// Its trips.
    pub const fn trips(&self) -> &TripWatch {
        &self.trips
    }

    /// Its trips, as far as their rows are durable.
    pub const fn trips_kept(&self) -> &KeptTrips {
        self.kept.shown()
    }

    /// The state of the drive's own watchdog.
    pub const fn watchdog(&self) -> &WatchdogWatch {
        &self.watchdog
    }

    /// What it has used, as it is shown.
    pub const fn usage_view(&self) -> UsageView {
        self.usage.view()
    }

    /// What was last seen of it, until it is seen again.
    pub const fn sight_view(&self) -> SightView {
        self.sight.view()
    }

    /// Whether the view has changed since the last call.
    pub const fn take_changed(&mut self) -> bool {
        self.reports.take_changed()
    }

    /// Marks the view as changed.
    pub const fn mark_changed(&mut self) {
        self.reports.mark_changed();
    }

    /// Whether the motor is known to turn.
    pub fn is_moving(&self) -> bool {
        self.motor.is_moving()
    }

    /// Whether the motor is at standstill for certain: one that turned, and was not stopped from here, has been so for long.
    fn stands(&self) -> bool {
        self.motor.stands(self.stop.is_stopping())
    }

    /// Status flags other than the run state.
    pub fn status_view(&self) -> StatusView {
        let bus = self
            .guard
            .control()
            .map_or(BusFunctions::Both, |control| control.bus);
        self.motor.status().view().of(bus)
    }

    /// The run state of the drive.
    pub fn run_state(&self, is_offline: bool) -> RunState {
        if is_offline {
            RunState::Offline
        } else if self.trips.is_contradicted() {
            RunState::Unknown
        } else if self.trips.view().active == Some(true) {
            RunState::Tripped
        } else {
            let intent = self.heard.intent(self.guard.intent());
            let status = self.motor.status();
            let is_stopping = self.stop.is_stopping();
            self.motor.output().run_state(status, intent, is_stopping)
        }
    }

    /// Control, as shown to clients; `None` without a control section.
    pub fn control_view(&self) -> Option<ControlView> {
        let guard = &self.guard;
        guard.control()?;
        let (last, commands) = self.reports.newest();
        Some(ControlView {
            lease: guard.lease(),
            intent: guard.intent(),
            setpoint: guard.setpoint(),
            start_inhibited: guard.is_start_inhibited(),
            command_pending: self.has_orders(),
            stop_pending: self.stop.is_pending(),
            not_effective: self
                .latch()
                .is_some_and(|latch| latch.is_late() || latch.is_refused()),
            output_outside: self.outside.is_reported(),
            stopped_elsewhere: self.followed.is_stopped_elsewhere(),
            failsafe: guard.fail_safe(),
            epoch: guard.epoch(),
            last,
            commands,
            stopped_again: self.stop.stopped_again(),
        })
    }

    /// Facts for the review.
    pub fn facts(&self, line_is_up: bool, is_offline: bool, now: MonoTime) -> DriveFacts {
        // Stale readings decide nothing: the motor may have been started since.
        let is_fresh = self.motor.is_fresh(now);
        let output = self.motor.output_frequency(self.guard.bases());
        DriveFacts {
            line_is_up,
            listens: false,
            line_is_bad: false,
            is_offline,
            is_implausible: false,
            stop_pending: self.stop.is_pending(),
            tripped: self.trips.view().active,
            at_standstill: is_fresh && self.motor.is_at_standstill(),
            rests: line_is_up && !is_offline && self.stop.rests(&self.motor, &self.guard, now),
            stop_refused: self.stop.is_refused(),
            output: output.filter(|_| is_fresh),
            turns: self.motor.turns(),
            is_local: self.status_view().is_local(),
            is_watched: self.watchdog.view().is_some_and(|view| view.is_in_order()),
        }
    }

    /// Until when the drive ignores requests, if that has just begun.
    pub const fn take_rest(&mut self) -> Option<MonoTime> {
        self.rest_until.take()
    }

    /// Number of commands in progress, stops excluded.
    pub fn commands_open(&self) -> usize {
        self.queue.iter().count()
    }

    /// Whether a stop is not effective yet, or a command has not ended.
    pub fn has_orders(&self) -> bool {
        self.stop.is_pending() || self.queue.iter().next().is_some()
    }

    /// Whether a stop waits that was not sent yet.
    pub fn has_new_stop(&self) -> bool {
        self.latch().is_some_and(|latch| latch.unsent().is_some())
    }

    /// Whether a stop is not effective yet, or a reset has begun but not ended: its last word clears it.
    pub fn must_go_on(&self) -> bool {
        let resets = |execution: &CommandExecution| {
            *execution.order() == Order::Reset && execution.has_begun()
        };
        self.stop.is_pending() || self.queue.current().is_some_and(resets)
    }

    /// Whether it may be commanded and runs, is under control, or still has to be stopped.
    pub fn is_in_use(&self) -> bool {
        self.guard.control().is_some() && (self.is_bound() || self.is_moving())
    }

    /// Whether it still needs this line: a stop in progress, a reset that has begun, control.
    pub fn is_bound(&self) -> bool {
        self.must_go_on() || self.guard.is_held()
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
            self.mark_changed();
        }
    }

    /// Nothing that was sent before `now` starts the drive.
    pub fn inhibit(&mut self, now: MonoTime) {
        self.guard.inhibit(now);
    }

    /// The connection of clients was reopened.
    pub fn new_epoch(&mut self) {
        self.guard.new_epoch();
        self.mark_changed();
    }

    /// Sets all sums of what it has used back to 0, because `owner` has requested it.
    pub fn reset_usage(&mut self, owner: Owner, out: Out<'_>) {
        self.usage.reset(owner, out);
        self.mark_changed();
    }

    /// The drive is to leave: only stops are accepted any more. With `stops`, a drive in use is stopped.
    pub fn leave(&mut self, now: MonoTime, stops: bool, out: Out<'_>) {
        let is_in_use = self.is_in_use();
        self.guard.leave();
        if !stops || !is_in_use {
            return;
        }
        // A stop in progress is the same stop.
        if self.stop.is_pending() && !self.guard.is_held() {
            return;
        }
        self.cut_motion(Reason::Removed, out);
        if let Some(lost) = self.guard.stop_to_leave(now) {
            self.reports.note(DriveNote::Leaving, out);
            self.fail_safe(lost, now, out);
        }
    }

    /// The drive stays after all.
    pub fn stay(&mut self) {
        self.guard.stay();
        self.mark_changed();
    }

    /// Runs the declared action because the gateway shuts down.
    pub fn shut_down(&mut self, now: MonoTime, out: Out<'_>) {
        if let Some(lost) = self.guard.shut_down(now) {
            self.reports.note(DriveNote::ShuttingDown(lost.action), out);
            self.fail_safe(lost, now, out);
        }
    }

    /// The gateway shuts down while it listens.
    pub const fn end(&mut self) {
        self.guard.end();
    }

    /// Everything up to `row` is durable.
    pub fn kept(&mut self, row: RowNumber) {
        if self.kept.kept(row) | self.usage.kept(row) {
            self.mark_changed();
        }
        self.opening.kept(row);
    }

    /// Records whether control has changed, and whether the reset word may remain from now on.
    pub fn keep_changes(&mut self, out: Out<'_>) {
        self.opening.keep_lease(&self.guard, &self.reports, out);
        self.words.keep_reset(&self.queue, &self.reports, out);
    }

    /// Applies the changes caused by time alone.
    pub fn pass(&mut self, now: MonoTime, is_offline: bool, out: Out<'_>) {
        self.settle(now, out);
        // A stop that has taken effect is all that can be done, even while the ramp lasts.
        let is_stopped = self.stands() || self.stop.is_stopping() || self.sight.stood_last();
        let at_rest = !self.stop.is_pending() && is_stopped;
        let had_lease = self.guard.lease().is_some();
        if let Some(lost) = self.guard.expire(now, at_rest) {
            if let Some(owner) = lost.owner {
                let action = lost.action;
                let note = match lost.cause {
                    FailSafeCause::Orphaned | FailSafeCause::CrashLoop => {
                        DriveNote::Orphaned { owner, action }
                    }
                    FailSafeCause::OutOfReach => DriveNote::OutOfReach { owner, action },
                    _ => DriveNote::CommanderLost { owner, action },
                };
                self.reports.note(note, out);
            }
            self.fail_safe(lost, now, out);
        }
        if had_lease && self.guard.lease().is_none() {
            self.mark_changed();
        }
        self.opening.pass(&self.queue, &self.reports, now, out);
        self.pass_stop(now, is_offline, out);
        self.leave_to_watchdog(now, out);
        self.expire_orders(now, out);
        self.take_start_back(now, is_offline, out);
        self.take_reset_back(now, is_offline, out);
    }

    /// When [`Self::pass`] is due.
    pub fn next_wake(&self) -> Option<MonoTime> {
        let control = self.guard.control();
        let unsettled = self.heard.unsettled();
        [
            self.guard.next_wake(),
            self.latch()
                .zip(control)
                .and_then(|(latch, control)| latch.next_wake(control)),
            self.left_at(),
            self.queue.next_wake(),
            self.opening.next_wake(),
            unsettled.and_then(|it| self.is_moving().then_some(it.until)),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    fn pass_stop(&mut self, now: MonoTime, is_offline: bool, out: Out<'_>) {
        let Some(control) = self.guard.control() else {
            return;
        };
        let dropped = self
            .stop
            .pass(now, is_offline, control, &mut self.reports, out);
        if let Some(report) = dropped {
            self.guard.inhibit(now);
            self.drop_stop(report, out);
        }
    }

    /// When a declared stop without effect is left to the drive's own watchdog; `None` if no watchdog can be relied on.
    fn left_at(&self) -> Option<MonoTime> {
        let declared = self.latch()?.declared_at()?;
        self.watchdog.stops_after()?;
        Some(declared + self.guard.control()?.failsafe_confirm_timeout)
    }

    /// A declared stop has no effect, and any frame keeps the drive's watchdog from acting: nothing is sent to the drive
    /// until the watchdog must have acted.
    fn leave_to_watchdog(&mut self, now: MonoTime, out: Out<'_>) {
        let (Some(after), Some(left_at)) = (self.watchdog.stops_after(), self.left_at()) else {
            return;
        };
        if left_at > now {
            return;
        }
        let until = now + after + MARGIN;
        if let Some(latch) = self.stop.latch_mut() {
            latch.leave_until(until);
        }
        self.rest_until = Some(until);
        self.mark_changed();
        self.reports.note(DriveNote::LeftToWatchdog, out);
    }

    fn expire_orders(&mut self, now: MonoTime, out: Out<'_>) {
        if self.queue.is_current_expired(now) {
            self.void(VoidApproval::TooLate, out);
        }
        while let Some(mut execution) = self.queue.take_expired(now) {
            let report = Report::new(Outcome::Expired, Reason::TooLate);
            self.finish(&mut execution, report, out);
        }
    }

    /// Takes back a start that has ended without the drive showing that it runs: at once, before everything else but a
    /// stop. What waits behind it would be sent to a drive that is not ready.
    fn take_start_back(&mut self, now: MonoTime, is_offline: bool, out: Out<'_>) {
        let is_busy = self.stop.is_pending() || self.queue.current().is_some();
        if is_busy || is_offline || !self.words.begin_start_back(now) {
            return;
        }
        self.cut_motion(Reason::NotReady, out);
        let Some(approved) = self.guard.take_start_back(now) else {
            return;
        };
        self.reports.note(DriveNote::StartTakenBack, out);
        self.queue.push_front(approved, &self.reports);
    }

    /// Clears the reset word if it may remain and nothing else is in progress. A turning motor is left alone: the reset
    /// word is not what it obeys. In a register of its own the word is cleared before the next order, whether or not the
    /// motor turns: the next trip would be reset by it.
    fn take_reset_back(&mut self, now: MonoTime, is_offline: bool, out: Out<'_>) {
        let is_apart = !self.motor.model().replaces_reset(OrderKind::Stop);
        let is_busy = self.stop.is_pending()
            || self.queue.current().is_some()
            || !(is_apart || self.queue.waiting() == 0);
        let is_at_rest =
            self.motor.is_at_standstill() && !matches!(self.guard.intent(), RunIntent::Run(_));
        let may_go = if is_apart { !is_offline } else { is_at_rest };
        if is_busy || !may_go || !self.words.begin_reset_back(now) {
            return;
        }
        let Some(approved) = self.guard.take_reset_back() else {
            return;
        };
        self.reports.note(DriveNote::ResetTakenBack, out);
        self.queue.push_front(approved, &self.reports);
    }
}
