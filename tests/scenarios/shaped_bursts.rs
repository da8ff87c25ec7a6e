//! Bytes that look like a reply prove nothing: noise in its shape, an echo that lost a byte, a second drive with the
//! same station, and replies later than any that was declared. None of them shifts the answers of a line.

use crate::support::{PROOF, Rig, RigOptions, STOP, plc};
use std::time::Duration;
use vfd_gateway::domain::command::Outcome;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome};
use vfd_gateway::domain::suspicion::LineSuspicion;
use vfd_gateway::domain::time::MonoTime;

/// Answers to clients.
#[derive(Debug, Default, PartialEq, Eq)]
struct Walked {
    right: u32,
    wrong: u32,
    /// Without words.
    none: u32,
}

const fn ms(millis: u64) -> Duration {
    Duration::from_millis(millis)
}

fn options(turnaround: Duration) -> RigOptions {
    let mut options = RigOptions {
        poll: Duration::from_secs(1),
        ..RigOptions::default()
    };
    options.bus.turnaround = turnaround;
    options
}

/// Two clients that never pause read words of the first drive that identify their exchange. `on_frame` is called when a
/// frame of ours is about to be on the wire, with its number.
fn walk(rig: &mut Rig, time: Duration, mut on_frame: impl FnMut(&mut Rig, u64)) -> Walked {
    rig.keeps_sent = false;
    let mut walked = Walked::default();
    let until = rig.now + time;
    for asker in 0..2 {
        rig.read(asker, 0, PROOF, 1);
    }
    let mut frames = rig.core.counters().requests;
    while rig.now < until {
        rig.step(until);
        if rig.core.counters().requests > frames {
            frames = rig.core.counters().requests;
            on_frame(rig, frames);
        }
        for (_, answer) in std::mem::take(&mut rig.answers) {
            match answer.outcome {
                NativeOutcome::Words(words) => {
                    let expected = rig.proof(answer.ticket);
                    let is_right = words.iter().all(|word| *word == expected);
                    *(if is_right {
                        &mut walked.right
                    } else {
                        &mut walked.wrong
                    }) += 1;
                }
                _ => walked.none += 1,
            }
            rig.read(answer.asker.0, 0, PROOF, 1);
        }
    }
    walked
}

/// When the last character of the frame being sent has left.
fn sent_until(rig: &Rig) -> MonoTime {
    rig.now
        + rig
            .setup
            .timing
            .on_wire(rig.sent.last().expect("a frame").frame.len())
}

#[test]
fn a_burst_shaped_like_the_reply_shifts_no_answer() {
    let mut rig = Rig::new(&options(ms(20)));
    let mut bursts = 0;
    let walked = walk(&mut rig, Duration::from_secs(40), |rig, _| {
        let is_proof = rig.sent.last().is_some_and(|sent| sent.pdu[1] == 0x30);
        if bursts == 0 && is_proof {
            bursts += 1;
            rig.bus
                .speak(sent_until(rig), &[1, 3, 2, 0x12, 0x34, 0x56, 0x78]);
        }
    });
    assert_eq!((walked.wrong, bursts), (0, 1), "{walked:?}");
    assert!(walked.right > 500 && walked.none <= 1, "{walked:?}");
}

#[test]
fn an_echo_that_always_loses_its_last_byte_shifts_no_answer() {
    let mut rig = Rig::new(&options(ms(20)));
    let walked = walk(&mut rig, Duration::from_secs(60), |rig, _| {
        let echo = rig.sent.last().expect("a frame").frame[..7].to_vec();
        rig.bus.speak(sent_until(rig), &echo);
    });
    assert_eq!(walked.wrong, 0, "{walked:?}");
    assert!(walked.right > 500 && walked.none == 0, "{walked:?}");
}

#[test]
fn two_drives_of_one_number_are_reported_and_shift_no_answer_for_long() {
    for delay in [15, 27, 40] {
        let mut rig = Rig::new(&options(ms(2)));
        let walked = walk(&mut rig, Duration::from_secs(60), |rig, _| {
            let second = rig.bus.newest_reply().to_vec();
            let begins =
                sent_until(rig) + ms(2) + rig.setup.timing.on_wire(second.len()) + ms(delay);
            rig.bus.speak(begins, &second);
        });
        assert!(walked.wrong <= 2, "{delay} ms: {walked:?}");
        assert!(walked.right > 100, "{delay} ms: {walked:?}");
        assert_eq!(
            rig.core.report().suspicion,
            Some(LineSuspicion::DuplicateStation(Station(1))),
            "{delay} ms"
        );
    }
}

