//! The wire of a Modbus TCP line: which replies are ours, and what gives a connection up.

use super::exchange::{Exchange, ExchangeEnding};
use super::timing::LineTiming;
use super::transaction::LineWire;
use crate::domain::ids::Station;
use crate::domain::link::{Framing, LinkSettings, PortKind};
use crate::domain::time::MonoTime;
use crate::domain::traffic::TrafficKind;
use crate::wire::mbap;
use crate::wire::pdu::{Reply, Request};
use std::time::Duration;

const AT: MonoTime = MonoTime::from_millis(20);
const FIRST: u16 = 0xFFFE;
const REPLY: [u8; 4] = [3, 2, 0x17, 0x70];

fn wire() -> LineWire {
    let timing = LineTiming::for_models(Framing::Mbap, LinkSettings::DEFAULT, [], Duration::ZERO);
    let mut wire = LineWire::new(timing, MonoTime::ZERO);
    wire.number_from(FIRST);
    wire.port_opened(MonoTime::ZERO, PortKind::Virtual);
    wire
}

fn message(transaction: u16, unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    mbap::encode(&mut out, transaction, unit, |adu| {
        adu.extend_from_slice(pdu)
    });
    out
}

fn exchange(request: Request) -> Exchange {
    Exchange {
        station: Station(1),
        request,
        timeout: Duration::from_millis(300),
        in_doubt: false,
    }
}

fn read() -> Exchange {
    exchange(Request::Read {
        address: 0x0C10_u16.into(),
        count: 1,
    })
}

fn stop() -> Exchange {
    exchange(Request::WriteSingle {
        address: 2_u16.into(),
        value: 0,
    })
}

/// Sends `exchange`; returns its transaction.
fn send(wire: &mut LineWire, exchange: Exchange) -> u16 {
    let mut out = Vec::new();
    wire.send(AT, exchange, &mut out);
    mbap::decode(&out).unwrap().unwrap().transaction
}

fn answered() -> Option<(Exchange, ExchangeEnding)> {
    Some((read(), ExchangeEnding::Reply(Reply::Words(vec![6000]))))
}

fn kinds(wire: &mut LineWire) -> Vec<TrafficKind> {
    wire.take_heard()
        .into_iter()
        .map(|heard| heard.kind)
        .collect()
}

#[test]
fn requests_are_numbered_one_after_the_other_over_every_connection() {
    let mut wire = wire();
    for expected in [FIRST, 0xFFFF, 0, 1] {
        assert_eq!(send(&mut wire, read()), expected);
        assert_eq!(wire.receive(AT, &message(expected, 1, &REPLY)), answered());
    }
    send(&mut wire, read());
    wire.port_opened(AT, PortKind::Virtual);
    assert_eq!(send(&mut wire, read()), 3);
}

#[test]
fn a_reply_ends_its_exchange_with_its_last_byte_and_needs_no_silence() {
    let mut wire = wire();
    for (pdu, ending) in [
        (&REPLY[..], ExchangeEnding::Reply(Reply::Words(vec![6000]))),
        (&[0x83, 2], ExchangeEnding::Exception(2)),
    ] {
        let reply = message(send(&mut wire, read()), 1, pdu);
        for byte in &reply[..reply.len() - 1] {
            assert_eq!(wire.receive(AT, &[*byte]), None);
        }
        assert_eq!(
            wire.receive(AT, &reply[reply.len() - 1..]),
            Some((read(), ending))
        );
        assert_eq!(wire.may_send_from(), AT, "the next request follows at once");
    }
}

#[test]
fn only_number_unit_and_function_together_make_a_reply() {
    let mut wire = wire();
    let id = send(&mut wire, read());
    let unit_1 = Station(1);
    for (bytes, kind) in [
        (
            message(id.wrapping_sub(1), 1, &REPLY),
            TrafficKind::Stray(unit_1),
        ),
        (
            message(id.wrapping_add(1), 1, &REPLY),
            TrafficKind::Stray(unit_1),
        ),
        (
            message(id.wrapping_add(1), 2, &REPLY),
            TrafficKind::Stray(Station(2)),
        ),
        (message(id, 2, &REPLY), TrafficKind::Foreign(Station(2))),
        (
            message(id, 1, &[4, 2, 0x17, 0x70]),
            TrafficKind::Stray(unit_1),
        ),
        (
            message(id, 1, &[3, 4, 0, 1, 0, 2]),
            TrafficKind::Stray(unit_1),
        ),
        (message(id, 1, &[0x84, 2]), TrafficKind::Stray(unit_1)),
        // Our own request, from a server that sends back what it gets.
        (
            message(id, 1, &[3, 0x0C, 0x10, 0, 1]),
            TrafficKind::Stray(unit_1),
        ),
    ] {
        assert_eq!(wire.receive(AT, &bytes), None, "{bytes:02X?}");
        assert_eq!(kinds(&mut wire), [kind], "{bytes:02X?}");
    }
    assert!(wire.is_busy() && !wire.is_out_of_step());
    assert_eq!(wire.receive(AT, &message(id, 1, &REPLY)), answered());
}

