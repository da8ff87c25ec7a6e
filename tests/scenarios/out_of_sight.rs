//! A motor that was not seen to stand may still run: that is kept and told until the drive is seen again or a person
//! confirms that it stands, and a declared action is never called further than it has come.

use crate::support::{MQTT, Rig, RigOptions, STOP, control, plc, run};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Origin, Outcome, Owner};
use vfd_gateway::domain::control::{ControlSettings, FailSafe};
use vfd_gateway::domain::fail_safe::{FailSafeCause, FailSafeStage};
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::DriveIndex;
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::domain::time::WallTime;
use vfd_gateway::drive::sight::{LastSeen, SeenAt, SightView};
use vfd_gateway::drive::view::RunState;
use vfd_gateway::gateway::{DriveNote, LineInput};
use vfd_gateway::journal::{JournalEntry, RememberedDrive, RememberedLease};
use vfd_gateway::sim::FaultPlan;

const RUN: u16 = 0x0002;
/// The lease of the rig's control section.
const LOST_AFTER: Duration = Duration::from_secs(10);

fn running_by(origin: Origin, action: FailSafe) -> Rig {
    let settings = ControlSettings {
        on_commander_lost: action,
        lost_after: LOST_AFTER,
        ..control()
    };
    let mut rig = Rig::new(&RigOptions {
        keeps: true,
        control: Some(settings),
        ..RigOptions::controlled()
    });
    if origin != MQTT {
        rig.commanded(origin, STOP);
    }
    rig.command(origin, 0, run(Direction::Forward, Some(3000)));
    for _ in 0..6 {
        rig.pass(Duration::from_secs(2));
        rig.command(origin, 0, Order::Renew);
    }
    assert_eq!(rig.output(1), 3000);
    rig
}

fn stage(rig: &Rig) -> Option<(FailSafeCause, FailSafeStage)> {
    rig.view(0)
        .control
        .unwrap()
        .failsafe
        .map(|run| (run.cause, run.stage))
}

fn seen(rig: &Rig) -> (bool, Option<(RunState, Option<Hertz>)>) {
    let SightView {
        last_seen,
        may_still_run,
    } = rig.view(0).sight;
    (
        may_still_run,
        last_seen.map(|seen| (seen.run_state, seen.output)),
    )
}

const THIRTY: Option<(RunState, Option<Hertz>)> =
    Some((RunState::Forward, Some(Hertz::from_millihertz(30_000))));

/// The client goes on renewing, which is refused, for `time`.
fn renew_in_vain(rig: &mut Rig, origin: Origin, time: Duration) {
    let end = rig.now + time;
    while rig.now < end {
        let ticket = rig.command(origin, 0, Order::Renew);
        rig.pass(Duration::from_millis(500));
        assert_eq!(rig.outcome_of(ticket).0, Outcome::Refused);
    }
}

#[test]
fn a_pulled_cable_leaves_what_was_last_seen_and_a_commander_that_is_there() {
    let mut rig = running_by(plc(1), FailSafe::Stop);
    assert_eq!(rig.view(0).sight, SightView::default());
    rig.close(LineFault::Gone);
    assert_eq!(seen(&rig), (true, THIRTY));
    assert!(
        rig.notes
            .iter()
            .any(|(_, note)| matches!(note, DriveNote::MayStillRun(Some(_)))),
        "{:?}",
        rig.notes
    );
    assert_eq!(stage(&rig), None);
    let sent = rig.sent.len();
    renew_in_vain(&mut rig, plc(1), LOST_AFTER + Duration::from_secs(5));
    // What is declared is due, because the drive could not be reached and not because its client was lost; nothing left.
    assert_eq!(
        stage(&rig),
        Some((FailSafeCause::OutOfReach, FailSafeStage::Due))
    );
    assert_eq!(rig.sent.len(), sent);
    let note = DriveNote::OutOfReach {
        owner: plc(1).owner,
        action: FailSafe::Stop,
    };
    assert!(
        rig.notes.iter().any(|(_, it)| *it == note),
        "{:?}",
        rig.notes
    );
    assert!(!rig.notes.iter().any(|(_, it)| matches!(
        it,
        DriveNote::CommanderLost { .. } | DriveNote::NotEffective
    )));
    assert!(
        rig.notes
            .iter()
            .any(|(_, it)| *it == DriveNote::StopNotSent),
        "{:?}",
        rig.notes
    );
    let control = rig.view(0).control.unwrap();
    assert!(
        control.stop_pending && !control.not_effective,
        "a stop that was not sent is not without effect"
    );
    assert_eq!(seen(&rig), (true, THIRTY), "it is not forgotten");
    rig.open();
    let end = rig.now + Duration::from_secs(2);
    while stage(&rig).is_some_and(|(_, stage)| stage == FailSafeStage::Due) && rig.now < end {
        rig.pass(Duration::from_millis(1));
    }
    assert_eq!(
        stage(&rig),
        Some((FailSafeCause::OutOfReach, FailSafeStage::Sent))
    );
    rig.pass(Duration::from_secs(40));
    assert_eq!(
        stage(&rig),
        Some((FailSafeCause::OutOfReach, FailSafeStage::Effective))
    );
    assert_eq!(
        (rig.output(1), rig.view(0).sight),
        (0, SightView::default())
    );
    let stages: Vec<_> = rig.entries().into_iter().filter_map(stage_in).collect();
    assert_eq!(
        stages,
        [
            FailSafeStage::Due,
            FailSafeStage::Sent,
            FailSafeStage::Effective
        ],
        "as the journal has it"
    );
    let sights = rig.entries().into_iter().filter(|it| {
        matches!(
            it,
            JournalEntry::OutOfSight { .. } | JournalEntry::InSight { .. }
        )
    });
    assert_eq!(sights.count(), 2);
}

