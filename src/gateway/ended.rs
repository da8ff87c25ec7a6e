//! An exchange has ended: who gets what, and what follows for the station.

use super::core::{Flight, LineCore, Purpose};
use super::event::Effect;
use super::port::waiters_of;
use super::work::Rank;
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
use std::time::Duration;

impl LineCore {
    pub(super) fn ended(&mut self, now: MonoTime, exchange: Exchange, ending: Ending) {
        let Some(Flight { drive, purpose, doubt, sent_at }) = self.flight.take() else { return };
        self.counters.busy_us += u64::try_from(now.since(sent_at).as_micros()).unwrap_or(0);
        match &ending {
            Ending::Reply(_) => self.counters.replies += 1,
            // A refusal that was asked for is the right reply.
            Ending::Exception(_) if matches!(exchange.request, Request::Unserved { .. }) => self.counters.replies += 1,
            Ending::Exception(_) => self.counters.exceptions += 1,
            Ending::Garbled => self.counters.garbled += 1,
            Ending::Silent => self.counters.silent += 1,
        }
        let fault = match fault_of(&ending) {
            Some(Fault::Silent) if now <= self.stations[drive.get()].rests_until() => Some(Fault::Deaf),
            Some(Fault::Silent) if matches!(purpose, Purpose::Trial(_)) => Some(Fault::Ignored),
            fault => fault,
        };
        match fault {
            None => self.answered(now, drive, &exchange, doubt),
            Some(fault) => self.was_not_answered(now, drive, &exchange, fault),
        }
        self.tell_plan(now, drive, &exchange.request, &ending);
        match (purpose, ending) {
            (Purpose::Trial(place), ending) => self.trial_ended(drive, place, &exchange.request, &ending),
            (Purpose::Work(rank), ending) => self.work_ended(now, drive, rank, &exchange, &ending, doubt),
            (purpose, Ending::Reply(Reply::Words(words))) => self.deliver(now, drive, purpose, words),
            (Purpose::Read(job), Ending::Reply(Reply::Echo)) => self.end_all(job.waiters, &NativeOutcome::Written),
            (purpose, Ending::Reply(_)) => self.end_all(waiters_of(purpose), &NativeOutcome::NoReply),
            (purpose, Ending::Exception(code)) => {
                self.end_all(waiters_of(purpose), &NativeOutcome::DriveException(code));
            }
            (purpose, ending @ (Ending::Garbled | Ending::Silent)) => self.read_failed(purpose, &ending),
        }
        self.forget_the_silent(drive);
    }

    /// The plan learns which registers the drive answers for.
    fn tell_plan(&mut self, now: MonoTime, drive: DriveIndex, request: &Request, ending: &Ending) {
        let (address, count) = match request {
            Request::ReadHolding { address, count } => (*address, *count),
            _ => (0, 0),
        };
        let plan = &mut self.plans[drive.get()];
        match ending {
            Ending::Reply(_) => plan.answered(address, count),
            Ending::Exception(_) => plan.refused(address, count, now),
            Ending::Silent => plan.unanswered(address, count, now),
            Ending::Garbled => {}
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
            self.echo.heard(heard.kind, &heard.bytes);
            if self.setup.tells_traffic {
                let record = TrafficRecord { at: now, kind: heard.kind, bytes: heard.bytes };
                self.effects.push_back(Effect::Traffic(record));
            }
        }
    }

    fn deliver(&mut self, now: MonoTime, drive: DriveIndex, purpose: Purpose, words: Vec<u16>) {
        match purpose {
            Purpose::Read(job) => {
                let words: Arc<[u16]> = Arc::from(words);
                for waiter in job.waiters {
                    if let Some(answer) = self.natives.words(waiter, &words) {
                        self.answer(answer);
                    }
                }
            }
            Purpose::Poll { address } => self.take_words(now, drive, address, &words),
            Purpose::Work(_) | Purpose::Barrier | Purpose::Trial(_) => {}
        }
    }

    /// Words that the drive showed to us: the picture takes what is polled, the drive's own work the rest.
    fn take_words(&mut self, now: MonoTime, drive: DriveIndex, address: u16, words: &[u16]) {
        let model = &self.setup.drives[drive.get()].model;
        for (address, word) in (address..=u16::MAX).zip(words) {
            if model.register_at(address).is_some_and(|register| register.poll.is_some()) {
                self.snapshots[drive.get()].take(address, &[*word], now);
            }
        }
        self.works[drive.get()].take_words(address, words, now, &mut self.effects);
    }

