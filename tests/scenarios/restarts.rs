//! A gateway that was killed: what the next one does with the drives that it finds, and what it never does.

use crate::support::{MQTT, Rig, RigOptions, STOP, control, plc, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Owner, Reason};
use vfd_gateway::domain::control::{ControlSettings, FailSafe};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::gateway::{DriveNote, LineInput};
use vfd_gateway::journal::{
    FailSafeCause, JournalEntry, RememberedDrive, RememberedLease, RememberedStop, TripBaseline,
};

const RUN: u16 = 0x0002;

fn leased(was_orphaned: bool) -> RememberedDrive {
    RememberedDrive {
        lease: Some(RememberedLease {
            owner: Owner::Mqtt,
            was_orphaned,
        }),
        ..RememberedDrive::default()
    }
}

fn stopped() -> RememberedDrive {
    RememberedDrive {
        stop: Some(RememberedStop { coast: false }),
        ..RememberedDrive::default()
    }
}

/// A drive that runs by an order from before the restart.
fn running_with(on_commander_lost: FailSafe) -> Rig {
    let settings = ControlSettings {
        on_commander_lost,
        ..control()
    };
    let mut rig = Rig::new(&RigOptions {
        keeps: true,
        control: Some(settings),
        ..RigOptions::controlled()
    });
    rig.command(MQTT, 0, run(Direction::Forward, Some(3000)));
    rig.live(Duration::from_secs(12));
    assert_eq!(rig.output(1), 3000);
    rig
}

fn running() -> Rig {
    running_with(FailSafe::Stop)
}

fn failsafes(rig: &Rig) -> Vec<FailSafeCause> {
    let cause = |entry: &&JournalEntry| match entry {
        JournalEntry::FailSafe { cause, .. } => Some(*cause),
        _ => None,
    };
    rig.entries().iter().filter_map(cause).collect()
}

fn leases(rig: &Rig) -> Vec<Option<Owner>> {
    let owner = |entry: &&JournalEntry| match entry {
        JournalEntry::Lease(owner) => Some(*owner),
        _ => None,
    };
    rig.entries().iter().filter_map(owner).collect()
}

#[test]
fn an_orphaned_lease_gives_its_owner_time_and_then_the_declared_action_runs() {
    for (action, words) in [
        (FailSafe::Stop, &[0][..]),
        (FailSafe::Coast, &[3]),
        (FailSafe::Hold, &[]),
    ] {
        let mut rig = running_with(action);
        rig.restart(leased(false));
        rig.pass(Duration::from_millis(2_900));
        assert_eq!(rig.writes().len(), 0, "its time is not over");
        let control = rig.view(0).control.unwrap();
        assert_eq!(
            (control.lease.unwrap().0, control.start_inhibited),
            (Owner::Mqtt, true)
        );
        assert_eq!(
            rig.commanded(plc(1), setpoint(2000)),
            (Outcome::Refused, Reason::OtherOwner)
        );
        rig.pass(Duration::from_millis(1_500));
        assert_eq!(rig.written(RUN), words, "{action:?}");
        assert_eq!(
            (failsafes(&rig), leases(&rig)),
            (vec![FailSafeCause::Orphaned], vec![None])
        );
        let note = DriveNote::Orphaned {
            owner: Owner::Mqtt,
            action,
        };
        assert!(
            rig.notes.iter().any(|(_, it)| *it == note),
            "{:?}",
            rig.notes
        );
        rig.pass(Duration::from_secs(20));
        assert_eq!(
            rig.output(1),
            if action == FailSafe::Hold { 3000 } else { 0 }
        );
    }
}

#[test]
fn its_owner_takes_an_orphaned_lease_up_by_a_sign_of_life() {
    for before_it_is_seen in [true, false] {
        let mut rig = running();
        rig.restart(leased(false));
        if !before_it_is_seen {
            rig.pass(Duration::from_secs(2));
        }
        rig.live(Duration::from_secs(10));
        assert_eq!(
            (rig.written(RUN), leases(&rig)),
            (vec![], vec![Some(Owner::Mqtt)])
        );
        rig.pass(Duration::from_secs(5));
        assert_eq!(
            (rig.written(RUN), failsafes(&rig)),
            (vec![0], vec![FailSafeCause::CommanderLost])
        );
    }
}

#[test]
fn in_a_crash_loop_the_declared_action_runs_at_once() {
    let mut rig = running();
    rig.restart(leased(true));
    rig.pass(Duration::from_millis(1_200));
    assert_eq!(
        (rig.written(RUN), failsafes(&rig)),
        (vec![0], vec![FailSafeCause::CrashLoop])
    );
    // An owner that returns before the drive is seen has not lost it.
    let mut rig = running();
    rig.restart(leased(true));
    rig.live(Duration::from_secs(5));
    assert_eq!(rig.writes().len(), 0);
}

#[test]
fn a_lease_of_a_drive_that_is_found_at_standstill_is_over() {
    let mut rig = Rig::new(&RigOptions {
        keeps: true,
        ..RigOptions::controlled()
    });
    rig.restart(leased(false));
    assert_eq!(
        rig.view(0).control.unwrap().lease.unwrap().0,
        Owner::Mqtt,
        "nobody else gets it before it is seen"
    );
    // It may have turned, and a moment of zeros proves nothing.
    rig.pass(Duration::from_secs(4));
    assert_eq!(
        (leases(&rig), rig.view(0).control.unwrap().lease),
        (vec![None], None)
    );
    rig.pass(Duration::from_secs(10));
    assert_eq!((rig.writes().len(), failsafes(&rig)), (0, vec![]));
}

