//! The state of one line and its single entry point for events.

use super::broadcast::BroadcastStop;
use super::drive::{DriveOnLine, LineDrives};
use super::event::{LineEffect, LineInput, LineWake, WakeReason};
use super::flight::OpenFlight;
use super::health::LineHealth;
use super::measured::LineMeasurements;
use super::natives::ClientReads;
use super::outbox::EffectOutbox;
use super::overdue::cut_for_a_stop;
use super::port::PortState;
use super::setup::LineSetup;
use super::share::LineShare;
use super::stop::StopLatch;
use super::traffic::TrafficWatch;
use super::turns::LineTurns;
use super::work::DriveWork;
use crate::domain::ids::DriveIndex;
use crate::domain::native::NativeAnswer;
use crate::domain::report::{
    LineCounters, LineFault, LineReport, LineWaiting, StationReport, StopBounds,
};
use crate::domain::time::MonoTime;
use crate::drive::snapshot::DriveSnapshot;
use crate::drive::view::DriveView;
use crate::line::barriers::LoopNonces;
use crate::line::echo::EchoWatch;
use crate::line::fault::{Fault, consequence};
use crate::line::timeouts::RequestClass;
use crate::line::timing::LineTiming;
use crate::line::transaction::LineWire;
use std::sync::Arc;

/// The state machine of one line with its drives. It does no I/O and has no clock and no task of its own; the caller
/// drives it through these methods.
///
/// * **Input**: [`handle`](Self::handle) takes one event and the moment at which it happened. Moments never go back. Every
///   input except [`LineInput::Time`] is only noted and answered; [`LineInput::Time`] decides what to send and what has expired.
/// * **Output**: [`next_effect`](Self::next_effect) returns what to do, in order.
///   [`changed_views`](Self::changed_views) and [`next_station`](Self::next_station) return what to publish.
/// * **Time**: [`next_wake`](Self::next_wake) is the moment at which [`LineInput::Time`] is due, if no event arrives earlier.
/// * **Queries**: all methods on `&self` only read, and may be called at any time.
///
/// Each round calls them in this order:
///
/// 1. `handle` with every event that has happened since the last round, then once with [`LineInput::Time`];
/// 2. `next_effect` until it returns `None`, executing the effects in that order;
/// 3. the changed views;
/// 4. `next_wake`: sleep until then, or until an event arrives.
///
/// To leave a line: [`LineInput::Leave`] or [`LineInput::Shutdown`], rounds as before until [`is_at_rest`](Self::is_at_rest) or the
/// time allowed has passed, then [`end_attempts`](Self::end_attempts) and the remaining effects.
#[derive(Debug)]
pub struct LineCore {
    pub(super) timing: LineTiming,
    /// Its drives may have been sent a request just before the line was opened.
    pub(super) asked_before: bool,
    pub(super) drives: LineDrives,
    pub(super) port: PortState,
    pub(super) wire: LineWire,
    pub(super) nonces: LoopNonces,
    pub(super) echo: EchoWatch,
    pub(super) health: LineHealth,
    pub(super) clients: ClientReads,
    pub(super) flight: Option<OpenFlight>,
    pub(super) turns: LineTurns,
    pub(super) broadcast: BroadcastStop,
    pub(super) traffic: TrafficWatch,
    pub(super) measured: LineMeasurements,
    pub(super) counters: LineCounters,
    pub(super) effects: EffectOutbox,
    /// Its share in the line, if there are other gateways.
    pub(super) share: Option<LineShare>,
    stop: StopBounds,
    planned_use_per_mille: u32,
}

impl LineCore {
    /// Creates a line whose port is not open yet.
    #[must_use]
    pub fn new(setup: LineSetup, now: MonoTime) -> Self {
        let budget = setup.budget();
        let mut effects = EffectOutbox::new(setup.keeps, setup.drives.len());
        effects.set_time(now);
        let mut drives = LineDrives::new(&setup, &budget, now);
        let share = LineShare::of(&setup);
        for drive in drives.iter_mut() {
            if setup.joins_late {
                drive.work.inhibit(now);
            }
            // Another gateway may have ordered something else since.
            if setup.keeps && share.is_some() {
                drive.work.remember_listening(&drive.setup.remembered, now);
            } else if setup.keeps {
                drive
                    .work
                    .remember(&drive.setup.remembered, now, &mut effects);
            }
        }
        Self {
            stop: setup.stop_bounds(),
            planned_use_per_mille: (budget.use_of_line * 1000.0).round() as u32,
            broadcast: BroadcastStop::of(&setup),
            measured: LineMeasurements::default(),
            port: PortState::closed(),
            wire: setup.wire(now),
            nonces: LoopNonces::new(setup.first_epoch),
            echo: EchoWatch::new(!setup.timing.framing.identifies_replies()),
            health: LineHealth::new(&setup),
            clients: ClientReads::default(),
            flight: None,
            turns: LineTurns::new(),
            counters: LineCounters::default(),
            traffic: TrafficWatch::new(setup.tells_traffic),
            effects,
            share,
            timing: setup.timing,
            asked_before: setup.asked_before,
            drives,
        }
    }

