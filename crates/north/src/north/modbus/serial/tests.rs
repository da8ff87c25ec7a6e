//! Tables of bytes and times through the machine of a serial slave.

use super::*;
use crate::domain::link::Parity;

const LINK: LinkSettings = LinkSettings {
    baud: 9600,
    data_bits: 8,
    parity: Parity::None,
    stop_bits: 1,
};
/// 3.5 characters of ten bits at 9600 bit/s.
const SILENCE_NS: u64 = 3_645_834;

const fn at(us: u64) -> MonoTime {
    MonoTime::from_nanos(1_000_000_000 + us * 1000)
}

fn slave(framing: Framing) -> SerialSlave {
    let settings = SlaveSettings {
        link: LINK,
        framing,
        answer_within: Duration::from_millis(100),
        is_paced: true,
    };
    SerialSlave::new(settings, at(0))
}

fn ours(unit: u8) -> bool {
    [1, 101].contains(&unit)
}

fn frame(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    rtu::encode(&mut out, unit, |out| out.extend_from_slice(pdu));
    out
}

fn text(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    ascii::encode(&mut out, unit, |out| out.extend_from_slice(pdu));
    out
}

const READ: [u8; 5] = [3, 0, 0, 0, 1];
const REPLY: [u8; 4] = [3, 2, 0, 7];
const WRITE: [u8; 5] = [6, 1, 0, 0, 1];

/// A slave that has taken `pdu` at 10 ms, with the request.
fn asked(pdu: &[u8]) -> (SerialSlave, SlaveRequest) {
    let mut slave = slave(Framing::Rtu);
    slave.received(at(10_000), &frame(1, pdu), &ours);
    slave.tick(at(13_700), &ours);
    let request = slave.next_request().unwrap();
    (slave, request)
}

#[test]
fn a_request_ends_with_silence_and_is_answered_at_once() {
    let mut slave = slave(Framing::Rtu);
    slave.received(at(10_000), &frame(1, &READ), &ours);
    assert_eq!(slave.next_request(), None, "more bytes may follow");
    assert_eq!(
        slave.next_wake(),
        Some(MonoTime::from_nanos(at(10_000).as_nanos() + SILENCE_NS))
    );
    slave.tick(at(13_600), &ours);
    assert_eq!(slave.next_request(), None);
    slave.tick(at(13_700), &ours);
    let request = slave.next_request().unwrap();
    assert_eq!((request.unit, request.pdu.as_slice()), (1, &READ[..]));
    assert_eq!(slave.next_frame(at(13_700)), None);
    slave.answer(request.number, &REPLY);
    assert_eq!(slave.next_frame(at(13_800)), Some(frame(1, &REPLY)));
    assert_eq!(slave.next_frame(at(13_900)), None, "once");
}

#[test]
fn a_foreign_request_and_its_reply_in_one_piece_are_foreign() {
    let exchange = |request: &[u8], reply: &[u8]| [frame(7, request), frame(7, reply)].concat();
    let reads = exchange(&READ, &REPLY);
    let writes = exchange(&WRITE, &WRITE);
    let refused = exchange(&READ, &[0x83, 2]);
    let foreign = |foreign| SlaveCounters {
        foreign,
        ..SlaveCounters::default()
    };
    let damaged = SlaveCounters {
        damaged: 1,
        ..SlaveCounters::default()
    };
    for (bytes, counters) in [
        (reads.clone(), foreign(2)),
        (writes.clone(), foreign(2)),
        (refused, foreign(2)),
        ([reads.clone(), writes].concat(), foreign(4)),
        // A slave that is not there, and the next request.
        ([frame(9, &READ), reads.clone()].concat(), foreign(3)),
        // The reply of another slave than the one that was asked, or to another function.
        ([frame(7, &READ), frame(9, &REPLY)].concat(), damaged),
        ([frame(7, &WRITE), frame(7, &REPLY)].concat(), damaged),
        ([reads.clone(), vec![0]].concat(), damaged),
    ] {
        let mut slave = slave(Framing::Rtu);
        slave.received(at(10_000), &bytes, &ours);
        slave.tick(at(13_700), &ours);
        slave.tick(at(200_000), &ours);
        assert_eq!(
            (slave.next_request(), slave.next_frame(at(200_000))),
            (None, None),
            "{bytes:02X?}"
        );
        assert_eq!(slave.counters(), &counters, "{bytes:02X?}");
    }
    // A request for the gateway right behind them is answered, and one that others follow is not.
    let mut slave = slave(Framing::Rtu);
    slave.received(
        at(10_000),
        &[reads.clone(), frame(1, &READ)].concat(),
        &ours,
    );
    slave.tick(at(13_700), &ours);
    assert_eq!(slave.next_request().map(|request| request.unit), Some(1));
    slave.received(at(30_000), &[frame(1, &READ), reads].concat(), &ours);
    slave.tick(at(33_700), &ours);
    assert_eq!(slave.next_request(), None);
    assert_eq!(
        slave.counters(),
        &SlaveCounters {
            requests: 2,
            foreign: 4,
            ..SlaveCounters::default()
        }
    );
}

