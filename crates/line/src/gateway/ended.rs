//! The end of an exchange: who is answered, and what follows for the station.

use super::core::LineCore;
use super::drive::DriveOnLine;
use super::execution::reason_of;
use super::flight::{ExchangePurpose, OpenFlight, is_stop};
use super::health::DoneExchange;
use super::overdue::{learn, learn_late};
use super::stop::BUSY_REST;
use crate::domain::ids::{DriveIndex, Station};
use crate::domain::native::NativeOutcome;
use crate::domain::time::MonoTime;
use crate::domain::traffic::{HeardFrame, TrafficKind};
use crate::drive::snapshot::DrivePresence;
use crate::line::exchange::{Exchange, ExchangeEnding, HeardData, answers};
use crate::line::fault::{Fault, consequence};
use crate::line::schedule::{ReadJob, WaiterId};
use crate::line::station::{MissingReply, StrayFrame};
use crate::profile::model::{ExceptionKind, Model, RefusedWrite};
use crate::wire::pdu::{Reply, Request};
use crate::wire::{exception, framing};
use std::time::Duration;

/// An exchange that is over, and what its end is worth.
struct Over {
    flight: OpenFlight,
    exchange: Exchange,
    ending: ExchangeEnding,
    /// What the drive means by it if that is an exception.
    kind: Option<ExceptionKind>,
    fault: Option<Fault>,
    /// Its reply may be to another request, or another drive's.
    doubt: bool,
    /// Its reply may be a mere echo.
    proves_nothing: bool,
    /// Until when its reply may still arrive.
    until: MonoTime,
}

impl LineCore {
    pub(super) fn ended(
        &mut self,
        now: MonoTime,
        exchange: Exchange,
        ending: ExchangeEnding,
    ) -> Option<DoneExchange> {
        let flight = self.flight.take()?;
        let drive = flight.drive;
        let silence = self.silence(&flight, &ending);
        let until = self.drives[drive].may_come_until(
            now,
            flight.request_end,
            &exchange.request,
            &self.timing,
        );
        let is_spoilt = flight.is_spoilt && ending != ExchangeEnding::Silent;
        if let Some((reply, late)) = flight.wrong_reply {
            self.came_instead(
                now,
                drive,
                (&exchange.request, reply),
                late,
                ending == ExchangeEnding::Silent,
            );
        }
        let (ending, kind) = self.judged(&flight, is_spoilt, ending);
        let proves_nothing = flight.proves_nothing && matches!(ending, ExchangeEnding::Reply(_));
        if !proves_nothing {
            let last_byte_at = self.wire.last_byte_at();
            learn(
                &mut self.drives[drive],
                &flight,
                (&exchange, &ending),
                last_byte_at,
                &self.timing,
            );
        }
        self.counters.busy_us += u64::try_from(now.since(flight.sent_at).as_micros()).unwrap_or(0);
        self.count_end(drive, &exchange.request, &ending);
        let fault = self.fault(now, drive, (&exchange.request, &ending, kind), silence);
        let over = Over {
            doubt: flight.doubt || is_spoilt,
            flight,
            exchange,
            ending,
            kind,
            fault,
            proves_nothing,
            until,
        };
        self.drive_learns(now, &over);
        // A listener does not read, so it does not know whether its adapter echoes; but others show it the effect of its stop.
        let shown_by_others = self.listens() && self.drives[drive].is_read_by_others(now);
        let doubt = (over.doubt || proves_nothing) && !shown_by_others;
        let done = self.done(&over);
        self.hand_on(now, over, doubt);
        Some(done)
    }

    /// What a silence means where the exchange of `flight` ended with `ending`, as it came: `judged` makes a silence of what
    /// tells that the drive cannot be reached.
    fn silence(&self, flight: &OpenFlight, ending: &ExchangeEnding) -> Fault {
        if self.health.is_jammed() || matches!(flight.purpose, ExchangePurpose::Trial(_)) {
            Fault::Ignored
        } else if self.is_unreachable(flight.drive, ending) {
            Fault::Unreachable
        } else {
            Fault::Silent
        }
    }