#[test]
fn a_late_reply_to_the_same_stop_acknowledges_nothing() {
    let mut wire = wire();
    let first = send(&mut wire, stop());
    let due = wire.wake_at().unwrap();
    assert_eq!(wire.pass(due), Some((stop(), ExchangeEnding::Silent)));
    let second = send(&mut wire, stop());
    let echo = [6, 0, 2, 0, 0];
    assert_eq!(wire.receive(due, &message(first, 1, &echo)), None);
    let acknowledged = Some((stop(), ExchangeEnding::Reply(Reply::Holds { value: 0 })));
    assert_eq!(wire.receive(due, &message(second, 1, &echo)), acknowledged);
    assert_eq!(wire.receive(due, &message(second, 1, &echo)), None, "twice");
    let stray = TrafficKind::Stray(Station(1));
    assert_eq!(kinds(&mut wire), [stray, TrafficKind::Reply, stray]);
}

#[test]
fn replies_that_changed_places_are_told_apart_in_one_read() {
    let mut wire = wire();
    let first = send(&mut wire, read());
    assert!(wire.pass(wire.wake_at().unwrap()).is_some());
    let second = send(&mut wire, read());
    let newer = message(second, 1, &REPLY);
    let older = message(first, 1, &[3, 2, 0, 9]);
    let both = [older.clone(), newer.clone(), older, newer].concat();
    assert_eq!(
        wire.receive(AT, &both),
        answered(),
        "not the 9 of the older one"
    );
    assert_eq!(
        kinds(&mut wire)
            .iter()
            .filter(|kind| **kind == TrafficKind::Reply)
            .count(),
        1
    );
}

#[test]
fn the_rest_of_a_reply_is_waited_for_over_time_outs_and_requests() {
    let mut wire = wire();
    let reply = message(send(&mut wire, read()), 1, &REPLY);
    assert_eq!(wire.receive(AT, &reply[..9]), None);
    let due = wire.wake_at().unwrap();
    assert_eq!(wire.pass(due), Some((read(), ExchangeEnding::Silent)));
    assert_eq!(
        wire.wake_at(),
        None,
        "nothing is to be done until more arrives"
    );
    let second = send(&mut wire, read());
    assert_eq!(wire.receive(due, &reply[9..]), None);
    assert_eq!(wire.receive(due, &message(second, 1, &REPLY)), answered());
    assert_eq!(
        kinds(&mut wire),
        [TrafficKind::Stray(Station(1)), TrafficKind::Reply]
    );
}

#[test]
fn a_header_that_is_none_gives_the_stream_up() {
    for wrong in [
        &[0, 1, 0, 1][..],
        &[0, 1, 0, 0, 0, 1],
        &[0, 1, 0, 0, 1, 0],
        b"HTTP/1.1 400 Bad Request",
    ] {
        let mut wire = wire();
        send(&mut wire, read());
        let mut bytes = message(7, 1, &REPLY);
        bytes.extend(wrong);
        assert_eq!(wire.receive(AT, &bytes), None);
        assert!(wire.is_out_of_step(), "{wrong:02X?}");
        assert_eq!(
            kinds(&mut wire),
            [TrafficKind::Stray(Station(1)), TrafficKind::Noise]
        );
        assert_eq!(wire.abandon(AT), Some(read()));
        assert!(!wire.is_out_of_step());
    }
}

#[test]
fn a_peer_that_never_stops_sending_fills_no_memory() {
    let mut wire = wire();
    send(&mut wire, read());
    let flood: Vec<u8> = std::iter::repeat_n(message(7, 1, &REPLY), 300)
        .flatten()
        .collect();
    for _ in 0..1000 {
        assert_eq!(wire.receive(AT, &flood), None);
        assert!(!wire.is_out_of_step());
        assert_eq!(wire.take_heard().len(), 300);
    }
}