    /// Handles an event that happened at `now`. Moments never go back.
    pub fn handle(&mut self, now: MonoTime, input: LineInput<'_>) {
        self.effects.set_time(now);
        match input {
            LineInput::Bytes(bytes) => self.on_bytes(now, bytes),
            LineInput::PortUp(kind) => self.on_port_up(now, kind),
            LineInput::PortRefused(reason) => self.port.refused(reason),
            LineInput::PortDown(fault) => self.on_port_down(now, fault),
            LineInput::ConnectionClosed => self.on_connection_closed(now),
            LineInput::ConnectionBack => self.port.connected(),
            LineInput::Native(request) => self.on_native(now, request),
            LineInput::AskerGone(asker) => self.on_asker_gone(asker),
            LineInput::Command(command) => self.on_command(now, &command),
            LineInput::PathAlive(owner) => {
                for drive in self.drives.iter_mut() {
                    let is_reached = !self.port.is_down() && !drive.is_offline();
                    drive.work.path_alive(owner, is_reached, now);
                }
            }
            LineInput::PathOpened(_) => self.drives.works_mut().for_each(DriveWork::new_epoch),
            LineInput::ResetUsage(drive, owner) => {
                if let Some(drive) = self.drives.get_mut(drive) {
                    drive.work.reset_usage(owner, &mut self.effects);
                }
            }
            LineInput::ConfirmStandstill(drive, owner) => {
                if let Some(drive) = self.drives.get_mut(drive) {
                    drive.work.confirm_standstill(owner, &mut self.effects);
                }
            }
            LineInput::Shutdown if self.listens() => self.end_listening(now),
            LineInput::Shutdown => {
                for work in self.drives.works_mut() {
                    work.shut_down(now, &mut self.effects);
                }
            }
            LineInput::Kept(row) => self.drives.works_mut().for_each(|work| work.kept(row)),
            LineInput::Leave { stops } => {
                let listens = self.listens();
                for work in self.drives.works_mut() {
                    let is_ours = !listens || work.is_bound();
                    work.leave(now, stops && is_ours, &mut self.effects);
                }
            }
            LineInput::Yield => self.on_yield(now),
            LineInput::Stay => self.drives.works_mut().for_each(DriveWork::stay),
            LineInput::Time => self.on_time(now),
        }
        for work in self.drives.works_mut() {
            work.keep_changes(&mut self.effects);
        }
    }

    /// The next effect to execute, in order.
    pub fn next_effect(&mut self) -> Option<LineEffect> {
        self.effects.pop_front()
    }

    /// When [`LineInput::Time`] is due next.
    #[must_use]
    pub fn next_wake(&self) -> Option<LineWake> {
        let deadline = self.clients.next_deadline().map(|at| LineWake {
            at,
            reason: WakeReason::RequestDeadline,
        });
        let control = self.drives.works().filter_map(DriveWork::next_wake).min();
        let control = control.map(|at| LineWake {
            at,
            reason: WakeReason::ControlDue,
        });
        let wire = self.wire.wake_at().map(|at| {
            let reason = if self.wire.is_busy() {
                WakeReason::ReplyDue
            } else {
                WakeReason::FrameEnd
            };
            LineWake { at, reason }
        });
        let overdue = self.flight.as_ref().and_then(|it| it.cut_at(&self.wire));
        let overdue = overdue.map(|at| LineWake {
            at,
            reason: WakeReason::ReplyDue,
        });
        let work = if self.wire.is_busy() {
            None
        } else {
            self.work_wake()
        };
        [
            deadline,
            control,
            wire,
            overdue,
            work,
            self.health_wake(),
            self.share_wake(),
        ]
        .into_iter()
        .flatten()
        .min_by_key(|wake| wake.at)
    }

