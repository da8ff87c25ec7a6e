//! Faults of the field: each is reported once, nothing is mistaken for something else, every request ends, and a stop
//! is tried in any state of the line.

use crate::support::{MQTT, PROOF, Rig, RigOptions, STOP, plc, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::address::DataTable;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::{EchoPolicy, PortKind};
use vfd_gateway::domain::native::{NativeOutcome, NativeRefusal};
use vfd_gateway::domain::report::{LineFault, LineState};
use vfd_gateway::domain::suspicion::LineSuspicion;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::{LineInput, LineNote};
use vfd_gateway::sim::FaultPlan;
use vfd_gateway::wire::{framing, pdu};

const RUN: u16 = 0x0002;
const FREQUENCY: u16 = 0x0004;
const LINE_DOWN: NativeOutcome = NativeOutcome::Refused(NativeRefusal::LineDown);

fn ms(millis: u64) -> Duration {
    Duration::from_millis(millis)
}

/// Properties of a line of one drive under control, with both framings.
fn with_both_framings(options: impl Fn() -> RigOptions, shows: impl Fn(Rig)) {
    shows(Rig::new(&options()));
    shows(Rig::new(&options().ascii()));
}

fn options(echo: EchoPolicy, echoes: bool) -> RigOptions {
    RigOptions {
        echo,
        echoes,
        ..RigOptions::controlled()
    }
}

fn faults(plan: &str) -> FaultPlan {
    plan.parse().expect("a plan")
}

fn state(rig: &Rig) -> (LineState, Option<LineFault>) {
    let report = rig.core.report();
    (report.state, report.fault)
}

/// The state changes reported so far.
fn told(rig: &Rig) -> Vec<LineNote> {
    let notes = rig.line_notes.iter().map(|(_, note)| *note);
    notes
        .filter(|note| matches!(note, LineNote::Down(_) | LineNote::Up))
        .collect()
}

/// Lets `time` pass and keeps the answers.
fn wait(rig: &mut Rig, time: Duration) {
    let until = rig.now + time;
    while rig.now < until {
        rig.step(until);
    }
}

/// A node talks for `time` without a pause, and nothing else is received.
fn babble(rig: &mut Rig, time: Duration) {
    let end = rig.now + time;
    while rig.now < end {
        wait(rig, ms(1));
        rig.core.handle(rig.now, LineInput::Bytes(&[0x55]));
        rig.settle();
    }
}

fn reopen(rig: &mut Rig, fault: LineFault, kind: PortKind) {
    rig.core.handle(rig.now, LineInput::PortDown(fault));
    rig.core.handle(rig.now, LineInput::PortUp(kind));
}

fn starts_running(rig: &mut Rig) {
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))).0,
        Outcome::Acknowledged
    );
    rig.live(Duration::from_secs(10));
}

#[test]
fn an_echo_takes_the_line_down_once_and_only_reads_and_stops_go_on() {
    with_both_framings(
        || options(EchoPolicy::Refuse, true),
        |mut rig| {
            assert_eq!(state(&rig), (LineState::Down, Some(LineFault::Echo)));
            assert_eq!(told(&rig), [LineNote::Down(LineFault::Echo)]);
            assert_eq!(rig.core.report().suspicion, Some(LineSuspicion::Echo));
            assert_eq!(
                rig.commanded(MQTT, run(Direction::Forward, Some(3000))),
                (Outcome::Refused, Reason::LineDown)
            );
            let read = rig.read(1, 0, PROOF, 1);
            assert_eq!(rig.answer_to(read), LINE_DOWN);
            rig.sent.clear();
            rig.pass(Duration::from_secs(600));
            assert!(
                (15..=40).contains(&rig.sent.len()),
                "{} probes in 10 minutes",
                rig.sent.len()
            );
            assert!(rig.writes().is_empty());
            // A stop is sent at once, and the drive's own answer after the echo is accepted.
            let stop = rig.command(plc(1), 0, STOP);
            assert_eq!(rig.written(RUN), [0]);
            assert_eq!(rig.outcome_of(stop), (Outcome::Confirmed, Reason::None));
            rig.echoes = false;
            rig.pass(Duration::from_secs(31));
            assert_eq!(told(&rig), [LineNote::Down(LineFault::Echo), LineNote::Up]);
            starts_running(&mut rig);
        },
    );
}

