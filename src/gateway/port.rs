//! Opening and loss of the port.

use super::core::{ExchangePurpose, LineCore};
use crate::domain::command::Reason;
use crate::domain::link::PortKind;
use crate::domain::native::{NativeOutcome, NativeRefusal};
use crate::domain::report::{LineFault, LineState};
use crate::domain::time::MonoTime;
use crate::line::fault::{Fault, consequence};
use crate::line::schedule::WaiterId;
use crate::line::station::MissingReply;

impl LineCore {
    pub(super) fn on_port_up(&mut self, now: MonoTime, kind: PortKind) {
        // The exchange on the wire is lost, whether or not the loss of the port was reported.
        self.on_port_down(now, LineFault::Gone);
        // A mute line stays mute until something is received: an open port proves nothing.
        self.health.trouble = self.health.is_mute.then_some(LineFault::Mute);
        self.state = if self.health.is_mute {
            LineState::Down
        } else {
            LineState::Up
        };
        self.is_open = true;
        self.is_parked = false;
        self.open_error = None;
        self.counters.port_ups += 1;
        self.wire.port_opened(now, kind);
        self.wire.strip_echo(false);
        self.echo.port_opened();
        self.share_port_opened(now);
        self.measured.port_opened(now);
        self.health.port_opened();
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
        if !self.is_open {
            return;
        }
        self.state = LineState::Down;
        self.is_open = false;
        self.fault = Some(fault);
        self.health.trouble = None;
        self.health.is_mute &= fault == LineFault::Mute;
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
        if !self.is_open {
            return;
        }
        self.is_parked = true;
        let ended = self.wire.cut_short();
        let done = ended.and_then(|(exchange, ending)| self.ended(now, exchange, ending));
        // The beginning of a message does not continue on the next connection.
        self.wire.abandon(now);
        self.conclude(now, done);
    }

    /// When another connection is needed: the server has closed the last one, and a frame is due.
    #[must_use]
    pub fn connects_at(&self) -> Option<MonoTime> {
        let wake = if self.is_parked {
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
        self.end_all(waiters_of(flight.purpose), &NativeOutcome::NoReply);
    }

    /// Answers everything that waits as not sent.
    pub(super) fn end_waiting(&mut self, now: MonoTime) {
        for work in self.drives.works_mut() {
            work.line_down(now, Reason::LineDown, &mut self.effects);
        }
        let waiting = self.schedule.clear();
        self.end_all(waiting, &NativeOutcome::Refused(NativeRefusal::LineDown));
    }

    /// Ends requests before their words have arrived; their other queued frames are dropped.
    pub(super) fn end_all(&mut self, waiters: Vec<WaiterId>, outcome: &NativeOutcome) {
        let had_waiters = !waiters.is_empty();
        for waiter in waiters {
            if let Some(answer) = self.natives.end(waiter, outcome.clone()) {
                self.answer(answer);
            }
        }
        if had_waiters {
            self.drop_unwanted();
        }
    }
}

pub(super) fn waiters_of(purpose: ExchangePurpose) -> Vec<WaiterId> {
    match purpose {
        ExchangePurpose::Read(job) => job.waiters,
        ExchangePurpose::Work(_)
        | ExchangePurpose::Poll
        | ExchangePurpose::Barrier
        | ExchangePurpose::Probe
        | ExchangePurpose::Trial(_) => Vec::new(),
    }
}
