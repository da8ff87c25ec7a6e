//! One drive's own work beside polls and native reads: its stop, its commands, its trips; and the picture of it.

use super::event::Effect;
use super::list::{List, Next};
use super::note::Note;
use super::stop::{StopLatch, Turn};
use super::waiter::Waiter;
use crate::domain::command::{CommandRequest, Order, Outcome, Owner, Reason, Report, RunIntent};
use crate::domain::control::ControlSettings;
use crate::domain::frequency::Hertz;
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::drive::run_state::OutputWatch;
use crate::drive::steps::Part;
use crate::drive::trips::TripWatch;
use crate::drive::view::{ControlView, RunState, TripEvent};
use crate::guard::{DriveGuard, Facts, Lost, Verdict, Void};
use crate::line::transaction::Ending;
use crate::profile::model::{Model, Role};
use crate::wire::pdu::{Reply, Request};
use std::collections::VecDeque;
use std::sync::Arc;

/// Most commands of one drive that wait behind the one that is being carried out.
pub const COMMANDS_MAX: usize = 8;

/// What a drive wants from the wire, in the order in which wishes are granted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rank {
    /// A stop that was never sent.
    FirstStop,
    /// A stop without effect so far.
    RepeatedStop,
    /// The next step of a command that has begun, read back included.
    Step,
    /// A look at whether a stop takes effect.
    Look,
    /// A trip record.
    Trip,
    /// The first step of a command.
    Start,
}

/// One wish.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Want {
    /// How urgent it is.
    pub rank: Rank,
    /// Not before this moment.
    pub at: MonoTime,
    /// What should go out.
    pub request: Request,
}

/// A drive's own work.
#[derive(Debug)]
pub struct DriveWork {
    drive: DriveIndex,
    guard: DriveGuard,
    latch: Option<StopLatch>,
    current: Option<List>,
    waiting: VecDeque<List>,
    /// What is on the wire for it, and whether its end still matters.
    flight: Option<Rank>,
    trips: TripWatch,
    output: OutputWatch,
    output_register: Option<(u16, u32)>,
    /// The last order given here was a stop, and the motor has not been seen at standstill since.
    is_stopping: bool,
    last: Option<Report>,
    commands: u16,
    has_changed: bool,
}

type Out<'a> = &'a mut VecDeque<Effect>;

impl DriveWork {
    /// The work of a drive that was just found.
    #[must_use]
    pub fn new(drive: DriveIndex, model: &Arc<Model>, control: Option<Arc<ControlSettings>>, epoch: u64) -> Self {
        let output = model.register_for(Role::OutputFrequency);
        Self {
            drive,
            guard: DriveGuard::new(Arc::clone(model), control, epoch),
            latch: None,
            current: None,
            waiting: VecDeque::new(),
            flight: None,
            trips: TripWatch::new(model),
            output: OutputWatch::default(),
            output_register: output.map(|register| (register.address, register.scale)),
            is_stopping: false,
            last: None,
            commands: 0,
            has_changed: true,
        }
    }

    /// Who holds control, and what is ordered.
    #[must_use]
    pub const fn guard(&self) -> &DriveGuard {
        &self.guard
    }

    /// What is known of its trips.
    #[must_use]
    pub const fn trips(&self) -> &TripWatch {
        &self.trips
    }

    /// Whether the picture has changed since this was asked last.
    pub const fn take_changed(&mut self) -> bool {
        std::mem::replace(&mut self.has_changed, false)
    }

    /// The picture has changed.
    pub const fn mark_changed(&mut self) {
        self.has_changed = true;
    }

    /// Whether a stop is not effective yet.
    #[must_use]
    pub const fn has_stop(&self) -> bool {
        self.latch.is_some()
    }

