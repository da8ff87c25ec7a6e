//! The state of the line: its port opens and closes, and its health decides whether it can be used.

use super::core::LineCore;
use super::event::LineEffect;
use super::health::{DoneExchange, jam_after};
use super::note::LineNote;
use super::work::DriveWork;
use crate::domain::command::Reason;
use crate::domain::link::PortKind;
use crate::domain::native::{NativeOutcome, NativeRefusal};
use crate::domain::report::LineFault;
use crate::domain::time::MonoTime;
use crate::line::echo::LocalEcho;
use crate::line::fault::{Fault, consequence};
use crate::line::station::MissingReply;
use std::time::Duration;

impl LineCore {
    pub(super) fn on_port_up(&mut self, now: MonoTime, kind: PortKind) {
        // The exchange on the wire is lost, whether or not the loss of the port was reported.
        self.on_port_down(now, LineFault::Gone);
        self.health.port_opened();
        self.port.opened(self.health.trouble());
        self.counters.port_ups += 1;
        self.wire.port_opened(now, kind);
        self.wire.strip_echo(false);
        self.echo.port_opened();
        self.share_port_opened(now);
        self.measured.port_opened(now);
        if self.counters.port_ups == 1 && self.asked_before {
            self.drives
                .iter_mut()
                .for_each(|drive| drive.asked_before(now));
        }
        self.drives
            .iter_mut()
            .for_each(|drive| drive.port_opened(now));
    }

    /// Answers everything that waits: what was on the wire as unanswered, the rest as not sent.
    pub(super) fn on_port_down(&mut self, now: MonoTime, fault: LineFault) {
        if !self.port.is_open() {
            return;
        }
        self.port.gone(fault);
        self.health.port_gone(fault);
        self.counters.port_downs += 1;
        self.lose_exchange(now);
        // What it saw and ordered itself is kept in mind before it is forgotten.
        self.lose_sight();
        self.share_port_gone(now);
        self.end_waiting(now);
    }

    /// No drive of the line can be seen any more.
    pub(super) fn lose_sight(&mut self) {
        self.drives
            .works_mut()
            .for_each(|work| work.lose_sight(&mut self.effects));
    }

    /// What is on the wire is not answered any more: that ends as a time-out does.
    pub(super) fn on_connection_closed(&mut self, now: MonoTime) {
        if !self.port.is_open() {
            return;
        }
        self.port.park();
        let ended = self.wire.cut_short();
        let done = ended.and_then(|(exchange, ending)| self.ended(now, exchange, ending));
        // The beginning of a message does not continue on the next connection.
        self.wire.abandon(now);
        self.conclude(now, done);
    }

    /// What is on the wire is lost; its reply may still arrive, later.
    pub(super) fn lose_exchange(&mut self, now: MonoTime) {
        let exchange = self.wire.abandon(now);
        let Some(flight) = self.flight.take() else {
            return;
        };
        if let Some(exchange) = exchange
            && consequence(Fault::PortGone).reply_may_come_late
        {
            // Its time-out has not passed, and may not even have begun.
            let drive = &mut self.drives[flight.drive];
            let sent_at = flight.request_end;
            let begun = now + drive.full_wait(&exchange.request, &self.timing);
            let until = drive.may_come_until(begun, sent_at, &exchange.request, &self.timing);
            drive.station.reply_missing(
                MissingReply {
                    request: exchange.request,
                    sent_at,
                    until,
                },
                now,
            );
        }
        self.end_all(flight.purpose.waiters(), &NativeOutcome::NoReply);
    }

    /// Answers everything that waits as not sent.
    fn end_waiting(&mut self, now: MonoTime) {
        for work in self.drives.works_mut() {
            work.line_down(now, Reason::LineDown, &mut self.effects);
        }
        self.clients.end_waiting(
            &NativeOutcome::Refused(NativeRefusal::LineDown),
            &mut self.effects,
        );
    }

    /// Whether requests and commands are accepted.
    pub(super) const fn takes_requests(&self) -> bool {
        self.port.is_open() && self.health.carries_requests()
    }

    /// Updates the health after received bytes, and after an exchange that is `done`.
    pub(super) fn conclude(&mut self, now: MonoTime, done: Option<DoneExchange>) {
        let trouble = self.health.trouble();
        if let Some(done) = &done {
            self.echo.ended();
            let misses_echo = self.echo.misses_echo();
            self.wire.strip_echo(self.echo.known() == LocalEcho::Found);
            self.health
                .exchange_ended(now, done, misses_echo, &mut self.effects);
        }
        self.check(now);
        if done.is_some() || trouble != self.health.trouble() {
            self.health.tell_suspicion(&mut self.effects);
        }
    }

    fn check(&mut self, now: MonoTime) {
        if !self.port.is_open() {
            return;
        }
        let is_jammed = self.is_jammed(now);
        let trouble =
            self.health
                .found(now, is_jammed, self.echo.known(), &self.wire, &self.drives);
        if trouble != self.health.trouble() {
            self.set_trouble(now, trouble);
        }
        if !self.wire.is_busy() && self.health.takes_reopening(now) {
            self.effects.push_back(LineEffect::Reopen(LineFault::Mute));
        }
    }

    /// Detects traffic that lasts so long that nothing can be sent. The jam is over with the first silence that is long
    /// enough for a frame.
    fn is_jammed(&self, now: MonoTime) -> bool {
        let is_silent = !self.wire.is_busy() && now >= self.wire.may_send_from();
        if self.wire.is_busy() || is_silent {
            return self.health.is_jammed() && !is_silent;
        }
        // Shorter traffic began after a silence that was not seen: the process was suspended.
        let talks = self
            .wire
            .talks_since(now)
            .map_or(Duration::ZERO, |since| now.since(since));
        let is_long = talks >= jam_after(&self.timing);
        is_long && (self.health.is_jammed() || self.work_at().is_some_and(|at| at <= now))
    }

    /// The line has become unusable, or usable again. If it is unusable, everything that waits is answered.
    fn set_trouble(&mut self, now: MonoTime, trouble: Option<LineFault>) {
        if self.health.is_jammed() {
            self.share.iter_mut().for_each(|share| share.jam_ended(now));
        }
        self.health.set_trouble(now, trouble, self.share.is_some());
        self.port.set_trouble(trouble);
        if !self.takes_requests() {
            self.end_waiting(now);
        }
        if self.health.is_jammed() {
            self.counters.jams += 1;
        }
        self.drives.works_mut().for_each(DriveWork::mark_changed);
        self.effects.push_back(LineEffect::LineNote(
            trouble.map_or(LineNote::Up, LineNote::Down),
        ));
    }
}