    /// What went wrong in an exchange in which a silence means `silence`.
    fn fault(
        &self,
        now: MonoTime,
        drive: DriveIndex,
        (request, ending, kind): (&Request, &ExchangeEnding, Option<ExceptionKind>),
        silence: Fault,
    ) -> Option<Fault> {
        let drive = &self.drives[drive];
        match fault_of(ending) {
            // That is how the drive takes it; for how long it hears nothing then is known.
            Some(Fault::Silent) if takes_in_silence(&drive.setup.model, request) => {
                Some(Fault::Deaf)
            }
            Some(_) if kind == Some(ExceptionKind::DamagedFrame) => Some(Fault::DamagedRequest),
            Some(Fault::Silent) if now <= drive.station.rests_until() => Some(Fault::Deaf),
            Some(Fault::Silent) => Some(silence),
            fault => fault,
        }
    }

    /// What follows for the station and for what is known of its drive.
    fn drive_learns(&mut self, now: MonoTime, over: &Over) {
        let drive = over.flight.drive;
        let request = &over.exchange.request;
        let missing = || MissingReply {
            request: request.clone(),
            sent_at: over.flight.request_end,
            until: over.until,
        };
        match over.fault {
            // It may not be from the drive, whose reply may still arrive.
            None if over.proves_nothing => self.drives[drive].station.reply_missing(missing(), now),
            None => {
                self.drives[drive]
                    .station
                    .exchange_ended(request, over.flight.noise > 1, now);
                self.drives[drive].answered(now, over.doubt.then(missing));
                self.drives[drive].set_presence(now, DrivePresence::Online, &mut self.effects);
            }
            Some(fault) => {
                self.drives[drive].was_not_answered(now, fault, missing);
                if consequence(fault).drive_is_there {
                    self.drives[drive].set_presence(now, DrivePresence::Online, &mut self.effects);
                }
            }
        }
        if over.kind == Some(ExceptionKind::Busy) {
            self.drives[drive].station.rest_until(now + BUSY_REST);
        }
        self.drives[drive].was_written(now, request, &over.ending);
        // One that says why tells nothing about the register.
        if !over.proves_nothing && over.kind.is_none() {
            self.drives[drive].tell_plan(now, request, &over.ending, &mut self.effects);
        }
    }

    /// What the exchange says about the health of the line.
    fn done(&self, over: &Over) -> DoneExchange {
        let fault = if over.proves_nothing {
            Some(Fault::Stray)
        } else {
            over.fault
        };
        DoneExchange {
            drive: over.flight.drive,
            fault,
            counts: matches!(fault, None | Some(Fault::Garbled | Fault::DamagedRequest))
                || (matches!(fault, Some(Fault::Silent | Fault::Unreachable))
                    && !over.flight.was_silent),
            reply_bytes: self
                .timing
                .adu_bytes(over.exchange.request.reply_pdu_bytes()),
        }
    }

    /// Gives its words to the drive and its end to those who wait for it. `doubt`: its reply may be to another request.
    fn hand_on(&mut self, now: MonoTime, over: Over, doubt: bool) {
        let Over {
            flight,
            exchange,
            ending,
            kind,
            ..
        } = over;
        let OpenFlight {
            drive,
            purpose,
            request_end,
            noise,
            ..
        } = flight;
        // What a process finds after it was suspended had arrived in time.
        let read_at = self
            .wire
            .last_byte_at()
            .min(now)
            .min(request_end + exchange.timeout);
        self.take_words(now, read_at, drive, &purpose, (&exchange.request, &ending));
        let answers = matches!(
            ending,
            ExchangeEnding::Reply(_) | ExchangeEnding::Exception(_)
        );
        let is_damaged = ending == ExchangeEnding::Garbled || noise > 0;
        if let ExchangePurpose::Work(rank) = purpose {
            self.between_ended(now, drive, rank, &ending);
        }
        self.tell_purpose(
            now,
            drive,
            purpose,
            (&exchange.request, ending, kind),
            doubt,
        );
        self.forget_the_silent(now, drive);
        self.confirm_share(now, answers, is_damaged);
    }

