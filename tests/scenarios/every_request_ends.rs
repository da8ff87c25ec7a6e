//! Every request ends in exactly one outcome, whatever happens to the port, the queue or the asker.

use crate::support::{PROOF, Rig, RigOptions, STOP, control, plc};
use std::time::Duration;
use vfd_gateway::domain::command::{Outcome, Reason};
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::ids::{AskerId, Station};
use vfd_gateway::domain::link::PortKind;
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome, NativeRefusal};
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::gateway::{COMMANDS_MAX, LineInput, REQUESTS_MAX, WAITERS_MAX};
use vfd_gateway::line::schedule::READS_MAX;

fn outcomes(rig: &mut Rig) -> Vec<NativeOutcome> {
    std::mem::take(&mut rig.answers)
        .into_iter()
        .map(|(_, answer)| answer.outcome)
        .collect()
}

#[test]
fn a_lost_port_answers_all_who_wait() {
    let mut rig = Rig::new(&RigOptions::default());
    rig.run_until(rig.now + Duration::from_millis(10), |_, _| {});
    rig.read(1, 0, PROOF, 1);
    rig.read(2, 0, PROOF, 2);
    assert_eq!(rig.sent.len(), 1, "one is on the wire");
    rig.core
        .handle(rig.now, LineInput::PortDown(LineFault::Gone));
    rig.settle();
    assert_eq!(
        outcomes(&mut rig),
        [
            NativeOutcome::NoReply,
            NativeOutcome::Refused(NativeRefusal::LineDown)
        ]
    );
    rig.read(1, 0, PROOF, 1);
    assert_eq!(
        outcomes(&mut rig),
        [NativeOutcome::Refused(NativeRefusal::LineDown)]
    );
    rig.core
        .handle(rig.now, LineInput::PortUp(PortKind::Serial));
    // The exchange on the wire may still be answered: another word count is sent first.
    let again = rig.read(1, 0, PROOF, 1);
    assert!(matches!(rig.answer_to(again), NativeOutcome::Words(_)));
}

#[test]
fn a_deadline_that_passes_in_the_queue_ends_the_wait() {
    let mut rig = Rig::new(&RigOptions {
        drives: 2,
        ..RigOptions::default()
    });
    rig.keeps_sent = false;
    for asker in 0..60 {
        rig.read(asker, 0, PROOF, 125);
    }
    let begun = rig.now;
    let mut ended = 0;
    rig.run_until(begun + Duration::from_secs(30), |rig, answer| {
        ended += 1;
        assert!(rig.now.since(begun) <= Duration::from_secs(5), "{answer:?}");
    });
    assert_eq!(ended, 60);
    // All requested the same, so sixteen frames served them all.
    assert_eq!(rig.core.counters().expired, 0);
    for asker in 0..60 {
        rig.read(asker, 0, PROOF + asker as u16, 125);
    }
    let mut expired = 0;
    rig.run_until(rig.now + Duration::from_secs(30), |_, answer| {
        expired += u64::from(answer.outcome == NativeOutcome::Expired);
    });
    assert!(expired > 0);
    assert_eq!(rig.core.counters().expired, expired);
}

#[test]
fn full_queues_refuse_and_grow_no_further() {
    let mut rig = Rig::new(&RigOptions::default());
    let asked = READS_MAX as u64 + 100;
    for n in 0..asked {
        rig.ask(
            n,
            0,
            NativeAsk::Read {
                address: (n as u16).into(),
                count: 1,
            },
        );
    }
    let refused = outcomes(&mut rig);
    assert!(
        refused
            .iter()
            .all(|outcome| *outcome == NativeOutcome::Refused(NativeRefusal::QueueFull))
    );
    // The first went on the wire at once.
    assert_eq!(refused.len() as u64, asked - READS_MAX as u64 - 1);
    let mut rig = Rig::new(&RigOptions::default());
    for n in 0..REQUESTS_MAX as u64 + 5 {
        rig.ask(
            n,
            0,
            NativeAsk::Read {
                address: PROOF.into(),
                count: 1,
            },
        );
    }
    assert_eq!(outcomes(&mut rig).len(), 5);
}

#[test]
fn commands_beyond_the_bound_are_refused_and_a_stop_is_not() {
    let often = ControlSettings {
        stored_write_interval: Duration::ZERO,
        ..control()
    };
    let mut rig = Rig::new(&RigOptions {
        poll: Duration::from_secs(3600),
        control: Some(often),
        ..RigOptions::controlled()
    });
    rig.pass(Duration::from_millis(100));
    rig.read(1, 0, PROOF, 8);
    for n in 0..COMMANDS_MAX as u64 + 3 {
        rig.ask(
            n,
            0,
            NativeAsk::Write {
                address: 0x020C_u16.into(),
                values: vec![30 + n as u16],
            },
        );
    }
    assert_eq!(
        outcomes(&mut rig),
        vec![NativeOutcome::Refused(NativeRefusal::QueueFull); 3]
    );
    let stop = rig.ask(
        50,
        0,
        NativeAsk::Write {
            address: 0x0002_u16.into(),
            values: vec![0],
        },
    );
    assert_eq!(rig.answer_to(stop), NativeOutcome::Written);
}

