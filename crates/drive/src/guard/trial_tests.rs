//! Trials: who may make them, and that nothing but the proof of one action is waived.

use super::tests::{NOW, RESTING, STOP, command, guard_of, mqtt, plc, reviewed, run};
use super::*;
use crate::domain::command::{
    CommandRequest, Direction, GoOrder, Order, OrderManner, Origin, Outcome, Owner, Reason,
    RegisterWrite, Rights,
};
use crate::domain::control::{ControlAction, ControlSettings, FailSafe};
use crate::domain::frequency::Hertz;
use crate::profile::model::{Confidence, Model};
use crate::vendors::testing::{control, model};

fn local() -> Origin {
    Origin {
        owner: Owner::Local,
        rights: Rights {
            write: true,
            stop: true,
        },
        manner: OrderManner::Once,
    }
}

fn unproven() -> Model {
    let mut unproven = model();
    let run = unproven.run.as_mut().unwrap();
    run.stop.confidence = Confidence::Inferred;
    for fact in [&mut run.reverse, &mut run.coast, &mut run.reset] {
        fact.as_mut().unwrap().confidence = Confidence::Inferred;
    }
    unproven
}

fn settings() -> ControlSettings {
    let directions = vec![Direction::Forward, Direction::Reverse];
    let on_commander_lost = FailSafe::Stop;
    ControlSettings {
        qualify: true,
        directions,
        on_commander_lost,
        restart_delay: std::time::Duration::ZERO,
        strict: false,
        ..control()
    }
}

fn trial(origin: Origin, order: Order, action: ControlAction) -> CommandRequest {
    CommandRequest {
        trial: Some(action),
        epoch: None,
        ..command(origin, order)
    }
}

const REFUSED: fn(Reason) -> Result<(), (Outcome, Reason)> =
    |reason| Err((Outcome::Refused, reason));

#[test]
fn only_the_local_socket_may_try_and_only_while_the_drive_is_qualified() {
    let forward = || run(Direction::Forward);
    for origin in [mqtt(), plc(1)] {
        let tried = reviewed(
            &mut guard_of(unproven(), settings()),
            &trial(origin, forward(), ControlAction::Basic),
        );
        assert_eq!(tried, REFUSED(Reason::NotAllowed), "{origin:?}");
    }
    for settings in [
        ControlSettings {
            qualify: false,
            ..settings()
        },
        ControlSettings {
            on_commander_lost: FailSafe::Hold,
            ..settings()
        },
    ] {
        let tried = reviewed(
            &mut guard_of(unproven(), settings),
            &trial(local(), forward(), ControlAction::Basic),
        );
        assert_eq!(tried, REFUSED(Reason::NotAllowed));
    }
    let mut guard = guard_of(unproven(), settings());
    assert_eq!(
        reviewed(&mut guard, &trial(local(), forward(), ControlAction::Basic)),
        Ok(())
    );
    assert_eq!(
        guard.lease().map(|(owner, until)| (owner, until > NOW)),
        Some((Owner::Local, true)),
        "it is leased"
    );
}

#[test]
fn a_mark_is_for_one_action_and_one_command() {
    let mut guard = guard_of(unproven(), settings());
    for (order, action) in [
        (Order::Coast, ControlAction::Basic),
        (Order::Reset, ControlAction::Coast),
        (Order::Release, ControlAction::Reset),
        (run(Direction::Reverse), ControlAction::Basic),
        (run(Direction::Forward), ControlAction::Reverse),
        (STOP, ControlAction::Basic),
    ] {
        assert_eq!(
            reviewed(&mut guard, &trial(local(), order.clone(), action)),
            REFUSED(Reason::Conflict),
            "{order:?}"
        );
    }
    assert_eq!(
        reviewed(
            &mut guard,
            &trial(local(), Order::Coast, ControlAction::Coast)
        ),
        Ok(())
    );
    assert_eq!(
        reviewed(&mut guard, &command(local(), Order::Coast)),
        REFUSED(Reason::Unverified),
        "the next has none"
    );
    assert_eq!(
        reviewed(&mut guard, &command(local(), STOP)),
        Ok(()),
        "a stop needs none"
    );
    let writes = vec![RegisterWrite::new(1_u16, 1)];
    let beside = Order::Go(GoOrder::new(writes, None, Some(Direction::Forward)).unwrap());
    let tried = reviewed(
        &mut guard_of(unproven(), settings()),
        &trial(local(), beside, ControlAction::Basic),
    );
    assert_eq!(
        tried,
        REFUSED(Reason::Conflict),
        "nothing else is written beside it"
    );
}

#[test]
fn everything_else_holds_in_a_trial() {
    let fast = Order::Go(
        GoOrder::new(
            Vec::new(),
            Some(Hertz::from_millihertz(9_000_000)),
            Some(Direction::Forward),
        )
        .unwrap(),
    );
    let tried = |settings: ControlSettings, order: &Order, action, facts: &DriveFacts| {
        let mut guard = guard_of(unproven(), settings);
        guard
            .review(&trial(local(), order.clone(), action), facts, NOW)
            .map(drop)
            .map_err(|report| report.reason)
    };
    let forward = run(Direction::Forward);
    let reverse = run(Direction::Reverse);
    let (basic, back) = (ControlAction::Basic, ControlAction::Reverse);
    assert_eq!(tried(settings(), &reverse, back, &RESTING), Ok(()));
    let forward_only = ControlSettings {
        directions: vec![Direction::Forward],
        ..settings()
    };
    assert_eq!(
        tried(forward_only, &reverse, back, &RESTING),
        Err(Reason::DirectionNotAllowed)
    );
    assert_eq!(
        tried(settings(), &fast, basic, &RESTING),
        Err(Reason::OutsideLimits)
    );
    for (facts, reason) in [
        (
            DriveFacts {
                line_is_up: false,
                ..RESTING
            },
            Reason::LineDown,
        ),
        (
            DriveFacts {
                line_is_bad: true,
                ..RESTING
            },
            Reason::LineQuality,
        ),
        (
            DriveFacts {
                is_offline: true,
                ..RESTING
            },
            Reason::Offline,
        ),
        (
            DriveFacts {
                stop_pending: true,
                ..RESTING
            },
            Reason::StopPending,
        ),
        (
            DriveFacts {
                tripped: Some(true),
                ..RESTING
            },
            Reason::Tripped,
        ),
        (
            DriveFacts {
                stop_refused: true,
                ..RESTING
            },
            Reason::StopRefused,
        ),
    ] {
        assert_eq!(
            tried(settings(), &forward, basic, &facts),
            Err(reason),
            "{facts:?}"
        );
    }
    let mut held = guard_of(unproven(), settings());
    held.lease.take(Owner::Mqtt, settings().lost_after, NOW);
    assert_eq!(
        reviewed(&mut held, &trial(local(), forward, basic)),
        REFUSED(Reason::OtherOwner)
    );
}
