//! A line over Modbus TCP keeps the promises of a serial line: no reply is taken for another, a stop waits for one exchange
//! at most, and a connection that comes and goes repeats nothing and starts nothing.

use crate::support::{MQTT, PROOF, Rig, RigOptions, STOP, plc, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction::Forward, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::{NativeOutcome, NativeRefusal};
use vfd_gateway::domain::report::{LineFault, LineState};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::drive::snapshot::DrivePresence;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::sim::{BusOptions, FaultPlan};
use vfd_gateway::wire::mbap;

const RUN: u16 = 0x0002;
/// The reply time-out of every drive.
const TIMEOUT: Duration = Duration::from_millis(200);

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
        .modbus_tcp(),
    )
}

/// A line of `drives` under control.
fn controlled(drives: u8) -> Rig {
    Rig::new(
        &RigOptions {
            drives,
            ..RigOptions::controlled()
        }
        .modbus_tcp(),
    )
}

/// One drive that runs at 30 Hz for MQTT.
fn running() -> Rig {
    let mut rig = controlled(1);
    assert_eq!(
        rig.commanded(MQTT, run(Forward, Some(3000))).0,
        Outcome::Acknowledged
    );
    rig.live(Duration::from_secs(20));
    assert_eq!(rig.output(1), 3000);
    rig
}

/// A message of unit 1 with the number of the newest request.
fn answer_to_newest(rig: &Rig, pdu: &[u8]) -> Vec<u8> {
    let id = mbap::transaction(&rig.sent.last().expect("a request").frame).expect("a number");
    let mut out = Vec::new();
    mbap::encode(&mut out, id, 1, |adu| adu.extend_from_slice(pdu));
    out
}

/// Lets time pass until `is_so`, at most a minute.
fn until(rig: &mut Rig, is_so: impl Fn(&Rig) -> bool) {
    let limit = rig.now + Duration::from_secs(60);
    while !is_so(rig) {
        assert!(rig.step(limit), "not within a minute");
    }
}

/// Lets time pass until a request with `function` was sent.
fn until_sent(rig: &mut Rig, function: u8) {
    until(rig, |rig| {
        rig.sent.last().is_some_and(|sent| sent.pdu[0] == function)
    });
}

/// Clients that never pause read proof words for `time`; returns how many reads ended with their words.
fn read_on(rig: &mut Rig, drives: u16, time: Duration) -> u64 {
    let mut right = 0;
    rig.keeps_sent = false;
    for asker in 0..4 {
        rig.read(asker, asker as u16 % drives, PROOF, 1 + asker as u16);
    }
    rig.run_until(rig.now + time, |rig, answer| {
        if let NativeOutcome::Words(words) = &answer.outcome {
            let expected = rig.proof(answer.ticket);
            assert!(
                words.iter().all(|word| *word == expected),
                "{words:04X?} for exchange {expected:04X}"
            );
            right += 1;
        }
        let n = answer.ticket.0;
        // Always as many words: on a serial line each of these could be taken for the other.
        rig.read(answer.asker.0, (n % u64::from(drives)) as u16, PROOF, 2);
    });
    right
}

#[test]
fn a_drive_is_commanded_and_stopped() {
    let mut rig = running();
    assert_eq!(rig.view(0).run_state, RunState::Forward);
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
}

#[test]
fn an_hour_of_delays_beyond_the_time_out_gives_no_wrong_value() {
    let mut rig = line(3, "late=200,beyond=200,lost=50,twin=100", 1);
    let right = read_on(&mut rig, 3, Duration::from_secs(3600));
    let (counters, report) = (*rig.core.counters(), rig.bus.report().clone());
    assert!(right > 10_000, "work went on: {right} {counters:?}");
    assert!(
        report.replies_late > 5_000 && counters.strays > 5_000,
        "{report:?} {counters:?}"
    );
    assert_eq!(counters.barriers, 0, "nothing has to be ruled out");
}

