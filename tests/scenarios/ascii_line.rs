//! A line with ASCII frames behaves like an RTU line: the same polls, reads, commands and stops, and no reply is taken
//! for another.

use crate::support::{ASCII_WORDS, MQTT, PROOF, Rig, RigOptions, STOP, plc, run};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome};
use vfd_gateway::domain::traffic::TrafficKind;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::sim::{BusOptions, FaultPlan};
use vfd_gateway::wire::ascii;

const RUN: u16 = 0x0002;

/// A line of `drives` on which `faults` happen.
fn line(drives: u8, faults: &str, seed: u64) -> Rig {
    let bus = BusOptions {
        faults: faults.parse().expect("a plan"),
        ..BusOptions::default()
    };
    Rig::new(
        &RigOptions {
            drives,
            bus,
            seed,
            ..RigOptions::default()
        }
        .ascii(),
    )
}

/// Clients that never pause read proof words for `time`; returns how many reads ended, and how many with their words.
fn read_on(rig: &mut Rig, drives: u16, time: Duration) -> (u64, u64) {
    let mut ended = 0;
    let mut right = 0;
    rig.keeps_sent = false;
    for asker in 0..4 {
        rig.read(asker, asker as u16 % drives, PROOF, 1 + asker as u16);
    }
    rig.run_until(rig.now + time, |rig, answer| {
        ended += 1;
        if let NativeOutcome::Words(words) = &answer.outcome {
            let expected = rig.proof(answer.ticket);
            assert!(
                words.iter().all(|word| *word == expected),
                "{words:04X?} for exchange {expected:04X}"
            );
            right += 1;
        }
        let n = answer.ticket.0;
        let count = 1 + (n % u64::from(ASCII_WORDS)) as u16;
        rig.read(answer.asker.0, (n % u64::from(drives)) as u16, PROOF, count);
    });
    (ended, right)
}

#[test]
fn polls_keep_the_silence_and_show_the_drives() {
    let options = RigOptions {
        drives: 4,
        poll: Duration::from_millis(20),
        ..RigOptions::default()
    };
    let mut rig = Rig::new(&options.ascii());
    rig.keeps_sent = false;
    rig.pass(Duration::from_secs(60));
    let report = rig.bus.report();
    assert!(
        report.requests_heard > 1_000 && report.requests_heard - report.replies_sent <= 1,
        "{report:?}"
    );
    assert_eq!(
        (report.bad_crc, report.gaps_too_short, report.talked_over),
        (0, 0, 0)
    );
    assert_eq!(
        report.shortest_gap,
        Some(Duration::from_millis(10)),
        "10 ms, and nothing more on a busy line"
    );
    for index in 0..4 {
        assert_eq!(rig.view(index).run_state, RunState::Stopped);
    }
}

#[test]
fn a_read_is_cut_into_frames_as_short_as_ascii_wants_them() {
    let mut rig = line(1, "", 1);
    let ticket = rig.read(1, 0, PROOF, 8);
    let NativeOutcome::Words(words) = rig.answer_to(ticket) else {
        panic!("words")
    };
    let counts: Vec<u8> = rig.sent.iter().map(|sent| sent.pdu[4]).collect();
    assert_eq!((words.len(), counts), (8, vec![6, 2]));
    let begun = rig.now;
    let ticket = rig.read(1, 0, PROOF, 1);
    rig.answer_to(ticket);
    // 17 characters of 10 bits out, 2 ms, 15 characters back, after 10 ms of silence.
    assert_eq!(
        rig.now.since(begun),
        Duration::from_nanos(10_000_000 + 17_708_334 + 2_000_000 + 15_625_000)
    );
    let write = rig.ask(
        1,
        0,
        NativeAsk::Write {
            address: 0x020C_u16.into(),
            values: vec![30],
        },
    );
    assert!(!matches!(rig.answer_to(write), NativeOutcome::NoReply));
}

#[test]
fn a_drive_is_commanded_and_stopped() {
    let mut rig = Rig::new(&RigOptions::controlled().ascii());
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))).0,
        Outcome::Acknowledged
    );
    rig.live(Duration::from_secs(20));
    assert_eq!(
        (rig.output(1), rig.view(0).run_state),
        (3000, RunState::Forward)
    );
    assert_eq!(
        rig.commanded(plc(1), STOP),
        (Outcome::Confirmed, Reason::None)
    );
    rig.pass(Duration::from_secs(20));
    assert_eq!(
        (rig.output(1), rig.view(0).run_state),
        (0, RunState::Stopped)
    );
    assert_eq!(rig.written(RUN), [1, 0]);
    assert!(
        rig.frames().contains(&b":010600020000F7\r\n".as_slice()),
        "stop as it stands on the wire"
    );
}

