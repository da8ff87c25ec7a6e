//! Reply time-outs are learned, and a late reply is never mistaken whatever the time-out was.

use crate::support::{MQTT, PROOF, Rig, RigOptions, STOP, control, run};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::ids::{DriveIndex, Station};
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::domain::report::ReplyReport;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::sim::{BusOptions, FaultPlan};

const CAP: Duration = Duration::from_millis(200);
/// The processing time of an N700 is unknown: 10 ms are assumed, and 20 ms are the adapter's.
const FLOOR: Duration = Duration::from_millis(30);

fn options(drives: u8, bus: BusOptions) -> RigOptions {
    let poll = Duration::from_millis(100);
    RigOptions {
        drives,
        bus,
        poll,
        learns: true,
        control: Some(control()),
        ..RigOptions::default()
    }
}

/// A line that has seen more than enough replies to its polls.
fn learned(drives: u8, bus: BusOptions) -> Rig {
    let mut rig = Rig::new(&options(
        drives,
        BusOptions {
            faults: FaultPlan::NONE,
            ..bus
        },
    ));
    rig.pass(Duration::from_secs(400));
    rig.bus.set_faults(bus.faults);
    rig.sent.clear();
    rig
}

fn reads(rig: &Rig, drive: u16) -> ReplyReport {
    rig.core.station(DriveIndex(drive)).unwrap().replies[0]
}

#[test]
fn the_wait_is_learned_from_a_thousand_replies() {
    let mut rig = Rig::new(&options(2, BusOptions::default()));
    assert_eq!(reads(&rig, 0).timeout, CAP, "nothing is known yet");
    rig.pass(Duration::from_secs(400));
    let ReplyReport {
        count,
        p50,
        p999,
        max,
        timeout,
        ..
    } = reads(&rig, 0);
    assert!(count >= 1000, "{count}");
    assert_eq!(
        (p50, p999, max),
        (max, max, Duration::from_millis(2)),
        "as the bus is set up"
    );
    assert_eq!(timeout, FLOOR);
    assert_eq!(
        rig.core.station(DriveIndex(0)).unwrap().replies[1].timeout,
        CAP,
        "no write was seen"
    );
}

#[test]
fn a_silence_shortens_nothing_and_an_opened_port_begins_again() {
    let mut rig = learned(1, BusOptions::default());
    let before = reads(&rig, 0);
    rig.bus.set_powered(rig.now, Station(1), false);
    rig.pass(Duration::from_secs(60));
    assert_eq!(reads(&rig, 0), before);
    rig.reopen();
    assert_eq!((reads(&rig, 0).count, reads(&rig, 0).timeout), (0, CAP));
}

#[test]
fn a_drive_that_becomes_slower_is_learned_and_not_given_up() {
    let mut rig = learned(2, BusOptions::default());
    rig.bus.set_turnaround(Duration::from_millis(80));
    rig.pass(Duration::from_secs(20));
    for drive in 0..2 {
        assert!(
            reads(&rig, drive).timeout >= Duration::from_millis(160),
            "{:?}",
            reads(&rig, drive)
        );
    }
    let silent = rig.core.counters().silent;
    rig.pass(Duration::from_secs(60));
    assert_eq!(
        rig.core.counters().silent,
        silent,
        "{:?}",
        rig.core.counters()
    );
    assert_eq!(rig.core.counters().garbled, 0);
}

/// A drive that is silent once gets the full time-out before it counts as offline.
#[test]
fn a_slow_drive_whose_late_replies_are_never_seen_is_not_taken_for_dead() {
    let mut rig = learned(1, BusOptions::default());
    let late = "late=1000,timeout-ms=100,lateness-ms=60".parse().unwrap();
    rig.bus.set_faults(late);
    rig.pass(Duration::from_secs(30));
    assert!(rig.core.counters().replies > 0 && rig.view(0).is_online());
}