    /// When the health must be checked next.
    fn health_wake(&self) -> Option<LineWake> {
        if !self.port.is_open() || self.wire.is_busy() {
            return None;
        }
        let at = self.health.next_check(&self.wire, &self.drives)?;
        Some(LineWake {
            at,
            reason: WakeReason::LineCheck,
        })
    }

    /// When another connection is needed: the server has closed the last one, and a frame is due.
    #[must_use]
    pub fn connects_at(&self) -> Option<MonoTime> {
        let wake = if self.port.is_parked() {
            self.frame_wake()
        } else {
            None
        };
        wake.map(|wake| wake.at)
    }

    /// Whether a reply is waited for.
    #[must_use]
    pub const fn awaits_reply(&self) -> bool {
        self.wire.is_busy()
    }

    /// Sets whether traffic is reported.
    pub const fn tell_traffic(&mut self, tells: bool) {
        self.traffic.tell(tells);
    }

    /// Whether an exchange is on the wire, or waits only for the silence before it: new requests cannot change
    /// what happens until then. A stop can, if a reply is overdue.
    #[must_use]
    pub fn is_occupied(&self) -> bool {
        if self.wire.is_busy() {
            return self.flight.as_ref().is_none_or(|flight| !flight.is_overdue);
        }
        self.work_wake()
            .is_some_and(|wake| wake.reason == WakeReason::SilentInterval)
    }

    /// Counts since start.
    #[must_use]
    pub const fn counters(&self) -> &LineCounters {
        &self.counters
    }