#[test]
fn an_echo_is_stripped_and_the_drive_is_commanded_as_if_there_were_none() {
    with_both_framings(
        || options(EchoPolicy::Strip, true),
        |mut rig| {
            assert_eq!(state(&rig).0, LineState::Up);
            starts_running(&mut rig);
            assert_eq!(rig.output(1), 3000);
            assert_eq!(
                rig.commanded(plc(1), STOP),
                (Outcome::Confirmed, Reason::None)
            );
            let counters = rig.core.counters();
            assert_eq!(
                (counters.noise_bytes, counters.strays, counters.silent),
                (0, 0, 0),
                "{counters:?}"
            );
            assert_eq!(counters.echoes, counters.requests);
            let report = rig.bus.report();
            assert_eq!((report.gaps_too_short, report.talked_over), (0, 0));
        },
    );
}

#[test]
fn where_there_is_only_an_echo_nothing_is_acknowledged() {
    for policy in [EchoPolicy::Strip, EchoPolicy::Refuse] {
        for echoed_before in [true, false] {
            with_both_framings(
                || options(EchoPolicy::Strip, echoed_before),
                |mut rig| {
                    starts_running(&mut rig);
                    rig.echoes = true;
                    rig.bus.set_powered(rig.now, Station(1), false);
                    // The drive is lost at this moment, and if `echoed_before` is false the echo begins.
                    let faster = rig.command(MQTT, 0, setpoint(4000));
                    assert_eq!(rig.outcome_of(faster).0, Outcome::Unknown, "{policy:?}");
                    let stop = rig.command(plc(1), 0, STOP);
                    rig.pass(Duration::from_secs(20));
                    assert!(
                        rig.told(stop)
                            .iter()
                            .all(|(outcome, ..)| *outcome == Outcome::Unknown)
                    );
                },
            );
        }
    }
}

#[test]
fn no_write_but_a_stop_goes_before_a_read_has_shown_an_echo() {
    for kind in [PortKind::Serial, PortKind::Virtual] {
        with_both_framings(
            || RigOptions {
                poll: Duration::from_secs(3600),
                ..RigOptions::controlled()
            },
            |mut rig| {
                reopen(&mut rig, LineFault::Gone, kind);
                rig.settle();
                rig.sent.clear();
                // A plain RUN would have to wait.
                let epoch = rig.view(0).control.map(|control| control.epoch);
                let start = run(Direction::Forward, Some(3000));
                let ticket = rig.command_with(MQTT, 0, start, |command| command.epoch = epoch);
                assert_eq!(rig.outcome_of(ticket).0, Outcome::Acknowledged);
                let functions: Vec<u8> = rig.sent.iter().map(|sent| sent.pdu[0]).collect();
                assert_eq!(functions[..3], [3, 6, 6], "one read, then setpoint and run");
            },
        );
        // An echo and no drive: the stop is sent at once, and its echo proves nothing.
        with_both_framings(
            || RigOptions {
                poll: Duration::from_secs(3600),
                ..RigOptions::controlled()
            },
            |mut rig| {
                rig.bus.set_powered(rig.now, Station(1), false);
                reopen(&mut rig, LineFault::Gone, kind);
                rig.echoes = true;
                rig.sent.clear();
                let stop = rig.command(plc(1), 0, STOP);
                rig.pass(ms(20));
                assert_eq!(rig.sent.first().map(|sent| sent.pdu[0]), Some(6));
                rig.pass(Duration::from_secs(20));
                assert!(
                    rig.told(stop)
                        .iter()
                        .all(|(outcome, ..)| *outcome == Outcome::Unknown),
                    "{:?}",
                    rig.told(stop)
                );
            },
        );
    }
}

