//! What a line reports to the journal: each write attempt once, with its end, and everything that a later start of the
//! gateway has to know. And what waits for that.

use crate::support::{MQTT, ORIGIN, Rig, RigOptions, STOP, plc, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Owner, Reason};
use vfd_gateway::domain::control::FailSafe;
use vfd_gateway::domain::ids::{AskerId, Station};
use vfd_gateway::domain::native::NativeAsk;
use vfd_gateway::gateway::{DriveNote, LineInput, WAITERS_MAX};
use vfd_gateway::journal::{AttemptId, FailSafeCause, JournalEntry, TriedWrite};

const RUN: u16 = 0x0002;
const WAIT: Duration = Duration::from_millis(20);

fn rig() -> Rig {
    Rig::new(&RigOptions {
        keeps: true,
        ..RigOptions::controlled()
    })
}

fn running() -> Rig {
    let mut rig = rig();
    rig.command(MQTT, 0, run(Direction::Forward, Some(3000)));
    rig.all_is_kept();
    rig.live(Duration::from_secs(2));
    rig.kept.clear();
    rig
}

/// Outcomes of the attempts so far with their ends, in the order of the attempts; nothing is reported twice.
fn accounts(rig: &Rig) -> Vec<Option<(Outcome, Reason)>> {
    let mut accounts = Vec::new();
    let mut first = None;
    for entry in rig.entries() {
        match entry {
            JournalEntry::Attempt(attempt) => {
                let first = *first.get_or_insert(attempt.id.0);
                assert_eq!(attempt.id, AttemptId(first + accounts.len() as u64));
                accounts.push(attempt.report.map(|it| (it.outcome, it.reason)));
            }
            JournalEntry::Ended { attempt, report } => {
                let place = first
                    .and_then(|first| attempt.0.checked_sub(first))
                    .expect("an attempt before its end");
                let account = &mut accounts[place as usize];
                assert_eq!(
                    account.replace((report.outcome, report.reason)),
                    None,
                    "{attempt:?} ends twice"
                );
            }
            _ => {}
        }
    }
    accounts
}

#[test]
fn rows_are_numbered_without_holes() {
    let mut rig = rig();
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.commanded(plc(1), STOP);
    rig.pass(Duration::from_secs(20));
    let rows: Vec<u64> = rig.kept.iter().map(|keep| keep.row.0).collect();
    assert_eq!(rows, (1..=rows.len() as u64).collect::<Vec<_>>());
    assert!(rows.len() > 8, "{:?}", rig.kept);
}

#[test]
fn nothing_is_said_without_a_journal() {
    let mut rig = Rig::new(&RigOptions::controlled());
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, 3);
    rig.pass(Duration::from_secs(5));
    assert_eq!((rig.kept.len(), rig.trips.len()), (0, 1));
    let kept = rig.view(0).trip_kept;
    assert_eq!(
        (kept.count, kept.total, kept.last_code),
        (Some(1), 1, Some(3)),
        "it is shown at once"
    );
}

#[test]
fn each_attempt_is_accounted_for_once() {
    let mut rig = rig();
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.commanded(MQTT, run(Direction::Forward, Some(9000)));
    rig.commanded(plc(1), setpoint(2000));
    // Sent again it changes nothing and is not an attempt; neither are renewals and reads.
    rig.commanded(MQTT, Order::Renew);
    rig.read(1, 0, 0x0101, 1);
    rig.commanded(plc(1), STOP);
    rig.commanded(plc(1), STOP);
    rig.command(plc(1), 0, Order::Renew);
    let write = |rig: &mut Rig, address, value| {
        let ticket = rig.ask(
            1,
            0,
            NativeAsk::Write {
                address,
                values: vec![value],
            },
        );
        rig.answer_to(ticket)
    };
    write(&mut rig, 0x020C_u16.into(), 50);
    write(&mut rig, 0x0999_u16.into(), 50);
    rig.pass(Duration::from_secs(1));
    let [first, second, third, stop, listed, unknown] = accounts(&rig)[..] else {
        panic!("{:?}", accounts(&rig))
    };
    assert_eq!(first, Some((Outcome::Acknowledged, Reason::None)));
    assert_eq!(second, Some((Outcome::Refused, Reason::OutsideLimits)));
    assert_eq!(third, Some((Outcome::Refused, Reason::OtherOwner)));
    assert_eq!(stop, Some((Outcome::Confirmed, Reason::None)));
    assert_eq!(listed.unwrap().0, Outcome::Confirmed);
    assert_eq!(unknown.unwrap().0, Outcome::Refused);
    let attempts = rig.entries().into_iter().filter_map(|it| match it {
        JournalEntry::Attempt(attempt) => Some((attempt.owner, attempt.tried.clone())),
        _ => None,
    });
    let attempts: Vec<_> = attempts.collect();
    assert_eq!(attempts[3], (plc(1).owner, TriedWrite::Order(STOP)));
    assert_eq!(
        attempts[5],
        (
            ORIGIN.owner,
            TriedWrite::Registers {
                address: 0x0999_u16.into(),
                values: vec![50]
            }
        )
    );
}

