//! An exchange has ended: who gets what, and what follows for the station.

use super::core::{Flight, LineCore, Purpose};
use super::event::Effect;
use super::port::waiters_of;
use crate::domain::ids::{DriveIndex, Station};
use crate::domain::native::NativeOutcome;
use crate::domain::time::MonoTime;
use crate::domain::traffic::{TrafficKind, TrafficRecord};
use crate::drive::snapshot::Presence;
use crate::line::fault::{Fault, consequence};
use crate::line::schedule::ReadJob;
use crate::line::transaction::{Ending, Exchange};
use crate::wire::pdu::{Reply, Request};
use std::sync::Arc;

impl LineCore {
    pub(super) fn ended(&mut self, now: MonoTime, exchange: Exchange, ending: Ending) {
        let Some(flight) = self.flight.take() else { return };
        match ending {
            Ending::Reply(reply) => {
                self.counters.replies += 1;
                self.answered(flight.drive);
                self.deliver(now, flight, &exchange, reply);
            }
            Ending::Exception(code) => {
                self.counters.exceptions += 1;
                self.answered(flight.drive);
                self.end_all(waiters_of(flight.purpose), &NativeOutcome::DriveException(code));
            }
            Ending::Garbled => {
                self.counters.garbled += 1;
                self.failed(now, flight, exchange, Fault::Garbled);
            }
            Ending::Silent => {
                self.counters.silent += 1;
                self.failed(now, flight, exchange, Fault::Silent);
            }
        }
    }

    /// Counts what was heard, tells it to whoever watches, and notes which stations are there.
    pub(super) fn tell_heard(&mut self, now: MonoTime) {
        for heard in self.wire.take_heard() {
            match heard.kind {
                TrafficKind::Request | TrafficKind::Reply => {}
                TrafficKind::Stray(station) => {
                    self.counters.strays += 1;
                    self.spoke(station);
                }
                TrafficKind::Foreign(station) => {
                    self.counters.foreign += 1;
                    self.spoke(station);
                }
                TrafficKind::Noise => self.counters.noise_bytes += heard.bytes.len() as u64,
            }
            if self.setup.tells_traffic {
                let record = TrafficRecord { at: now, kind: heard.kind, bytes: heard.bytes };
                self.effects.push_back(Effect::Traffic(record));
            }
        }
    }

    fn deliver(&mut self, now: MonoTime, flight: Flight, exchange: &Exchange, reply: Reply) {
        match (flight.purpose, reply) {
            (Purpose::Read(job), Reply::Words(words)) => {
                let words: Arc<[u16]> = Arc::from(words);
                for waiter in job.waiters {
                    if let Some(answer) = self.natives.words(waiter, &words) {
                        self.answer(answer);
                    }
                }
            }
            (Purpose::Poll { address }, Reply::Words(words)) => {
                self.snapshots[flight.drive.get()].take(address, &words, now);
            }
            (purpose, reply) => {
                let outcome = write_outcome(&exchange.request, &reply);
                self.end_all(waiters_of(purpose), &outcome);
            }
        }
    }

    fn failed(&mut self, now: MonoTime, flight: Flight, exchange: Exchange, fault: Fault) {
        let what = consequence(fault);
        let station = &mut self.stations[flight.drive.get()];
        if what.reply_may_come_late {
            let drive = &self.setup.drives[flight.drive.get()];
            // The lateness is declared against the full time-out, and a probe waits for less.
            let early = drive.reply_timeout.saturating_sub(exchange.timeout);
            station.reply_missing(exchange.request, now, early + drive.max_lateness);
        }
        if what.backs_off {
            station.silent(now);
        }
        match flight.purpose {
            Purpose::Read(job) if what.repeats_read && !job.repeated && self.is_waited_for(&job) => {
                self.counters.retries += 1;
                self.schedule.repeat_read(job);
            }
            purpose => self.end_all(waiters_of(purpose), &NativeOutcome::NoReply),
        }
        if self.stations[flight.drive.get()].is_known_silent() {
            self.set_presence(flight.drive, Presence::Offline);
            let waiting = self.schedule.take_reads_of(flight.drive);
            self.end_all(waiting.into_iter().flat_map(|job| job.waiters).collect(), &NativeOutcome::NoReply);
        }
    }

    fn is_waited_for(&self, job: &ReadJob) -> bool {
        job.waiters.iter().any(|waiter| self.natives.is_waited_for(*waiter))
    }

    fn answered(&mut self, drive: DriveIndex) {
        self.stations[drive.get()].answered();
        self.set_presence(drive, Presence::Online);
    }

    /// A frame of `station` was heard that answers nothing: if it is one of ours, it is there.
    fn spoke(&mut self, station: Station) {
        if let Some(at) = self.setup.drives.iter().position(|drive| drive.station == station)
            && consequence(Fault::Stray).drive_is_there
        {
            self.stations[at].is_there();
        }
    }

    fn set_presence(&mut self, drive: DriveIndex, presence: Presence) {
        let known = &mut self.snapshots[drive.get()].presence;
        if *known != presence {
            *known = presence;
            self.effects.push_back(Effect::Presence(drive, presence));
        }
    }
}

/// What a write's reply says: drives that refuse by keeping the old value answer with that value.
fn write_outcome(request: &Request, reply: &Reply) -> NativeOutcome {
    match (request, reply) {
        (Request::WriteSingle { value, .. }, Reply::Holds { value: held }) if value != held => {
            NativeOutcome::KeptOldValue(*held)
        }
        _ => NativeOutcome::Written,
    }
}
