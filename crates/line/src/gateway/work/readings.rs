//! What is known of the drive: what an earlier process left, what was read, and what was heard on a line with several gateways.

use super::DriveWork;
use super::heard::{HeardOrder, UnsettledMotion};
use super::motor::Age;
use super::reports::Out;
use crate::domain::address::Address;
use crate::domain::command::{
    Direction, GoOrder, Order, Outcome, Owner, Reason, Report, RunIntent,
};
use crate::domain::time::MonoTime;
use crate::drive::sight::{LastSeen, SeenAt};
use crate::drive::snapshot::DriveSnapshot;
use crate::drive::view::{TripEvent, TripEventKind};
use crate::gateway::event::LineEffect;
use crate::gateway::note::DriveNote;
use crate::gateway::stop::StopLatch;
use crate::gateway::waiter::ReportWaiter;
use crate::guard::LossAction;
use crate::journal::{JournalEntry, RememberedDrive, TriedWrite};
use crate::line::standby::SIGNALS_WITHIN;
use crate::profile::model::IndicatedState;

/// The origin of words.
#[derive(Clone, Copy, Debug)]
pub struct WordsOrigin {
    /// The drive sent them no later than this.
    pub at: MonoTime,
    /// They are certainly from this drive: only then do they report trips.
    pub is_its_own: bool,
}

impl DriveWork {
    /// Restores the remembered state at `now`: the trip baseline, the owner of control, and a stop that was accepted but
    /// not seen to take effect. A run order is never restored.
    pub fn remember(&mut self, remembered: &RememberedDrive, now: MonoTime, out: Out<'_>) {
        self.remember_records(remembered);
        if let Some(lease) = remembered.lease {
            self.opening.remember(lease.owner);
            self.guard.remember_lease(lease);
        }
        self.remember_orders(remembered, now, out);
    }

    /// Restores, on a line that this gateway listens to, what does not depend on who sends there, and whose control it was.
    pub fn remember_listening(&mut self, remembered: &RememberedDrive, now: MonoTime) {
        self.remember_records(remembered);
        if let Some(lease) = remembered.lease {
            self.opening.remember(lease.owner);
            self.guard
                .remember_lease_listening(lease, now, SIGNALS_WITHIN);
        }
    }

    /// This gateway takes the line, and no other one was heard since the start: restores what was ordered. Returns whether
    /// control has an owner.
    pub fn remember_on_line(
        &mut self,
        remembered: &RememberedDrive,
        now: MonoTime,
        out: Out<'_>,
    ) -> bool {
        self.remember_orders(remembered, now, out);
        self.guard.awaited_since_start();
        self.guard.lease().is_some()
    }

    /// Restores what does not depend on who sends on the line: trips and sums.
    fn remember_records(&mut self, remembered: &RememberedDrive) {
        self.trips =
            std::mem::take(&mut self.trips).remembering(remembered.trips.unwrap_or_default());
        self.kept.remember(remembered);
        self.usage.remember(remembered.usage);
    }

    /// Restores what was ordered.
    fn remember_orders(&mut self, remembered: &RememberedDrive, now: MonoTime, out: Out<'_>) {
        if remembered.may_still_run || remembered.lease.is_some() || remembered.stop.is_some() {
            self.motor.set_turned(true);
            self.sight.remember(remembered.last_seen);
        }
        self.words
            .remember(remembered.reset, self.guard.leaves_a_reset_standing());
        let Some(stop) = remembered.stop else { return };
        match self.guard.remember_stop(stop.coast, now) {
            Some(order) => self.stop.remember(order, now),
            // Its control section is gone, or the drive was replaced.
            None => {
                self.reports.note(DriveNote::StopDropped, out);
                let is_effective = false;
                self.reports
                    .keep(JournalEntry::StopOver { is_effective }, out);
            }
        }
    }

