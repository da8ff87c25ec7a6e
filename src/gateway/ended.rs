//! An exchange has ended: who gets what, and what follows for the station.

use super::core::{Flight, LineCore, Purpose};
use super::decide::is_stop;
use super::event::Effect;
use super::health::Done;
use super::port::waiters_of;
use super::work::Reading;
use crate::domain::ids::{DriveIndex, Station};
use crate::domain::native::NativeOutcome;
use crate::domain::time::MonoTime;
use crate::domain::traffic::TrafficKind;
use crate::drive::snapshot::Presence;
use crate::journal::Entry;
use crate::line::exchange::{Ending, Exchange};
use crate::line::fault::{Fault, consequence};
use crate::line::schedule::ReadJob;
use crate::line::station::{Missing, Stray};
use crate::profile::model::PollClass;
use crate::wire::framing;
use crate::wire::pdu::{Reply, Request};
use std::sync::Arc;

impl LineCore {
    pub(super) fn ended(&mut self, now: MonoTime, exchange: Exchange, ending: Ending) -> Option<Done> {
        let flight = self.flight.take()?;
        let until = self.may_come_until(now, &flight, &exchange);
        let is_jammed = self.health.is_jammed();
        // What comes clean out of babble may be made up of it, and what follows a frame that nothing explains may be
        // another one of that kind. A stop goes without proof, and is confirmed by a look.
        let is_spoilt = flight.is_spoilt && ending != Ending::Silent;
        let ending = match ending {
            _ if is_jammed => Ending::Silent,
            _ if is_spoilt && !matches!(flight.purpose, Purpose::Work(rank) if is_stop(rank)) => Ending::Garbled,
            ending => ending,
        };
        let proves_nothing = flight.proves_nothing && matches!(ending, Ending::Reply(_));
        if !proves_nothing {
            self.learn(&flight, &exchange, &ending);
        }
        let Flight { drive, purpose, was_silent, sent_at, request_end, noise, .. } = flight;
        let doubt = flight.doubt || is_spoilt;
        self.counters.busy_us += u64::try_from(now.since(sent_at).as_micros()).unwrap_or(0);
        self.count_end(drive, &exchange.request, &ending);
        let fault = match fault_of(&ending) {
            Some(Fault::Silent) if now <= self.stations[drive.get()].rests_until() => Some(Fault::Deaf),
            Some(Fault::Silent) if is_jammed || matches!(purpose, Purpose::Trial(_)) => Some(Fault::Ignored),
            fault => fault,
        };
        let missing = || Missing { request: exchange.request.clone(), sent_at: request_end, until };
        match fault {
            // It may not have come from the drive, whose reply may still come.
            None if proves_nothing => self.stations[drive.get()].reply_missing(missing(), now),
            None => {
                self.stations[drive.get()].exchange_ended(&exchange.request, noise > 1, now);
                self.answered(now, drive, doubt.then(missing));
            }
            Some(fault) => self.was_not_answered(now, drive, fault, missing),
        }
        if !proves_nothing {
            self.tell_plan(now, drive, &exchange.request, &ending);
        }
        let doubt = doubt || proves_nothing;
        let fault = if proves_nothing { Some(Fault::Stray) } else { fault };
        let done = Done {
            drive,
            fault,
            counts: matches!(fault, None | Some(Fault::Garbled)) || (fault == Some(Fault::Silent) && !was_silent),
            reply_bytes: self.setup.timing.adu_bytes(exchange.request.reply_pdu_bytes()),
        };
        if let Purpose::Work(_) | Purpose::Poll = purpose
            && let (Request::ReadHolding { address, .. }, Ending::Reply(Reply::Words(words))) =
                (&exchange.request, &ending)
        {
            // What a process that was suspended finds had come in time.
            let read_at = self.wire.last_byte_at().min(now).min(request_end + exchange.timeout);
            self.take_words(now, read_at, drive, (*address, words));
        }
        match (purpose, ending) {
            (Purpose::Trial(place), ending) => self.trial_ended(drive, place, &exchange.request, &ending),
            (Purpose::Work(rank), ending) => {
                let work = &mut self.works[drive.get()];
                work.ended(rank, &exchange.request, &ending, doubt, now, &mut self.effects);
            }
            (Purpose::Read(job), Ending::Reply(Reply::Words(words))) => self.deliver(job, words),
            (Purpose::Read(job), Ending::Reply(Reply::Echo)) => self.end_all(job.waiters, &NativeOutcome::Written),
            (purpose, Ending::Reply(_)) => self.end_all(waiters_of(purpose), &NativeOutcome::NoReply),
            (purpose, Ending::Exception(code)) => {
                self.end_all(waiters_of(purpose), &NativeOutcome::DriveException(code));
            }
            (purpose, ending @ (Ending::Garbled | Ending::Silent)) => self.read_failed(purpose, &ending),
        }
        self.forget_the_silent(now, drive);
        Some(done)
    }