#[test]
fn a_babbling_node_jams_the_line_once_and_everything_that_waits_is_answered() {
    with_both_framings(
        || RigOptions {
            poll: Duration::from_secs(1),
            ..RigOptions::controlled()
        },
        |mut rig| {
            starts_running(&mut rig);
            // Clear of the exchange that is on the wire.
            rig.pass(ms(100));
            babble(&mut rig, ms(5));
            rig.core.handle(rig.now, LineInput::PathAlive(MQTT.owner));
            let read = rig.read(1, 0, PROOF, 1);
            let begun = rig.now;
            babble(&mut rig, Duration::from_secs(2));
            let answered = rig
                .answers
                .iter()
                .find(|(_, answer)| answer.ticket == read)
                .expect("an answer");
            assert_eq!(answered.1.outcome, LINE_DOWN);
            assert!(
                answered.0.since(begun) <= ms(1200),
                "{:?}",
                answered.0.since(begun)
            );
            assert_eq!(told(&rig), [LineNote::Down(LineFault::Jammed)]);
            assert_eq!(
                (state(&rig).0, rig.core.counters().jams),
                (LineState::Down, 1)
            );
            rig.sent.clear();
            let read = rig.read(1, 0, PROOF, 1);
            assert_eq!(
                rig.answers
                    .last()
                    .map(|(_, it)| (it.ticket, it.outcome.clone())),
                Some((read, LINE_DOWN))
            );
            let faster = rig.command(MQTT, 0, setpoint(4000));
            assert_eq!(
                rig.told(faster),
                [(Outcome::Refused, Reason::LineDown, true)]
            );
            // The stop is sent over the babble, at its own rate, and nothing that comes back confirms it.
            let stop = rig.command(plc(1), 0, STOP);
            assert_eq!(rig.written(RUN), [0], "at once");
            babble(&mut rig, Duration::from_secs(20));
            assert!(
                (4..=10).contains(&rig.written(RUN).len()),
                "{:?}",
                rig.written(RUN)
            );
            assert!(
                rig.sent.iter().all(|sent| sent.pdu[0] == 6),
                "nothing but stops"
            );
            assert!(
                !rig.told(stop)
                    .iter()
                    .any(|(outcome, ..)| *outcome == Outcome::Acknowledged)
            );
            rig.pass(Duration::from_secs(10));
            assert_eq!(
                told(&rig),
                [LineNote::Down(LineFault::Jammed), LineNote::Up]
            );
            assert!(!rig.view(0).control.expect("control").stop_pending);
            assert!(rig.view(0).is_online());
        },
    );
}

#[test]
fn after_a_suspension_a_stop_waits_for_silence_though_the_line_was_jammed_before() {
    let mut rig = Rig::new(&RigOptions {
        poll: Duration::from_secs(1),
        ..RigOptions::controlled()
    });
    starts_running(&mut rig);
    rig.pass(ms(100));
    babble(&mut rig, Duration::from_secs(3));
    assert_eq!(told(&rig), [LineNote::Down(LineFault::Jammed)]);
    // The babble ends meanwhile, and what is read first is old.
    rig.now = rig.now + Duration::from_secs(5);
    rig.core.handle(rig.now, LineInput::Bytes(&[0x55; 200]));
    rig.sent.clear();
    rig.command(plc(1), 0, STOP);
    assert!(
        rig.written(RUN).is_empty(),
        "another master may be sending right now"
    );
    rig.pass(ms(50));
    assert_eq!(rig.written(RUN).first(), Some(&0));
    assert_eq!(
        told(&rig),
        [LineNote::Down(LineFault::Jammed), LineNote::Up]
    );
}

#[test]
fn babble_before_anything_waits_long_enough_is_no_jam() {
    let mut rig = Rig::new(&RigOptions {
        poll: Duration::from_secs(1),
        ..RigOptions::controlled()
    });
    for _ in 0..20 {
        babble(&mut rig, ms(300));
        rig.pass(ms(200));
    }
    assert_eq!(told(&rig), []);
}