#[test]
fn late_replies_are_not_mistaken_where_waits_are_learned() {
    for seed in 0..6 {
        // Late replies arrive after the learned time-out, up to the full one plus the lateness.
        let faults: FaultPlan = "late=200,timeout-ms=35,lateness-ms=660".parse().unwrap();
        let bus = BusOptions {
            faults,
            ..BusOptions::default()
        };
        let mut rig = Rig::new(&RigOptions {
            seed,
            poll: Duration::from_secs(3600),
            ..options(3, bus)
        });
        rig.bus.set_faults(FaultPlan::NONE);
        rig.keeps_sent = false;
        for asker in 0..4 {
            rig.read(asker, asker as u16 % 3, PROOF, 1 + asker as u16);
        }
        let mut right = 0;
        let mut has_faults = false;
        while rig.bus.report().replies_late < 1_500 {
            let until = rig.now + Duration::from_secs(200);
            rig.run_until(until, |rig, answer| {
                if let NativeOutcome::Words(words) = &answer.outcome {
                    let expected = rig.proof(answer.ticket);
                    assert!(
                        words.iter().all(|word| *word == expected),
                        "{words:04X?} for exchange {expected:04X}"
                    );
                    right += 1;
                }
                let n = answer.ticket.0;
                rig.read(answer.asker.0, (n % 3) as u16, PROOF, 1 + (n % 8) as u16);
            });
            if !has_faults {
                assert_eq!(
                    reads(&rig, 0).timeout,
                    FLOOR,
                    "it was learned before anything came late"
                );
                has_faults = true;
                right = 0;
                rig.bus.set_faults(faults);
            }
        }
        assert!(right > 1_000, "work went on: {right}");
    }
}

/// The echo of a stop that may be that of an earlier one: its own may be as late as that of any other request.
#[test]
fn after_an_echo_in_doubt_the_right_one_is_reckoned_with_as_long_as_any() {
    let cap = Duration::from_secs(2);
    let control = ControlSettings {
        stop_effect_timeout: Duration::from_secs(60),
        ..control()
    };
    let options = options(1, BusOptions::default());
    let mut rig = Rig::new(&RigOptions {
        reply_timeout: cap,
        control: Some(control),
        ..options
    });
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))).0,
        Outcome::Acknowledged
    );
    rig.pass(Duration::from_secs(1));
    rig.sent.clear();
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), false);
    let ticket = rig.command(MQTT, 0, STOP);
    let until_sent = |rig: &mut Rig, count: usize| {
        while rig.written(2).len() < count {
            assert!(rig.step(rig.now + Duration::from_secs(10)));
        }
    };
    let echo = |rig: &mut Rig| {
        let frame = rig
            .sent
            .iter()
            .rfind(|sent| sent.pdu[0] == 6)
            .unwrap()
            .frame
            .clone();
        rig.core.handle(rig.now, LineInput::Bytes(&frame));
        rig.settle();
    };
    until_sent(&mut rig, 2);
    let second = rig.now;
    // The late echo of the first one.
    rig.pass(Duration::from_millis(300));
    echo(&mut rig);
    until_sent(&mut rig, 3);
    rig.pass(Duration::from_millis(20));
    assert!(
        rig.now < second + cap + Duration::from_millis(500),
        "that of the second one is not too late yet"
    );
    echo(&mut rig);
    rig.pass(Duration::from_millis(100));
    assert_eq!(rig.told(ticket), [], "and it proves nothing for the third");
}

#[test]
fn a_stop_does_not_wait_for_a_drive_that_is_dead() {
    for lead_us in (0..40_000).step_by(2_000) {
        let mut rig = learned(2, BusOptions::default());
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), false);
        // The first request to the dead drive has just gone out.
        while rig.sent.last().is_none_or(|sent| sent.frame[0] != 1) {
            rig.step(now + Duration::from_secs(5));
        }
        let asked = rig.now;
        let words = u64::from(rig.sent.last().unwrap().pdu[4]);
        rig.pass(Duration::from_micros(lead_us));
        let ticket = rig.command(MQTT, 1, STOP);
        let commanded = rig.now;
        while !rig.sent.iter().any(|sent| sent.frame[..2] == [2, 6]) {
            assert!(rig.step(rig.now + Duration::from_secs(5)));
        }
        let request = Duration::from_micros(8 * 1_042);
        let silence = Duration::from_nanos(4_687_500);
        // It may be that nothing is received before the whole reply has arrived.
        let reply = Duration::from_micros((5 + 2 * words) * 1_042);
        let bound =
            (asked + request + reads(&rig, 0).max + reply + silence).max(commanded + silence);
        assert!(
            rig.now <= bound,
            "{lead_us} us: {:?} after the request",
            rig.now.since(asked)
        );
        assert_eq!(rig.outcome_of(ticket), (Outcome::Confirmed, Reason::None));
    }
}

