//! The state of one line and its single entry point for events.

use super::broadcast;
use super::drive::{DriveOnLine, LineDrives};
use super::event::{LineEffect, LineInput, LineWake, WakeReason};
use super::health::LineHealth;
use super::measured::LineMeasurements;
use super::natives::PendingNatives;
use super::outbox::EffectOutbox;
use super::setup::LineSetup;
use super::share::LineShare;
use super::work::{DriveWork, WishRank};
use crate::domain::ids::DriveIndex;
use crate::domain::link::EchoPolicy;
use crate::domain::native::NativeAnswer;
use crate::domain::report::{LineCounters, LineFault, LineState, StopBounds};
use crate::domain::time::MonoTime;
use crate::domain::traffic::HeardFrame;
use crate::drive::snapshot::DriveSnapshot;
use crate::drive::view::DriveView;
use crate::line::barriers::LoopNonces;
use crate::line::echo::EchoWatch;
use crate::line::fault::{Fault, consequence};
use crate::line::schedule::{ReadJob, ReadSchedule};
use crate::line::timing::LineTiming;
use crate::line::transaction::LineWire;
use crate::wire::pdu::Request;
use std::sync::Arc;
use std::time::Duration;

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
    pub(super) echo_policy: EchoPolicy,
    pub(super) tells_traffic: bool,
    /// Its drives may have been sent a request just before the line was opened.
    pub(super) asked_before: bool,
    pub(super) drives: LineDrives,
    pub(super) state: LineState,
    /// Whether there is a port to send to, whatever the reported state of the line.
    pub(super) is_open: bool,
    /// The server has closed the connection: another one is made when a frame is due.
    pub(super) is_parked: bool,
    /// The frame that is handed to the port is the stop of all drives.
    pub(super) stops_all: bool,
    pub(super) wire: LineWire,
    pub(super) nonces: LoopNonces,
    pub(super) echo: EchoWatch,
    pub(super) health: LineHealth,
    pub(super) schedule: ReadSchedule,
    pub(super) natives: PendingNatives,
    pub(super) flight: Option<OpenFlight>,
    /// The drive whose wait was just cut short because others are to be stopped: their stops are sent before its own.
    pub(super) cut_short: Option<DriveIndex>,
    /// Native reads and polls alternate: whether it is the polls' turn.
    pub(super) polls_turn: bool,
    /// Consecutive polls that were overdue.
    pub(super) aged_polls: u8,
    /// A command has begun and nothing else has had an exchange since: if others wait, they get one before the next begins.
    pub(super) others_turn: bool,
    /// The station that stops all drives, if the line has one.
    pub(super) all_stop_at: Option<u8>,
    pub(super) stop: StopBounds,
    pub(super) planned_use_per_mille: u32,
    pub(super) measured: LineMeasurements,
    /// Why the port was closed last.
    pub(super) fault: Option<LineFault>,
    /// Why the port cannot be opened; `None` once it is open.
    pub(super) open_error: Option<Arc<str>>,
    pub(super) counters: LineCounters,
    /// The last data received that is already reported, because a frame of ours was sent after it.
    pub(super) told_ahead: usize,
    pub(super) effects: EffectOutbox,
    /// Its share in the line, if there are other gateways.
    pub(super) share: Option<LineShare>,
}

/// The exchange on the wire.
#[derive(Debug)]
pub(super) struct OpenFlight {
    pub(super) drive: DriveIndex,
    pub(super) purpose: ExchangePurpose,
    /// A late reply could be mistaken for its reply.
    pub(super) doubt: bool,
    /// The request, if its refusal could be a late one and is not believed; `None` once such a frame has arrived.
    pub(super) doubts_refusal: Option<Request>,
    /// A reply that repeats it may be a mere echo.
    pub(super) proves_nothing: bool,
    /// The drive was known to be silent: its silence says nothing about the line.
    pub(super) was_silent: bool,
    pub(super) sent_at: MonoTime,
    /// When the last character of the request has left.
    pub(super) request_end: MonoTime,
    /// From this moment on a stop for another drive ends the wait, if nothing was received. `None`: too few replies are
    /// known.
    pub(super) overdue_at: Option<MonoTime>,
    /// The moment `overdue_at` has passed.
    pub(super) is_overdue: bool,
    /// An unexplained frame of the station preceded its reply: the apparent reply may be another such frame.
    pub(super) is_spoilt: bool,
    /// The first frame that came instead of its reply, and how late; without that if it is of no configured station.
    pub(super) wrong_reply: Option<(HeardFrame, Option<Duration>)>,
    /// Bytes before its reply that form no frame.
    pub(super) noise: usize,
}

