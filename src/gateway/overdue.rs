//! How long a reply is waited for, until when one may still come late, and what its time teaches.

use super::core::{Flight, LineCore};
use super::work::DriveWork;
use crate::domain::ids::{DriveIndex, Station};
use crate::domain::time::MonoTime;
use crate::line::exchange::{Ending, Exchange};
use crate::line::timeouts::Class;
use crate::wire::framing;
use crate::wire::pdu::Request;
use std::time::Duration;

/// PDU bytes of an exception.
const EXCEPTION_BYTES: usize = 2;

impl LineCore {
    /// Longest wait for the start of the reply to `request` from `drive`, and for what its characters take longer than
    /// ours. After a silence it is the full one: a drive that has become slower is not given up for that.
    pub(super) fn wait_for(&self, drive: DriveIndex, request: &Request) -> Duration {
        let (setup, station) = (&self.setup.drives[drive.get()], &self.stations[drive.get()]);
        let (class, timing) = (Class::of(request, &setup.model), &setup.model.timing);
        let learned = self.measured.reply_times(drive).wait(class);
        let wait = if station.is_known_silent() {
            setup.timeouts.probe(class, timing, learned)
        } else if station.is_in_question() {
            setup.timeouts.of(class)
        } else {
            setup.timeouts.in_force(class, timing, learned)
        };
        wait + setup.reply_time(request, &self.setup.timing).1
    }

    /// The same with nothing learned: what late replies are declared against.
    pub(super) fn full_wait(&self, drive: DriveIndex, request: &Request) -> Duration {
        let setup = &self.setup.drives[drive.get()];
        let wait = setup.timeouts.of(Class::of(request, &setup.model));
        wait + setup.reply_time(request, &self.setup.timing).1
    }

    /// How long after the end of `request` nobody who needs a stop has to wait any more, if nothing was heard: every
    /// reply that was seen would have come by then, also where an adapter hands it over only as a whole. Nothing while
    /// too few were seen.
    pub(super) fn patience(&self, drive: DriveIndex, request: &Request) -> Option<Duration> {
        let setup = &self.setup.drives[drive.get()];
        let worst = self.measured.reply_times(drive).worst(Class::of(request, &setup.model))?;
        Some(worst + setup.reply_time(request, &self.setup.timing).0 + self.setup.timing.silence)
    }

    /// Until when the reply to an exchange that has ended at `now` may still come. The lateness is declared against the
    /// full wait, however short this one was.
    pub(super) fn may_come_until(&self, now: MonoTime, flight: &Flight, exchange: &Exchange) -> MonoTime {
        let setup = &self.setup.drives[flight.drive.get()];
        let (reply, longer) = setup.reply_time(&exchange.request, &self.setup.timing);
        let due = flight.request_end + self.full_wait(flight.drive, &exchange.request) + (reply - longer);
        now.max(due) + self.stations[flight.drive.get()].lateness(setup.max_lateness)
    }

    /// When the exchange on the wire becomes one that a stop for another drive ends, if it still may; or one that any stop
    /// ends, because something that may have been the reply came damaged.
    pub(super) fn overdue_at(&self) -> Option<MonoTime> {
        let flight = self.flight.as_ref().filter(|flight| !flight.is_overdue)?;
        if let Some(damaged_from) = self.wire.damaged_from() {
            return Some(flight.overdue_at.unwrap_or(damaged_from).max(damaged_from));
        }
        flight.overdue_at.filter(|_| !self.wire.has_heard_after(flight.request_end))
    }

    /// Ends the wait for a drive that has answered every time before now, if another drive waits for its stop; and the
    /// wait for a reply that may come behind a damaged one, if any drive does. What follows is what follows from a
    /// time-out.
    pub(super) fn end_overdue_for_a_stop(&mut self, now: MonoTime) {
        let damaged_from = self.wire.damaged_from();
        let Some(flight) = self.flight.as_mut() else { return };
        let is_damaged = damaged_from.is_some_and(|at| now >= flight.overdue_at.unwrap_or(at).max(at));
        let is_late = flight.overdue_at.is_some_and(|at| now >= at);
        if !is_damaged && !is_late {
            return;
        }
        flight.is_overdue = true;
        let (drive, request_end) = (flight.drive, flight.request_end);
        let waits_for_stop =
            |(other, work): (DriveIndex, &DriveWork)| work.has_new_stop() && (is_damaged || other != drive);
        let may_cut = is_damaged || !self.wire.has_heard_after(request_end);
        if !may_cut || !(0..).map(DriveIndex).zip(&self.works).any(waits_for_stop) {
            return;
        }
        let ended = if is_damaged { self.wire.cut_damaged() } else { self.wire.cut_short() };
        if let Some((exchange, ending)) = ended {
            self.cut_short = Some(drive);
            self.ended(now, exchange, ending);
        }
    }

    /// Learns from an exchange that has ended. What may have been the late reply to another teaches nothing.
    pub(super) fn learn(&mut self, flight: &Flight, exchange: &Exchange, ending: &Ending) {
        let setup = &self.setup.drives[flight.drive.get()];
        let (reply, _) = match ending {
            Ending::Reply(_) => setup.reply_time(&exchange.request, &self.setup.timing),
            Ending::Exception(_) => setup.time_of(EXCEPTION_BYTES, &self.setup.timing),
            Ending::Garbled | Ending::Silent => return,
        };
        if !flight.doubt {
            let began = self.wire.last_byte_at().before(reply);
            let class = Class::of(&exchange.request, &setup.model);
            self.measured.reply_came(flight.drive, class, began.since(flight.request_end));
        }
    }

    /// Learns from a frame of `station` that came at `now` and answers nothing that is on the wire.
    pub(super) fn learn_late(&mut self, now: MonoTime, station: Station, adu: &[u8]) {
        let timing = &self.setup.timing;
        let Some(place) = self.setup.drives.iter().position(|drive| drive.station == station) else { return };
        let Some((_, pdu)) = framing::decode(timing.framing, adu) else { return };
        if let Some((request, sent_at)) = self.stations[place].answered_late(&pdu, now) {
            let setup = &self.setup.drives[place];
            let began = self.wire.last_byte_at().before(setup.time_of(pdu.len(), timing).0);
            let class = Class::of(request, &setup.model);
            let drive = DriveIndex(place as u16);
            self.measured.reply_came(drive, class, began.since(sent_at));
        }
    }
}