#[test]
fn what_is_not_for_the_gateway_gets_no_answer() {
    for (bytes, counters) in [
        (
            frame(7, &READ),
            SlaveCounters {
                foreign: 1,
                ..SlaveCounters::default()
            },
        ),
        (
            frame(0, &WRITE),
            SlaveCounters {
                broadcasts: 1,
                ..SlaveCounters::default()
            },
        ),
        (
            vec![1, 3, 0, 0, 0, 1, 0, 0],
            SlaveCounters {
                damaged: 1,
                ..SlaveCounters::default()
            },
        ),
        (
            vec![0xFF],
            SlaveCounters {
                damaged: 1,
                ..SlaveCounters::default()
            },
        ),
    ] {
        let mut slave = slave(Framing::Rtu);
        slave.received(at(10_000), &bytes, &ours);
        slave.tick(at(50_000), &ours);
        slave.tick(at(200_000), &ours);
        assert_eq!(
            (slave.next_request(), slave.next_frame(at(200_000))),
            (None, None),
            "{bytes:02X?}"
        );
        assert_eq!(slave.counters(), &counters, "{bytes:02X?}");
        slave.received(at(300_000), &frame(1, &READ), &ours);
        slave.tick(at(304_000), &ours);
        assert!(slave.next_request().is_some(), "after {bytes:02X?}");
    }
}

#[test]
fn a_request_behind_noise_and_one_in_pieces_are_taken() {
    let noisy = [&[0xFF, 0][..], &frame(1, &READ)].concat();
    let mut slave = slave(Framing::Rtu);
    slave.received(at(10_000), &noisy, &ours);
    slave.tick(at(14_000), &ours);
    assert!(slave.next_request().is_some());
    let whole = frame(101, &WRITE);
    slave.received(at(60_000), &whole[..3], &ours);
    slave.received(at(76_000), &whole[3..], &ours);
    slave.tick(at(80_000), &ours);
    assert_eq!(
        slave.next_request().map(|it| it.unit),
        Some(101),
        "an adapter delivers after 16 ms"
    );
    slave.received(at(200_000), &whole[..3], &ours);
    slave.received(at(221_000), &whole[3..], &ours);
    slave.tick(at(300_000), &ours);
    assert_eq!(slave.next_request(), None, "no adapter pauses for 21 ms");
}

/// Function 06 to the run word, and the bytes that a driver adds which is switched on or off.
const STOP: [u8; 5] = [6, 0, 0, 0, 0];
const GLITCHES: [&[u8]; 6] = [
    &[0],
    &[0xFF],
    &[0, 0],
    &[0xFF, 0],
    &[0, 0xFF],
    &[0x55, 0, 0xFF],
];

