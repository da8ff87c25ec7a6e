//! Waiting times for replies, the time for late replies, and learning from reply times.

use super::core::{LineCore, OpenFlight};
use super::drive::DriveOnLine;
use crate::domain::ids::Station;
use crate::domain::time::MonoTime;
use crate::line::exchange::{Exchange, ExchangeEnding};
use crate::line::timeouts::RequestClass;
use crate::wire::framing;

/// PDU size of an exception, in bytes.
const EXCEPTION_BYTES: usize = 2;

impl LineCore {
    /// When a stop for another drive may end the exchange on the wire, if it still may; or when any stop may, because the
    /// reply may have arrived damaged.
    pub(super) fn overdue_at(&self) -> Option<MonoTime> {
        let flight = self.flight.as_ref().filter(|flight| !flight.is_overdue)?;
        if let Some(damaged_from) = self.wire.damaged_from() {
            return Some(flight.overdue_at.unwrap_or(damaged_from).max(damaged_from));
        }
        if self.wire.has_heard_after(flight.request_end) {
            None
        } else {
            flight.overdue_at
        }
    }

    /// Ends the wait for a drive that has always answered sooner, if another drive waits for its stop; and the wait for
    /// a reply that may follow a damaged one, if any drive waits for its stop. The consequences are those of a
    /// time-out.
    pub(super) fn end_overdue_for_a_stop(&mut self, now: MonoTime) {
        let damaged_from = self.wire.damaged_from();
        let Some(flight) = self.flight.as_mut() else {
            return;
        };
        let is_damaged =
            damaged_from.is_some_and(|at| now >= flight.overdue_at.unwrap_or(at).max(at));
        let is_late = flight.overdue_at.is_some_and(|at| now >= at);
        if !is_damaged && !is_late {
            return;
        }
        flight.is_overdue = true;
        let drive = flight.drive;
        let request_end = flight.request_end;
        let waits_for_stop =
            |other: &DriveOnLine| other.work.has_new_stop() && (is_damaged || other.index != drive);
        let may_cut = is_damaged || !self.wire.has_heard_after(request_end);
        if !may_cut || !self.drives.iter().any(waits_for_stop) {
            return;
        }
        let ended = if is_damaged {
            self.wire.cut_damaged()
        } else {
            self.wire.cut_short()
        };
        if let Some((exchange, ending)) = ended {
            self.cut_short = Some(drive);
            self.ended(now, exchange, ending);
        }
    }

    /// Learns from an exchange that has ended, unless its reply may have been a late reply to another.
    pub(super) fn learn(
        &mut self,
        flight: &OpenFlight,
        exchange: &Exchange,
        ending: &ExchangeEnding,
    ) {
        let drive = &mut self.drives[flight.drive];
        let (reply, _) = match ending {
            ExchangeEnding::Reply(_) => drive.setup.reply_time(&exchange.request, &self.timing),
            ExchangeEnding::Exception(_) => drive.setup.time_of(EXCEPTION_BYTES, &self.timing),
            ExchangeEnding::Garbled | ExchangeEnding::Silent => return,
        };
        if !flight.doubt {
            let began = self.wire.last_byte_at().before(reply);
            let class = RequestClass::of(&exchange.request, &drive.setup.model);
            drive
                .measured
                .reply_came(class, began.since(flight.request_end));
        }
    }

    /// Learns from a frame of `station` that arrived at `now` and answers no request on the wire.
    pub(super) fn learn_late(&mut self, now: MonoTime, station: Station, adu: &[u8]) {
        let timing = &self.timing;
        let Some(drive) = self.drives.at_station(station) else {
            return;
        };
        let Some((_, pdu)) = framing::decode(timing.framing, adu) else {
            return;
        };
        let DriveOnLine {
            station,
            setup,
            measured,
            ..
        } = &mut self.drives[drive];
        if let Some((request, sent_at)) = station.answered_late(&pdu, now) {
            let began = self
                .wire
                .last_byte_at()
                .before(setup.time_of(pdu.len(), timing).0);
            measured.reply_came(
                RequestClass::of(request, &setup.model),
                began.since(sent_at),
            );
        }
    }
}