    /// What `ending` is worth, and what the drive means by it if that is an exception. A clean frame amid babble may be an
    /// artefact of it, and the frame after an unexplained one may be another of that kind. A stop is sent without proof,
    /// and confirmed by a read-back.
    fn judged(
        &self,
        flight: &OpenFlight,
        is_spoilt: bool,
        ending: ExchangeEnding,
    ) -> (ExchangeEnding, Option<ExceptionKind>) {
        let ending = match ending {
            _ if self.health.is_jammed() || self.is_unreachable(flight.drive, &ending) => {
                ExchangeEnding::Silent
            }
            _ if is_spoilt
                && !matches!(flight.purpose, ExchangePurpose::Work(rank) if is_stop(rank)) =>
            {
                ExchangeEnding::Garbled
            }
            ending => ending,
        };
        let model = &self.drives[flight.drive].setup.model;
        let code = match ending {
            ExchangeEnding::Exception(code) => code,
            // Whatever its value is, it says only that the write was received.
            ExchangeEnding::Reply(Reply::Holds { .. })
                if model.write.refused.value == RefusedWrite::EchoMayBeOld =>
            {
                return (ExchangeEnding::Reply(Reply::Echo), None);
            }
            ending => return (ending, None),
        };
        let kind = model.exception_kind(code);
        if kind == Some(ExceptionKind::DamagedFrame) {
            (ExchangeEnding::Garbled, kind)
        } else {
            (ending, kind)
        }
    }

    /// Takes the words of an exchange, as far as they say something about the drive.
    fn take_words(
        &mut self,
        now: MonoTime,
        read_at: MonoTime,
        drive: DriveIndex,
        purpose: &ExchangePurpose,
        (request, ending): (&Request, &ExchangeEnding),
    ) {
        let (Request::Read { address, .. }, ExchangeEnding::Reply(Reply::Words(words))) =
            (request, ending)
        else {
            return;
        };
        let drive = &mut self.drives[drive];
        match purpose {
            ExchangePurpose::Work(_) | ExchangePurpose::Poll => {
                drive.take_words(now, read_at, (*address, words), &mut self.effects)
            }
            ExchangePurpose::Read(_) => {
                drive.take_read(now, read_at, (*address, words), &mut self.effects)
            }
            ExchangePurpose::Barrier | ExchangePurpose::Probe | ExchangePurpose::Trial(_) => {}
        }
    }

    /// Whether `ending` is the answer of a converter whose drive is not reached, or has not answered: the drive itself
    /// was silent. A model may name these codes for a reason of the drive's own.
    fn is_unreachable(&self, drive: DriveIndex, ending: &ExchangeEnding) -> bool {
        let ExchangeEnding::Exception(
            code @ (exception::GATEWAY_PATH_UNAVAILABLE | exception::GATEWAY_TARGET_FAILED),
        ) = ending
        else {
            return false;
        };
        self.timing.may_have_converter()
            && self.drives[drive]
                .setup
                .model
                .exception_text(*code)
                .is_none()
    }

    /// Tells those who wait for the exchange how it ended.
    fn tell_purpose(
        &mut self,
        now: MonoTime,
        drive: DriveIndex,
        purpose: ExchangePurpose,
        ended: (&Request, ExchangeEnding, Option<ExceptionKind>),
        doubt: bool,
    ) {
        let (request, ending, kind) = ended;
        match (purpose, ending) {
            (ExchangePurpose::Trial(place), ending) => {
                self.drives[drive].trial_ended(place, request, &ending)
            }
            (ExchangePurpose::Work(rank), ending) => {
                let work = &mut self.drives[drive].work;
                work.ended(rank, request, &ending, doubt, now, &mut self.effects);
            }
            (ExchangePurpose::Read(job), ExchangeEnding::Exception(_))
                if kind == Some(ExceptionKind::Busy)
                    && !job.repeated
                    && self.clients.is_waited_for(&job) =>
            {
                self.repeat(job);
            }
            (ExchangePurpose::Read(job), ExchangeEnding::Reply(Reply::Words(words))) => {
                self.clients.deliver(job, words, &mut self.effects)
            }
            (ExchangePurpose::Read(job), ExchangeEnding::Reply(Reply::Echo)) => {
                self.end_all(job.waiters, &NativeOutcome::Written)
            }
            (purpose, ExchangeEnding::Reply(_)) => {
                self.end_all(purpose.waiters(), &NativeOutcome::NoReply)
            }
            (purpose, ExchangeEnding::Exception(code)) => {
                let reason = reason_of(kind);
                self.end_all(
                    purpose.waiters(),
                    &NativeOutcome::DriveException { code, reason },
                );
            }
            (purpose, ending @ (ExchangeEnding::Garbled | ExchangeEnding::Silent)) => {
                self.read_failed(purpose, &ending)
            }
        }
    }