#[test]
fn a_request_is_taken_with_a_glitch_behind_it_before_it_or_on_both_sides() {
    let requests: [&[u8]; 4] = [
        &READ,
        &STOP,
        &[0x10, 0, 1, 0, 2, 4, 0, 1, 0, 2],
        &[0x17, 0, 0, 0, 1, 0, 5, 0, 1, 2, 0, 7],
    ];
    for (pdu, glitch) in requests
        .iter()
        .flat_map(|pdu| GLITCHES.map(|glitch| (*pdu, glitch)))
    {
        let frame = frame(1, pdu);
        for bytes in [
            [&frame[..], glitch].concat(),
            [glitch, &frame].concat(),
            [glitch, &frame, glitch].concat(),
        ] {
            let mut slave = slave(Framing::Rtu);
            slave.received(at(10_000), &bytes, &ours);
            slave.tick(at(13_700), &ours);
            let request = slave.next_request();
            assert_eq!(
                request.as_ref().map(|it| it.pdu.as_slice()),
                Some(pdu),
                "{bytes:02X?}"
            );
            slave.answer(request.unwrap().number, &REPLY);
            assert!(slave.next_frame(at(13_800)).is_some(), "{bytes:02X?}");
            slave.tick(at(60_000), &ours);
            slave.received(at(60_000), &frame, &ours);
            slave.tick(at(63_700), &ours);
            assert!(
                slave.next_request().is_some(),
                "the next one behind {bytes:02X?}"
            );
        }
    }
}

#[test]
fn the_glitch_behind_a_request_may_be_the_beginning_of_the_next_one() {
    let (first, second) = (frame(1, &READ), frame(101, &STOP));
    let mut slave = slave(Framing::Rtu);
    slave.received(at(10_000), &[&first[..], &second[..2]].concat(), &ours);
    slave.tick(at(13_700), &ours);
    assert_eq!(slave.next_request().map(|it| it.unit), Some(1));
    slave.received(at(20_000), &second[2..], &ours);
    slave.tick(at(23_700), &ours);
    assert_eq!(slave.next_request().map(|it| it.unit), Some(101));
}

#[test]
fn what_is_longer_than_its_function_says_is_answered_as_it_is() {
    // The check is right over all of it, so it is no glitch.
    let long = frame(1, &[3, 0, 0, 0, 1, 9]);
    let mut slave = slave(Framing::Rtu);
    slave.received(at(10_000), &long, &ours);
    slave.tick(at(13_700), &ours);
    assert_eq!(
        slave.next_request().map(|it| it.pdu),
        Some(vec![3, 0, 0, 0, 1, 9])
    );
}

#[test]
fn an_echo_with_a_glitch_before_it_is_no_request_where_echoes_are_known() {
    let (mut slave, request) = asked(&WRITE);
    slave.answer(request.number, &WRITE);
    let reply = slave.next_frame(at(13_800)).unwrap();
    slave.received(at(23_000), &reply, &ours);
    slave.received(at(60_000), &frame(1, &WRITE), &ours);
    slave.tick(at(64_000), &ours);
    let again = slave.next_request().unwrap();
    slave.answer(again.number, &WRITE);
    let reply = slave.next_frame(at(64_100)).unwrap();
    slave.received(at(73_000), &[&[0xFF], &reply[..]].concat(), &ours);
    slave.tick(at(77_000), &ours);
    assert_eq!(slave.next_request(), None);
}

#[test]
fn a_glitch_around_a_text_frame_costs_nothing() {
    for glitch in GLITCHES {
        let request = text(1, &STOP);
        for bytes in [[&request[..], glitch].concat(), [glitch, &request].concat()] {
            let mut slave = slave(Framing::Ascii);
            slave.received(at(10_000), &bytes, &ours);
            assert!(slave.next_request().is_some(), "{bytes:02X?}");
            slave.received(at(60_000), &request, &ours);
            assert!(
                slave.next_request().is_some(),
                "the next one behind {bytes:02X?}"
            );
        }
    }
}