    fn count_end(&mut self, drive: DriveIndex, request: &Request, ending: &Ending) {
        let (line, drive) = (&mut self.counters, &mut self.measured.of(drive).exchanges);
        let (line, drive) = match ending {
            Ending::Reply(_) => (&mut line.replies, &mut drive.replies),
            // A refusal that was asked for is the right reply.
            Ending::Exception(_) if matches!(request, Request::Unserved { .. }) => {
                (&mut line.replies, &mut drive.replies)
            }
            Ending::Exception(_) => (&mut line.exceptions, &mut drive.exceptions),
            Ending::Garbled => (&mut line.garbled, &mut drive.garbled),
            Ending::Silent => (&mut line.silent, &mut drive.silent),
        };
        *line += 1;
        *drive += 1;
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
        let mut was_answered = false;
        for heard in self.wire.take_heard() {
            match heard.kind {
                TrafficKind::Request => {}
                TrafficKind::Reply => was_answered = true,
                TrafficKind::Echo => self.counters.echoes += 1,
                TrafficKind::OtherMaster(_) => self.counters.other_master += 1,
                TrafficKind::Stray(station) => {
                    self.counters.strays += 1;
                    self.learn_late(now, station, &heard.bytes);
                    self.spoke(now, station, &heard.bytes, was_answered);
                }
                TrafficKind::Foreign(station) => {
                    self.counters.foreign += 1;
                    self.learn_late(now, station, &heard.bytes);
                    self.spoke(now, station, &heard.bytes, was_answered);
                }
                TrafficKind::Noise => {
                    self.counters.noise_bytes += heard.bytes.len() as u64;
                    let flight = self.flight.as_mut().filter(|flight| !was_answered && heard.end > flight.sent_at);
                    flight.into_iter().for_each(|flight| flight.noise += heard.bytes.len());
                }
            }
            self.echo.heard(heard.kind, &heard.bytes);
            self.health.diagnosis.heard(heard.kind, &heard.bytes);
            self.health.damage.heard(heard.kind, &heard.bytes);
            self.tell_of(heard);
        }
    }

    fn deliver(&mut self, job: ReadJob, words: Vec<u16>) {
        let words: Arc<[u16]> = Arc::from(words);
        for waiter in job.waiters {
            if let Some(answer) = self.natives.words(waiter, &words) {
                self.answer(answer);
            }
        }
    }

    /// Words that the drive showed to us: the picture takes what is polled, the drive's own work the rest.
    fn take_words(&mut self, now: MonoTime, read_at: MonoTime, drive: DriveIndex, read: (u16, &[u16])) {
        let (address, words) = read;
        let model = &self.setup.drives[drive.get()].model;
        for (address, word) in (address..=u16::MAX).zip(words) {
            if let Some(class) = model.register_at(address).and_then(|register| register.poll) {
                let snapshot = &mut self.snapshots[drive.get()];
                if class == PollClass::Fast
                    && let Some(last) = snapshot.reading(address)
                {
                    self.measured.of(drive).aged(now.since(last.at), now);
                }
                // A reply that had to wait for the silence behind it is as old as its last byte.
                snapshot.take(address, &[*word], read_at);
            }
        }
        let reading = Reading { at: read_at, is_its_own: !self.stations[drive.get()].is_doubtful() };
        self.works[drive.get()].take_words(address, words, reading, now, &mut self.effects);
    }

    /// The exchange had no good answer: a late one may follow, and a silent drive is asked less and less often.
    fn was_not_answered(&mut self, now: MonoTime, drive: DriveIndex, fault: Fault, missing: impl FnOnce() -> Missing) {
        let what = consequence(fault);
        let station = &mut self.stations[drive.get()];
        if what.reply_may_come_late {
            station.reply_missing(missing(), now);
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
                self.measured.of(job.key.drive).exchanges.retries += 1;
                self.schedule.repeat_read(job);
            }
            purpose => self.end_all(waiters_of(purpose), &NativeOutcome::NoReply),
        }
    }

    /// Nobody waits for a drive that is known to be silent.
    fn forget_the_silent(&mut self, now: MonoTime, drive: DriveIndex) {
        if self.stations[drive.get()].is_known_silent() {
            self.set_presence(now, drive, Presence::Offline);
            self.barriers[drive.get()].lost();
            let waiting = self.schedule.take_reads_of(drive);
            self.end_all(waiting.into_iter().flat_map(|job| job.waiters).collect(), &NativeOutcome::NoReply);
        }
    }

    fn is_waited_for(&self, job: &ReadJob) -> bool {
        job.waiters.iter().any(|waiter| self.natives.is_waited_for(*waiter))
    }

    /// The drive answered. That settles what was missing, unless a missing reply could have been taken for this one:
    /// then the right one is `still_missing`.
    fn answered(&mut self, now: MonoTime, drive: DriveIndex, still_missing: Option<Missing>) {
        let station = &mut self.stations[drive.get()];
        if let Some(missing) = still_missing {
            station.is_there();
            station.reply_missing(missing, now);
        } else {
            station.answered();
        }
        self.barriers[drive.get()].answered(now);
        self.set_presence(now, drive, Presence::Online);
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

    /// A frame of `station` was heard that answers nothing: if it is one of ours, it is there. If nothing explains it,
    /// another drive may have its number, or its replies come later than any may: it is not asked again before it was
    /// silent for long enough.
    fn spoke(&mut self, now: MonoTime, station: Station, adu: &[u8], was_answered: bool) {
        let Some(at) = self.setup.drives.iter().position(|drive| drive.station == station) else { return };
        let stray = match framing::decode(self.setup.timing.framing, adu) {
            Some((_, pdu)) => self.stations[at].stray(&pdu, now, self.setup.drives[at].max_lateness),
            None => return,
        };
        if consequence(Fault::Stray).drive_is_there {
            self.stations[at].is_there();
        }
        self.health.diagnosis.stray(at, stray);
        self.health.damage.stray(at, stray);
        if let Some(flight) = self.flight.as_mut().filter(|flight| flight.drive.get() == at)
            && stray != Stray::Explained
            && !was_answered
        {
            flight.is_spoilt = true;
        }
    }

    fn set_presence(&mut self, now: MonoTime, drive: DriveIndex, presence: Presence) {
        let known = &mut self.snapshots[drive.get()].presence;
        if *known != presence {
            *known = presence;
            self.effects.push_back(Effect::Presence(drive, presence));
            self.effects.keep(drive, Entry::Presence(presence));
            if presence == Presence::Online {
                self.plans[drive.get()].drive_is_back(now);
            }
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