    fn count_end(&mut self, drive: DriveIndex, request: &Request, ending: &ExchangeEnding) {
        let is_silent_write = takes_in_silence(&self.drives[drive].setup.model, request);
        let line = &mut self.counters;
        let drive = &mut self.drives[drive].measured.exchanges;
        let (line, drive) = match ending {
            ExchangeEnding::Reply(_) => (&mut line.replies, &mut drive.replies),
            // A refusal that was provoked is the correct reply.
            ExchangeEnding::Exception(_) if matches!(request, Request::Unserved { .. }) => {
                (&mut line.replies, &mut drive.replies)
            }
            // So is a silence that was announced.
            ExchangeEnding::Silent if is_silent_write => (&mut line.replies, &mut drive.replies),
            ExchangeEnding::Exception(_) => (&mut line.exceptions, &mut drive.exceptions),
            ExchangeEnding::Garbled => (&mut line.garbled, &mut drive.garbled),
            ExchangeEnding::Silent => (&mut line.silent, &mut drive.silent),
        };
        *line += 1;
        *drive += 1;
    }

    /// Counts what was received, reports it to watchers, and notes which stations are present.
    pub(super) fn tell_heard(&mut self, now: MonoTime) {
        let mut was_answered = false;
        for heard in self.wire.take_heard() {
            if self.overhears(now, &heard) {
                self.traffic.tell_of(heard, &mut self.effects);
                continue;
            }
            let is_of_others = matches!(heard.kind, TrafficKind::OtherMaster(_));
            if is_of_others && self.hears_listener(now, &heard.bytes) {
                self.traffic.tell_of(heard, &mut self.effects);
                continue;
            }
            // The adapter does not echo: another gateway has asked the same.
            let is_no_echo = heard.kind == TrafficKind::Echo && self.is_no_echo(&heard.bytes);
            let is_unasked = matches!(heard.kind, TrafficKind::Stray(_) | TrafficKind::Foreign(_));
            if (is_no_echo || is_of_others || is_unasked) && self.hears_stop(now, &heard.bytes) {
                self.traffic.tell_of(heard, &mut self.effects);
                continue;
            }
            let is_foreign = is_of_others && !self.is_own_signal(&heard.bytes);
            let rival =
                ((is_no_echo || is_foreign) && self.share.is_some()).then(|| heard.bytes.clone());
            was_answered |= heard.kind == TrafficKind::Reply;
            if !is_no_echo {
                self.count_heard(now, &heard, was_answered);
            }
            if matches!(
                heard.kind,
                TrafficKind::Reply | TrafficKind::Stray(_) | TrafficKind::Foreign(_)
            ) {
                self.share
                    .iter_mut()
                    .for_each(|share| share.was_answered(now));
            }
            if !is_no_echo {
                self.echo.heard(heard.kind, &heard.bytes);
            }
            self.health.heard(heard.kind, &heard.bytes);
            self.traffic.tell_of(heard, &mut self.effects);
            // What follows is listened to.
            if let Some(frame) = rival {
                self.hears_rival(now, &frame);
            }
        }
    }

    /// Counts a frame or noise, and takes from it what it says of its station and of the request on the wire.
    fn count_heard(&mut self, now: MonoTime, heard: &HeardData, was_answered: bool) {
        match heard.kind {
            TrafficKind::Request | TrafficKind::Reply => {}
            TrafficKind::Echo => self.counters.echoes += 1,
            TrafficKind::OtherMaster(_) => self.counters.other_master += 1,
            TrafficKind::Stray(station) => {
                self.counters.strays += 1;
                self.speaks_unasked(now, station, &heard.bytes, was_answered);
            }
            TrafficKind::Foreign(station) => {
                self.counters.foreign += 1;
                // No station has the number 0: it is what the addressed one says.
                if station.0 == 0
                    && !was_answered
                    && let Some(flight) = &mut self.flight
                {
                    flight.wrong_reply = Some((HeardFrame::of(&heard.bytes), None));
                }
                self.speaks_unasked(now, station, &heard.bytes, was_answered);
            }
            TrafficKind::Noise => {
                self.counters.noise_bytes += heard.bytes.len() as u64;
                let flight = self
                    .flight
                    .as_mut()
                    .filter(|flight| !was_answered && heard.end > flight.sent_at);
                flight
                    .into_iter()
                    .for_each(|flight| flight.noise += heard.bytes.len());
            }
        }
    }

    /// Ends requests before their words have arrived.
    pub(super) fn end_all(&mut self, waiters: Vec<WaiterId>, outcome: &NativeOutcome) {
        self.clients.end_all(waiters, outcome, &mut self.effects);
    }

