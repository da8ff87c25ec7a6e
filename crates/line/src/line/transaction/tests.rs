//! Tests of the wire of one line.

use super::super::timing::ADAPTER_HOLE;
use super::super::timing::testing::N700;
use super::*;
use crate::wire::pdu::Reply;
use crate::wire::rtu;

fn wire() -> LineWire {
    LineWire::new(N700, MonoTime::ZERO)
}

fn frame(station: u8, pdu: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    rtu::encode(&mut out, station, |adu| adu.extend_from_slice(pdu));
    out
}

fn exchange(request: Request, in_doubt: bool) -> Exchange {
    Exchange {
        station: Station(1),
        request,
        timeout: Duration::from_millis(300),
        in_doubt,
    }
}

fn read() -> Exchange {
    exchange(
        Request::Read {
            address: 0x0101_u16.into(),
            count: 1,
        },
        false,
    )
}

const SENT: MonoTime = MonoTime::from_millis(5);

fn sent(exchange: Exchange) -> LineWire {
    let mut wire = wire();
    wire.send(SENT, exchange, &mut Vec::new());
    wire
}

#[test]
fn silence_counts_from_the_later_of_last_byte_and_own_end() {
    let mut wire = wire();
    assert_eq!(wire.may_send_from(), MonoTime::from_nanos(4_687_500));
    wire.send(SENT, read(), &mut Vec::new());
    assert_eq!(
        wire.may_send_from(),
        SENT + Duration::from_nanos(8_333_334 + 4_687_500)
    );
    let at = MonoTime::from_millis(30);
    let ended = wire.receive(at, &frame(1, &[3, 2, 0x17, 0x70]));
    assert_eq!(
        ended,
        Some((read(), ExchangeEnding::Reply(Reply::Words(vec![6000]))))
    );
    assert_eq!(wire.may_send_from(), at + Duration::from_nanos(4_687_500));
}

#[test]
fn what_overtakes_our_frame_neither_answers_it_nor_shortens_the_silence_behind_it() {
    let stop = Request::WriteSingle {
        address: 2_u16.into(),
        value: 0,
    };
    let mut wire = wire();
    wire.port_opened(MonoTime::ZERO, PortKind::Serial);
    wire.send(SENT, exchange(stop, true), &mut Vec::new());
    let own_end = SENT + Duration::from_nanos(8_333_334);
    let ended = wire.receive(
        own_end.before(Duration::from_millis(3)),
        &frame(1, &[6, 0, 2, 0, 0]),
    );
    assert_eq!(ended, None, "it only looks like the answer");
    assert_eq!(
        wire.may_send_from(),
        own_end + Duration::from_nanos(4_687_500)
    );
    assert!(wire.receive(own_end, &frame(1, &[6, 0, 2, 0, 0])).is_some());
}

#[test]
fn a_silent_station_ends_at_the_time_out_and_not_before() {
    let mut wire = sent(read());
    let due = wire.wake_at().unwrap();
    // 8 bytes out, 300 ms, 7 bytes back
    assert_eq!(
        due,
        SENT + Duration::from_nanos(8_333_334 + 300_000_000 + 7_291_667)
    );
    assert_eq!(wire.pass(due.before(Duration::from_nanos(1))), None);
    assert_eq!(wire.pass(due), Some((read(), ExchangeEnding::Silent)));
}

#[test]
fn a_foreign_frame_leaves_the_timer_running() {
    let mut wire = sent(read());
    let due = wire.wake_at();
    assert_eq!(
        wire.receive(MonoTime::from_millis(20), &frame(2, &[3, 2, 0, 1])),
        None
    );
    assert_eq!(wire.take_heard()[0].kind, TrafficKind::Foreign(Station(2)));
    assert_eq!(wire.wake_at(), due);
}

#[test]
fn a_frame_of_the_station_that_answers_something_else_is_a_stray() {
    let mut wire = sent(read());
    assert_eq!(
        wire.receive(MonoTime::from_millis(20), &frame(1, &[3, 4, 0, 1, 0, 2])),
        None
    );
    assert_eq!(wire.take_heard()[0].kind, TrafficKind::Stray(Station(1)));
    assert!(wire.is_busy());
}

#[test]
fn bytes_in_the_shape_of_the_reply_end_nothing_before_its_time_is_over() {
    let mut wire = sent(read());
    let due = wire.wake_at().unwrap();
    let mut reply = frame(1, &[3, 2, 0x17, 0x70]);
    reply[4] ^= 1;
    let at = MonoTime::from_millis(25);
    assert_eq!(wire.receive(at, &reply), None);
    let end = at + N700.silence;
    assert_eq!(
        (wire.damaged_from(), wire.wake_at()),
        (Some(end), Some(due))
    );
    assert_eq!(wire.pass(end), None);
    assert_eq!(wire.pass(due), Some((read(), ExchangeEnding::Garbled)));
}