/// Why an exchange was sent.
#[derive(Debug)]
pub(super) enum ExchangePurpose {
    /// A request of clients.
    Read(ReadJob),
    /// The drive's own work: stops, commands, read-backs.
    Work(WishRank),
    /// A poll.
    Poll,
    /// To rule out late replies.
    Barrier,
    /// To find out whether the line echoes.
    Probe,
    /// To find out whether the barrier at this index of the model is reliable.
    Trial(usize),
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
            all_stop_at: broadcast::station_for_all(&setup),
            stop: setup.stop_bounds(),
            planned_use_per_mille: (budget.use_of_line * 1000.0).round() as u32,
            measured: LineMeasurements::default(),
            others_turn: false,
            fault: None,
            open_error: None,
            state: LineState::Down,
            is_open: false,
            is_parked: false,
            stops_all: false,
            wire: setup.wire(now),
            nonces: LoopNonces::new(setup.first_epoch),
            echo: EchoWatch::new(!setup.timing.framing.identifies_replies()),
            health: LineHealth::new(
                setup.timing.framing,
                setup.drives.iter().map(|drive| drive.station),
            ),
            schedule: ReadSchedule::default(),
            natives: PendingNatives::default(),
            flight: None,
            cut_short: None,
            polls_turn: true,
            aged_polls: 0,
            counters: LineCounters::default(),
            told_ahead: 0,
            effects,
            share,
            timing: setup.timing,
            echo_policy: setup.echo,
            tells_traffic: setup.tells_traffic,
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
            LineInput::PortRefused(reason) => self.open_error = Some(reason),
            LineInput::PortDown(fault) => self.on_port_down(now, fault),
            LineInput::ConnectionClosed => self.on_connection_closed(now),
            LineInput::ConnectionBack => self.is_parked = false,
            LineInput::Native(request) => self.on_native(now, request),
            LineInput::AskerGone(asker) => self.on_asker_gone(asker),
            LineInput::Command(command) => self.on_command(now, &command),
            LineInput::PathAlive(owner) => {
                for drive in self.drives.iter_mut() {
                    let is_reached = self.state != LineState::Down && !drive.is_offline();
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
            work.keep_lease(&mut self.effects);
            work.keep_reset(&mut self.effects);
        }
    }

    /// The next effect to execute, in order.
    pub fn next_effect(&mut self) -> Option<LineEffect> {
        self.effects.pop_front()
    }

    /// When [`LineInput::Time`] is due next.
    #[must_use]
    pub fn next_wake(&self) -> Option<LineWake> {
        let deadline = self.natives.next_deadline().map(|at| LineWake {
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
        let overdue = self.overdue_at().map(|at| LineWake {
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
        let state = self.state;
        self.drives.iter_mut().filter_map(move |drive| {
            let has_changed = drive.work.take_changed();
            has_changed.then(|| (drive.index, Arc::new(drive.view(state))))
        })
    }

    /// The current view of the drive at `index`.
    #[must_use]
    pub fn view(&self, index: DriveIndex) -> Option<DriveView> {
        self.drives.get(index).map(|drive| drive.view(self.state))
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
        self.drives.works().any(DriveWork::has_new_stop)
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
        self.state == LineState::Down || self.drives.get(drive).is_some_and(DriveOnLine::is_offline)
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
        let mut expired = 0;
        while let Some(answer) = self.natives.expire(now) {
            expired += 1;
            self.answer(answer);
        }
        if expired > 0 {
            self.counters.expired += expired;
            self.drop_unwanted();
        }
        for drive in self.drives.indices() {
            let is_offline = self.is_offline(drive);
            self.drives[drive]
                .work
                .pass(now, is_offline, &mut self.effects);
            if let Some(until) = self.drives[drive].work.take_rest() {
                self.rest(drive, until);
            }
        }
        self.end_overdue_for_a_stop(now);
        self.pass_share(now);
        self.forget_old(now);
        self.decide(now);
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
        if !self.is_open {
            return;
        }
        let ended = self.wire.receive(now, bytes);
        // More bytes may change whether the wait can be cut short for a stop.
        self.flight
            .iter_mut()
            .for_each(|flight| flight.is_overdue = false);
        self.tell_heard(now);
        let done = ended.and_then(|(exchange, ending)| self.ended(now, exchange, ending));
        self.health.is_mute = false;
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

    pub(super) fn drop_unwanted(&mut self) {
        self.schedule
            .drop_unwanted(|waiter| self.natives.is_waited_for(waiter));
    }
}