#[test]
fn a_stop_waits_for_the_exchange_on_the_wire_and_for_nothing_else() {
    for lead_ms in 0..60 {
        let mut rig = Rig::new(&RigOptions::controlled().ascii());
        for n in 0..100 {
            rig.ask(
                n % 60,
                0,
                NativeAsk::Read {
                    address: (PROOF + n as u16).into(),
                    count: 1,
                },
            );
        }
        rig.pass(Duration::from_millis(lead_ms));
        let stopped_at = rig.now;
        rig.command(plc(1), 0, STOP);
        while rig.written(RUN).is_empty() {
            rig.step(rig.now + Duration::from_secs(1));
        }
        let waited = rig.sent.last().expect("the stop").at.since(stopped_at);
        let bound = Duration::from_nanos(17_708_334 + 2_000_000 + 15_625_000 + 10_000_000);
        assert!(waited <= bound, "{waited:?} after {lead_ms} ms");
    }
}

#[test]
fn late_replies_answer_nothing_else() {
    for seed in 0..4 {
        let mut rig = line(3, "late=300", seed);
        let (_, right) = read_on(&mut rig, 3, Duration::from_secs(1_200));
        assert!(right > 1_000, "work went on: {right}");
        assert!(
            rig.bus.report().replies_late > 1_000,
            "{:?}",
            rig.bus.report()
        );
        assert!(
            rig.core.counters().strays > 300,
            "late replies were seen: {:?}",
            rig.core.counters()
        );
    }
}

#[test]
fn a_station_with_a_missing_reply_is_asked_only_what_cannot_be_mistaken() {
    line(1, "", 1).shows_that_a_missing_reply_is_waited_out();
}

/// One wrong bit only: two can cancel each other in an LRC and go unnoticed.
#[test]
fn a_reply_with_a_wrong_check_is_asked_for_again_when_its_time_is_over() {
    let mut rig = line(1, "", 1);
    rig.traffic.clear();
    let ticket = rig.read(1, 0, PROOF, 1);
    let asked = rig.sent.last().expect("the line was idle").clone();
    let end = asked.at + Duration::from_nanos(17_708_334);
    // The drive's reply arrives, but with another last digit before its LRC.
    let mut reply = Vec::new();
    ascii::encode(&mut reply, 1, |pdu| pdu.extend([3, 2, 0, 1]));
    reply[10] = b'3';
    rig.bus.take_due(end + Duration::from_millis(20), |_, _| {});
    rig.now = end + Duration::from_millis(20);
    rig.core
        .handle(rig.now, vfd_gateway::gateway::LineInput::Bytes(&reply));
    rig.settle();
    assert_eq!(rig.core.counters().garbled, 0, "the reply may still come");
    // The barrier is sent in between.
    assert_eq!(
        rig.answer_to(ticket),
        NativeOutcome::Words(vec![asked.proof + 2].into())
    );
    let counters = rig.core.counters();
    assert_eq!(
        (counters.garbled, counters.strays, counters.barriers),
        (1, 0, 1)
    );
    let again = rig.sent.last().expect("the repetition").at.since(end);
    assert!(
        (Duration::from_millis(200)..Duration::from_millis(320)).contains(&again),
        "{again:?}"
    );
}

#[test]
fn every_fault_at_once_mixes_nothing_up() {
    for seed in 0..4 {
        let mut rig = line(4, "noise=80,lost=10,late=10,cut=20,foreign=30", seed);
        let (ended, right) = read_on(&mut rig, 4, Duration::from_secs(600));
        assert!(
            right * 10 > ended * 8,
            "most still get their words: {right} of {ended}"
        );
        let report = rig.bus.report();
        assert!(
            report.gaps_too_short <= report.replies_late / 10,
            "{report:?}"
        );
    }
}

#[test]
fn noise_before_a_reply_is_distinguished() {
    let options = RigOptions {
        tells_traffic: true,
        ..RigOptions::default()
    };
    let mut rig = Rig::new(&options.ascii());
    rig.bus.set_faults(FaultPlan {
        noise: 1000,
        ..FaultPlan::NONE
    });
    for n in 0..100 {
        let ticket = rig.read(1, 0, PROOF + n, 1);
        assert!(
            matches!(rig.answer_to(ticket), NativeOutcome::Words(_)),
            "{n}"
        );
    }
    let noise = rig
        .traffic
        .iter()
        .filter(|record| record.kind == TrafficKind::Noise)
        .count();
    assert_eq!(noise, 100);
    let replies = rig
        .traffic
        .iter()
        .filter(|record| record.kind == TrafficKind::Reply);
    assert!(
        replies.clone().count() == 100
            && replies
                .clone()
                .all(|reply| ascii::decode(&reply.bytes).is_some())
    );
}