/// The process was suspended before the write, or the adapter was unplugged right then.
#[test]
fn a_stop_that_was_decided_on_and_not_written_was_not_sent() {
    let mut rig = running_by(MQTT, FailSafe::Stop);
    rig.port_is_stuck = true;
    rig.pass(LOST_AFTER + Duration::from_secs(5));
    assert_eq!(
        stage(&rig),
        Some((FailSafeCause::CommanderLost, FailSafeStage::Due))
    );
    assert!(
        rig.notes
            .iter()
            .any(|(_, it)| *it == DriveNote::StopNotSent),
        "{:?}",
        rig.notes
    );
    assert!(
        !rig.notes
            .iter()
            .any(|(_, it)| *it == DriveNote::NotEffective),
        "{:?}",
        rig.notes
    );
    rig.port_is_stuck = false;
    rig.pass(Duration::from_secs(20));
    assert_eq!(
        stage(&rig),
        Some((FailSafeCause::CommanderLost, FailSafeStage::Effective))
    );
    assert_eq!(rig.output(1), 0);
}

fn stage_in(entry: &JournalEntry) -> Option<FailSafeStage> {
    match entry {
        JournalEntry::FailSafe { .. } => Some(FailSafeStage::Due),
        JournalEntry::FailSafeCame(run) => Some(run.stage),
        _ => None,
    }
}

#[test]
fn a_client_that_falls_silent_while_the_line_is_down_is_a_lost_commander() {
    let mut rig = running_by(plc(1), FailSafe::Stop);
    rig.close(LineFault::Gone);
    rig.pass(LOST_AFTER + Duration::from_secs(1));
    assert_eq!(
        stage(&rig),
        Some((FailSafeCause::CommanderLost, FailSafeStage::Due))
    );
}

#[test]
fn a_drive_that_falls_silent_while_it_runs_may_still_run() {
    let mut rig = running_by(plc(1), FailSafe::Stop);
    rig.bus.set_faults("lost=1000".parse().unwrap());
    rig.pass(Duration::from_secs(8));
    assert_eq!(seen(&rig), (true, THIRTY));
    renew_in_vain(&mut rig, plc(1), LOST_AFTER);
    assert_eq!(
        stage(&rig).map(|(cause, _)| cause),
        Some(FailSafeCause::OutOfReach)
    );
    rig.bus.set_faults("lost=0".parse().unwrap());
    rig.pass(Duration::from_secs(60));
    assert_eq!((seen(&rig), rig.output(1)), ((false, None), 0));
    assert_eq!(
        stage(&rig),
        Some((FailSafeCause::OutOfReach, FailSafeStage::Effective))
    );
}

#[test]
fn a_drive_that_was_seen_at_standstill_does_not_run() {
    let mut rig = running_by(MQTT, FailSafe::Stop);
    assert_eq!(rig.commanded(MQTT, STOP).0, Outcome::Confirmed);
    rig.pass(Duration::from_millis(500));
    assert!(rig.output(1) > 0, "on its ramp");
    rig.close(LineFault::Gone);
    assert!(seen(&rig).0, "a ramp is no standstill");
    rig.open();
    rig.pass(Duration::from_secs(30));
    rig.close(LineFault::Gone);
    assert_eq!(
        seen(&rig),
        (false, Some((RunState::Stopped, Some(Hertz::ZERO))))
    );
}