    /// Words came from `address` on, for whatever reason they were read. Returns a full scale that has changed, and is to be
    /// read again before it is believed.
    pub fn take_words(
        &mut self,
        address: Address,
        words: &[u16],
        reading: WordsOrigin,
        now: MonoTime,
        out: Out<'_>,
    ) -> Option<Address> {
        self.mark_changed();
        let mut changed = None;
        if reading.is_its_own {
            changed = self.guard.take_bases(address, words, reading.at);
            if changed.is_some() {
                // What waits was worked out with another full scale.
                self.cut_motion(Reason::FullScaleUnknown, out);
            }
            self.guard.take_setting(address, words, reading.at);
        }
        let shown = self.motor.take_status(address, words, reading.at);
        if let Some((running, is_started)) = shown {
            if running {
                self.words.runs_now(self.queue.current());
            }
            if self.stop.shows(running, is_started, now) {
                self.effective(out);
            }
        }
        if let Some(state) = self.motor.take_undocumented() {
            self.reports.note(DriveNote::Undocumented(state), out);
        }
        let output = self.motor.steps(address, words, &self.guard);
        if let Some(raw) = output {
            self.take_output(raw, reading.at, now, out);
            self.held_against_limits(now, out);
        }
        if let Some((running, _)) = shown {
            let stops = self.stop.is_pending();
            let ended = self
                .followed
                .take(running, &self.motor, stops, &self.guard, now);
            if let Some(direction) = ended {
                self.was_stopped_elsewhere(direction, now, out);
            }
        }
        if output.is_some() || self.motor.status_at() == Some(reading.at) {
            self.is_seen(out);
        }
        if self.is_moving() {
            self.motor.set_turned(true);
            self.guard.found_running(self.motor.turns(), now);
        }
        if !self.stop.is_pending() && self.stands() {
            self.motor.set_turned(false);
            self.heard
                .motor_stands(matches!(self.guard.intent(), RunIntent::Run(_)));
            self.stop.ends_stopping();
            self.guard.at_standstill();
        }
        self.bear_out(output.is_some(), now, out);
        self.take_watchdog(address, words, out);
        if reading.is_its_own {
            let events = self.trips.take(address, words, now);
            self.trip(events, out);
        } else {
            let event = self.trips.take_unsure(address, words);
            self.trip(event, out);
        }
        changed
    }

    /// Words were read from the drive at `read_at`, and `snapshot` has them.
    pub fn take_usage(&mut self, snapshot: &DriveSnapshot, read_at: MonoTime, out: Out<'_>) {
        if self.motor.read_at() == Some(read_at) {
            self.usage.take_running(self.motor.runs(), read_at);
        }
        self.usage.take_readings(snapshot, out);
    }

    /// The register of the output frequency, if `words` show more there than the drive can do: such a reading proves
    /// nothing.
    pub fn impossible_output(&self, address: Address, words: &[u16]) -> Option<Address> {
        self.motor.impossible_output(address, words, &self.guard)
    }

    fn take_output(&mut self, raw: u16, read_at: MonoTime, now: MonoTime, out: Out<'_>) {
        self.motor.take_output(raw, read_at);
        let runs = self.motor.status().is_running() == Some(true);
        let least_fall = self.motor.least_fall(self.guard.bases());
        let latch = self.stop.latch_mut();
        if latch.is_some_and(|it| it.takes_effect(raw, runs, least_fall, now)) {
            self.effective(out);
        }
        let again = self.stop.held_against(&self.motor, &mut self.guard);
        if let Some(order) = again {
            self.stop.begin(order, None, now, &self.reports, out);
        }
        if self.motor.output().is_active() {
            let event = self.trips.output_is_active(now);
            self.trip(event, out);
        }
    }

    fn effective(&mut self, out: Out<'_>) {
        let Some((mut latch, was_reported)) = self.stop.end() else {
            return;
        };
        if latch.is_acknowledged() {
            self.guard.stop_was_effective();
            self.heard.stopped_from_here();
        }
        self.motor.ramps_down(out.now());
        self.stop_is_over(true, out);
        if was_reported {
            self.reports.note(DriveNote::EffectiveAtLast, out);
        }
        let report = Report::new(Outcome::Confirmed, Reason::None);
        self.reports.tell_all(latch.waiters(), report, out);
    }

    pub(super) fn trip(&mut self, events: impl IntoIterator<Item = TripEvent>, out: Out<'_>) {
        let events = Vec::from_iter(events);
        let has_trip = events
            .iter()
            .any(|event| event.kind != TripEventKind::Cleared);
        let is_tripped = self.trips.view().active == Some(true);
        if has_trip || (is_tripped && self.guard.intent() != RunIntent::Stop) {
            // A trip cuts the output off: what reads as 0 from now on stands.
            self.motor.set_turned(false);
            // A trip ends all orders: after a reset a new order is required.
            self.guard.lost_touch(out.now());
            self.cut_motion(Reason::Tripped, out);
        }
        self.usage.count_trips(&events, out);
        self.kept.keep(&self.trips, &events, &self.reports, out);
        let drive = self.reports.drive();
        events
            .into_iter()
            .for_each(|event| out.push_back(LineEffect::Trip(drive, event)));
    }