#[test]
fn the_reply_after_bytes_that_look_like_it_is_the_reply() {
    let mut wire = sent(read());
    let due = wire.wake_at();
    let mut reply = frame(1, &[3, 2, 0x17, 0x70]);
    reply[4] ^= 1;
    assert_eq!(wire.receive(MonoTime::from_millis(25), &reply), None);
    assert_eq!(wire.wake_at(), due);
    let whole = frame(1, &[3, 2, 0x17, 0x70]);
    assert!(
        wire.receive(MonoTime::from_millis(60), &whole).is_some(),
        "the reply still came"
    );
}

#[test]
fn a_cut_reply_is_waited_for_and_then_counts_as_missing() {
    let mut wire = sent(read());
    assert_eq!(wire.receive(MonoTime::from_millis(25), &[1, 3, 2]), None);
    assert_eq!(
        wire.pass(MonoTime::from_millis(60)),
        None,
        "a hole of an adapter is no end"
    );
    assert_eq!(
        wire.pass(wire.wake_at().unwrap()),
        Some((read(), ExchangeEnding::Silent))
    );
}

#[test]
fn a_reply_that_comes_in_at_the_due_moment_is_let_in() {
    let mut wire = sent(read());
    let due = wire.wake_at().unwrap();
    let reply = frame(1, &[3, 2, 0x17, 0x70]);
    assert_eq!(
        wire.receive(due.before(Duration::from_millis(1)), &reply[..6]),
        None
    );
    assert_eq!(wire.pass(due), None);
    let ended = wire.receive(due + Duration::from_micros(200), &reply[6..]);
    assert!(matches!(ended, Some((_, ExchangeEnding::Reply(_)))));
}

#[test]
fn babble_cannot_hold_an_exchange_open() {
    let mut wire = sent(read());
    let mut at = SENT;
    loop {
        at = at + Duration::from_millis(1);
        wire.receive(at, &[0x55]);
        if let Some(ended) = wire.pass(at) {
            assert_eq!(ended, (read(), ExchangeEnding::Silent));
            break;
        }
        assert!(at < MonoTime::from_millis(700));
    }
}

#[test]
fn an_exception_counts_once_silence_follows_it() {
    let at = MonoTime::from_millis(25);
    let silence = Duration::from_nanos(4_687_500);
    let refused = |behind: &[u8]| {
        let mut wire = sent(read());
        let due = wire.wake_at();
        assert_eq!(
            wire.receive(at, &[&frame(1, &[0x83, 2])[..], behind].concat()),
            None
        );
        assert_eq!(wire.pass(at + silence / 2), None);
        assert_eq!(wire.wake_at(), Some(at + silence));
        (due.unwrap(), wire.pass(at + silence), wire)
    };
    assert_eq!(refused(&[]).1, Some((read(), ExchangeEnding::Exception(2))));
    let (due, ended, mut wire) = refused(&[0x17, 0x70]);
    assert_eq!(
        (ended, wire.wake_at()),
        (None, Some(due)),
        "the reply may still come"
    );
    assert_eq!(wire.pass(due), Some((read(), ExchangeEnding::Garbled)));
    let (_, _, mut wire) = refused(&[0x17, 0x70]);
    assert!(
        wire.receive(at + silence * 2, &frame(1, &[3, 2, 0x17, 0x70]))
            .is_some()
    );
}

/// The beginning of a truncated reply followed by the beginning of the reply itself, with a valid CRC by chance.
#[test]
fn a_sound_frame_that_the_reply_may_begin_inside_of_counts_only_with_silence_after_it() {
    let two_words = || {
        exchange(
            Request::Read {
                address: 0x0101_u16.into(),
                count: 2,
            },
            false,
        )
    };
    let (cut, high) = (0..=u16::MAX)
        .find_map(|word| {
            let [first, second] = word.to_be_bytes();
            let whole = frame(1, &[3, 4, first, second, 1, 3]);
            (whole[7..8] == [4] && whole[8] != 0).then(|| (whole.clone(), whole[8]))
        })
        .expect("one of 256");
    let cut = [&cut[..5], &[1, 3, 4, high]].concat();
    assert!(rtu::decode(&cut).is_some());
    let reply = frame(1, &[3, 4, high, 7, 0, 9]);
    let at = MonoTime::from_millis(25);
    let mut wire = sent(two_words());
    assert_eq!(wire.receive(at, &cut), None);
    assert_eq!(wire.wake_at(), Some(at + N700.silence));
    let ended = wire.receive(at + Duration::from_millis(3), &reply[4..]);
    let words = vec![u16::from_be_bytes([high, 7]), 9];
    assert_eq!(
        ended,
        Some((two_words(), ExchangeEnding::Reply(Reply::Words(words))))
    );
    // A reply that only looks like that is accepted once silence has followed.
    let mut wire = sent(two_words());
    assert_eq!(wire.receive(at, &cut), None);
    assert!(matches!(
        wire.pass(at + N700.silence),
        Some((_, ExchangeEnding::Reply(_)))
    ));
}