#[test]
fn a_missing_reply_holds_up_nothing_that_follows() {
    let mut rig = line(1, "", 1);
    rig.bus.set_faults(FaultPlan {
        lost: 1000,
        ..FaultPlan::NONE
    });
    let first = rig.read(1, 0, PROOF, 1);
    rig.bus.set_faults(FaultPlan::NONE);
    let same = rig.read(1, 0, PROOF + 1, 1);
    assert_eq!(rig.answer_to(first), NativeOutcome::NoReply);
    let timed_out = rig.now;
    assert!(matches!(rig.answer_to(same), NativeOutcome::Words(_)));
    assert_eq!(
        rig.now.since(timed_out),
        Duration::from_millis(2),
        "one turnaround, and no lateness waited out"
    );
}

#[test]
fn one_request_is_on_the_connection_at_a_time() {
    let faults = "late=100,lost=100".parse().expect("a plan");
    let bus = BusOptions {
        faults,
        ..BusOptions::default()
    };
    let poll = Duration::from_millis(20);
    let mut rig = Rig::new(
        &RigOptions {
            drives: 3,
            bus,
            poll,
            ..RigOptions::default()
        }
        .modbus_tcp(),
    );
    rig.tells_traffic();
    rig.pass(Duration::from_secs(60));
    let mut open: Option<MonoTime> = None;
    for record in &rig.traffic {
        match record.kind.keyword() {
            "request" => {
                let ended = open
                    .replace(record.begin)
                    .is_none_or(|sent| record.begin.since(sent) >= TIMEOUT);
                assert!(
                    ended,
                    "a request at {:?} while another one waits",
                    record.begin
                );
            }
            "reply" => open = None,
            _ => {}
        }
    }
    assert!(rig.traffic.len() > 1000, "{}", rig.traffic.len());
}

#[test]
fn a_stop_waits_for_one_time_out_and_is_confirmed_at_once() {
    for silent in [1, 2] {
        let mut rig = controlled(2);
        let bound = rig.core.report().stop;
        assert_eq!(bound.one_silent, TIMEOUT, "no characters, no silence");
        rig.bus.set_powered(rig.now, Station(silent), false);
        until(&mut rig, |rig| {
            rig.sent.last().is_some_and(|sent| sent.frame[6] == silent)
        });
        let on_wire = rig.now;
        rig.pass(Duration::from_millis(1));
        let asked = rig.now;
        let ticket = rig.command(plc(1), 1, STOP);
        rig.bus.set_powered(rig.now, Station(silent), true);
        until_sent(&mut rig, 6);
        let sent = rig.sent.last().expect("the stop").at;
        assert!(
            sent.since(asked) <= bound.one_silent && sent.since(on_wire) <= TIMEOUT,
            "drive {silent} was silent"
        );
        assert_eq!(rig.outcome_of(ticket), (Outcome::Confirmed, Reason::None));
        assert!(
            rig.now.since(sent) < Duration::from_millis(100),
            "{:?}",
            rig.now.since(sent)
        );
    }
}

#[test]
fn the_late_reply_to_a_stop_acknowledges_no_later_stop() {
    let mut rig = running();
    rig.swallows = Some(vec![6, 0, 2, 0, 0]);
    let ticket = rig.command(plc(1), 0, STOP);
    until_sent(&mut rig, 6);
    let late = answer_to_newest(&rig, &[6, 0, 2, 0, 0]);
    let before = rig.written(RUN).len();
    until(&mut rig, |rig| rig.written(RUN).len() > before);
    // The drive has heard neither of them. Two copies of the first reply come while the second is waited for.
    rig.core.handle(rig.now, LineInput::Bytes(&late));
    rig.core.handle(rig.now, LineInput::Bytes(&late));
    rig.settle();
    rig.pass(TIMEOUT * 2);
    let is_taken =
        |outcome: &Outcome| matches!(outcome, Outcome::Acknowledged | Outcome::Confirmed);
    assert!(
        !rig.told(ticket)
            .iter()
            .any(|(outcome, ..)| is_taken(outcome)),
        "{:?}",
        rig.told(ticket)
    );
    assert!(rig.view(0).control.expect("control").stop_pending);
    rig.swallows = None;
    assert_eq!(rig.outcome_of(ticket), (Outcome::Confirmed, Reason::None));
}