#[test]
fn replies_beyond_the_longest_lateness_are_reported_learned_and_make_no_trip() {
    for seed in 0..3 {
        let mut rig = Rig::new(&RigOptions {
            seed,
            ..options(ms(2))
        });
        rig.bus.set_faults("beyond=50".parse().expect("a plan"));
        let mut was_suspected = false;
        let walked = walk(&mut rig, Duration::from_secs(600), |rig, _| {
            was_suspected |=
                rig.core.report().suspicion == Some(LineSuspicion::LateBeyondLimit(Station(1)));
        });
        // Until the latest reply was seen, one may be mistaken; never two in a row.
        assert!(
            walked.wrong <= 3 && walked.right > 500,
            "{seed}: {walked:?}"
        );
        assert!(
            was_suspected && rig.trips.is_empty(),
            "{seed}: {:?}",
            rig.trips
        );
    }
}

#[test]
fn two_drives_of_one_number_make_no_trip() {
    for seed in 0..3 {
        let mut rig = Rig::new(&RigOptions {
            seed,
            ..RigOptions::controlled()
        });
        rig.bus.set_faults("twin=1000".parse().expect("a plan"));
        rig.pass(Duration::from_secs(120));
        assert!(rig.trips.is_empty(), "{seed}: {:?}", rig.trips);
        assert_eq!(
            rig.core.report().suspicion,
            Some(LineSuspicion::DuplicateStation(Station(1)))
        );
        assert!(rig.view(0).is_online());
        // A stop waits for none of that.
        let begun = rig.now;
        rig.command(plc(1), 0, STOP);
        rig.pass(Duration::from_secs(1));
        let first = rig
            .sent
            .iter()
            .find(|sent| sent.at >= begun && sent.pdu[0] == 6)
            .expect("a stop");
        assert!(
            first.at.since(begun) < ms(40),
            "{:?}",
            first.at.since(begun)
        );
    }
}

/// A stop is sent as early as when such bytes ended the exchange.
#[test]
fn a_stop_ends_the_wait_for_the_reply_after_a_burst() {
    for drive in 0..2 {
        let mut options = RigOptions {
            drives: 2,
            poll: Duration::from_secs(3600),
            ..RigOptions::controlled()
        };
        options.bus.turnaround = ms(60);
        let mut rig = Rig::new(&options);
        let read = rig.read(1, 0, PROOF, 1);
        let request_end = sent_until(&rig);
        rig.bus
            .speak(request_end, &[1, 3, 2, 0x12, 0x34, 0x56, 0x78]);
        let stop = rig.command(plc(1), drive, STOP);
        rig.pass(ms(50));
        let burst = rig.setup.timing.on_wire(7) + rig.setup.timing.silence;
        let stops: Vec<_> = rig
            .sent
            .iter()
            .filter(|sent| sent.pdu[0] == 6)
            .map(|sent| sent.at)
            .collect();
        assert!(
            stops
                .first()
                .is_some_and(|at| at.since(request_end) <= burst + ms(1)),
            "{drive}: {stops:?}"
        );
        // The read's own reply arrives after the stop, and is not mistaken for anything else.
        assert_eq!(
            rig.answer_to(read),
            NativeOutcome::Words([read_proof(&rig)].into()),
            "{drive}"
        );
        assert_eq!(rig.outcome_of(stop).0, Outcome::Confirmed, "{drive}");
    }
}

/// The number of the newest exchange in which proof words were read.
fn read_proof(rig: &Rig) -> u16 {
    rig.sent
        .iter()
        .rev()
        .find(|sent| sent.pdu[1] == 0x30)
        .expect("a read")
        .proof
}

#[test]
fn a_write_after_a_burst_is_not_sent_again() {
    let mut options = RigOptions {
        poll: Duration::from_secs(3600),
        ..RigOptions::controlled()
    };
    options.bus.turnaround = ms(20);
    let mut rig = Rig::new(&options);
    let write = rig.ask(
        1,
        0,
        NativeAsk::Write {
            address: 0x020C_u16.into(),
            values: vec![7],
        },
    );
    while !rig.sent.iter().any(|sent| sent.pdu[0] == 6) {
        rig.step(rig.now + ms(100));
    }
    let end = sent_until(&rig);
    rig.bus.speak(end, &[1, 6, 2, 0x0C, 0, 7, 0x56, 0x78]);
    assert_eq!(rig.answer_to(write), NativeOutcome::Written);
    assert_eq!(rig.sent.iter().filter(|sent| sent.pdu[0] == 6).count(), 1);
}