    fn take_watchdog(&mut self, address: Address, words: &[u16], out: Out<'_>) {
        let is_commanded = self.guard.control().is_some();
        if let Some(state) = self.watchdog.take(address, words)
            && is_commanded
        {
            self.reports.note(DriveNote::Watchdog(state), out);
        }
    }

    /// Takes a reading of the output.
    fn held_against_limits(&mut self, now: MonoTime, out: Out<'_>) {
        let stops = self.stop.is_pending();
        let (guard, reports) = (&mut self.guard, &mut self.reports);
        let lost = self
            .outside
            .take(&self.motor, stops, guard, reports, now, out);
        if let Some(lost) = lost {
            self.fail_safe(lost, now, out);
        }
    }

    /// The order is over. Nothing restarts the motor but a new one.
    fn was_stopped_elsewhere(&mut self, direction: Direction, now: MonoTime, out: Out<'_>) {
        let owner = self.guard.lease().map_or(Owner::Local, |(owner, _)| owner);
        self.guard.inhibit(now);
        let report = Report::new(Outcome::Failed, Reason::StoppedElsewhere);
        self.reports.ended_after_all(report);
        self.reports.note(DriveNote::StoppedElsewhere, out);
        if let Some(run) = GoOrder::new(Vec::new(), None, Some(direction)) {
            let tried = TriedWrite::Order(Order::Go(run));
            out.attempt_ended(self.reports.drive(), owner, tried, report);
        }
    }

    /// Takes a new reading. If the drive runs although a stop was just answered from memory, the stop is sent after all.
    fn bear_out(&mut self, shows_output: bool, now: MonoTime, out: Out<'_>) {
        let unconfirmed = self
            .stop
            .bear_out(shows_output, &self.motor, &self.guard, now);
        let Some((by, coast)) = unconfirmed else {
            return;
        };
        self.stop.is_stopped_by(by, &self.reports, now, out);
        let Some(order) = self.guard.stop_after_all(by, coast, now) else {
            return;
        };
        let mut waiter = ReportWaiter::of_nobody(self.reports.drive());
        let tried = if coast {
            Order::Coast
        } else {
            Order::Stop { setpoint: None }
        };
        let tried = TriedWrite::Order(tried);
        self.reports.count(&mut waiter);
        out.attempt_taken(self.reports.drive(), by, tried, &mut waiter);
        self.stop_by(order, Some(waiter), now, out);
    }

    /// A person, `owner`, confirms that the motor stands.
    pub fn confirm_standstill(&mut self, owner: Owner, out: Out<'_>) {
        if self.sight.confirmed() {
            self.mark_changed();
            self.reports
                .note(DriveNote::StandstillConfirmed { by: owner }, out);
            let confirmed_by = Some(owner);
            self.reports
                .keep(JournalEntry::InSight { confirmed_by }, out);
        }
    }

    /// The drive has stopped answering.
    pub fn out_of_sight(&mut self, out: Out<'_>) {
        self.lose_sight(out);
        self.forget_readings(out);
    }

    /// Nothing that was read of the drive holds any more: it has stopped answering, or its line is down or another's.
    pub(super) fn forget_readings(&mut self, out: Out<'_>) {
        self.usage.out_of_sight(out);
        self.forget_motor(true, true);
        self.guard.forget_bases();
        self.stop.motion_out_of_sight(out.now());
        self.stop
            .latch_mut()
            .into_iter()
            .for_each(StopLatch::out_of_sight);
        self.watchdog.forget();
        let unread = self.trips.lost_sight();
        self.trip(unread, out);
        self.guard.lost_touch(out.now());
        self.guard.may_be_another();
        self.cut_motion(Reason::Offline, out);
    }

    fn forget_motor(&mut self, output: bool, status: bool) {
        self.mark_changed();
        if output {
            self.motor.forget_output();
            self.outside.pause();
        }
        if status {
            self.motor.forget_status();
        }
    }