#[test]
fn a_drive_that_another_party_has_started_is_left_alone() {
    let mut rig = running();
    rig.restart(RememberedDrive::default());
    rig.pass(Duration::from_secs(30));
    assert_eq!((rig.writes().len(), rig.output(1)), (0, 3000));
    assert_eq!(
        rig.commanded(plc(1), run(Direction::Forward, None)),
        (Outcome::Refused, Reason::StartInhibited)
    );
}

#[test]
fn a_remembered_stop_is_sent_only_to_a_drive_that_runs() {
    let mut rig = running();
    rig.restart(stopped());
    let wire: Vec<u8> = rig.sent.iter().map(|sent| sent.pdu[0]).collect();
    assert!(!wire.contains(&6), "it is read first");
    rig.pass(Duration::from_secs(1));
    assert_eq!(rig.written(RUN), [0]);
    rig.pass(Duration::from_secs(20));
    assert_eq!(rig.output(1), 0);
    let over = |rig: &Rig| {
        rig.entries()
            .iter()
            .any(|it| **it == JournalEntry::StopOver { is_effective: true })
    };
    assert!(over(&rig), "{:?}", rig.kept);
    rig.restart(stopped());
    rig.pass(Duration::from_secs(20));
    assert_eq!(
        (rig.writes().len(), over(&rig)),
        (0, true),
        "one that stands is not written to"
    );
    let alarm = |(_, note): &(_, DriveNote)| *note == DriveNote::StopNotSent;
    assert!(!rig.notes.iter().any(alarm), "{:?}", rig.notes);
}

#[test]
fn a_remembered_stop_of_a_drive_that_stays_away_is_dropped() {
    let mut rig = running();
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), false);
    rig.restart(stopped());
    rig.pass(Duration::from_secs(590));
    assert!(rig.view(0).control.unwrap().stop_pending);
    rig.pass(Duration::from_secs(20));
    assert!(!rig.view(0).control.unwrap().stop_pending);
    assert!(
        rig.notes
            .iter()
            .any(|(_, note)| *note == DriveNote::StopDropped),
        "{:?}",
        rig.notes
    );
    assert!(rig.entries().iter().any(|it| **it
        == JournalEntry::StopOver {
            is_effective: false
        }));
}

#[test]
fn a_trip_whose_row_was_lost_is_reported_once_more_and_a_kept_one_is_not() {
    for is_kept in [false, true] {
        let mut rig = running();
        rig.commanded(MQTT, STOP);
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, 5);
        rig.pass(Duration::from_secs(3));
        let count = Some(u16::from(is_kept));
        let trips = Some(TripBaseline {
            count,
            held: None,
            code: None,
        });
        rig.restart(RememberedDrive {
            trips,
            trips_total: 7,
            last_code: Some(2),
            ..RememberedDrive::default()
        });
        assert_eq!(rig.view(0).trip_kept.total, 7);
        rig.pass(Duration::from_secs(5));
        rig.all_is_kept();
        let kept = rig.view(0).trip_kept;
        let expected = if is_kept {
            (0, 7, Some(2))
        } else {
            (1, 8, Some(5))
        };
        assert_eq!((rig.trips.len(), kept.total, kept.last_code), expected);
        assert!(
            rig.trips.iter().all(|(_, event)| event.while_away),
            "{:?}",
            rig.trips
        );
    }
}

/// A message may have waited before the gateway since before a reload stopped the drive.
#[test]
fn a_line_that_a_reload_brings_takes_a_plain_run_after_a_while_and_that_of_a_start_at_once() {
    for (joins_late, reason) in [(true, Reason::RestartDelay), (false, Reason::None)] {
        let mut rig = Rig::new(&RigOptions::controlled());
        rig.setup.joins_late = joins_late;
        rig.restart(RememberedDrive::default());
        rig.pass(Duration::from_millis(1_500));
        assert_eq!(
            rig.commanded(MQTT, run(Direction::Forward, Some(3000))).1,
            reason
        );
        rig.live(ControlSettings::RESTART_DELAY);
        assert_eq!(
            rig.commanded(MQTT, run(Direction::Forward, Some(3000))).0,
            Outcome::Acknowledged
        );
    }
}

#[test]
fn a_run_of_an_earlier_life_is_never_sent() {
    let mut rig = Rig::new(&RigOptions {
        keeps: true,
        ..RigOptions::controlled()
    });
    rig.command(MQTT, 0, run(Direction::Forward, Some(3000)));
    rig.restart(leased(false));
    rig.core.handle(rig.now, LineInput::PathAlive(Owner::Mqtt));
    rig.live(Duration::from_secs(20));
    assert!(!rig.written(RUN).contains(&1), "{:?}", rig.written(RUN));
}

/// A remembered stop reads the drive first, because it may be at standstill for long. A stop that is ordered now does
/// not.
#[test]
fn a_stop_that_is_ordered_right_after_a_restart_waits_for_no_look() {
    let mut rig = running();
    rig.restart(stopped());
    let begun = rig.now;
    rig.command(plc(1), 0, STOP);
    rig.pass(Duration::from_millis(100));
    let first = rig.sent.first().expect("a frame");
    assert_eq!(first.pdu, [6, 0, 2, 0, 0]);
    assert!(
        first.at.since(begun) < Duration::from_millis(10),
        "only the silence before a frame: {:?}",
        first.at
    );
}