#[test]
fn a_mute_line_is_reported_once_and_comes_back_by_itself() {
    with_both_framings(
        || RigOptions {
            drives: 2,
            poll: Duration::from_secs(1),
            ..RigOptions::controlled()
        },
        |mut rig| {
            let off = rig.now;
            let power = |rig: &mut Rig, on| {
                [1, 2].map(|station| rig.bus.set_powered(rig.now, Station(station), on))
            };
            power(&mut rig, false);
            let hours = Duration::from_secs(8 * 3600);
            while rig.now.since(off) < hours {
                let before = rig.reopens.len();
                rig.pass(Duration::from_secs(1));
                if rig.reopens.len() > before {
                    reopen(&mut rig, LineFault::Mute, PortKind::Serial);
                }
            }
            assert_eq!(told(&rig), [LineNote::Down(LineFault::Mute)]);
            assert_eq!(state(&rig), (LineState::Down, Some(LineFault::Mute)));
            let at: Vec<u64> = rig
                .reopens
                .iter()
                .map(|(at, _)| at.since(off).as_secs())
                .collect();
            let waits: Vec<u64> = at.windows(2).map(|pair| pair[1] - pair[0]).collect();
            assert!(waits.len() > 90, "{at:?} {waits:?}");
            assert!((9..25).contains(&at[0]), "{at:?}");
            assert!(
                waits[..4]
                    .iter()
                    .zip([10, 20, 40, 80])
                    .all(|(a, b)| a.abs_diff(b) < 2),
                "{waits:?}"
            );
            assert!(
                waits[6..].iter().all(|wait| (299..=302).contains(wait)),
                "{waits:?}"
            );
            // Requests are answered as for any silent drive, not as for a closed port.
            let read = rig.read(1, 0, PROOF, 1);
            assert_eq!(rig.answer_to(read), NativeOutcome::NoReply);
            power(&mut rig, true);
            rig.pass(Duration::from_secs(31));
            assert_eq!(told(&rig), [LineNote::Down(LineFault::Mute), LineNote::Up]);
            assert!(rig.view(0).is_online() && rig.view(1).is_online());
        },
    );
}

#[test]
fn one_silent_drive_among_others_makes_no_line_mute() {
    let mut rig = Rig::new(&RigOptions {
        drives: 2,
        poll: Duration::from_secs(1),
        ..RigOptions::controlled()
    });
    rig.bus.set_powered(rig.now, Station(2), false);
    rig.pass(Duration::from_secs(600));
    assert!(told(&rig).is_empty() && rig.reopens.is_empty());
}

/// Damages replies of the line until orders that move are suspended, never two in a row: the drive stays there.
fn spoil(rig: &mut Rig, mut meanwhile: impl FnMut(&mut Rig)) {
    let begun = rig.now;
    while !rig.core.report().quality.is_suspended {
        assert!(
            rig.now.since(begun) < Duration::from_secs(60),
            "{:?}",
            rig.core.report()
        );
        rig.bus.set_faults(faults("flip=1000"));
        rig.live(ms(90));
        rig.bus.set_faults(FaultPlan::NONE);
        rig.live(ms(310));
        meanwhile(rig);
    }
}

#[test]
fn a_bad_line_takes_no_order_that_makes_a_motor_faster() {
    let mut rig = Rig::new(&RigOptions::controlled());
    starts_running(&mut rig);
    spoil(&mut rig, |_| {});
    let notes = |rig: &Rig, is: fn(&LineNote) -> bool| {
        rig.line_notes.iter().filter(|(_, note)| is(note)).count()
    };
    let suspended = |note: &LineNote| matches!(note, LineNote::Suspended { .. });
    assert_eq!(notes(&rig, suspended), 1);
    assert_eq!(
        rig.commanded(MQTT, setpoint(4000)),
        (Outcome::Refused, Reason::LineQuality)
    );
    assert_eq!(
        rig.commanded(MQTT, setpoint(2000)),
        (Outcome::Confirmed, Reason::None),
        "slower may be ordered"
    );
    assert_eq!(
        rig.commanded(plc(1), STOP),
        (Outcome::Confirmed, Reason::None)
    );
    rig.pass(Duration::from_secs(3));
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Refused, Reason::LineQuality)
    );
    rig.pass(Duration::from_secs(60));
    assert_eq!(
        (
            notes(&rig, suspended),
            notes(&rig, |note| *note == LineNote::Resumed)
        ),
        (1, 1)
    );
    starts_running(&mut rig);
}