    /// The drive cannot be asked any more. To be called before readings and orders are forgotten.
    pub fn lose_sight(&mut self, out: Out<'_>) {
        let last_seen = self.motor.read_at().map(|at| LastSeen {
            run_state: self.run_state(false),
            output: self.motor.output_frequency(self.guard.bases()),
            at: SeenAt::Here(at),
        });
        let is_heard = matches!(self.heard.order(), HeardOrder::Run(..));
        // What was read before an order says nothing of what it does.
        let is_ordered = self.guard.may_be_obeyed() || is_heard || self.stop.is_pending();
        let may_run = is_ordered || (last_seen.is_some() && !self.stands());
        if self.sight.lost(last_seen, may_run) {
            self.may_still_run(out);
        }
    }

    pub(super) fn may_still_run(&self, out: Out<'_>) {
        let last_seen = self.sight.last_seen();
        self.reports.note(DriveNote::MayStillRun(last_seen), out);
        self.reports
            .keep(JournalEntry::OutOfSight { last_seen }, out);
    }

    /// What was read of the motor too long ago shows nothing any more: the drive answers, but not what it is asked.
    pub fn forget_old(&mut self, now: MonoTime, out: Out<'_>) {
        let Some(ages) = self.motor.old_readings(now) else {
            return;
        };
        if !ages.contains(&Some(Age::Fresh)) {
            self.lose_sight(out);
            self.usage.out_of_sight(out);
        }
        self.stop.motion_out_of_sight(now);
        let [output, status] = ages.map(|age| age == Some(Age::Old));
        self.forget_motor(output, status);
    }

    /// A reading shows what the drive does.
    fn is_seen(&mut self, out: Out<'_>) {
        if self.sight.seen() {
            let confirmed_by = None;
            self.reports
                .keep(JournalEntry::InSight { confirmed_by }, out);
        }
    }

    /// Another gateway sent `order` to the drive at `at`.
    pub fn heard(&mut self, order: &Order, at: MonoTime, out: Out<'_>) {
        let Some(heard) = self.heard.take(order, at) else {
            return;
        };
        self.mark_changed();
        if let HeardOrder::Run(direction, _) = heard {
            self.guard.turned_by_another(direction);
            // Newer than a stop answered from memory.
            self.stop.answer_is_outdated();
            let latch = self.stop.latch();
            if latch.is_some_and(StopLatch::is_acknowledged) {
                // The stop that waits here is older than this order.
                self.drop_stop(Report::new(Outcome::Unknown, Reason::Standby), out);
            }
        }
    }

    /// The active gateway tells at `at` by which order the drive runs; `None`: it was not started over the line.
    pub fn order_received(&mut self, order: Option<Direction>, at: MonoTime) {
        self.heard.receive(order, at);
        self.mark_changed();
    }

    /// Whether the drive runs, and this listener does not know by which order.
    pub fn lacks_order(&self) -> bool {
        let is_known =
            self.heard.order() != HeardOrder::Nothing || self.motor.ordered_direction().is_some();
        let runs = self.guard.control().is_some()
            && self.is_moving()
            && self.status_view().is_local() != Some(true);
        runs && !self.stop.is_pending() && !is_known
    }

    /// What is sent about the drive before the line is handed over: the order by which it runs, or that it was not
    /// started over the line. `None` if it does not run.
    pub fn order_to_tell(&self) -> Option<Option<Direction>> {
        self.guard.control()?;
        match self.guard.intent() {
            RunIntent::Run(direction) => Some(Some(direction)),
            RunIntent::Stop | RunIntent::Coast if self.stop.is_stopping() => None,
            RunIntent::Stop | RunIntent::Coast if self.heard.may_run_on() => {
                Some(self.guard.last_direction())
            }
            RunIntent::Stop | RunIntent::Coast => self.is_moving().then_some(None),
        }
    }

    /// Another gateway or master sent the drive a stop while this gateway is active: it holds like one by another client, and
    /// is sent once more to see its effect.
    pub fn stopped_by_another(&mut self, coast: bool, now: MonoTime, out: Out<'_>) {
        let Some(order) = self.guard.stop_by_another(coast, now) else {
            return;
        };
        self.mark_changed();
        if !self.stop.is_pending() {
            self.reports.note(DriveNote::StoppedByAnother, out);
        }
        self.stop_by(order, None, now, out);
    }

    /// Another gateway has taken the line, and sees to what is declared: control is no longer of this gateway. If this one has
    /// not heard all that was sent (`is_informed`), a stop that it has declared itself may be older than the present orders.
    pub fn left_to_another(&mut self, is_informed: bool, out: Out<'_>) {
        if self.guard.is_held() {
            self.mark_changed();
        }
        self.guard.give_up();
        if !is_informed && self.latch().is_some_and(StopLatch::is_declared_alone) {
            self.drop_stop(Report::new(Outcome::Unknown, Reason::Standby), out);
        }
    }

