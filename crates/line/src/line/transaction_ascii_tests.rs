//! The wire of an ASCII line: what ends an exchange there, and what does not.

use super::exchange::{Exchange, ExchangeEnding};
use super::timing::testing::ASCII;
use super::transaction::LineWire;
use crate::domain::ids::Station;
use crate::domain::time::MonoTime;
use crate::domain::traffic::TrafficKind;
use crate::wire::ascii;
use crate::wire::pdu::{Reply, Request};
use std::time::Duration;

const SENT: MonoTime = MonoTime::from_millis(20);

fn frame(station: u8, pdu: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    ascii::encode(&mut out, station, |adu| adu.extend_from_slice(pdu));
    out
}

fn reply() -> Vec<u8> {
    frame(1, &[3, 2, 0x17, 0x70])
}

fn exchange(request: Request) -> Exchange {
    let timeout = Duration::from_millis(300);
    Exchange {
        station: Station(1),
        request,
        timeout,
        in_doubt: false,
    }
}

fn read() -> Exchange {
    exchange(Request::Read {
        address: 0x0C10_u16.into(),
        count: 1,
    })
}

fn answered() -> Option<(Exchange, ExchangeEnding)> {
    Some((read(), ExchangeEnding::Reply(Reply::Words(vec![6000]))))
}

fn sent(exchange: Exchange) -> LineWire {
    let mut wire = LineWire::new(ASCII, MonoTime::ZERO);
    wire.send(SENT, exchange, &mut Vec::new());
    wire
}

fn at(millis: u64) -> MonoTime {
    MonoTime::from_millis(millis)
}

#[test]
fn a_request_goes_out_as_text_and_silence_counts_from_its_end() {
    let mut wire = LineWire::new(ASCII, MonoTime::ZERO);
    assert_eq!(wire.may_send_from(), at(10));
    let mut out = Vec::new();
    wire.send(SENT, read(), &mut out);
    assert_eq!(out, b":01030C100001DF\r\n");
    // 17 characters of 10 bits at 9600 bit/s out, 15 back.
    assert_eq!(
        wire.may_send_from(),
        SENT + Duration::from_nanos(17_708_334) + Duration::from_millis(10)
    );
    assert_eq!(
        wire.wake_at(),
        Some(SENT + Duration::from_nanos(17_708_334 + 300_000_000 + 15_625_000))
    );
    assert_eq!(wire.receive(at(60), &reply()), answered());
    assert_eq!(wire.may_send_from(), at(70));
}

#[test]
fn a_reply_counts_in_either_case_and_in_pieces_with_holes() {
    let lower = reply().to_ascii_lowercase();
    let mut wire = sent(read());
    for (n, byte) in lower.iter().enumerate() {
        let at = at(60 + 15 * n as u64);
        let ended = wire
            .receive(at, &[*byte])
            .or_else(|| wire.pass(at + Duration::from_millis(14)));
        assert_eq!(ended.is_some(), n + 1 == lower.len(), "{n}");
    }
    let heard = wire.take_heard();
    assert_eq!(
        (heard[0].kind, &heard[0].bytes),
        (TrafficKind::Reply, &lower)
    );
}

#[test]
fn a_frame_that_has_ended_with_a_wrong_check_is_garbled_when_the_reply_was_due() {
    for place in [5, 9, 12] {
        let mut damaged = reply();
        damaged[place] = if damaged[place] == b'1' { b'3' } else { b'1' };
        let mut wire = sent(read());
        let due = wire.wake_at();
        assert_eq!(wire.receive(at(60), &damaged), None, "{place}");
        assert_eq!(wire.wake_at(), due);
        assert_eq!(
            wire.pass(due.unwrap()),
            Some((read(), ExchangeEnding::Garbled)),
            "{place}"
        );
        let heard = wire.take_heard();
        assert_eq!(
            (heard[0].kind, &heard[0].bytes),
            (TrafficKind::Noise, &damaged)
        );
        assert_eq!(wire.wake_at(), None, "nothing is left to wait for");
    }
    let mut damaged = frame(1, &[0x83, 2]);
    damaged[8] ^= 1;
    let mut wire = sent(read());
    assert_eq!(wire.receive(at(60), &damaged), None);
    let due = wire.wake_at().unwrap();
    assert_eq!(wire.pass(due), Some((read(), ExchangeEnding::Garbled)));
}

#[test]
fn damage_that_is_not_the_reply_ends_nothing() {
    let mut of_another = frame(2, &[3, 2, 0x17, 0x70]);
    of_another[9] ^= 1;
    let mut too_long = frame(1, &[3, 4, 0x17, 0x70, 0, 0]);
    too_long[9] ^= 1;
    for noise in [
        &of_another,
        &too_long,
        &reply()[..14].to_vec(),
        &b"\r\n".to_vec(),
    ] {
        let mut wire = sent(read());
        assert_eq!(wire.receive(at(60), noise), None);
        assert_eq!(wire.pass(at(100)), None);
        assert_eq!(
            wire.receive(at(120), &reply()),
            answered(),
            "the reply after it still counts"
        );
    }
}