#[test]
fn all_drives_are_stopped_one_after_the_other() {
    let mut rig = controlled(3);
    for drive in 0..3 {
        rig.command_unsettled(plc(1), drive, STOP);
    }
    rig.settle();
    rig.pass(Duration::from_secs(2));
    assert_eq!(
        rig.core.counters().broadcasts,
        0,
        "a connection carries none"
    );
    let stops: Vec<u8> = rig
        .sent
        .iter()
        .filter(|sent| sent.pdu == [6, 0, 2, 0, 0])
        .map(|sent| sent.frame[6])
        .collect();
    assert_eq!(stops, [1, 2, 3]);
}

/// The connection is cut at each moment around the run command, and comes back.
#[test]
fn a_connection_that_comes_and_goes_repeats_no_command_and_starts_nothing() {
    for moment_ms in 0..12 {
        let mut rig = controlled(1);
        assert_eq!(rig.commanded(MQTT, setpoint(3000)).0, Outcome::Confirmed);
        rig.sent.clear();
        let ticket = rig.command(MQTT, 0, run(Forward, None));
        rig.pass(Duration::from_millis(moment_ms));
        rig.close(LineFault::Gone);
        rig.pass(Duration::from_millis(400));
        rig.open();
        let (outcome, _) = rig.outcome_of(ticket);
        let runs = rig.written(RUN);
        match outcome {
            Outcome::Unknown | Outcome::Acknowledged | Outcome::Confirmed => {
                assert_eq!(runs, [1], "{moment_ms} ms")
            }
            _ => assert!(runs.is_empty(), "{moment_ms} ms: {outcome:?}"),
        }
        let was_open = runs.len();
        rig.pass(Duration::from_secs(2));
        assert_eq!(rig.written(RUN).len(), was_open, "{moment_ms} ms");
        assert_eq!(rig.commanded(plc(1), STOP).0, Outcome::Confirmed);
        rig.pass(Duration::from_secs(20));
        assert_eq!(rig.output(1), 0);
    }
}

#[test]
fn a_reply_of_an_earlier_connection_answers_nothing_on_the_next() {
    let mut rig = line(1, "lost=1000", 1);
    let ticket = rig.read(1, 0, PROOF, 1);
    let of_earlier = answer_to_newest(&rig, &[3, 2, 0xDE, 0xAD]);
    rig.close(LineFault::Gone);
    assert_eq!(rig.answer_to(ticket), NativeOutcome::NoReply);
    rig.open();
    let ticket = rig.read(1, 0, PROOF, 1);
    rig.core.handle(rig.now, LineInput::Bytes(&of_earlier));
    rig.settle();
    assert_eq!(
        rig.answer_to(ticket),
        NativeOutcome::NoReply,
        "a converter brings it along: it is not ours"
    );
}

#[test]
fn a_stream_out_of_step_is_given_up_before_anything_else_is_sent() {
    let mut rig = controlled(1);
    let ticket = rig.command(MQTT, 0, setpoint(3000));
    until_sent(&mut rig, 6);
    let sent = rig.sent.len();
    let waiting = rig.read(1, 0, PROOF, 1);
    rig.core
        .handle(rig.now, LineInput::Bytes(b"HTTP/1.1 400 Bad Request\r\n"));
    rig.core.handle(rig.now, LineInput::Bytes(&[0; 300]));
    rig.settle();
    assert_eq!(
        rig.reopens
            .iter()
            .map(|(_, fault)| *fault)
            .collect::<Vec<_>>(),
        [LineFault::OutOfStep]
    );
    assert_eq!(rig.core.report().state, LineState::Down);
    assert_eq!(
        rig.outcome_of(ticket).0,
        Outcome::Unknown,
        "whether it was heard is not known"
    );
    assert_eq!(
        rig.answer_to(waiting),
        NativeOutcome::Refused(NativeRefusal::LineDown)
    );
    let refused = rig.read(1, 0, PROOF, 1);
    assert_eq!(
        rig.answer_to(refused),
        NativeOutcome::Refused(NativeRefusal::LineDown)
    );
    rig.pass(Duration::from_secs(5));
    assert_eq!(
        rig.sent.len(),
        sent,
        "nothing goes out on a connection that is given up"
    );
    rig.close(LineFault::OutOfStep);
    rig.open();
    let ticket = rig.read(1, 0, PROOF, 1);
    assert!(matches!(rig.answer_to(ticket), NativeOutcome::Words(_)));
}

