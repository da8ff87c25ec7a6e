//! One owner at a time: others are refused, control is handed over or ends, and any client may stop.

use crate::support::families::{accepting, models, rig_of};
use crate::support::{MQTT, Rig, STOP, plc, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Owner, Reason, RunIntent};
use vfd_gateway::domain::control::{ControlSettings, LeaseMode, Ownership};
use vfd_gateway::gateway::{DriveNote, LineInput};
use vfd_gateway::profile::model::Model;

const SECOND: Duration = Duration::from_secs(1);

/// A drive of `model` that runs at 30 Hz for the MQTT side.
fn running(model: &Arc<Model>, control: ControlSettings) -> Rig {
    let mut rig = rig_of(model, control);
    let (outcome, reason) = rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    assert!(
        matches!(outcome, Outcome::Acknowledged | Outcome::Confirmed),
        "{}: {reason:?}",
        model.id
    );
    rig.live(SECOND * 6);
    rig.sent.clear();
    rig
}

fn owner(rig: &Rig) -> Option<Owner> {
    rig.view(0).control.unwrap().lease.map(|(owner, _)| owner)
}

#[test]
fn who_does_not_hold_control_commands_nothing_and_may_stop() {
    for model in models() {
        let mut rig = running(&model, accepting());
        for order in [
            setpoint(4000),
            run(Direction::Forward, None),
            Order::Reset,
            Order::Release,
        ] {
            assert_eq!(
                rig.commanded(plc(1), order),
                (Outcome::Refused, Reason::OtherOwner),
                "{}",
                model.id
            );
        }
        assert_eq!(
            (rig.writes(), owner(&rig)),
            (Vec::new(), Some(Owner::Mqtt)),
            "{}",
            model.id
        );
        assert_eq!(
            rig.commanded(plc(1), STOP).0,
            Outcome::Confirmed,
            "{}",
            model.id
        );
        assert_eq!(owner(&rig), None, "{}: that ends the lease", model.id);
        rig.live(SECOND * 30);
        assert_eq!(rig.output(1), 0, "{}", model.id);
    }
}

#[test]
fn control_that_is_taken_over_changes_nothing_on_the_drive() {
    for model in models() {
        let mut rig = running(
            &model,
            ControlSettings {
                allow_take: true,
                ..accepting()
            },
        );
        let output = rig.output(1);
        assert_eq!(
            rig.commanded(plc(1), Order::Take),
            (Outcome::Acknowledged, Reason::None),
            "{}",
            model.id
        );
        let taken = DriveNote::Taken {
            from: Some(Owner::Mqtt),
            by: plc(1).owner,
        };
        assert!(
            rig.notes.iter().any(|(_, note)| *note == taken),
            "{:?}",
            rig.notes
        );
        assert_eq!(
            (rig.writes(), owner(&rig)),
            (Vec::new(), Some(plc(1).owner)),
            "{}",
            model.id
        );
        assert_eq!(
            rig.view(0).control.unwrap().intent,
            RunIntent::Run(Direction::Forward)
        );
        assert_eq!(
            rig.commanded(MQTT, setpoint(4000)),
            (Outcome::Refused, Reason::OtherOwner)
        );
        assert!(rig.output(1) >= output, "{}", model.id);
        assert_ne!(
            rig.commanded(plc(1), setpoint(2000)).0,
            Outcome::Refused,
            "{}",
            model.id
        );
        // The former owner sends heartbeats, which no longer count.
        rig.live(SECOND * 40);
        assert_eq!(
            (rig.output(1), owner(&rig)),
            (0, None),
            "{}: the taker fell silent",
            model.id
        );
        let lost = rig.notes.iter().any(
            |(_, it)| matches!(it, DriveNote::CommanderLost { owner, .. } if *owner == plc(1).owner),
        );
        assert!(lost, "{:?}", rig.notes);
    }
}

#[test]
fn control_that_may_not_be_taken_stays_where_it_is() {
    for model in models() {
        let mut rig = running(&model, accepting());
        assert_eq!(
            rig.commanded(plc(1), Order::Take),
            (Outcome::Refused, Reason::NoTake),
            "{}",
            model.id
        );
        assert_eq!((rig.writes(), owner(&rig)), (Vec::new(), Some(Owner::Mqtt)));
    }
}

#[test]
fn what_the_one_before_has_ordered_and_not_begun_is_not_sent() {
    let model = &models()[0];
    let mut rig = running(
        model,
        ControlSettings {
            allow_take: true,
            ..accepting()
        },
    );
    let first = rig.command_unsettled(MQTT, 0, setpoint(3500));
    let second = rig.command_unsettled(MQTT, 0, Order::Renew);
    let take = rig.command_unsettled(plc(1), 0, Order::Take);
    rig.settle();
    assert_eq!(rig.outcome_of(take), (Outcome::Acknowledged, Reason::None));
    assert_eq!(
        rig.outcome_of(first),
        (Outcome::Refused, Reason::OtherOwner)
    );
    assert_eq!(rig.outcome_of(second).0, Outcome::Acknowledged);
    rig.pass(SECOND);
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
}

#[test]
fn a_drive_that_nobody_holds_and_that_rests_is_not_taken() {
    for model in models() {
        let mut rig = rig_of(
            &model,
            ControlSettings {
                allow_take: true,
                ..accepting()
            },
        );
        assert_eq!(
            rig.commanded(plc(1), Order::Take),
            (Outcome::Acknowledged, Reason::Unchanged),
            "{}",
            model.id
        );
        assert_eq!((owner(&rig), rig.writes()), (None, Vec::new()));
    }
}

#[test]
fn where_anybody_may_command_the_last_one_holds_control() {
    for model in models() {
        let mut rig = running(
            &model,
            ControlSettings {
                ownership: Ownership::Any,
                ..accepting()
            },
        );
        assert_ne!(
            rig.commanded(plc(1), setpoint(2000)).0,
            Outcome::Refused,
            "{}",
            model.id
        );
        assert_eq!(owner(&rig), Some(plc(1).owner), "{}", model.id);
        rig.live(SECOND * 40);
        assert_eq!(
            (rig.output(1), owner(&rig)),
            (0, None),
            "{}: the last one fell silent",
            model.id
        );
    }
}

#[test]
fn an_explicit_lease_does_not_live_by_the_way_alone() {
    for (lease, still) in [(LeaseMode::Session, true), (LeaseMode::Explicit, false)] {
        let model = &models()[0];
        let mut rig = rig_of(
            model,
            ControlSettings {
                lease,
                ..accepting()
            },
        );
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        rig.live(SECOND * 3 + ControlSettings::RESTART_DELAY);
        assert_eq!(owner(&rig).is_some(), still, "{lease:?}");
        if still {
            continue;
        }
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        for _ in 0..5 {
            rig.pass(SECOND);
            rig.core.handle(rig.now, LineInput::PathAlive(Owner::Mqtt));
            rig.command(MQTT, 0, Order::Renew);
        }
        assert_eq!(owner(&rig), Some(Owner::Mqtt), "it says so itself");
    }
}