#[test]
fn the_reply_after_a_damaged_frame_is_the_reply() {
    let mut damaged = reply();
    damaged[9] ^= 1;
    let mut wire = sent(read());
    assert_eq!(wire.receive(at(60), &damaged), None);
    assert_eq!(wire.pass(at(100)), None);
    assert!(wire.receive(at(120), &reply()).is_some());
}

#[test]
fn a_colon_drops_what_was_begun() {
    let mut wire = sent(read());
    assert_eq!(wire.receive(at(60), b":010302"), None);
    assert_eq!(wire.receive(at(80), &reply()), answered());
    let kinds: Vec<_> = wire
        .take_heard()
        .into_iter()
        .map(|heard| (heard.kind, heard.bytes.len()))
        .collect();
    assert_eq!(
        kinds,
        [(TrafficKind::Noise, 7), (TrafficKind::Reply, reply().len())]
    );
}

#[test]
fn a_second_without_a_character_ends_a_frame() {
    let patient = Exchange {
        timeout: Duration::from_secs(5),
        ..read()
    };
    for (hole, is_answered) in [(999, true), (1_000, false)] {
        let mut wire = sent(patient.clone());
        assert_eq!(wire.receive(at(60), &reply()[..8]), None);
        assert_eq!(
            wire.receive(at(60 + hole), &reply()[8..]).is_some(),
            is_answered,
            "{hole}"
        );
    }
    let mut idle = LineWire::new(ASCII, MonoTime::ZERO);
    assert_eq!(idle.receive(at(60), b":0103"), None);
    assert_eq!(idle.wake_at(), Some(at(1_060)));
    idle.pass(at(1_060));
    assert_eq!((idle.take_heard().len(), idle.wake_at()), (1, None));
}

#[test]
fn an_exception_counts_at_once() {
    for (code, adu) in [(2, frame(1, &[0x83, 2])), (4, b":01830478\r\n".to_vec())] {
        assert_eq!(
            sent(read()).receive(at(60), &adu),
            Some((read(), ExchangeEnding::Exception(code)))
        );
    }
}

#[test]
fn foreign_and_stray_frames_leave_the_timer_running() {
    let mut wire = sent(read());
    let due = wire.wake_at();
    assert_eq!(wire.receive(at(60), &frame(2, &[3, 2, 0, 1])), None);
    assert_eq!(wire.receive(at(80), &frame(1, &[3, 4, 0, 1, 0, 2])), None);
    // A function whose reply length is not known.
    assert_eq!(wire.receive(at(90), &frame(1, &[0x2B, 0x0E, 1])), None);
    let kinds: Vec<_> = wire
        .take_heard()
        .into_iter()
        .map(|heard| heard.kind)
        .collect();
    let stray = TrafficKind::Stray(Station(1));
    assert_eq!(kinds, [TrafficKind::Foreign(Station(2)), stray, stray]);
    assert_eq!(wire.wake_at(), due);
}

#[test]
fn a_reply_that_never_ends_is_silence_at_the_time_out() {
    let mut wire = sent(read());
    let due = wire.wake_at().unwrap();
    assert_eq!(wire.receive(at(60), &reply()[..14]), None);
    assert_eq!(wire.pass(due), Some((read(), ExchangeEnding::Silent)));
    // What follows nevertheless answers nothing.
    assert_eq!(
        wire.receive(due + Duration::from_millis(1), &reply()[14..]),
        None
    );
}

#[test]
fn a_reply_that_comes_in_at_the_due_moment_is_let_in() {
    let mut wire = sent(read());
    let due = wire.wake_at().unwrap();
    assert_eq!(
        wire.receive(due.before(Duration::from_millis(1)), &reply()[..12]),
        None
    );
    assert_eq!(wire.pass(due), None);
    assert_eq!(wire.wake_at(), Some(due + Duration::from_millis(9)));
    assert_eq!(
        wire.receive(due + Duration::from_millis(2), &reply()[12..]),
        answered()
    );
}

#[test]
fn babble_cannot_hold_an_exchange_open() {
    for babble in [b"0", b":", b"\n"] {
        let mut wire = sent(read());
        let mut now = SENT;
        let ended = loop {
            now = now + Duration::from_millis(1);
            wire.receive(now, babble);
            if let Some(ended) = wire.pass(now) {
                break ended;
            }
            // The longest frame, 513 characters, and the silence after it.
            assert!(now < at(20 + 18 + 300 + 16 + 535 + 10 + 1));
        };
        assert_eq!(ended, (read(), ExchangeEnding::Silent));
    }
}