#[test]
fn a_lease_ends_on_a_connection_whose_replies_are_late() {
    let mut rig = running();
    rig.bus
        .set_faults("late=300,beyond=100,twin=200".parse().expect("a plan"));
    rig.pass(Duration::from_secs(60));
    assert_eq!(rig.written(RUN).first(), Some(&1));
    assert!(rig.written(RUN).iter().skip(1).all(|word| *word == 0) && rig.written(RUN).len() > 1);
    assert_eq!(rig.output(1), 0);
    assert!(!rig.view(0).control.expect("control").stop_pending);
}

/// The server has closed the connection, as some do behind each reply.
fn parts(rig: &mut Rig) {
    rig.core.handle(rig.now, LineInput::ConnectionClosed);
    rig.bus.hang_up(rig.now);
    rig.settle();
}

fn connects(rig: &mut Rig) {
    assert!(
        rig.core.connects_at().is_some_and(|at| at <= rig.now),
        "a frame is due"
    );
    rig.core.handle(rig.now, LineInput::ConnectionBack);
    rig.settle();
}

#[test]
fn what_waits_for_another_connection_is_decided_when_it_stands() {
    // The deadline of a command is a second.
    for (stops_after, connects_after, expected) in [
        (None, 300, [1].as_slice()),
        (None, 1250, &[]),
        (Some(400), 900, &[0]),
    ] {
        let mut rig = controlled(1);
        assert_eq!(rig.commanded(MQTT, setpoint(3000)).0, Outcome::Confirmed);
        parts(&mut rig);
        rig.sent.clear();
        let began = rig.now;
        let ordered = rig.command(MQTT, 0, run(Forward, None));
        let stop = stops_after.map(|after| {
            rig.pass(Duration::from_millis(after));
            rig.command(plc(1), 0, STOP)
        });
        rig.pass(Duration::from_millis(connects_after).saturating_sub(rig.now.since(began)));
        assert!(
            rig.sent.is_empty(),
            "nothing is written without a connection"
        );
        connects(&mut rig);
        rig.pass(Duration::from_secs(2));
        let told = format!("{stops_after:?} {connects_after}");
        assert_eq!(rig.written(RUN), expected, "{told}");
        let outcome = rig.outcome_of(ordered).0;
        match (stop, connects_after) {
            (Some(stop), _) => {
                assert_eq!(
                    (outcome, rig.outcome_of(stop).0),
                    (Outcome::Superseded, Outcome::Confirmed)
                );
            }
            (None, 300) => assert_eq!(outcome, Outcome::Acknowledged, "{told}"),
            _ => assert_eq!(outcome, Outcome::Expired, "{told}"),
        }
    }
}

#[test]
fn the_time_to_connect_is_no_part_of_the_time_for_the_reply() {
    let mut rig = line(1, "", 1);
    for _ in 0..20 {
        parts(&mut rig);
        let ticket = rig.read(1, 0, PROOF, 1);
        rig.pass(TIMEOUT * 3);
        connects(&mut rig);
        assert!(matches!(rig.answer_to(ticket), NativeOutcome::Words(_)));
    }
    assert_eq!(
        (rig.core.counters().silent, rig.core.report().state),
        (0, LineState::Up)
    );
}

