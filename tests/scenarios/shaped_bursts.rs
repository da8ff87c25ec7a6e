//! Bytes that look like a reply prove nothing: noise in its shape, an echo that lost a byte, a second drive of the same
//! number, and replies later than any that was declared. None of them shifts the answers of a line.

use crate::support::{PROOF, Rig, RigOptions};
use std::time::Duration;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::domain::suspicion::Suspicion;
use vfd_gateway::domain::time::MonoTime;

/// What clients were answered.
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
    let mut options = RigOptions { poll: Duration::from_secs(1), ..RigOptions::default() };
    options.bus.turnaround = turnaround;
    options
}

/// Two clients that never pause read words of the first drive that tell in which exchange they were given. `on_frame` is
/// called when a frame of ours is about to be on the wire, with its number.
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
                    *(if is_right { &mut walked.right } else { &mut walked.wrong }) += 1;
                }
                _ => walked.none += 1,
            }
            rig.read(answer.asker.0, 0, PROOF, 1);
        }
    }
    walked
}

/// When the last character of the frame that goes out now has left.
fn sent_until(rig: &Rig) -> MonoTime {
    rig.now + rig.setup.timing.on_wire(rig.sent.last().expect("a frame").frame.len())
}

#[test]
fn a_burst_shaped_like_the_reply_shifts_no_answer() {
    let mut rig = Rig::new(&options(ms(20)));
    let mut bursts = 0;
    let walked = walk(&mut rig, Duration::from_secs(40), |rig, _| {
        let is_proof = rig.sent.last().is_some_and(|sent| sent.pdu[1] == 0x30);
        if bursts == 0 && is_proof {
            bursts += 1;
            rig.bus.speak(sent_until(rig), &[1, 3, 2, 0x12, 0x34, 0x56, 0x78]);
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
            let begins = sent_until(rig) + ms(2) + rig.setup.timing.on_wire(second.len()) + ms(delay);
            rig.bus.speak(begins, &second);
        });
        assert!(walked.wrong <= 2, "{delay} ms: {walked:?}");
        assert!(walked.right > 100, "{delay} ms: {walked:?}");
        assert_eq!(rig.core.report().suspicion, Some(Suspicion::DuplicateStation(Station(1))), "{delay} ms");
    }
}