    /// Somebody commands.
    pub fn command(&mut self, now: MonoTime, command: &CommandRequest, waiter: Waiter, facts: Facts, out: Out<'_>) {
        self.has_changed = true;
        let is_attempt = command.order != Order::Renew;
        let is_full = self.waiting.len() >= COMMANDS_MAX && matches!(command.order, Order::Go(_) | Order::Reset);
        let verdict =
            if is_full { Err(Report::refused(Reason::QueueFull)) } else { self.guard.review(command, &facts, now) };
        match verdict {
            Err(report) => {
                self.count(is_attempt);
                self.tell(&waiter, report, true, out);
            }
            Ok(Verdict::Unchanged) => {
                let report = Report::new(Outcome::Acknowledged, Reason::Unchanged);
                out.extend(waiter.answer(report, true));
            }
            Ok(Verdict::JoinsStop) => self.join_stop(waiter, out),
            Ok(Verdict::Stop(order)) => {
                self.count(true);
                self.cut(out);
                self.is_stopping = true;
                match &mut self.latch {
                    Some(latch) => latch.renew(order, Some(waiter), now),
                    None => self.latch = Some(StopLatch::new(order, Some(waiter), now)),
                }
            }
            Ok(Verdict::Go(approved)) => {
                self.count(true);
                self.push(List::new(approved, waiter), out);
            }
        }
    }

    /// A sign of life of a commander.
    pub fn renew(&mut self, owner: Owner, now: MonoTime) {
        self.guard.renew(owner, now);
        self.has_changed = true;
    }

    /// The way from commanders was opened anew.
    pub fn new_epoch(&mut self) {
        self.guard.new_epoch();
        self.has_changed = true;
    }

    /// The gateway ends: the declared action.
    pub fn shut_down(&mut self, now: MonoTime, out: Out<'_>) {
        if let Some(lost) = self.guard.shut_down(now) {
            out.push_back(Effect::Note(self.drive, Note::ShuttingDown(lost.action)));
            self.fail_safe(lost, now, out);
        }
    }

    /// What time alone brings about.
    pub fn pass(&mut self, now: MonoTime, is_offline: bool, out: Out<'_>) {
        let at_rest = self.output.is_at_standstill() && self.latch.is_none();
        let had_lease = self.guard.lease().is_some();
        if let Some(lost) = self.guard.expire(now, at_rest) {
            if let Some(owner) = lost.owner {
                out.push_back(Effect::Note(self.drive, Note::CommanderLost { owner, action: lost.action }));
            }
            self.fail_safe(lost, now, out);
        }
        self.has_changed |= had_lease && self.guard.lease().is_none();
        self.pass_stop(now, is_offline, out);
        self.expire_lists(now, out);
    }

    /// When [`Self::pass`] has something to do.
    #[must_use]
    pub fn next_wake(&self) -> Option<MonoTime> {
        let control = self.guard.control();
        let stop = self.latch.as_ref().zip(control).map(|(latch, control)| latch.next_wake(control));
        let current = self.current.as_ref().filter(|list| !list.has_begun() && self.flight.is_none());
        let lists = current.into_iter().chain(&self.waiting).map(List::start_before).min();
        [self.guard.next_wake(), stop, lists].into_iter().flatten().min()
    }