#[test]
fn those_who_wait_for_one_stop_are_bounded_and_the_stop_goes_all_the_same() {
    let mut rig = Rig::new(&RigOptions::controlled());
    rig.read(1, 0, PROOF, 8);
    let tickets: Vec<_> = (0..=WAITERS_MAX)
        .map(|n| rig.command(plc(n as u8), 0, STOP))
        .collect();
    let (last, waiting) = tickets.split_last().unwrap();
    assert_eq!(
        rig.told(*last),
        [(Outcome::Unknown, Reason::StopPending, true)],
        "told at once"
    );
    for ticket in waiting {
        assert_eq!(rig.outcome_of(*ticket).0, Outcome::Confirmed);
    }
    assert_eq!(rig.written(0x0002), [0], "one stop for all");
}

/// Every queue from a socket to the wire is in the tables of `docs/design/bounds.md`, with its bound.
#[test]
fn the_table_of_bounds_names_every_queue_as_it_is() {
    use vfd_gateway::daemon::exchange::inbox;
    let tables = include_str!("../../docs/design/bounds.md");
    let rows = [
        (
            "Modbus TCP connections",
            vfd_gateway::north::modbus::ClientSlots::MOST,
        ),
        (
            "requests of a connection",
            vfd_gateway::north::modbus::ConnectionLimits::default().pending_max,
        ),
        ("messages for a line: reads", inbox::INBOX_MAX),
        ("then writes, commands, heartbeats", inbox::COMMANDS_MAX),
        ("then stops, clients that left, shutdown", inbox::STOPS_MAX),
        ("native requests that wait on a line", REQUESTS_MAX),
        ("different native reads that wait on a line", READS_MAX),
        ("commands that wait for a drive", COMMANDS_MAX),
        ("commanders that wait for one stop", WAITERS_MAX),
        (
            "frames of one request, registers of one command",
            vfd_gateway::domain::native::FRAMES_MAX,
        ),
        (
            "replies that a station may still owe",
            vfd_gateway::line::station::MISSING_MAX,
        ),
    ];
    for (what, bound) in rows {
        let row = tables
            .lines()
            .find(|line| line.starts_with(&format!("| {what} | ")))
            .unwrap_or_else(|| panic!("{what}"));
        let most = row.split('|').nth(2).unwrap().trim();
        assert!(
            most.split([' ', ',']).next() == Some(&bound.to_string()),
            "{what}: {most}, not {bound}"
        );
    }
}

#[test]
fn an_asker_that_is_gone_takes_its_reads_along() {
    let mut rig = Rig::new(&RigOptions::default());
    rig.run_until(rig.now + Duration::from_millis(10), |_, _| {});
    rig.read(1, 0, PROOF, 1);
    for n in 0..16 {
        rig.read(2, 0, PROOF + n, 2);
    }
    rig.core.handle(rig.now, LineInput::AskerGone(AskerId(2)));
    rig.run_until(rig.now + Duration::from_secs(2), |_, answer| {
        assert_eq!(answer.asker, AskerId(1))
    });
    assert_eq!(
        rig.sent.len(),
        1,
        "nothing was sent for the one that is gone"
    );
}

#[test]
fn a_silent_drive_is_answered_for_at_once_until_it_is_asked_again() {
    let mut rig = Rig::new(&RigOptions::default());
    rig.bus.set_powered(rig.now, Station(1), false);
    for _ in 0..2 {
        let ticket = rig.read(1, 0, PROOF, 1);
        assert_eq!(rig.answer_to(ticket), NativeOutcome::NoReply);
    }
    let sent = rig.sent.len();
    let ticket = rig.read(1, 0, PROOF, 1);
    assert_eq!(rig.answers.len(), 1, "answered without a frame");
    assert_eq!(rig.answer_to(ticket), NativeOutcome::NoReply);
    assert_eq!(rig.sent.len(), sent);
    rig.bus.set_powered(rig.now, Station(1), true);
    rig.run_until(rig.now + Duration::from_secs(40), |_, _| {});
    let ticket = rig.read(1, 0, PROOF, 1);
    assert!(
        matches!(rig.answer_to(ticket), NativeOutcome::Words(_)),
        "it is asked again after the wait"
    );
}