/// Two drives are to be stopped, and one of them owes a reply: the wait for that is ended for the other.
#[test]
fn a_stop_that_ends_a_wait_goes_before_that_of_the_drive_that_was_waited_for() {
    let mut rig = learned(3, BusOptions::default());
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), false);
    while rig.sent.last().is_none_or(|sent| sent.frame[0] != 1) {
        rig.step(now + Duration::from_secs(5));
    }
    // Longer than any reply has taken, and shorter than the time-out.
    rig.pass(Duration::from_millis(28));
    assert_eq!(rig.sent.last().unwrap().frame[0], 1);
    rig.sent.clear();
    rig.command_unsettled(MQTT, 0, STOP);
    rig.command_unsettled(MQTT, 1, STOP);
    rig.settle();
    rig.pass(Duration::from_millis(100));
    let stops: Vec<u8> = rig
        .sent
        .iter()
        .filter(|sent| sent.pdu[0] == 6)
        .map(|sent| sent.frame[0])
        .collect();
    assert_eq!(stops, [2, 1]);
}

#[test]
fn a_stop_waits_for_a_reply_that_comes_in() {
    for lead_us in (0..20_000).step_by(900) {
        let mut rig = learned(2, BusOptions::default());
        // Slower than ever before, but in time.
        rig.bus.set_turnaround(Duration::from_millis(5));
        while rig.sent.last().is_none_or(|sent| sent.frame[0] != 1) {
            rig.step(rig.now + Duration::from_secs(5));
        }
        rig.pass(Duration::from_micros(lead_us));
        rig.command(MQTT, 1, STOP);
        rig.pass(Duration::from_secs(1));
        assert_eq!(rig.bus.report().talked_over, 0, "{lead_us} us");
        assert_eq!(
            (rig.core.counters().silent, rig.core.counters().strays),
            (0, 0),
            "{lead_us} us"
        );
    }
}

/// Three drives, of which one is switched off and on, lost and damaged replies, and stops all the time.
#[test]
fn no_stop_waits_longer_than_its_bound() {
    for (learns, seed) in [(false, 1), (true, 2), (true, 3)] {
        let faults = "lost=100,flip=30,cut=30,noise=30".parse().unwrap();
        let bus = BusOptions {
            faults,
            ..BusOptions::default()
        };
        let mut rig = Rig::new(&RigOptions {
            seed,
            learns,
            ..options(3, bus)
        });
        rig.keeps_sent = false;
        let mut random = fastrand::Rng::with_seed(seed);
        for _ in 0..2_000 {
            let drive = random.u16(0..3);
            rig.command(MQTT, drive, STOP);
            rig.pass(Duration::from_micros(random.u64(700_000..4_000_000)));
            if random.u8(..10) == 0 {
                let now = rig.now;
                let is_on = random.bool();
                rig.bus.set_powered(now, Station(1), is_on);
            }
        }
        let report = rig.core.report();
        assert!(
            report.measured.longest_stop > report.stop.all_healthy,
            "{:?}",
            report.measured
        );
        assert!(
            report.measured.longest_stop <= report.stop.one_silent,
            "{report:?}"
        );
    }
}

#[test]
fn a_stop_among_drives_that_answer_keeps_the_shorter_bound() {
    let mut rig = Rig::new(&options(
        3,
        BusOptions {
            turnaround: Duration::from_millis(10),
            ..BusOptions::default()
        },
    ));
    rig.keeps_sent = false;
    let mut random = fastrand::Rng::with_seed(1);
    for _ in 0..2_000 {
        let drive = random.u16(0..3);
        rig.read(1, drive, PROOF, 8);
        rig.pass(Duration::from_micros(random.u64(..100_000)));
        rig.command(MQTT, drive, STOP);
        // Stops at the same time wait for each other.
        rig.pass(Duration::from_micros(random.u64(50_000..1_000_000)));
    }
    let report = rig.core.report();
    let waited = report.measured.longest_stop;
    assert!(
        waited <= report.stop.all_healthy && waited > report.stop.all_healthy / 3,
        "{report:?}"
    );
}

#[test]
fn the_planned_age_is_kept_also_by_a_plan_that_is_over_full() {
    for drives in [4, 12, 30] {
        let bus = BusOptions {
            turnaround: Duration::from_millis(10),
            ..BusOptions::default()
        };
        let mut rig = Rig::new(&options(drives, bus));
        rig.pass(Duration::from_secs(300));
        for drive in 0..drives.into() {
            let station = rig.core.station(DriveIndex(drive)).unwrap();
            let planned = station.planned_age.unwrap();
            assert!(
                station.oldest_age <= planned,
                "{drives} drives: {:?}, planned {planned:?}",
                station.oldest_age
            );
        }
    }
}