    /// The views that have changed since the last call.
    pub fn changed_views(&mut self) -> impl Iterator<Item = (DriveIndex, Arc<DriveView>)> + '_ {
        let state = self.port.state();
        self.drives.iter_mut().filter_map(move |drive| {
            let has_changed = drive.work.take_changed();
            has_changed.then(|| (drive.index, Arc::new(drive.view(state))))
        })
    }

    /// The current view of the drive at `index`.
    #[must_use]
    pub fn view(&self, index: DriveIndex) -> Option<DriveView> {
        self.drives
            .get(index)
            .map(|drive| drive.view(self.port.state()))
    }

    /// Whether no stop is in progress, including that of a reset: the line may be left.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        !self.drives.works().any(DriveWork::must_go_on)
    }

    /// Leaves the line at `now`: every open attempt gets an outcome. A pending stop stays pending.
    pub fn end_attempts(&mut self, now: MonoTime) {
        self.effects.set_time(now);
        self.drives
            .works_mut()
            .for_each(|work| work.end_attempts(&mut self.effects));
    }

    /// Whether a stop waits that has never been sent.
    #[must_use]
    pub fn has_unsent_stop(&self) -> bool {
        self.drives
            .works()
            .any(|work| work.latch().is_some_and(StopLatch::is_first))
    }

    /// The drives that may be commanded and that run, are under control, or still have to be stopped.
    pub fn in_use(&self) -> impl Iterator<Item = DriveIndex> + '_ {
        // On a line that is listened to, a drive that moves is in use by another gateway.
        let listens = self.listens();
        let is_ours = move |work: &DriveWork| !listens || work.is_bound();
        self.drives
            .iter()
            .filter(move |it| it.work.is_in_use() && is_ours(&it.work))
            .map(|it| it.index)
    }

    /// The drives that still need this line: a stop in progress, a reset that has begun, control.
    pub fn bound(&self) -> impl Iterator<Item = DriveIndex> + '_ {
        self.drives
            .iter()
            .filter(|drive| drive.work.is_bound())
            .map(|drive| drive.index)
    }

    pub(super) fn is_offline(&self, drive: DriveIndex) -> bool {
        self.port.is_down() || self.drives.get(drive).is_some_and(DriveOnLine::is_offline)
    }

    /// The static description of the drive at `index`.
    #[must_use]
    pub fn snapshot(&self, index: DriveIndex) -> Option<&DriveSnapshot> {
        self.drives.get(index).map(|drive| &drive.snapshot)
    }

    fn on_time(&mut self, now: MonoTime) {
        let ended = self.wire.pass(now);
        // What was received before a reply may show how far to trust it.
        self.tell_heard(now);
        let done = ended.and_then(|(exchange, ending)| self.ended(now, exchange, ending));
        self.conclude(now, done);
        self.counters.expired += self.clients.expire(now, &mut self.effects);
        for drive in self.drives.indices() {
            let is_offline = self.is_offline(drive);
            self.drives[drive]
                .work
                .pass(now, is_offline, &mut self.effects);
            if let Some(until) = self.drives[drive].work.take_rest() {
                self.drives[drive].station.rest_until(until);
            }
        }
        self.end_overdue_for_a_stop(now);
        self.pass_share(now);
        self.forget_old(now);
        self.decide(now);
    }

    /// Ends a wait early for a stop.
    fn end_overdue_for_a_stop(&mut self, now: MonoTime) {
        let Some(flight) = &mut self.flight else {
            return;
        };
        let drive = flight.drive;
        let ended = cut_for_a_stop(now, flight, &mut self.wire, &self.drives);
        if let Some((exchange, ending)) = ended {
            self.turns.was_cut_short(drive);
            self.ended(now, exchange, ending);
        }
    }

    /// While this gateway asks the drives, what it has not read for long shows nothing any more.
    fn forget_old(&mut self, now: MonoTime) {
        if self.listens() {
            return;
        }
        for drive in self.drives.indices() {
            if !self.is_offline(drive) {
                self.drives[drive].work.forget_old(now, &mut self.effects);
            }
        }
    }

    fn on_bytes(&mut self, now: MonoTime, bytes: &[u8]) {
        // The connection is given up; its last bytes are read before it is closed.
        if !self.port.is_open() {
            return;
        }
        let ended = self.wire.receive(now, bytes);
        // More bytes may change whether the wait can be cut short for a stop.
        self.flight
            .iter_mut()
            .for_each(|flight| flight.is_overdue = false);
        self.tell_heard(now);
        let done = ended.and_then(|(exchange, ending)| self.ended(now, exchange, ending));
        self.health.received();
        self.conclude(now, done);
        if self.wire.is_out_of_step() && consequence(Fault::OutOfStep).reopens_port {
            self.on_port_down(now, LineFault::OutOfStep);
            self.effects
                .push_back(LineEffect::Reopen(LineFault::OutOfStep));
        }
    }

    pub(super) fn answer(&mut self, answer: NativeAnswer) {
        self.effects.push_back(LineEffect::Answer(answer));
    }

    /// The drive at `drive` ignores requests until `until`: only stops are sent to it, and its silence means nothing.
    pub fn rest(&mut self, drive: DriveIndex, until: MonoTime) {
        if let Some(drive) = self.drives.get_mut(drive) {
            drive.station.rest_until(until);
        }
    }

    /// The drives whose stop is not effective yet, and whether it was sent at all.
    pub fn open_stops(&self) -> impl Iterator<Item = (DriveIndex, bool)> + '_ {
        self.drives
            .iter()
            .filter_map(|drive| Some((drive.index, !drive.work.latch()?.is_unsent())))
    }

    /// The line's state and counters.
    #[must_use]
    pub fn report(&self) -> LineReport {
        LineReport {
            state: self.port.state(),
            fault: self.port.fault(),
            open_error: self.port.open_error(),
            counters: LineCounters {
                noise_between: self.health.noise_between(),
                ..self.counters
            },
            stop: self.stop,
            planned_use_per_mille: self.planned_use_per_mille,
            measured: self.measured.line,
            quality: self.health.report(),
            suspicion: self.health.suspicion(),
            waiting: self.waiting(),
            standby: self.standby_report(),
        }
    }

    fn waiting(&self) -> LineWaiting {
        let stops = self.drives.works().filter_map(DriveWork::latch).count();
        let commands = self.drives.works().map(DriveWork::commands_open).sum();
        LineWaiting {
            requests: self.clients.len(),
            commands,
            stops,
        }
    }

    /// The next report of a drive due at `now`, if any.
    pub fn next_station(&mut self, now: MonoTime) -> Option<(DriveIndex, StationReport)> {
        let place = self.measured.report_due(self.drives.len(), now)?;
        let drive = DriveIndex(u16::try_from(place).ok()?);
        Some((drive, self.station(drive)?))
    }

    /// The current report of the drive at `drive`; `None` if there is no such drive.
    #[must_use]
    pub fn station(&self, drive: DriveIndex) -> Option<StationReport> {
        let DriveOnLine {
            setup, measured, ..
        } = self.drives.get(drive)?;
        let place = drive.get();
        Some(StationReport {
            replies: RequestClass::ALL.map(|class| measured.replies(class, setup)),
            oldest_age: measured.oldest_age(),
            planned_age: measured.planned_age,
            exchanges: measured.exchanges,
            damage: self.health.damage_of(place),
            reply_counts: measured.reply_counts,
            commands: self.effects.commands(drive),
            bad_per_cent: self.health.bad_per_cent(place),
            is_suspended: self.health.is_suspended(place),
        })
    }
}
