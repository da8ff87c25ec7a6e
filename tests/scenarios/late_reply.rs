//! A late reply is never taken for the answer to another request.

use crate::support::{PROOF, Rig, RigOptions};
use std::time::Duration;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::journal::RememberedDrive;
use vfd_gateway::sim::{BusOptions, FaultPlan};

fn late(per_mille: u16, drives: u8, seed: u64) -> Rig {
    let faults = FaultPlan {
        late: per_mille,
        ..FaultPlan::NONE
    };
    let bus = BusOptions {
        faults,
        ..BusOptions::default()
    };
    Rig::new(&RigOptions {
        drives,
        bus,
        seed,
        ..RigOptions::default()
    })
}

/// Clients that never pause read proof words, whose value identifies the exchange that requested them.
fn walk(rig: &mut Rig, drives: u16, late_replies: u64) -> u64 {
    rig.keeps_sent = false;
    for asker in 0..4 {
        rig.read(asker, asker as u16 % drives, PROOF, 1 + asker as u16);
    }
    let mut right = 0;
    while rig.bus.report().replies_late < late_replies {
        let until = rig.now + Duration::from_secs(60);
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
            rig.read(
                answer.asker.0,
                (n % u64::from(drives)) as u16,
                PROOF,
                1 + (n % 8) as u16,
            );
        });
    }
    right
}

#[test]
fn late_replies_answer_nothing_else() {
    for seed in 0..4 {
        let mut rig = late(300, 3, seed);
        let right = walk(&mut rig, 3, 5_000);
        assert!(right > 1_000, "work went on: {right}");
        assert!(
            rig.core.counters().strays > 1_000,
            "late replies were seen: {:?}",
            rig.core.counters()
        );
    }
}

#[test]
fn a_late_reply_to_a_short_probe_is_waited_for_as_long_as_any_other() {
    for seed in 0..8 {
        // So many replies are late that the stations are mostly probed.
        let mut rig = late(800, 2, seed);
        walk(&mut rig, 2, 5_000);
    }
}

#[test]
fn a_late_reply_from_before_a_kill_answers_nothing() {
    for seed in 0..20 {
        let mut rig = late(500, 2, seed);
        for life in 0..20 {
            let late_before = rig.bus.report().replies_late;
            walk(&mut rig, 2, late_before + 1 + life % 3);
            rig.restart(RememberedDrive::default());
        }
    }
}

/// Found by the measurement of a million late replies: the late replies of two drives ran into each other and made
/// something that began like the awaited reply and was as long.
#[test]
fn two_late_replies_that_collide_are_no_damaged_reply() {
    let mut rig = late(300, 4, 1);
    rig.keeps_sent = false;
    for asker in 0..6 {
        rig.read(asker, asker as u16 % 4, PROOF, 1 + asker as u16);
    }
    rig.run_until(rig.now + Duration::from_secs(600), |rig, answer| {
        if let NativeOutcome::Words(words) = &answer.outcome {
            let expected = rig.proof(answer.ticket);
            assert!(
                words.iter().all(|word| *word == expected),
                "{words:04X?} for exchange {expected:04X}"
            );
        }
        let n = answer.ticket.0;
        rig.read(answer.asker.0, (n % 4) as u16, PROOF, 1 + (n % 8) as u16);
    });
}

#[test]
fn a_station_with_a_missing_reply_is_asked_only_what_cannot_be_mistaken() {
    late(0, 1, 1).shows_that_a_missing_reply_is_waited_out();
}

#[test]
fn without_an_answer_to_the_barrier_the_longest_lateness_is_waited_out() {
    let mut rig = late(0, 1, 1);
    rig.bus.set_faults(FaultPlan {
        lost: 1000,
        ..FaultPlan::NONE
    });
    let first = rig.read(1, 0, PROOF, 1);
    assert_eq!(rig.answer_to(first), NativeOutcome::NoReply);
    let timed_out = rig.now;
    rig.run_until(timed_out + Duration::from_secs(3), |_, _| {});
    rig.bus.set_faults(FaultPlan::NONE);
    let same_count = rig.read(1, 0, PROOF, 1);
    assert!(matches!(rig.answer_to(same_count), NativeOutcome::Words(_)));
    let sent = &rig.sent;
    assert!(sent[sent.len() - 1].at.since(timed_out) >= Duration::from_millis(500));
}

#[test]
fn other_stations_are_not_held_up() {
    let mut rig = late(0, 2, 1);
    rig.bus
        .set_powered(rig.now, vfd_gateway::domain::ids::Station(1), false);
    let dead = rig.read(1, 0, PROOF, 1);
    assert_eq!(rig.answer_to(dead), NativeOutcome::NoReply);
    let begun = rig.now;
    let alive = rig.read(2, 1, PROOF, 1);
    assert!(matches!(rig.answer_to(alive), NativeOutcome::Words(_)));
    assert!(
        rig.now.since(begun) < Duration::from_millis(40),
        "{:?}",
        rig.now.since(begun)
    );
}

#[test]
fn one_exchange_takes_what_the_wire_takes_and_nothing_more() {
    let mut rig = late(0, 1, 1);
    let begun = rig.now;
    let ticket = rig.read(1, 0, PROOF, 1);
    rig.answer_to(ticket);
    assert_eq!(
        rig.now.since(begun),
        Duration::from_nanos(8_333_334 + 2_000_000 + 7_291_667)
    );
}