    /// What it wants from the wire.
    pub fn wants(&self) -> impl Iterator<Item = Want> + '_ {
        let stop = self.latch.as_ref().map(|latch| {
            let (at, request) = latch.frame();
            let rank = if latch.is_first() { Rank::FirstStop } else { Rank::RepeatedStop };
            Want { rank, at, request }
        });
        let list = self.current.as_ref().or(self.waiting.front()).and_then(|list| {
            let rank = if list.is_new() { Rank::Start } else { Rank::Step };
            Some(Want { rank, at: MonoTime::ZERO, request: list.request()? })
        });
        let look = self.latch.as_ref().zip(self.output_register).and_then(|(latch, (address, _))| {
            let request = Request::ReadHolding { address, count: 1 };
            (latch.look_at() < MonoTime::NEVER).then(|| Want { rank: Rank::Look, at: latch.look_at(), request })
        });
        let trip = self.trips.wants().map(|(address, count)| Want {
            rank: Rank::Trip,
            at: MonoTime::ZERO,
            request: Request::ReadHolding { address, count },
        });
        [stop, list, look, trip].into_iter().flatten()
    }

    /// The wish of `rank` goes out at `now`, unless its time is over: then it is answered and nothing goes out.
    pub fn send(&mut self, rank: Rank, now: MonoTime, out: Out<'_>) -> bool {
        match rank {
            Rank::FirstStop | Rank::RepeatedStop => {
                if let Some(latch) = &mut self.latch {
                    latch.was_sent(now);
                }
            }
            Rank::Step | Rank::Start => {
                if self.current.is_none() {
                    self.current = self.waiting.pop_front();
                }
                let Some(list) = &mut self.current else { return false };
                if let Err(void) = list.may_go(now, self.guard.stops()) {
                    self.void(void, out);
                    return false;
                }
                list.was_sent();
            }
            Rank::Look | Rank::Trip => {}
        }
        self.flight = Some(rank);
        self.has_changed = true;
        true
    }

    /// The exchange that was sent for the wish of `rank` is over. `doubt`: a late reply could have been taken for its
    /// answer.
    pub fn ended(&mut self, rank: Rank, ending: &Ending, doubt: bool, now: MonoTime, out: Out<'_>) {
        let is_wanted = self.flight.take().is_some();
        self.has_changed = true;
        match rank {
            Rank::FirstStop | Rank::RepeatedStop => self.stop_ended(ending, doubt, now, out),
            Rank::Step | Rank::Start if is_wanted => self.step_ended(ending, out),
            Rank::Step | Rank::Start => {}
            Rank::Look => {
                if let (Some(latch), false) = (&mut self.latch, matches!(ending, Ending::Reply(_))) {
                    latch.look_failed(now);
                }
            }
            Rank::Trip => {
                if !matches!(ending, Ending::Reply(_)) {
                    self.trips.read_failed();
                }
            }
        }
    }

    /// Words came from `address` on, for whatever reason they were read.
    pub fn take_words(&mut self, address: u16, words: &[u16], now: MonoTime, out: Out<'_>) {
        self.has_changed = true;
        let output = self.output_register.and_then(|(register, _)| {
            let offset = register.checked_sub(address)?;
            words.get(usize::from(offset)).copied()
        });
        if let Some(raw) = output {
            self.take_output(raw, now, out);
        }
        let event = self.trips.take(address, words, now);
        self.trip(event, out);
    }

    /// The drive has stopped answering, or its line is down.
    pub fn out_of_sight(&mut self) {
        self.has_changed = true;
        self.output.forget();
        self.trips.lost_sight();
        self.guard.inhibit();
    }

    /// The line is down: what waits is not sent, what is on the wire is in doubt. A stop goes on waiting.
    pub fn line_down(&mut self, now: MonoTime, out: Out<'_>) {
        self.out_of_sight();
        self.flight = None;
        if let Some(latch) = &mut self.latch {
            latch.failed(now);
        }
        for list in self.current.take().into_iter().chain(std::mem::take(&mut self.waiting)) {
            let report = if list.has_begun() {
                Report::new(Outcome::Unknown, Reason::NoReply)
            } else {
                Report::refused(Reason::LineDown)
            };
            self.finish(&list, report, out);
        }
    }

    /// Facts for the review.
    #[must_use]
    pub fn facts(&self, line_is_up: bool, is_offline: bool) -> Facts {
        let scale = self.output_register.map_or(1, |(_, scale)| scale);
        Facts {
            line_is_up,
            is_offline,
            stop_pending: self.latch.is_some(),
            tripped: self.trips.view().active,
            at_standstill: self.output.is_at_standstill(),
            output: self.output.raw().map(|raw| Hertz::from_word(raw, scale)),
        }
    }

    /// What the drive does.
    #[must_use]
    pub fn run_state(&self, is_offline: bool) -> RunState {
        if is_offline {
            RunState::Offline
        } else if self.trips.view().active == Some(true) {
            RunState::Tripped
        } else {
            self.output.run_state(self.guard.intent(), self.is_stopping)
        }
    }

    /// Control, as the north sides are shown it; nothing without a control section.
    #[must_use]
    pub fn control_view(&self) -> Option<ControlView> {
        let guard = &self.guard;
        guard.control()?;
        Some(ControlView {
            lease: guard.lease(),
            intent: guard.intent(),
            setpoint: guard.setpoint(),
            start_inhibited: guard.is_start_inhibited(),
            command_pending: self.latch.is_some() || self.current.is_some() || !self.waiting.is_empty(),
            stop_pending: self.latch.is_some(),
            not_effective: self.latch.as_ref().is_some_and(StopLatch::is_late),
            failsafe: guard.has_failed_safe(),
            epoch: guard.epoch(),
            last: self.last,
            commands: self.commands,
        })
    }

    fn take_output(&mut self, raw: u16, now: MonoTime, out: Out<'_>) {
        self.output.take(raw, now);
        if self.latch.as_mut().is_some_and(|latch| latch.takes_effect(raw, now)) {
            self.effective(out);
        }
        if self.output.is_active() {
            let event = self.trips.output_is_active(now);
            self.trip(event, out);
        }
        if self.output.is_at_standstill() && self.latch.is_none() {
            self.is_stopping = false;
            self.guard.at_standstill();
        }
    }

    fn effective(&mut self, out: Out<'_>) {
        let Some(mut latch) = self.latch.take() else { return };
        if latch.is_late() {
            out.push_back(Effect::Note(self.drive, Note::EffectiveAtLast));
        }
        for waiter in std::mem::take(latch.waiters()) {
            self.tell(&waiter, Report::new(Outcome::Confirmed, Reason::None), true, out);
        }
    }

    fn trip(&mut self, event: Option<TripEvent>, out: Out<'_>) {
        if self.trips.view().active == Some(true) && self.guard.intent() != RunIntent::Stop {
            // A trip ends what was ordered: after a reset a fresh order is needed.
            self.guard.inhibit();
        }
        if let Some(event) = event {
            if self.trips.view().active == Some(true) {
                self.guard.inhibit();
            }
            out.push_back(Effect::Trip(self.drive, event));
        }
    }

    fn push(&mut self, list: List, out: Out<'_>) {
        while let Some(at) = self.waiting.iter().position(|old| old.is_replaced_by(&list)) {
            if let Some(old) = self.waiting.remove(at) {
                self.tell(old.waiter(), Report::new(Outcome::Superseded, Reason::Newer), true, out);
            }
        }
        self.waiting.push_back(list);
    }

    fn join_stop(&mut self, waiter: Waiter, out: Out<'_>) {
        if let Some(report) = self.latch.as_mut().and_then(|latch| latch.join(waiter)) {
            out.extend(waiter.answer(report, true));
        }
    }

    /// A stop cancels everything else that was ordered.
    fn cut(&mut self, out: Out<'_>) {
        if matches!(self.flight, Some(Rank::Step | Rank::Start)) {
            self.flight = None;
        }
        for list in self.current.take().into_iter().chain(std::mem::take(&mut self.waiting)) {
            self.tell(list.waiter(), Report::new(Outcome::Superseded, Reason::Stopped), true, out);
        }
    }

    fn fail_safe(&mut self, lost: Lost, now: MonoTime, out: Out<'_>) {
        self.has_changed = true;
        let Some(order) = lost.order else { return };
        self.cut(out);
        self.is_stopping = true;
        match &mut self.latch {
            Some(latch) => latch.renew(order, None, now),
            None => self.latch = Some(StopLatch::new(order, None, now)),
        }
    }

    fn pass_stop(&mut self, now: MonoTime, is_offline: bool, out: Out<'_>) {
        let (Some(latch), Some(control)) = (&mut self.latch, self.guard.control()) else { return };
        let turn = latch.pass(now, is_offline, control);
        let note = match turn {
            Turn::None => return,
            Turn::NotEffective => Note::NotEffective,
            Turn::Dropped => Note::StopDropped,
        };
        self.has_changed = true;
        out.push_back(Effect::Note(self.drive, note));
        let report = latch.late_report();
        let waiters = std::mem::take(latch.waiters());
        if turn == Turn::Dropped {
            self.latch = None;
        }
        for waiter in waiters {
            self.tell(&waiter, report, true, out);
        }
    }

    fn expire_lists(&mut self, now: MonoTime, out: Out<'_>) {
        if self.flight.is_none()
            && self.current.as_ref().is_some_and(|list| !list.has_begun() && now >= list.start_before())
        {
            self.void(Void::TooLate, out);
        }
        while let Some(at) = self.waiting.iter().position(|list| now >= list.start_before()) {
            if let Some(list) = self.waiting.remove(at) {
                self.finish(&list, Report::new(Outcome::Expired, Reason::TooLate), out);
            }
        }
    }

    fn void(&mut self, void: Void, out: Out<'_>) {
        let Some(list) = self.current.take() else { return };
        let report = match void {
            Void::Stopped => Report::new(Outcome::Superseded, Reason::Stopped),
            Void::TooLate => Report::new(Outcome::Expired, Reason::TooLate),
        };
        self.finish(&list, report, out);
    }

    fn stop_ended(&mut self, ending: &Ending, doubt: bool, now: MonoTime, out: Out<'_>) {
        let Some(latch) = &mut self.latch else { return };
        let Request::WriteSingle { value, .. } = latch.frame().1 else { return };
        let failed = Report::new(Outcome::Failed, Reason::KeptOldValue);
        let (report, is_final) = match ending {
            Ending::Reply(Reply::Holds { value: held }) if *held != value => {
                latch.failed(now);
                (Some(Report { held: Some(*held), ..failed }), true)
            }
            Ending::Reply(_) => (latch.echoed(now, doubt), false),
            Ending::Exception(code) => {
                latch.failed(now);
                (Some(Report { exception: Some(*code), reason: Reason::DriveException, ..failed }), true)
            }
            Ending::Garbled | Ending::Silent => {
                latch.failed(now);
                (None, false)
            }
        };
        let Some(report) = report else { return };
        let waiters = std::mem::take(latch.waiters());
        for waiter in waiters {
            self.tell(&waiter, report, is_final, out);
            let goes_on = !is_final && !waiter.is_done(report);
            if let (true, Some(latch)) = (goes_on, &mut self.latch) {
                latch.waiters().push(waiter);
            }
        }
        self.last = Some(report);
    }

    fn step_ended(&mut self, ending: &Ending, out: Out<'_>) {
        let Some(mut list) = self.current.take() else { return };
        let written = list.present_write().copied();
        let next = match ending {
            Ending::Reply(reply) => list.answered(reply),
            Ending::Exception(code) => list.excepted(*code),
            Ending::Garbled | Ending::Silent => list.unanswered(),
        };
        let refused = matches!(next, Next::Ends(Report { outcome: Outcome::Failed, .. }));
        if let (Some(write), Ending::Reply(_), false) = (written, ending, refused) {
            self.part_taken(write.part);
        }
        match next {
            Next::Goes(report) => {
                if let Some(report) = report {
                    self.tell(list.waiter(), report, false, out);
                }
                self.current = Some(list);
            }
            Next::Ends(report) => {
                if report.reason == Reason::SetpointUnknown {
                    out.push_back(Effect::Note(self.drive, Note::SetpointOutside));
                }
                self.finish(&list, report, out);
            }
        }
    }

    fn part_taken(&mut self, part: Part) {
        match part {
            Part::Setpoint(value) => self.guard.setpoint_was_acknowledged(value),
            Part::Run(direction) => self.guard.run_was_acknowledged(direction),
            Part::Reset { ends: true } => self.trips.reset_acknowledged(),
            Part::Register | Part::Reset { ends: false } => {}
        }
    }

    /// The list is over: what it ordered and did not reach is no intent any more.
    fn finish(&mut self, list: &List, report: Report, out: Out<'_>) {
        if matches!(report.outcome, Outcome::Refused | Outcome::Expired | Outcome::Failed | Outcome::Superseded) {
            let runs = |part| matches!(part, Part::Run(_));
            let is_ordered_anew = self.waiting.iter().any(|newer| newer.parts_left().any(runs));
            for part in list.parts_left() {
                if let (Part::Run(direction), false) = (part, is_ordered_anew) {
                    self.guard.run_failed(direction);
                }
            }
        }
        self.tell(list.waiter(), report, true, out);
    }

    fn tell(&mut self, waiter: &Waiter, report: Report, is_final: bool, out: Out<'_>) {
        self.last = Some(report);
        self.has_changed = true;
        out.extend(waiter.answer(report, is_final));
    }

    fn count(&mut self, is_attempt: bool) {
        self.commands = self.commands.wrapping_add(u16::from(is_attempt));
    }
}