#[test]
fn without_an_answer_an_exception_is_sent_in_time_and_the_answer_never() {
    for (pdu, code) in [
        (&READ[..], 6),
        (&WRITE, 0x0B),
        (&[4, 0, 0, 0, 1], 6),
        (&[0x10, 0, 0, 0, 1, 2, 0, 1], 0x0B),
    ] {
        let (mut slave, request) = asked(pdu);
        let due = slave.next_wake().unwrap();
        let end = due + LINK.bytes(5);
        assert!(end <= at(110_000) && end >= at(105_000), "{due:?}");
        assert_eq!(
            slave.next_frame(due),
            Some(frame(1, &[pdu[0] | 0x80, code]))
        );
        slave.answer(request.number, &REPLY);
        assert_eq!(slave.next_frame(at(160_000)), None);
        slave.received(at(170_000), &frame(1, &READ), &ours);
        slave.tick(at(174_000), &ours);
        let next = slave.next_request().unwrap();
        slave.answer(request.number, &REPLY);
        assert_eq!(
            slave.next_frame(at(174_000)),
            None,
            "the answer to another question"
        );
        slave.answer(next.number, &REPLY);
        assert_eq!(slave.next_frame(at(174_100)), Some(frame(1, &REPLY)));
        let counters = SlaveCounters {
            requests: 2,
            not_in_time: 1,
            late: 2,
            ..SlaveCounters::default()
        };
        assert_eq!(slave.counters(), &counters);
    }
}

#[test]
fn a_new_frame_ends_the_wait_for_the_answer_before_it() {
    let (mut slave, first) = asked(&READ);
    slave.received(at(40_000), &frame(7, &READ), &ours);
    slave.tick(at(44_000), &ours);
    slave.answer(first.number, &REPLY);
    assert_eq!(
        slave.next_frame(at(60_000)),
        None,
        "the bus is in use by others"
    );
    assert_eq!(slave.next_frame(at(200_000)), None);
}

#[test]
fn noise_delays_a_reply_until_silence_and_never_past_its_time() {
    let (mut slave, request) = asked(&READ);
    slave.answer(request.number, &REPLY);
    slave.received(at(13_750), &[0xAA], &ours);
    assert_eq!(slave.next_frame(at(14_000)), None);
    assert_eq!(slave.next_frame(at(17_500)), Some(frame(1, &REPLY)));
    let (mut slave, request) = asked(&READ);
    slave.answer(request.number, &REPLY);
    for ms in 14..120 {
        slave.received(at(ms * 1000), &[0xAA], &ours);
        assert_eq!(slave.next_frame(at(ms * 1000 + 500)), None);
    }
    assert_eq!(slave.next_frame(at(130_000)), None);
}

#[test]
fn an_echo_of_a_reply_is_no_request() {
    let (mut slave, request) = asked(&WRITE);
    slave.answer(request.number, &WRITE);
    let reply = slave.next_frame(at(13_800)).unwrap();
    // The reply to a write is the same as the request.
    slave.received(at(16_000), &reply[..2], &ours);
    slave.received(at(23_000), &reply[2..], &ours);
    slave.tick(at(30_000), &ours);
    assert_eq!(slave.next_request(), None);
    slave.received(at(60_000), &frame(1, &WRITE), &ours);
    slave.tick(at(64_000), &ours);
    assert!(slave.next_request().is_some(), "the master repeats it");
}

#[test]
fn a_frame_that_begins_during_a_reply_is_not_taken() {
    let (mut slave, request) = asked(&READ);
    slave.answer(request.number, &REPLY);
    slave.next_frame(at(13_800)).unwrap();
    slave.received(at(15_000), &frame(101, &WRITE), &ours);
    slave.tick(at(40_000), &ours);
    assert_eq!(slave.next_request(), None);
    assert_eq!(slave.counters().collisions, 1);
    slave.received(at(60_000), &frame(101, &WRITE), &ours);
    slave.tick(at(64_000), &ours);
    assert!(slave.next_request().is_some());
}