#[test]
fn an_exchange_ends_with_its_connection() {
    let mut rig = running();
    rig.swallows = Some(vec![6, 0, 2, 0, 0]);
    let ticket = rig.command(plc(1), 0, STOP);
    until_sent(&mut rig, 6);
    rig.pass(Duration::from_millis(1));
    parts(&mut rig);
    rig.swallows = None;
    let closed = rig.now;
    rig.sent.clear();
    connects(&mut rig);
    until_sent(&mut rig, 6);
    assert!(
        rig.now.since(closed) < TIMEOUT / 2,
        "{:?}",
        rig.now.since(closed)
    );
    assert_eq!(rig.outcome_of(ticket), (Outcome::Confirmed, Reason::None));
}

/// A converter says for its drive that it does not answer. The drive itself has said nothing.
#[test]
fn a_drive_that_a_converter_does_not_reach_is_silent() {
    for code in [0x0A, 0x0B] {
        let mut rig = controlled(1);
        rig.bus.set_powered(rig.now, Station(1), false);
        let ticket = rig.command(MQTT, 0, setpoint(3000));
        until_sent(&mut rig, 6);
        let refusal = answer_to_newest(&rig, &[0x86, code]);
        rig.core.handle(rig.now, LineInput::Bytes(&refusal));
        rig.settle();
        while rig.view(0).snapshot.presence != DrivePresence::Offline {
            until_sent(&mut rig, 3);
            let silence = answer_to_newest(&rig, &[0x83, code]);
            rig.core.handle(rig.now, LineInput::Bytes(&silence));
            rig.settle();
            let limit = rig.now + Duration::from_secs(60);
            assert!(rig.step(limit));
        }
        assert_eq!(
            rig.outcome_of(ticket).0,
            Outcome::Unknown,
            "it may have been written"
        );
        assert_eq!(rig.core.counters().exceptions, 0);
        let writes = rig.writes().len();
        rig.pass(Duration::from_secs(60));
        assert_eq!(rig.writes().len(), writes, "nothing is written again");
        rig.bus.set_powered(rig.now, Station(1), true);
        rig.pass(Duration::from_secs(60));
        assert_eq!(rig.view(0).snapshot.presence, DrivePresence::Online);
    }
}

/// 06 means what it means on a serial line: it is there, and asked again.
#[test]
fn a_busy_drive_is_there() {
    let mut rig = line(1, "", 1);
    rig.bus.set_powered(rig.now, Station(1), false);
    let ticket = rig.read(1, 0, PROOF, 1);
    let busy = answer_to_newest(&rig, &[0x83, 6]);
    rig.core.handle(rig.now, LineInput::Bytes(&busy));
    rig.settle();
    assert!(matches!(
        rig.answer_to(ticket),
        NativeOutcome::DriveException { code: 6, .. }
    ));
    assert_eq!(rig.view(0).snapshot.presence, DrivePresence::Online);
}

#[test]
fn a_server_that_takes_everything_and_says_nothing_is_connected_to_again() {
    let mut rig = line(2, "", 1);
    for station in [1, 2] {
        rig.bus.set_powered(rig.now, Station(station), false);
    }
    for drive in [0, 1, 0, 1] {
        let ticket = rig.read(1, drive, PROOF, 1);
        rig.answer_to(ticket);
    }
    rig.pass(Duration::from_secs(600));
    let waits: Vec<_> = rig
        .reopens
        .windows(2)
        .map(|pair| pair[1].0.since(pair[0].0).as_secs())
        .collect();
    assert!(
        rig.reopens
            .iter()
            .all(|(_, fault)| *fault == LineFault::Mute)
            && rig.reopens.len() > 3,
        "{:?}",
        rig.reopens
    );
    assert!(
        waits.windows(2).all(|pair| pair[0] <= pair[1]),
        "with growing waits: {waits:?}"
    );
}