/// The beginning of a truncated reply, and the end of an earlier one.
#[test]
fn what_comes_after_a_pause_that_no_adapter_makes_does_not_complete_a_frame() {
    let reply = frame(1, &[3, 2, 0x17, 0x70]);
    let at = MonoTime::from_millis(40);
    for (kind, hole, is_one) in [
        (PortKind::Serial, Duration::from_millis(16), true),
        (PortKind::Serial, ADAPTER_HOLE, true),
        (
            PortKind::Serial,
            ADAPTER_HOLE + Duration::from_millis(1),
            false,
        ),
        (PortKind::Virtual, Duration::from_millis(100), true),
    ] {
        let mut wire = wire();
        let mut out = Vec::new();
        wire.port_opened(MonoTime::ZERO, kind);
        wire.send(SENT, read(), &mut out);
        assert_eq!(wire.receive(at, &reply[..3]), None);
        assert_eq!(wire.pass(at + N700.silence), None);
        let behind = at + hole + N700.on_wire(4);
        assert_eq!(
            wire.receive(behind, &reply[3..]).is_some(),
            is_one,
            "{kind:?} {hole:?}"
        );
        // The reply itself may still arrive.
        let later = behind + Duration::from_millis(50);
        assert_eq!(
            wire.receive(later, &reply).is_some(),
            !is_one,
            "{kind:?} {hole:?}"
        );
    }
}

#[test]
fn in_doubt_neither_exception_nor_kept_value_is_an_answer() {
    let write = Request::WriteSingle {
        address: 2_u16.into(),
        value: 1,
    };
    for (in_doubt, pdu, answered) in [
        (false, vec![6, 0, 2, 0, 0], true),
        (true, vec![6, 0, 2, 0, 0], false),
        (true, vec![6, 0, 2, 0, 1], true),
        (false, vec![0x86, 2], true),
        (true, vec![0x86, 2], false),
    ] {
        let mut wire = sent(exchange(write.clone(), in_doubt));
        let at = MonoTime::from_millis(30);
        let ended = wire
            .receive(at, &frame(1, &pdu))
            .or_else(|| wire.pass(at + Duration::from_millis(5)));
        assert_eq!(ended.is_some(), answered, "{in_doubt} {pdu:02X?}");
    }
}

#[test]
fn to_a_function_that_is_not_served_only_its_refusal_is_an_answer() {
    let request = Request::Unserved {
        function: 8,
        data: 7,
    };
    for (pdu, answered) in [
        (&[0x88, 1][..], true),
        (&[0x88, 0x51], true),
        (&[0x88, 4], false),
        (&[0x83, 1], false),
        (&[8, 0, 0, 0, 7], false),
        (&[3, 2, 0, 1], false),
    ] {
        let mut wire = sent(exchange(request.clone(), false));
        let at = MonoTime::from_millis(30);
        let ended = wire
            .receive(at, &frame(1, pdu))
            .or_else(|| wire.pass(at + Duration::from_millis(5)));
        assert_eq!(ended.is_some(), answered, "{pdu:02X?}");
    }
}

#[test]
fn a_copy_of_a_write_that_no_drive_can_have_sent_yet_is_an_echo() {
    let write = || {
        exchange(
            Request::WriteSingle {
                address: 2_u16.into(),
                value: 1,
            },
            false,
        )
    };
    for (kind, is_known, early_is_echo) in [
        (PortKind::Serial, false, true),
        (PortKind::Virtual, false, false),
        (PortKind::Virtual, true, true),
    ] {
        let mut wire = wire();
        let mut out = Vec::new();
        wire.port_opened(MonoTime::ZERO, kind);
        wire.strip_echo(is_known);
        wire.send(SENT, write(), &mut out);
        let ended = wire.receive(SENT + Duration::from_millis(9), &out);
        assert_eq!(ended.is_none(), early_is_echo, "{kind:?}");
        let expected = if early_is_echo {
            TrafficKind::Echo
        } else {
            TrafficKind::Reply
        };
        assert_eq!(wire.take_heard()[0].kind, expected);
        if early_is_echo {
            assert!(
                wire.receive(SENT + Duration::from_millis(20), &out)
                    .is_some(),
                "the drive's own reply"
            );
        }
    }
}