#[test]
fn a_request_right_after_a_reply_is_taken() {
    let (mut slave, request) = asked(&READ);
    slave.answer(request.number, &REPLY);
    slave.next_frame(at(13_800)).unwrap();
    slave.received(at(26_000), &frame(1, &READ), &ours);
    slave.tick(at(30_000), &ours);
    assert!(slave.next_request().is_some());
}

#[test]
fn ascii_frames_end_by_their_mark() {
    let mut slave = slave(Framing::Ascii);
    let request = text(1, &READ);
    slave.received(at(10_000), &request[..4], &ours);
    slave.received(at(500_000), &request[4..], &ours);
    let asked = slave.next_request().unwrap();
    slave.answer(asked.number, &REPLY);
    assert_eq!(
        slave.next_frame(at(509_000)),
        None,
        "10 ms lie between frames"
    );
    assert_eq!(slave.next_frame(at(510_000)), Some(text(1, &REPLY)));
    let mut spoilt = request.clone();
    spoilt[4] = b'9';
    slave.received(at(700_000), &spoilt, &ours);
    assert_eq!((slave.next_request(), slave.counters().damaged), (None, 1));
    slave.received(at(800_000), &request, &ours);
    assert!(slave.next_request().is_some());
}

#[test]
fn a_babbling_node_cannot_fill_the_memory() {
    for framing in [Framing::Rtu, Framing::Ascii] {
        let mut slave = slave(framing);
        for step in 0..1000 {
            slave.received(at(10_000 + step), &[b':'; 100], &ours);
        }
        assert!(slave.bytes.len() <= KEPT_MAX);
    }
}

#[test]
fn the_least_time_leaves_room_for_silence_and_exception() {
    assert!(least_answer_within(LINK, Framing::Rtu) < Duration::from_millis(20));
    let slow = LinkSettings { baud: 300, ..LINK };
    assert!(least_answer_within(slow, Framing::Rtu) > Duration::from_millis(100));
    assert_eq!(
        silence(
            LinkSettings {
                baud: 115_200,
                ..LINK
            },
            Framing::Rtu
        ),
        SILENCE_FAST
    );
}

/// All requests that wait to be taken out, in order.
fn taken_out(slave: &mut SerialSlave) -> Vec<Vec<u8>> {
    std::iter::from_fn(|| slave.next_request())
        .map(|request| request.pdu)
        .collect()
}

#[test]
fn a_stop_counts_wherever_it_stands_in_a_piece() {
    let (stop, other, read, foreign) = (
        frame(1, &STOP),
        frame(101, &STOP),
        frame(1, &READ),
        frame(7, &READ),
    );
    let damaged = [&read[..5], &[0x33, 0x44]].concat();
    for (pieces, stops) in [
        (vec![&stop, &read], 1),
        (vec![&stop, &other], 2),
        (vec![&stop, &foreign], 1),
        (vec![&foreign, &stop, &foreign], 1),
        (vec![&stop, &damaged, &read], 1),
        (vec![&damaged, &stop, &damaged], 1),
        (vec![&stop, &foreign, &damaged, &other, &read], 2),
        // A port that was read again after seconds has far more than is kept.
        (
            [
                vec![&stop],
                vec![&read; 200],
                vec![&other],
                vec![&foreign; 200],
            ]
            .concat(),
            2,
        ),
    ] {
        let bytes: Vec<u8> = pieces.into_iter().flatten().copied().collect();
        let mut slave = slave(Framing::Rtu);
        for piece in bytes.chunks(512) {
            slave.received(at(10_000), piece, &ours);
        }
        slave.tick(at(13_700), &ours);
        slave.tick(at(60_000), &ours);
        let found = taken_out(&mut slave)
            .iter()
            .filter(|pdu| pdu[..] == STOP)
            .count();
        assert_eq!(found, stops, "{bytes:02X?}");
    }
    let mut slave = slave(Framing::Ascii);
    slave.received(
        at(10_000),
        &[text(1, &STOP), text(1, &READ)].concat(),
        &ours,
    );
    assert_eq!(taken_out(&mut slave), [&STOP[..], &READ]);
}