    /// This gateway gives the line up at `now`, or its port is gone: control is no longer its own.
    pub fn give_up(&mut self, now: MonoTime, out: Out<'_>) {
        // Its own order stands like one that was heard.
        let ordered = match self.guard.intent() {
            RunIntent::Run(direction) => Some(direction),
            RunIntent::Stop | RunIntent::Coast if self.heard.may_run_on() => {
                self.guard.last_direction()
            }
            RunIntent::Stop | RunIntent::Coast => None,
        };
        self.heard.give_up(ordered, self.motor.is_moving(), now);
        // The lease goes on: where no other gateway takes the line, its commander is lost in its own time.
        self.line_down(now, Reason::Standby, out);
        self.stop
            .latch_mut()
            .into_iter()
            .for_each(StopLatch::line_given_up);
    }

    /// This gateway takes the line over at `now`: a drive that was heard or seen ordered to run gets the declared action,
    /// and a stop that was heard without effect is repeated. Where the line was handed over on purpose, running drives go
    /// on. What was not seen at standstill may run by an order that is not known here: its first readings decide.
    pub fn take_over(&mut self, now: MonoTime, goes_on: bool, out: Out<'_>) {
        let heard = self.heard.take_over();
        self.guard.give_up();
        if self.guard.control().is_none() || self.stop.is_pending() {
            return;
        }
        self.mark_changed();
        match heard {
            HeardOrder::Stop { coast } if !self.stands() => {
                let lost = self.guard.repeat_stop(coast, now);
                self.gateway_left(lost, goes_on, now, out);
            }
            HeardOrder::Run(direction, at) => {
                let is_newer = self
                    .motor
                    .status_at()
                    .is_some_and(|status_at| status_at > at);
                let is_followed = !is_newer || self.motor.status().is_running() != Some(false);
                self.runs_on(is_followed.then_some(direction), goes_on, now, out);
            }
            HeardOrder::Elsewhere if goes_on => {}
            HeardOrder::Stop { .. } | HeardOrder::Nothing | HeardOrder::Elsewhere => {
                self.heard.await_readings(goes_on, now);
                self.settle(now, out);
            }
        }
    }

    /// Decides what follows for a drive that may run by an order that is not known here, as soon as that can be seen. A drive
    /// that shows that it obeys its panel or terminals is left alone.
    pub(super) fn settle(&mut self, now: MonoTime, out: Out<'_>) {
        let Some(UnsettledMotion { goes_on, until }) = self.heard.unsettled() else {
            return;
        };
        let is_ordered_here =
            self.stop.is_pending() || matches!(self.guard.intent(), RunIntent::Run(_));
        if is_ordered_here || self.stands() {
            return self.heard.settled();
        }
        let is_local = self.status_view().is_local();
        let model = self.motor.model();
        let may_show_it = is_local.is_none() && model.status_flag(IndicatedState::BusRun).is_some();
        if !self.is_moving() || (may_show_it && now < until) {
            return;
        }
        self.heard.settled();
        if is_local != Some(true) {
            self.runs_on(self.motor.ordered_direction(), goes_on, now, out);
        }
    }

    /// The drive is ordered to run, in `direction` if that is known, and the gateway that ordered it is lost.
    fn runs_on(
        &mut self,
        direction: Option<Direction>,
        goes_on: bool,
        now: MonoTime,
        out: Out<'_>,
    ) {
        let lost = self.guard.gateway_left(direction, goes_on, now);
        self.gateway_left(lost, goes_on, now, out);
    }

    /// The gateway that had the line is lost, or gave it up on purpose (`was_given`).
    fn gateway_left(
        &mut self,
        lost: Option<LossAction>,
        was_given: bool,
        now: MonoTime,
        out: Out<'_>,
    ) {
        self.mark_changed();
        if self.guard.is_adopted() {
            let note = if was_given {
                DriveNote::GoesOn
            } else {
                DriveNote::Adopted
            };
            self.reports.note(note, out);
        }
        if let Some(lost) = lost {
            let note = if was_given {
                DriveNote::LineGiven(lost.action)
            } else {
                DriveNote::GatewayLost(lost.action)
            };
            self.reports.note(note, out);
            self.fail_safe(lost, now, out);
        }
    }
}