    /// A poll, a barrier or a native read failed. After a damaged reply it is sent once more.
    fn read_failed(&mut self, purpose: ExchangePurpose, ending: &ExchangeEnding) {
        let repeats = fault_of(ending).is_some_and(|fault| consequence(fault).repeats_read);
        match purpose {
            ExchangePurpose::Read(job)
                if repeats && !job.repeated && self.clients.is_waited_for(&job) =>
            {
                self.repeat(job)
            }
            purpose => self.end_all(purpose.waiters(), &NativeOutcome::NoReply),
        }
    }

    /// A native read is sent once more.
    fn repeat(&mut self, job: ReadJob) {
        self.counters.retries += 1;
        self.drives[job.key.drive].measured.exchanges.retries += 1;
        self.clients.repeat(job);
    }

    /// No request waits for a drive that is known to be silent.
    fn forget_the_silent(&mut self, now: MonoTime, drive: DriveIndex) {
        if self.drives[drive].station.is_known_silent() {
            self.drives[drive].set_presence(now, DrivePresence::Offline, &mut self.effects);
            self.drives[drive].barriers.lost();
            self.clients
                .end_those_of(drive, &NativeOutcome::NoReply, &mut self.effects);
        }
    }

    /// A frame of `station` was received that answers no request. A configured station is thereby present. If the frame is
    /// unexplained, another drive may share its number, or its replies exceed the maximum lateness: it is not asked again
    /// before it has been silent for long enough.
    fn speaks_unasked(&mut self, now: MonoTime, station: Station, adu: &[u8], was_answered: bool) {
        let last_byte_at = self.wire.last_byte_at();
        learn_late(
            &mut self.drives,
            now,
            (station, adu),
            last_byte_at,
            &self.timing,
        );
        let Some(index) = self.drives.at_station(station) else {
            return;
        };
        let DriveOnLine { station, setup, .. } = &mut self.drives[index];
        let Some((_, pdu)) = framing::decode(self.timing.framing, adu) else {
            return;
        };
        let mut flight = self
            .flight
            .as_mut()
            .filter(|flight| flight.drive == index && !was_answered);
        let refused = flight
            .as_mut()
            .and_then(|it| it.doubts_refusal.take_if(|request| answers(request, &pdu)));
        if let (Some(flight), Some(_)) = (&mut flight, refused) {
            flight.is_spoilt = true;
            station.refused_in_doubt(now);
            return;
        }
        let waits = flight
            .as_ref()
            .is_some_and(|flight| flight.wrong_reply.is_none());
        let stray = station.stray(&pdu, now, setup.max_lateness, waits);
        if consequence(Fault::Stray).drive_is_there {
            station.is_there();
        }
        self.health.stray(index.get(), stray);
        if let Some(flight) = flight
            && stray != StrayFrame::Explained
        {
            flight.is_spoilt = true;
            if let StrayFrame::WrongForm(late) = stray {
                flight.wrong_reply = Some((HeardFrame::of(adu), Some(late)));
            }
        }
    }

    /// The exchange of `request` is over, to which `reply` came that does not answer it. If `nothing` else came, it is how the
    /// drive answers; if a reply did, it is one of too many.
    fn came_instead(
        &mut self,
        now: MonoTime,
        drive: DriveIndex,
        (request, reply): (&Request, HeardFrame),
        late: Option<Duration>,
        nothing: bool,
    ) {
        if nothing {
            let mut frame = Vec::new();
            let station = self.drives[drive].setup.station.0;
            framing::encode(self.timing.framing, &mut frame, station, |pdu| {
                request.encode(pdu)
            });
            return self
                .health
                .wrong_reply(drive.get(), HeardFrame::of(&frame), reply);
        }
        let Some(late) = late else { return };
        self.drives[drive].station.is_unexplained(late, now);
        self.health.stray(drive.get(), StrayFrame::TooMany(late));
    }
}

/// Whether a drive of `model` never answers `request`.
fn takes_in_silence(model: &Model, request: &Request) -> bool {
    // A read writes nothing: then no register is looked at.
    request
        .written()
        .any(|address| model.silent_writes().any(|silent| silent == address))
}

const fn fault_of(ending: &ExchangeEnding) -> Option<Fault> {
    match ending {
        ExchangeEnding::Reply(_) | ExchangeEnding::Exception(_) => None,
        ExchangeEnding::Garbled => Some(Fault::Garbled),
        ExchangeEnding::Silent => Some(Fault::Silent),
    }
}
