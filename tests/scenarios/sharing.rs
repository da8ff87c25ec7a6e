//! Equal requests share one exchange, and no client pays for a dead or busy neighbour.

use crate::support::{PROOF, Rig, RigOptions, STOP, plc, setpoint};
use std::collections::HashMap;
use std::time::Duration;
use vfd_gateway::domain::command::Reason;
use vfd_gateway::domain::ids::{AskerId, Station};
use vfd_gateway::domain::native::{NativeAnswer, NativeAsk, NativeOutcome, NativeRefusal};
use vfd_gateway::wire::pdu::MAX_READ_WORDS;

/// Clients that read `drives` drives in turn, each waiting for its answer; right answers per client in 60 s.
fn walks(clients: u64, drives: u16, dead: Option<u8>) -> HashMap<AskerId, u32> {
    let mut rig = Rig::new(&RigOptions {
        drives: drives as u8,
        ..RigOptions::default()
    });
    rig.keeps_sent = false;
    if let Some(station) = dead {
        rig.bus.set_powered(rig.now, Station(station), false);
    }
    let mut place: HashMap<AskerId, u16> = HashMap::new();
    for client in 0..clients {
        // They do not begin at the same drive.
        let at = (client * 3 % u64::from(drives)) as u16;
        place.insert(AskerId(client), at);
        rig.read(client, at, 0x0101, 1);
    }
    let mut right = HashMap::new();
    let until = rig.now + Duration::from_secs(60);
    rig.run_until(until, |rig, answer: &NativeAnswer| {
        if matches!(answer.outcome, NativeOutcome::Words(_)) {
            *right.entry(answer.asker).or_default() += 1;
        }
        let at = place.get_mut(&answer.asker).expect("known");
        *at = (*at + 1) % drives;
        rig.read(answer.asker.0, *at, 0x0101, 1);
    });
    right
}

#[test]
fn twenty_clients_get_what_one_alone_gets() {
    let alone = f64::from(walks(1, 8, None)[&AskerId(0)]);
    let together = walks(20, 8, None);
    assert_eq!(together.len(), 20);
    for (client, right) in together {
        assert!(
            f64::from(right) >= 0.9 * alone,
            "{client:?}: {right} of {alone}"
        );
    }
}

#[test]
fn a_dead_drive_costs_the_others_little() {
    let all = f64::from(walks(1, 8, None)[&AskerId(0)]) * 7.0 / 8.0;
    let seven = f64::from(walks(1, 8, Some(4))[&AskerId(0)]);
    assert!(seven >= 0.95 * all, "{seven} of {all}");
}

#[test]
fn a_long_read_goes_in_frames_that_the_drive_takes() {
    let mut rig = Rig::new(&RigOptions::default());
    let ticket = rig.read(1, 0, PROOF, 20);
    let NativeOutcome::Words(words) = rig.answer_to(ticket) else {
        panic!("no words")
    };
    assert_eq!(words.len(), 20);
    let asked: Vec<_> = rig
        .sent
        .iter()
        .map(|sent| (sent.frame[3], sent.frame[5]))
        .collect();
    assert_eq!(asked, [(0, 8), (8, 8), (16, 4)]);
    let proofs: Vec<u16> = rig.sent.iter().map(|sent| sent.proof).collect();
    let expected: Vec<u16> = proofs
        .iter()
        .zip([8, 8, 4])
        .flat_map(|(proof, n)| vec![*proof; n])
        .collect();
    assert_eq!(words.to_vec(), expected);
}

#[test]
fn the_longest_read_is_sixteen_frames_and_no_more() {
    let mut rig = Rig::new(&RigOptions::default());
    let whole = rig.read(1, 0, PROOF, MAX_READ_WORDS);
    assert!(matches!(rig.answer_to(whole), NativeOutcome::Words(words) if words.len() == 125));
    assert_eq!(rig.sent.len(), 16);
    // Across a group boundary one more frame would be needed.
    let begun = rig.sent.len();
    let crossing = rig.read(1, 0, PROOF + 0x00FC, MAX_READ_WORDS);
    assert_eq!(
        rig.answer_to(crossing),
        NativeOutcome::Refused(NativeRefusal::TooManyFrames)
    );
    assert_eq!(
        rig.sent.len(),
        begun,
        "a refused request puts nothing on the line"
    );
}

#[test]
fn a_long_read_that_failed_is_not_gone_on_with() {
    let mut rig = Rig::new(&RigOptions::default());
    rig.bus.set_powered(rig.now, Station(1), false);
    let ticket = rig.read(1, 0, PROOF, 20);
    assert_eq!(rig.answer_to(ticket), NativeOutcome::NoReply);
    rig.run_until(rig.now + Duration::from_secs(3), |_, _| {});
    assert_eq!(
        rig.sent.len(),
        1,
        "no client waits for the other frames: {:02X?}",
        rig.frames()
    );
}

#[test]
fn writes_are_refused_and_put_nothing_on_the_line() {
    let mut rig = Rig::new(&RigOptions::default());
    for (address, values) in [
        (0x0002, vec![1]),
        (0x0002, vec![0]),
        (0x020C, vec![100]),
        (0x0004, vec![1, 2]),
    ] {
        let ticket = rig.ask(
            1,
            0,
            NativeAsk::Write {
                address: address.into(),
                values,
            },
        );
        assert_eq!(
            rig.answer_to(ticket),
            NativeOutcome::Refused(NativeRefusal::Guard(Reason::ReadOnly))
        );
    }
    assert!(rig.frames().is_empty());
}

#[test]
fn setpoints_without_end_leave_others_a_turn_between_any_two() {
    const FREQUENCY: u16 = 0x0004;
    let mut rig = Rig::new(&RigOptions {
        drives: 2,
        ..RigOptions::controlled()
    });
    rig.commanded(plc(1), STOP);
    rig.pass(Duration::from_secs(1));
    rig.sent.clear();
    let until = rig.now + Duration::from_secs(10);
    let mut reads = 0;
    let mut newest = 1000;
    rig.read(7, 1, PROOF, 4);
    while rig.now < until {
        newest = 1000 + (newest + 7) % 3000;
        rig.command(plc(1), 0, setpoint(newest));
        rig.run_until(rig.now + Duration::from_millis(1), |rig, _| {
            reads += 1;
            rig.read(7, 1, PROOF, 4);
        });
    }
    let all = rig.sent.len();
    let written = rig.written(FREQUENCY).len();
    // Each is written and read back, and then others have a turn: overdue polls, at most three in a row.
    assert!(
        (all / 4..=all / 3 + 1).contains(&written),
        "{written} setpoints in {all} exchanges"
    );
    assert!(reads >= all / 13, "{reads} reads in {all} exchanges");
    rig.pass(Duration::from_secs(1));
    assert_eq!(
        rig.written(FREQUENCY).last(),
        Some(&newest),
        "the newest wins"
    );
}