#[test]
fn an_order_to_run_that_may_have_arrived_counts_as_run() {
    for was_sent in [false, true] {
        let mut rig = Rig::new(&RigOptions::controlled());
        rig.pass(Duration::from_secs(3));
        rig.command_unsettled(MQTT, 0, run(Direction::Forward, Some(3000)));
        let end = rig.now + Duration::from_secs(1);
        while was_sent && rig.written(RUN).is_empty() && rig.now < end {
            rig.pass(Duration::from_millis(1));
        }
        assert_eq!(rig.written(RUN).len(), usize::from(was_sent));
        rig.close(LineFault::Gone);
        assert_eq!(seen(&rig).0, was_sent);
    }
}

#[test]
fn a_person_confirms_that_it_stands_and_that_sends_nothing_and_cancels_nothing() {
    let mut rig = running_by(MQTT, FailSafe::Stop);
    rig.close(LineFault::Gone);
    let sent = rig.sent.len();
    rig.command(plc(2), 0, STOP);
    rig.core.handle(
        rig.now,
        LineInput::ConfirmStandstill(DriveIndex(0), Owner::Local),
    );
    rig.settle();
    assert_eq!(seen(&rig), (false, THIRTY));
    let confirmed = JournalEntry::InSight {
        confirmed_by: Some(Owner::Local),
    };
    assert_eq!(
        rig.entries()
            .into_iter()
            .filter(|it| **it == confirmed)
            .count(),
        1
    );
    rig.core.handle(
        rig.now,
        LineInput::ConfirmStandstill(DriveIndex(0), Owner::Local),
    );
    assert_eq!(
        rig.entries()
            .into_iter()
            .filter(|it| **it == confirmed)
            .count(),
        1,
        "there is nothing left to confirm"
    );
    assert!(rig.sent.len() == sent && rig.view(0).control.unwrap().stop_pending);
    rig.open();
    rig.pass(Duration::from_secs(40));
    assert_eq!(
        (rig.written(RUN).last(), rig.output(1)),
        (Some(&0), 0),
        "the stop was sent all the same"
    );
}

#[test]
fn a_restart_does_not_forget_what_was_not_seen_to_stand() {
    let at = SeenAt::Before(WallTime {
        unix_ms: 1_700_000_000_000,
    });
    let last_seen = Some(LastSeen {
        run_state: RunState::Forward,
        output: Some(Hertz::from_millihertz(30_000)),
        at,
    });
    let told = RememberedDrive {
        may_still_run: true,
        last_seen,
        ..RememberedDrive::default()
    };
    // A process that is killed while the drive runs has told nothing; it held a lease.
    let lease = Some(RememberedLease {
        owner: Owner::Mqtt,
        was_orphaned: false,
    });
    let leased = RememberedDrive {
        lease,
        ..RememberedDrive::default()
    };
    for (remembered, shown) in [
        (told, (true, THIRTY)),
        (leased, (true, None)),
        (RememberedDrive::default(), (false, None)),
    ] {
        let mut rig = running_by(MQTT, FailSafe::Stop);
        rig.restart(remembered);
        rig.close(LineFault::Gone);
        assert_eq!(seen(&rig), shown);
        rig.open();
        rig.pass(Duration::from_secs(2));
        assert_eq!(seen(&rig), (false, None), "it is in sight");
    }
}

#[test]
fn an_open_session_renews_nothing_while_the_drive_is_out_of_reach() {
    let mut rig = running_by(MQTT, FailSafe::Stop);
    rig.bus.set_faults("lost=1000".parse().unwrap());
    rig.live(LOST_AFTER * 2);
    assert_eq!(rig.view(0).run_state, RunState::Offline);
    // It may hear what it does not answer.
    assert_eq!(
        stage(&rig),
        Some((FailSafeCause::OutOfReach, FailSafeStage::Sent)),
        "as for a client whose orders are refused"
    );
    rig.bus.set_faults(FaultPlan::NONE);
    rig.live(Duration::from_secs(40));
    assert_eq!(
        (rig.output(1), stage(&rig)),
        (
            0,
            Some((FailSafeCause::OutOfReach, FailSafeStage::Effective))
        )
    );
}