#[test]
fn a_drive_that_is_bad_alone_is_suspended_alone() {
    let mut rig = Rig::new(&RigOptions {
        drives: 2,
        ..RigOptions::controlled()
    });
    let mut sent = rig.sent.len();
    let mut polls = 0;
    while rig.notes.is_empty() {
        // Every third reply of the second drive comes damaged.
        rig.bus.set_faults(if polls % 3 == 2 {
            faults("flip=1000")
        } else {
            FaultPlan::NONE
        });
        while rig.sent.len() == sent {
            rig.step(rig.now + Duration::from_secs(1));
        }
        sent = rig.sent.len();
        polls += usize::from(rig.sent.last().is_some_and(|sent| sent.frame[0] == 2));
        assert!(sent < 1000, "{:?}", rig.core.report());
    }
    rig.bus.set_faults(FaultPlan::NONE);
    let suspended: Vec<Reason> = (0..2)
        .map(|drive| {
            let ticket = rig.command(MQTT, drive, run(Direction::Forward, Some(3000)));
            rig.outcome_of(ticket).1
        })
        .collect();
    assert_eq!(
        suspended
            .iter()
            .filter(|reason| **reason == Reason::LineQuality)
            .count(),
        1,
        "{suspended:?}"
    );
    assert!(!rig.core.report().quality.is_suspended);
}

#[test]
fn what_is_wrong_is_diagnosed_from_what_is_heard() {
    for (plan, expected) in [
        ("lost=1000", LineSuspicion::NothingHeard),
        ("flip=1000", LineSuspicion::AlwaysDamaged),
        ("cut=1000", LineSuspicion::DrivesAreFaster),
    ] {
        let mut rig = Rig::new(&RigOptions {
            poll: Duration::from_secs(1),
            ..RigOptions::controlled()
        });
        rig.bus.set_faults(faults(plan));
        rig.pass(Duration::from_secs(1));
        reopen(&mut rig, LineFault::Gone, PortKind::Serial);
        rig.pass(Duration::from_secs(30));
        assert_eq!(rig.core.report().suspicion, Some(expected), "{plan}");
        let told = |rig: &Rig, what| {
            rig.line_notes
                .iter()
                .filter(|(_, it)| *it == LineNote::Suspects(what))
                .count()
        };
        assert_eq!(told(&rig, Some(expected)), 1);
        rig.bus.set_faults(FaultPlan::NONE);
        rig.pass(Duration::from_secs(60));
        assert_eq!(
            (rig.core.report().suspicion, told(&rig, None)),
            (None, 1),
            "{plan}"
        );
    }
}

#[test]
fn another_master_is_reported_and_its_requests_are_nobodys_answers() {
    with_both_framings(RigOptions::controlled, |mut rig| {
        rig.bus.set_powered(rig.now, Station(1), false);
        rig.pass(Duration::from_secs(20));
        let is_ascii = rig.sent.last().is_some_and(|sent| sent.frame[0] == b':');
        let framing = if is_ascii {
            framing_of(true)
        } else {
            framing_of(false)
        };
        let mut request = Vec::new();
        framing::encode(framing, &mut request, 1, |out| out.extend([3, 0, 1, 0, 1]));
        for _ in 0..6 {
            rig.core.handle(rig.now, LineInput::Bytes(&request));
            rig.pass(Duration::from_secs(5));
        }
        assert_eq!(rig.core.counters().other_master, 6);
        assert_eq!(
            rig.core.report().suspicion,
            Some(LineSuspicion::OtherMaster)
        );
        assert!(!rig.view(0).is_online(), "who is asked has not spoken");
    });
}

const fn framing_of(is_ascii: bool) -> vfd_gateway::domain::link::Framing {
    if is_ascii {
        vfd_gateway::domain::link::Framing::Ascii
    } else {
        vfd_gateway::domain::link::Framing::Rtu
    }
}

#[test]
fn two_replies_to_one_request_name_the_station() {
    with_both_framings(RigOptions::controlled, |mut rig| {
        for _ in 0..4 {
            let read = rig.read(1, 0, PROOF, 2);
            let NativeOutcome::Words(words) = rig.answer_to(read) else {
                panic!("words")
            };
            let is_ascii = rig.sent.last().is_some_and(|sent| sent.frame[0] == b':');
            let mut second = Vec::new();
            framing::encode(framing_of(is_ascii), &mut second, 1, |out| {
                pdu::encode_read_reply(out, DataTable::Holding, &words)
            });
            rig.core.handle(rig.now, LineInput::Bytes(&second));
            rig.pass(Duration::from_secs(1));
        }
        assert_eq!(
            rig.core.report().suspicion,
            Some(LineSuspicion::DuplicateStation(Station(1)))
        );
    });
}