#[test]
fn whatever_ends_an_attempt_is_its_end() {
    let mut rig = running();
    rig.restart(Default::default());
    rig.live(Duration::from_secs(1));
    rig.kept.clear();
    // Superseded by a newer one, cut by a stop, withdrawn, cut off with the line, expired.
    rig.command_unsettled(MQTT, 0, setpoint(2000));
    rig.command_unsettled(MQTT, 0, setpoint(2500));
    rig.command_unsettled(MQTT, 0, STOP);
    rig.settle();
    rig.pass(Duration::from_secs(15));
    rig.command_unsettled(MQTT, 0, setpoint(2000));
    rig.core
        .handle(rig.now, LineInput::AskerGone(AskerId::MQTT));
    rig.settle();
    rig.command_unsettled(MQTT, 0, setpoint(2100));
    rig.reopen();
    let ends: Vec<Reason> = accounts(&rig)
        .into_iter()
        .map(|it| it.expect("an end").1)
        .collect();
    assert_eq!(
        ends,
        [
            Reason::Newer,
            Reason::Stopped,
            Reason::None,
            Reason::CommanderLost,
            Reason::LineDown
        ],
        "{:?}",
        rig.kept
    );
    rig.command_unsettled(MQTT, 0, setpoint(2200));
    rig.core.end_attempts(rig.now);
    rig.settle();
    assert_eq!(
        accounts(&rig).last(),
        Some(&Some((Outcome::Refused, Reason::ShuttingDown)))
    );
}

#[test]
fn a_stop_ends_for_everybody_who_has_asked_for_it() {
    let mut rig = running();
    for client in 0..=WAITERS_MAX as u8 {
        rig.command_unsettled(plc(client), 0, STOP);
    }
    let native = rig.ask(
        9,
        0,
        NativeAsk::Write {
            address: RUN.into(),
            values: vec![0],
        },
    );
    rig.settle();
    assert_eq!(
        accounts(&rig).iter().filter(|it| it.is_some()).count(),
        2,
        "there is room for so many"
    );
    rig.answer_to(native);
    rig.pass(Duration::from_secs(15));
    let ends: Vec<_> = rig
        .kept
        .iter()
        .filter(|it| matches!(it.entry, JournalEntry::Ended { .. }))
        .collect();
    assert_eq!(ends.len(), WAITERS_MAX + 2);
    let stops = rig.entries().into_iter().filter(|it| {
        matches!(
            it,
            JournalEntry::StopPending { .. } | JournalEntry::StopOver { .. }
        )
    });
    let stops: Vec<JournalEntry> = stops.cloned().collect();
    assert_eq!(
        stops,
        [
            JournalEntry::StopPending { coast: false },
            JournalEntry::StopOver { is_effective: true }
        ]
    );
}

#[test]
fn who_holds_control_is_kept_when_it_changes() {
    let mut rig = rig();
    rig.command(MQTT, 0, run(Direction::Forward, Some(3000)));
    rig.live(Duration::from_secs(6));
    rig.pass(Duration::from_secs(20));
    let said: Vec<JournalEntry> = rig
        .entries()
        .into_iter()
        .filter(|it| matches!(it, JournalEntry::Lease(_) | JournalEntry::FailSafe { .. }))
        .cloned()
        .collect();
    let lost = JournalEntry::FailSafe {
        owner: Some(Owner::Mqtt),
        action: FailSafe::Stop,
        cause: FailSafeCause::CommanderLost,
    };
    assert_eq!(
        said,
        [
            JournalEntry::Lease(Some(Owner::Mqtt)),
            lost,
            JournalEntry::Lease(None)
        ]
    );
}