    fn work_ended(
        &mut self,
        now: MonoTime,
        drive: DriveIndex,
        rank: Rank,
        exchange: &Exchange,
        ending: &Ending,
        doubt: bool,
    ) {
        if let (Request::ReadHolding { address, .. }, Ending::Reply(Reply::Words(words))) = (&exchange.request, ending)
        {
            self.take_words(now, drive, *address, words);
        }
        self.works[drive.get()].ended(rank, &exchange.request, ending, doubt, now, &mut self.effects);
    }

    /// The exchange had no good answer: a late one may follow, and a silent drive is asked less and less often.
    fn was_not_answered(&mut self, now: MonoTime, drive: DriveIndex, exchange: &Exchange, fault: Fault) {
        let what = consequence(fault);
        let setup = &self.setup.drives[drive.get()];
        let station = &mut self.stations[drive.get()];
        if what.reply_may_come_late {
            // The lateness is declared against the full time-out, and a probe waits for less.
            let full = setup.wait_for(&exchange.request, &self.setup.timing, Duration::MAX);
            let early = full.saturating_sub(exchange.timeout);
            station.reply_missing(exchange.request.clone(), now, early + setup.max_lateness);
        }
        if what.backs_off {
            station.silent(now);
        }
    }

    /// A poll, a barrier or a native read had no good answer. A damaged one is asked for once more.
    fn read_failed(&mut self, purpose: Purpose, ending: &Ending) {
        let repeats = fault_of(ending).is_some_and(|fault| consequence(fault).repeats_read);
        match purpose {
            Purpose::Read(job) if repeats && !job.repeated && self.is_waited_for(&job) => {
                self.counters.retries += 1;
                self.schedule.repeat_read(job);
            }
            purpose => self.end_all(waiters_of(purpose), &NativeOutcome::NoReply),
        }
    }

    /// Nobody waits for a drive that is known to be silent.
    fn forget_the_silent(&mut self, drive: DriveIndex) {
        if self.stations[drive.get()].is_known_silent() {
            self.set_presence(drive, Presence::Offline);
            self.barriers[drive.get()].lost();
            let waiting = self.schedule.take_reads_of(drive);
            self.end_all(waiting.into_iter().flat_map(|job| job.waiters).collect(), &NativeOutcome::NoReply);
        }
    }

    fn is_waited_for(&self, job: &ReadJob) -> bool {
        job.waiters.iter().any(|waiter| self.natives.is_waited_for(*waiter))
    }

    /// The drive answered. That settles what was missing, unless a missing reply could have been taken for this one:
    /// then the right one may still follow.
    fn answered(&mut self, now: MonoTime, drive: DriveIndex, exchange: &Exchange, doubt: bool) {
        let station = &mut self.stations[drive.get()];
        if doubt {
            station.is_there();
            station.reply_missing(exchange.request.clone(), now, self.setup.drives[drive.get()].max_lateness);
        } else {
            station.answered();
        }
        self.barriers[drive.get()].answered(now);
        self.set_presence(drive, Presence::Online);
    }

    /// The drive was asked whether a barrier can be relied on.
    fn trial_ended(&mut self, drive: DriveIndex, place: usize, request: &Request, ending: &Ending) {
        let barriers = &mut self.barriers[drive.get()];
        match (request, ending) {
            (Request::Unserved { .. }, Ending::Exception(_)) | (_, Ending::Reply(_)) => barriers.shown(place),
            (_, Ending::Garbled) => barriers.damaged(place),
            (_, Ending::Exception(_) | Ending::Silent) => barriers.failed(place),
        }
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
            let work = &mut self.works[drive.get()];
            if presence == Presence::Offline { work.out_of_sight(&mut self.effects) } else { work.mark_changed() }
        }
    }
}

const fn fault_of(ending: &Ending) -> Option<Fault> {
    match ending {
        Ending::Reply(_) | Ending::Exception(_) => None,
        Ending::Garbled => Some(Fault::Garbled),
        Ending::Silent => Some(Fault::Silent),
    }
}
