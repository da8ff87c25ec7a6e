//! The port comes and goes.

use super::core::{LineCore, Purpose};
use super::work::DriveWork;
use crate::domain::native::{NativeOutcome, Refusal};
use crate::domain::report::{LineState, PortFault};
use crate::domain::time::MonoTime;
use crate::line::barriers::Barriers;
use crate::line::fault::{Fault, consequence};
use crate::line::schedule::WaiterId;
use std::time::Duration;

impl LineCore {
    pub(super) fn on_port_up(&mut self, now: MonoTime) {
        self.state = LineState::Up;
        self.counters.port_ups += 1;
        self.wire.abandon(now);
        self.echo.port_opened();
        self.stations.iter_mut().for_each(|station| station.line_opened(now));
        self.barriers.iter_mut().for_each(Barriers::port_opened);
        self.plans.iter_mut().for_each(|plan| plan.port_opened(now));
        self.works.iter_mut().for_each(DriveWork::mark_changed);
    }

    /// Everything that waits is answered: what was on the wire as not answered, the rest as not sent.
    pub(super) fn on_port_down(&mut self, now: MonoTime, fault: PortFault) {
        if self.state == LineState::Down {
            return;
        }
        self.state = LineState::Down;
        self.fault = Some(fault);
        self.counters.port_downs += 1;
        if let (Some(exchange), Some(flight)) = (self.wire.abandon(now), self.flight.take()) {
            if consequence(Fault::PortGone).reply_may_come_late {
                let drive = &self.setup.drives[flight.drive.get()];
                // Its time-out had not passed yet, perhaps not even begun.
                let wait = drive.wait_for(&exchange.request, &self.setup.timing, Duration::MAX);
                let lateness = wait + drive.max_lateness;
                self.stations[flight.drive.get()].reply_missing(exchange.request, now, lateness);
            }
            self.end_all(waiters_of(flight.purpose), &NativeOutcome::NoReply);
        }
        for work in &mut self.works {
            work.line_down(now, &mut self.effects);
        }
        let waiting = self.schedule.clear();
        self.end_all(waiting, &NativeOutcome::Refused(Refusal::LineDown));
    }

    /// Ends requests before their words have come; what else was queued for them is not needed any more.
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

pub(super) fn waiters_of(purpose: Purpose) -> Vec<WaiterId> {
    match purpose {
        Purpose::Read(job) => job.waiters,
        Purpose::Work(_) | Purpose::Poll { .. } | Purpose::Barrier | Purpose::Trial(_) => Vec::new(),
    }
}
