//! A wait that ends early for a stop, and learning from reply times.

use super::drive::{DriveOnLine, LineDrives};
use super::flight::OpenFlight;
use super::stop::StopLatch;
use crate::domain::ids::Station;
use crate::domain::time::MonoTime;
use crate::line::exchange::{Exchange, ExchangeEnding};
use crate::line::timeouts::RequestClass;
use crate::line::timing::LineTiming;
use crate::line::transaction::LineWire;
use crate::wire::framing;

/// PDU size of an exception, in bytes.
const EXCEPTION_BYTES: usize = 2;

/// Ends the wait for a drive that has always answered sooner, if another drive waits for its stop; and the wait for
/// a reply that may follow a damaged one, if any drive waits for its stop. The consequences are those of a
/// time-out.
pub(super) fn cut_for_a_stop(
    now: MonoTime,
    flight: &mut OpenFlight,
    wire: &mut LineWire,
    drives: &LineDrives,
) -> Option<(Exchange, ExchangeEnding)> {
    let is_damaged = wire
        .damaged_from()
        .is_some_and(|at| now >= flight.overdue_at.unwrap_or(at).max(at));
    let is_late = flight.overdue_at.is_some_and(|at| now >= at);
    if !is_damaged && !is_late {
        return None;
    }
    flight.is_overdue = true;
    let waits_for_stop = |other: &DriveOnLine| {
        other.work.latch().is_some_and(StopLatch::is_first)
            && (is_damaged || other.index != flight.drive)
    };
    let may_cut = is_damaged || !wire.has_heard_after(flight.request_end);
    if !may_cut || !drives.iter().any(waits_for_stop) {
        return None;
    }
    if is_damaged {
        wire.cut_damaged()
    } else {
        wire.cut_short()
    }
}

/// Learns how soon `drive` answers from an exchange that has ended, unless its reply may have been a late reply to another.
pub(super) fn learn(
    drive: &mut DriveOnLine,
    flight: &OpenFlight,
    (exchange, ending): (&Exchange, &ExchangeEnding),
    last_byte_at: MonoTime,
    timing: &LineTiming,
) {
    let (reply, _) = match ending {
        ExchangeEnding::Reply(_) => drive.setup.reply_time(&exchange.request, timing),
        ExchangeEnding::Exception(_) => drive.setup.time_of(EXCEPTION_BYTES, timing),
        ExchangeEnding::Garbled | ExchangeEnding::Silent => return,
    };
    if !flight.doubt {
        let began = last_byte_at.before(reply);
        let class = RequestClass::of(&exchange.request, &drive.setup.model);
        drive
            .measured
            .reply_came(class, began.since(flight.request_end));
    }
}

/// Learns from a frame of `station` that arrived at `now` and answers no request on the wire.
pub(super) fn learn_late(
    drives: &mut LineDrives,
    now: MonoTime,
    (station, adu): (Station, &[u8]),
    last_byte_at: MonoTime,
    timing: &LineTiming,
) {
    let Some(drive) = drives.at_station(station) else {
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
    } = &mut drives[drive];
    if let Some((request, sent_at)) = station.answered_late(&pdu, now) {
        let began = last_byte_at.before(setup.time_of(pdu.len(), timing).0);
        measured.reply_came(
            RequestClass::of(request, &setup.model),
            began.since(sent_at),
        );
    }
}