#[test]
fn noise_foreign_frames_and_second_replies_change_no_answer() {
    for plan in ["noise=1000", "foreign=1000"] {
        with_both_framings(
            || RigOptions {
                drives: 2,
                poll: Duration::from_secs(2),
                ..RigOptions::controlled()
            },
            |mut rig| {
                rig.bus.set_faults(faults(plan));
                for n in 0..200 {
                    let read = rig.read(1, n % 2, PROOF, 1 + n % 5);
                    let answer = rig.answer_to(read);
                    let NativeOutcome::Words(words) = answer else {
                        panic!("{plan}: {n}: {answer:?}")
                    };
                    let proof = rig
                        .sent
                        .iter()
                        .rev()
                        .find(|sent| sent.pdu[1] == 0x30)
                        .expect("the read")
                        .proof;
                    assert!(
                        words.iter().all(|word| *word == proof),
                        "{plan}: {words:04X?} for {proof:04X}"
                    );
                }
                assert_eq!(state(&rig).0, LineState::Up);
            },
        );
    }
}

#[test]
fn a_cut_reply_is_no_answer_and_its_rest_is_none_either() {
    with_both_framings(RigOptions::default, |mut rig| {
        rig.bus.set_faults(faults("cut=1000"));
        let read = rig.read(1, 0, PROOF, 4);
        assert_eq!(rig.answer_to(read), NativeOutcome::NoReply);
        rig.bus.set_faults(FaultPlan::NONE);
        let read = rig.read(1, 0, PROOF, 4);
        assert!(matches!(rig.answer_to(read), NativeOutcome::Words(_)));
    });
}

#[test]
fn a_reply_with_a_hole_of_an_adapter_is_one_reply() {
    for cut in 1..12 {
        with_both_framings(RigOptions::default, |mut rig| {
            let read = rig.read(1, 0, PROOF, 4);
            wait(&mut rig, ms(9));
            let mut reply = Vec::new();
            let mut end = MonoTime::ZERO;
            // The adapter keeps what the wire brings.
            rig.bus.take_due(rig.now + ms(100), |at, bytes| {
                reply.extend_from_slice(bytes);
                end = at;
            });
            assert!(reply.len() > cut, "{cut}");
            for (at, part) in [(ms(0), &reply[..cut]), (ms(16), &reply[cut..])] {
                rig.now = rig.now.max(end + at);
                rig.core.handle(rig.now, LineInput::Bytes(part));
                rig.settle();
                wait(&mut rig, ms(15));
            }
            let answer = rig.answer_to(read);
            assert!(
                matches!(answer, NativeOutcome::Words(_)),
                "{cut}: {answer:?} {reply:02X?} {:?}",
                rig.core.counters()
            );
            assert_eq!(rig.core.counters().retries, 0);
        });
    }
}

#[test]
fn an_order_to_run_that_is_in_force_stays_so_on_a_bad_line() {
    let mut rig = Rig::new(&RigOptions::controlled());
    let cyclic = plc(1);
    assert_eq!(rig.commanded(cyclic, STOP).0, Outcome::Confirmed);
    assert_eq!(
        rig.commanded(cyclic, run(Direction::Forward, Some(3000))).0,
        Outcome::Acknowledged
    );
    spoil(&mut rig, |rig| {
        let again = rig.command(cyclic, 0, run(Direction::Forward, Some(3000)));
        assert_eq!(
            rig.told(again),
            [(Outcome::Acknowledged, Reason::Unchanged, true)]
        );
    });
    let again = rig.command(cyclic, 0, run(Direction::Forward, Some(3000)));
    assert_eq!(
        rig.told(again),
        [(Outcome::Acknowledged, Reason::Unchanged, true)]
    );
    assert_eq!(
        (rig.written(FREQUENCY).len(), rig.written(RUN)),
        (1, vec![0, 1])
    );
}