#[test]
fn a_damaged_echo_is_no_damaged_reply() {
    let mut wire = wire();
    let mut out = Vec::new();
    wire.strip_echo(true);
    wire.send(
        SENT,
        exchange(
            Request::WriteSingle {
                address: 2_u16.into(),
                value: 1,
            },
            false,
        ),
        &mut out,
    );
    out[5] ^= 1;
    let at = SENT + Duration::from_millis(9);
    assert_eq!(wire.receive(at, &out), None);
    assert_eq!(wire.pass(at + Duration::from_millis(10)), None);
}

#[test]
fn talk_lasts_until_a_silence_is_long_enough() {
    let mut wire = wire();
    let at = MonoTime::from_millis;
    for ms in 10..20 {
        wire.receive(at(ms), &[0x55]);
    }
    assert_eq!(wire.talks_since(at(22)), Some(at(10)));
    assert_eq!(wire.talks_since(at(24)), None);
    wire.receive(at(30), &[0x55]);
    assert_eq!(wire.talks_since(at(31)), None, "one byte is no talk");
}

#[test]
fn requests_of_another_master_are_no_strays() {
    let mut wire = wire();
    wire.receive(SENT, &frame(7, &[3, 1, 1, 0, 1]));
    wire.pass(SENT + Duration::from_millis(5));
    assert_eq!(
        wire.take_heard()[0].kind,
        TrafficKind::OtherMaster(Station(7))
    );
}

#[test]
fn a_second_reply_answers_nothing() {
    let mut wire = sent(read());
    let reply = frame(1, &[3, 2, 0x17, 0x70]);
    let twice = [reply.clone(), reply].concat();
    assert!(wire.receive(MonoTime::from_millis(30), &twice).is_some());
    let kinds: Vec<_> = wire
        .take_heard()
        .into_iter()
        .map(|heard| heard.kind)
        .collect();
    assert_eq!(kinds, [TrafficKind::Reply, TrafficKind::Stray(Station(1))]);
}

#[test]
fn what_is_heard_has_the_moments_of_its_own_bytes() {
    let ms = MonoTime::from_millis;
    let us = MonoTime::from_micros;
    let mut wire = wire();
    wire.port_opened(ms(0), PortKind::Serial);
    assert_eq!(wire.receive(ms(100), &[0x55]), None);
    let mut out = Vec::new();
    let read = Request::Read {
        address: 0x0101_u16.into(),
        count: 1,
    };
    wire.send(ms(110), exchange(read, false), &mut out);
    // Read in two parts, the second with a byte after the reply.
    let mut reply = frame(1, &[3, 2, 0x17, 0x70]);
    reply.push(0xAA);
    assert_eq!(wire.receive(us(130_000), &reply[..3]), None);
    assert!(wire.receive(us(134_000), &reply[3..]).is_some());
    assert_eq!(wire.pass(ms(200)), None);
    let heard: Vec<_> = wire
        .take_heard()
        .into_iter()
        .map(|it| (it.kind, it.begin, it.end))
        .collect();
    let char_time = Duration::from_nanos(1_041_667);
    let noise = TrafficKind::Noise;
    let reply = TrafficKind::Reply;
    assert_eq!(
        heard,
        [
            (noise, ms(100).before(char_time), ms(100)),
            // 7 characters take 7.29 ms, and the first part was read 4 ms before the end.
            (reply, us(134_000).before(N700.on_wire(7)), us(134_000)),
            (noise, us(134_000).before(char_time), us(134_000)),
        ]
    );
}

#[test]
fn without_character_times_a_frame_begins_when_it_is_read() {
    let mut wire = wire();
    wire.port_opened(MonoTime::ZERO, PortKind::Virtual);
    assert_eq!(wire.receive(MonoTime::from_millis(50), &[0x55, 0x55]), None);
    assert_eq!(wire.receive(MonoTime::from_millis(52), &[0x55]), None);
    assert_eq!(wire.pass(MonoTime::from_millis(80)), None);
    let heard = &wire.heard()[0];
    assert_eq!(
        (heard.begin, heard.end),
        (MonoTime::from_millis(50), MonoTime::from_millis(52))
    );
}