#[test]
fn a_run_that_opens_a_lease_waits_for_its_row() {
    let mut rig = rig();
    rig.command(MQTT, 0, run(Direction::Forward, Some(3000)));
    let began = rig.now;
    let wake = rig.core.next_wake().unwrap().at;
    assert!(wake <= began + WAIT, "{wake:?}");
    rig.pass(Duration::from_millis(12));
    assert_eq!(rig.writes().len(), 0);
    rig.all_is_kept();
    rig.pass(Duration::from_millis(100));
    assert_eq!(rig.written(RUN), [1]);
    assert!(
        !rig.notes
            .iter()
            .any(|(_, note)| *note == DriveNote::JournalSlow)
    );
    // The next order of its owner waits for nothing.
    let now = rig.now;
    rig.command(MQTT, 0, run(Direction::Forward, Some(2000)));
    rig.pass(Duration::from_millis(100));
    let first = rig
        .sent
        .iter()
        .find(|sent| sent.at >= now && sent.pdu[0] == 6)
        .expect("a write");
    assert!(first.at.since(now) < WAIT, "{:?}", first.at.since(now));
}

#[test]
fn a_slow_journal_holds_no_run_back() {
    let mut rig = rig();
    let now = rig.now;
    rig.command(MQTT, 0, run(Direction::Forward, Some(3000)));
    rig.pass(Duration::from_millis(200));
    let first = rig
        .sent
        .iter()
        .find(|sent| sent.pdu[0] == 6)
        .expect("a write");
    assert!(
        first.at.since(now) >= WAIT && first.at.since(now) < WAIT * 3,
        "{:?}",
        first.at.since(now)
    );
    assert_eq!(
        rig.notes
            .iter()
            .filter(|(_, note)| *note == DriveNote::JournalSlow)
            .count(),
        1
    );
}

#[test]
fn a_stop_waits_for_no_row() {
    let mut rig = rig();
    let run = rig.command(MQTT, 0, run(Direction::Forward, Some(3000)));
    rig.pass(Duration::from_millis(5));
    let now = rig.now;
    let stop = rig.command(plc(1), 0, STOP);
    assert_eq!(rig.outcome_of(run), (Outcome::Superseded, Reason::Stopped));
    rig.outcome_of(stop);
    rig.pass(Duration::from_secs(1));
    assert!(
        rig.written(RUN).iter().all(|word| *word == 0),
        "{:?}",
        rig.written(RUN)
    );
    let frame = rig
        .sent
        .iter()
        .find(|sent| sent.pdu[0] == 6)
        .expect("a stop");
    assert!(
        frame.at.since(now) < Duration::from_millis(40),
        "{:?}",
        frame.at.since(now)
    );
    assert!(
        !rig.notes
            .iter()
            .any(|(_, note)| *note == DriveNote::JournalSlow),
        "nothing went on without its row"
    );
}

#[test]
fn a_trip_is_shown_as_kept_once_it_is() {
    let mut rig = running();
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, 7);
    rig.pass(Duration::from_secs(3));
    let trips: Vec<_> = rig
        .kept
        .iter()
        .filter(|it| matches!(it.entry, JournalEntry::Trip(..)))
        .collect();
    let [keep] = trips[..] else {
        panic!("{trips:?}")
    };
    let JournalEntry::Trip(event, baseline) = &keep.entry else {
        panic!()
    };
    assert_eq!((event.count, baseline.count), (Some(1), Some(1)));
    let view = rig.view(0);
    let row = keep.row;
    assert_eq!(
        (view.trip.seen, view.trip_kept.total, view.trip_kept.count),
        (1, 0, Some(0))
    );
    rig.core.handle(rig.now, LineInput::Kept(row));
    let kept = rig.view(0).trip_kept;
    assert_eq!(
        (kept.total, kept.count, kept.last_code),
        (1, Some(1), Some(7))
    );
    assert_eq!(kept.last.unwrap().code, Some(7));
}
