//! Reviews that need a model or a moment that no simulated drive provides.

use super::*;
use crate::domain::address::Address;
use crate::domain::command::{
    CommandRequest, Direction, GoOrder, Order, OrderManner, Origin, Outcome, Owner, Reason,
    RegisterWrite, Report, Rights, RunIntent,
};
use crate::domain::control::{ControlAction, ControlSettings, FailSafe};
use crate::domain::frequency::Hertz;
use crate::domain::ids::{AskerId, CommanderName, DriveIndex, Ticket};
use crate::domain::time::MonoTime;
use crate::profile::model::{Confidence, Model};
use crate::vendors::testing::{control, fact, model, setup};
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::time::Duration;

pub(super) const NOW: MonoTime = MonoTime::from_millis(100_000);
pub(super) const STOP: Order = Order::Stop { setpoint: None };
pub(super) const RESTING: DriveFacts = DriveFacts {
    line_is_up: true,
    listens: false,
    line_is_bad: false,
    is_offline: false,
    is_implausible: false,
    stop_pending: false,
    tripped: Some(false),
    at_standstill: true,
    rests: true,
    stop_refused: false,
    output: Some(Hertz::ZERO),
    turns: None,
    is_local: None,
    is_watched: false,
};

pub(super) fn plc(last: u8) -> Origin {
    let owner = Owner::ModbusTcp(IpAddr::V4(Ipv4Addr::new(10, 0, 0, last)));
    Origin {
        owner,
        rights: Rights {
            write: true,
            stop: true,
        },
        manner: OrderManner::Cyclic,
    }
}

pub(super) fn mqtt() -> Origin {
    Origin {
        owner: Owner::Mqtt,
        manner: OrderManner::Once,
        ..plc(0)
    }
}

pub(super) fn command(origin: Origin, order: Order) -> CommandRequest {
    CommandRequest {
        asker: AskerId(1),
        ticket: Ticket(1),
        drive: DriveIndex(0),
        origin,
        order,
        start_before: NOW + Duration::from_secs(1),
        issued: None,
        epoch: None,
        trial: None,
    }
}

pub(super) fn run(direction: Direction) -> Order {
    Order::Go(
        GoOrder::new(
            Vec::new(),
            Some(Hertz::from_centihertz(2000)),
            Some(direction),
        )
        .unwrap(),
    )
}

pub(super) fn guard_of(model: Model, control: ControlSettings) -> DriveGuard {
    DriveGuard::new(Arc::new(model), Some(Arc::new(control)), 7, MonoTime::ZERO)
}

pub(super) fn reviewed(
    guard: &mut DriveGuard,
    command: &CommandRequest,
) -> Result<(), (Outcome, Reason)> {
    let verdict = guard.review(command, &RESTING, NOW);
    verdict.map(drop).map_err(
        |Report {
             outcome, reason, ..
         }| (outcome, reason),
    )
}

#[test]
fn an_unproven_fact_carries_an_action_only_where_that_is_accepted() {
    let mut unproven = model();
    let run_facts = unproven.run.as_mut().unwrap();
    for fact in [
        &mut run_facts.reverse,
        &mut run_facts.coast,
        &mut run_facts.reset,
    ] {
        fact.as_mut().unwrap().confidence = Confidence::Inferred;
    }
    let facts = DriveFacts {
        tripped: Some(true),
        ..RESTING
    };
    for (order, action) in [
        (run(Direction::Reverse), ControlAction::Reverse),
        (Order::Coast, ControlAction::Coast),
        (Order::Reset, ControlAction::Reset),
    ] {
        let facts = if order == Order::Reset {
            facts
        } else {
            RESTING
        };
        let mut strict = guard_of(unproven.clone(), control());
        let refusal = strict
            .review(&command(mqtt(), order.clone()), &facts, NOW)
            .unwrap_err();
        assert_eq!(refusal, Report::refused(Reason::Unverified), "{order:?}");
        let settings = ControlSettings {
            accept_unverified: vec![action],
            ..control()
        };
        let mut accepting = guard_of(unproven.clone(), settings);
        assert!(
            accepting
                .review(&command(mqtt(), order), &facts, NOW)
                .is_ok()
        );
    }
}

#[test]
fn a_motor_whose_stop_is_unproven_is_not_started_and_may_always_be_stopped() {
    let mut unproven = model();
    unproven.run.as_mut().unwrap().stop.confidence = Confidence::ThirdParty;
    let setpoint =
        Order::Go(GoOrder::new(Vec::new(), Some(Hertz::from_centihertz(2000)), None).unwrap());
    let orders = [run(Direction::Forward), run(Direction::Reverse), setpoint];
    for order in orders {
        let mut strict = guard_of(unproven.clone(), control());
        let refusal = reviewed(&mut strict, &command(mqtt(), order.clone()));
        assert_eq!(
            refusal,
            Err((Outcome::Refused, Reason::Unverified)),
            "{order:?}"
        );
        assert_eq!(reviewed(&mut strict, &command(mqtt(), STOP)), Ok(()));
        let settings = ControlSettings {
            accept_unverified: vec![ControlAction::Basic],
            ..control()
        };
        let mut accepting = guard_of(unproven.clone(), settings);
        assert_eq!(reviewed(&mut accepting, &command(mqtt(), order)), Ok(()));
    }
}

#[test]
fn what_a_model_cannot_do_is_refused_by_name_and_stop_never_stands_in_for_coast() {
    let mut plain = model();
    let run_facts = plain.run.as_mut().unwrap();
    run_facts.reverse = None;
    run_facts.coast = None;
    run_facts.reset = None;
    let mut guard = guard_of(plain, control());
    for order in [run(Direction::Reverse), Order::Coast] {
        assert_eq!(
            reviewed(&mut guard, &command(mqtt(), order)),
            Err((Outcome::Refused, Reason::NotCapable))
        );
    }
    assert_eq!(guard.stops(), 0);
}

#[test]
fn a_run_that_fails_after_one_that_holds_does_not_make_a_stop_change_nothing() {
    for is_sure in [true, false] {
        let mut guard = guard_of(model(), control());
        assert!(matches!(
            guard.review(&command(plc(1), STOP), &RESTING, NOW),
            Ok(CommandVerdict::Stop(_))
        ));
        assert_eq!(
            reviewed(&mut guard, &command(plc(1), run(Direction::Forward))),
            Ok(())
        );
        if is_sure {
            guard.run_was_acknowledged(Direction::Forward);
        } else {
            guard.run_is_unknown(Direction::Forward);
        }
        // Another setpoint and RUN that was never sent.
        let other = GoOrder::new(
            Vec::new(),
            Some(Hertz::from_centihertz(3000)),
            Some(Direction::Forward),
        )
        .unwrap();
        let again = Origin {
            manner: OrderManner::Once,
            ..plc(1)
        };
        let later = CommandRequest {
            issued: Some(NOW + Duration::from_millis(1)),
            ..command(again, Order::Go(other))
        };
        assert_eq!(reviewed(&mut guard, &later), Ok(()));
        guard.run_failed(Direction::Forward, None);
        assert_eq!(
            guard.intent(),
            RunIntent::Run(Direction::Forward),
            "the motor runs"
        );
        assert!(matches!(
            guard.review(&command(plc(1), STOP), &RESTING, NOW),
            Ok(CommandVerdict::Stop(_))
        ));
        assert_eq!(guard.intent(), RunIntent::Stop);
    }
}

#[test]
fn strict_messages_must_say_what_they_have_seen() {
    let mut guard = guard_of(
        model(),
        ControlSettings {
            strict: true,
            ..control()
        },
    );
    let plain = command(mqtt(), run(Direction::Forward));
    assert_eq!(
        reviewed(&mut guard, &plain),
        Err((Outcome::Refused, Reason::EpochNeeded))
    );
    let stale = CommandRequest {
        epoch: Some(6),
        ..plain.clone()
    };
    assert_eq!(
        reviewed(&mut guard, &stale),
        Err((Outcome::Refused, Reason::StaleEpoch))
    );
    assert_eq!(
        reviewed(
            &mut guard,
            &CommandRequest {
                epoch: Some(7),
                ..plain
            }
        ),
        Ok(())
    );
}

#[test]
fn a_moment_of_issue_counts_only_after_the_last_stop_inhibit_or_start_of_the_gateway() {
    let issued = |at| CommandRequest {
        issued: Some(at),
        ..command(mqtt(), run(Direction::Forward))
    };
    let until_then = issued(NOW);
    let after = issued(NOW + Duration::from_millis(1));
    let stale = Err((Outcome::Refused, Reason::Stale));
    for strict in [false, true] {
        let settings = || ControlSettings {
            strict,
            ..control()
        };
        let mut stopped = guard_of(model(), settings());
        assert_eq!(reviewed(&mut stopped, &command(mqtt(), STOP)), Ok(()));
        let mut inhibited = guard_of(model(), settings());
        inhibited.inhibit(NOW);
        let new = DriveGuard::new(Arc::new(model()), Some(Arc::new(settings())), 7, NOW);
        for mut guard in [stopped, inhibited, new] {
            assert_eq!(reviewed(&mut guard, &until_then), stale);
            assert_eq!(reviewed(&mut guard, &after), Ok(()));
        }
    }
}

#[test]
fn who_has_not_stopped_the_drive_may_not_start_it_and_the_memory_of_that_is_bounded() {
    let mut guard = guard_of(model(), control());
    let refused = Err((Outcome::Refused, Reason::StartInhibited));
    assert_eq!(
        reviewed(&mut guard, &command(plc(1), run(Direction::Forward))),
        refused
    );
    for client in 1..=255 {
        assert_eq!(reviewed(&mut guard, &command(plc(client), STOP)), Ok(()));
    }
    assert_eq!(
        reviewed(&mut guard, &command(plc(1), run(Direction::Forward))),
        refused,
        "others stopped it since"
    );
    assert_eq!(
        reviewed(&mut guard, &command(plc(255), run(Direction::Forward))),
        Ok(())
    );
}

#[test]
fn a_stop_raises_the_epoch_and_voids_what_was_approved() {
    let mut guard = guard_of(model(), control());
    let Ok(CommandVerdict::Go(approved)) =
        guard.review(&command(mqtt(), run(Direction::Forward)), &RESTING, NOW)
    else {
        panic!("approved")
    };
    assert_eq!(approved.may_go(false, NOW, guard.stops()), Ok(()));
    assert_eq!(
        approved.may_go(false, NOW + Duration::from_secs(1), guard.stops()),
        Err(VoidApproval::TooLate)
    );
    assert_eq!(
        approved.may_go(true, NOW + Duration::from_secs(1), guard.stops()),
        Ok(()),
        "a command that has begun continues"
    );
    let epoch = guard.epoch();
    assert_eq!(reviewed(&mut guard, &command(plc(1), STOP)), Ok(()));
    assert_eq!(
        approved.may_go(true, NOW, guard.stops()),
        Err(VoidApproval::Stopped)
    );
    assert!(guard.epoch() > epoch);
}

#[test]
fn a_lease_that_runs_out_over_a_resting_drive_does_nothing_to_it() {
    let mut guard = guard_of(model(), control());
    let setpoint =
        Order::Go(GoOrder::new(Vec::new(), Some(Hertz::from_centihertz(2000)), None).unwrap());
    reviewed(&mut guard, &command(mqtt(), run(Direction::Forward))).unwrap();
    reviewed(&mut guard, &command(mqtt(), STOP)).unwrap();
    let (_, until) = guard.lease().unwrap();
    assert_eq!(
        guard.expire(until, true),
        None,
        "it was stopped and stands still"
    );
    assert_eq!((guard.lease(), guard.is_start_inhibited()), (None, true));
    reviewed(&mut guard, &command(mqtt(), setpoint)).unwrap();
    assert_eq!(
        guard.lease(),
        None,
        "a setpoint for a resting drive takes no control"
    );
}

#[test]
fn a_lease_that_runs_out_over_a_moving_drive_brings_the_declared_action() {
    for action in [FailSafe::Stop, FailSafe::Coast, FailSafe::Hold] {
        let mut guard = guard_of(
            model(),
            ControlSettings {
                on_commander_lost: action,
                ..control()
            },
        );
        reviewed(&mut guard, &command(mqtt(), run(Direction::Forward))).unwrap();
        let (_, until) = guard.lease().unwrap();
        assert_eq!(
            guard.expire(until.before(Duration::from_nanos(1)), false),
            None
        );
        let lost = guard.expire(until, false).unwrap();
        assert_eq!((lost.owner, lost.action), (Some(Owner::Mqtt), action));
        assert_eq!(lost.order.is_some(), action != FailSafe::Hold);
        assert_eq!(
            guard.intent() == RunIntent::Coast,
            action == FailSafe::Coast
        );
        assert!(guard.fail_safe().is_some());
    }
}

pub(super) fn register(address: Address, value: u16) -> Order {
    Order::Go(GoOrder::new(vec![RegisterWrite::new(address, value)], None, None).unwrap())
}

/// The verdict on `order` of a local client with these facts.
pub(super) fn judged(
    guard: &mut DriveGuard,
    order: Order,
    facts: DriveFacts,
) -> Result<CommandVerdict, Reason> {
    let local = Origin {
        owner: Owner::Local,
        ..mqtt()
    };
    guard
        .review(&command(local, order), &facts, NOW)
        .map_err(|report| report.reason)
}

#[test]
fn a_register_that_commands_is_no_parameter_even_if_it_is_listed() {
    let mut with_door = model();
    let ramp = with_door
        .registers
        .iter_mut()
        .find(|register| register.address == 0x020E)
        .unwrap();
    ramp.back_door = Some("another way in".to_owned());
    let ramp = with_door
        .registers
        .iter_mut()
        .find(|register| register.address == 0x020C)
        .unwrap();
    ramp.range = Some(1..=30_000);
    let everything = ControlSettings {
        native_write: (0..=u16::MAX).collect(),
        ..control()
    };
    for (address, value, reason) in [
        (0x0002, 1, Reason::NotAllowed),
        (0x0002, 0, Reason::NotAllowed),
        (0x0002, 9, Reason::NotUnderstood),
        (0x0004, 2000, Reason::NotAllowed),
        (0x0201, 2000, Reason::NotListed),
        (0x0211, 3, Reason::NotAllowed),
        (0x0212, 3, Reason::NotAllowed),
        (0x020E, 7, Reason::NotAllowed),
        (0x1234, 1, Reason::NotListed),
        (0x020C, 0, Reason::OutsideRange),
    ] {
        let mut guard = guard_of(with_door.clone(), everything.clone());
        let verdict = reviewed(
            &mut guard,
            &command(mqtt(), register(address.into(), value)),
        );
        assert_eq!(verdict, Err((Outcome::Refused, reason)), "{address:04X}");
    }
    let mut guard = guard_of(with_door.clone(), everything);
    assert_eq!(
        reviewed(
            &mut guard,
            &command(mqtt(), register(0x020C_u16.into(), 100))
        ),
        Ok(())
    );
    let mut unlisted = guard_of(
        with_door,
        ControlSettings {
            native_write: Vec::new(),
            ..control()
        },
    );
    let verdict = reviewed(
        &mut unlisted,
        &command(mqtt(), register(0x020C_u16.into(), 100)),
    );
    assert_eq!(verdict, Err((Outcome::Refused, Reason::NotListed)));
}

#[test]
fn a_reset_goes_to_a_tripped_drive_or_to_one_that_stands_still_and_may_be() {
    let moving = DriveFacts {
        at_standstill: false,
        ..RESTING
    };
    for (facts, runs, expected) in [
        (
            DriveFacts {
                tripped: Some(true),
                ..RESTING
            },
            false,
            Ok(()),
        ),
        (
            DriveFacts {
                tripped: Some(true),
                ..moving
            },
            false,
            Ok(()),
        ),
        (
            DriveFacts {
                tripped: None,
                ..RESTING
            },
            false,
            Ok(()),
        ),
        (
            DriveFacts {
                tripped: None,
                ..RESTING
            },
            true,
            Err(Reason::NotTripped),
        ),
        (
            DriveFacts {
                tripped: None,
                ..moving
            },
            false,
            Err(Reason::NotTripped),
        ),
        (RESTING, false, Err(Reason::NotTripped)),
        (
            DriveFacts {
                tripped: Some(true),
                stop_pending: true,
                ..RESTING
            },
            false,
            Err(Reason::StopPending),
        ),
    ] {
        let mut guard = guard_of(model(), control());
        if runs {
            let local = Origin {
                owner: Owner::Local,
                ..mqtt()
            };
            reviewed(&mut guard, &command(local, run(Direction::Forward))).unwrap();
        }
        let verdict = judged(&mut guard, Order::Reset, facts).map(drop);
        assert_eq!(verdict, expected, "{facts:?}, ordered to run {runs}");
    }
    let mut guard = guard_of(model(), control());
    let cyclic = guard.review(&command(plc(1), Order::Reset), &RESTING, NOW);
    assert!(
        matches!(cyclic, Ok(CommandVerdict::Unchanged)),
        "a controller that holds the value: {cyclic:?}"
    );
    let late = command(mqtt(), Order::Reset);
    let facts = DriveFacts {
        tripped: Some(true),
        ..RESTING
    };
    let refusal = guard.review(&late, &facts, late.start_before).unwrap_err();
    assert_eq!(
        (refusal.outcome, refusal.reason),
        (Outcome::Expired, Reason::TooLate)
    );
}

#[test]
fn what_the_motor_obeys_changes_only_while_nothing_is_ordered_and_nothing_turns() {
    let mut able = model();
    able.run.as_mut().unwrap().release = Some(fact(9));
    able.setup = setup();
    let settings = ControlSettings {
        allow_release: true,
        ..control()
    };
    let addresses = || Order::Setup(vec![0x0211_u16.into()]);
    for order in [Order::Release, addresses()] {
        for (facts, reason) in [
            (
                DriveFacts {
                    at_standstill: false,
                    ..RESTING
                },
                Reason::Moving,
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
                    is_offline: true,
                    ..RESTING
                },
                Reason::Offline,
            ),
            (
                DriveFacts {
                    is_implausible: true,
                    ..RESTING
                },
                Reason::Implausible,
            ),
            (
                DriveFacts {
                    line_is_up: false,
                    ..RESTING
                },
                Reason::LineDown,
            ),
        ] {
            let verdict = judged(
                &mut guard_of(able.clone(), settings.clone()),
                order.clone(),
                facts,
            )
            .map(drop);
            assert_eq!(verdict, Err(reason), "{order:?}");
        }
        let mut guard = guard_of(able.clone(), settings.clone());
        judged(&mut guard, run(Direction::Forward), RESTING).unwrap();
        let verdict = judged(&mut guard, order.clone(), RESTING).map(drop);
        assert_eq!(
            verdict,
            Err(Reason::Moving),
            "{order:?}: the order to run may not have reached the motor yet"
        );
        let mut guard = guard_of(able.clone(), settings.clone());
        assert!(matches!(
            judged(&mut guard, order, RESTING),
            Ok(CommandVerdict::Go(_))
        ));
    }
    let mut guard = guard_of(able.clone(), settings);
    assert_eq!(
        judged(&mut guard, Order::Setup(Vec::new()), RESTING).map(drop),
        Err(Reason::NotUnderstood)
    );
    for (origin, reason) in [(mqtt(), Reason::NotFromHere), (plc(1), Reason::NotFromHere)] {
        let verdict = reviewed(&mut guard, &command(origin, addresses()));
        assert_eq!(verdict, Err((Outcome::Refused, reason)));
    }
    let mut closed = guard_of(able, control());
    assert_eq!(
        judged(&mut closed, Order::Release, RESTING).map(drop),
        Err(Reason::NoRelease)
    );
}

#[test]
fn anyone_who_is_signed_in_commands_where_the_drive_says_so() {
    let by = |name| Origin {
        owner: Owner::Page(CommanderName::new(name).unwrap()),
        ..mqtt()
    };
    let anna = by("anna");
    let bob = by("bob");
    let mut guard = guard_of(
        model(),
        ControlSettings {
            from_page: false,
            ..control()
        },
    );
    for order in [run(Direction::Forward), STOP, Order::Renew] {
        let verdict = reviewed(&mut guard, &command(anna, order));
        assert_eq!(verdict, Err((Outcome::Refused, Reason::NotFromHere)));
    }
    // Retained messages of a broker do not matter here.
    let mut guard = guard_of(
        model(),
        ControlSettings {
            strict: true,
            ..control()
        },
    );
    reviewed(&mut guard, &command(anna, run(Direction::Forward))).unwrap();
    let held = Some((anna.owner, NOW + Duration::from_secs(3)));
    guard.path_alive(Owner::Mqtt, NOW + Duration::from_secs(1));
    assert_eq!(guard.lease(), held, "only the page itself keeps it");
    assert_eq!(
        reviewed(&mut guard, &command(bob, Order::Renew)),
        Err((Outcome::Refused, Reason::OtherOwner))
    );
    assert!(
        matches!(
            guard.review(&command(bob, STOP), &RESTING, NOW),
            Ok(CommandVerdict::Stop(_))
        ),
        "whoever may, stops"
    );
    assert_eq!(guard.lease(), None);
    let verdict = reviewed(&mut guard, &command(bob, run(Direction::Forward)));
    assert_eq!(
        verdict,
        Err((Outcome::Refused, Reason::RestartDelay)),
        "it may have been sent before the stop"
    );
}

#[test]
fn on_a_bad_line_nothing_may_make_a_motor_faster() {
    let bad = DriveFacts {
        line_is_bad: true,
        ..RESTING
    };
    let go = |hertz| {
        Order::Go(GoOrder::new(Vec::new(), Some(Hertz::from_centihertz(hertz)), None).unwrap())
    };
    let mut guard = guard_of(model(), control());
    assert_eq!(
        judged(&mut guard, go(3000), bad).map(drop),
        Err(Reason::LineQuality),
        "none is in force"
    );
    judged(&mut guard, go(3000), RESTING).map(drop).unwrap();
    for (order, refused) in [
        (go(3100), true),
        (go(2900), false),
        (run(Direction::Forward), true),
        (STOP, false),
    ] {
        let verdict = judged(&mut guard, order.clone(), bad).map(drop);
        assert_eq!(
            verdict == Err(Reason::LineQuality),
            refused,
            "{order:?}: {verdict:?}"
        );
        assert!(refused || verdict.is_ok(), "{order:?}: {verdict:?}");
    }
}

#[test]
fn a_release_ends_control_before_its_frame_goes() {
    let mut able = model();
    able.run.as_mut().unwrap().release = Some(fact(9));
    let mut guard = guard_of(
        able,
        ControlSettings {
            allow_release: true,
            ..control()
        },
    );
    let local = Origin {
        owner: Owner::Local,
        ..mqtt()
    };
    reviewed(&mut guard, &command(local, run(Direction::Forward))).unwrap();
    // A trip ends the order and keeps the lease.
    guard.inhibit(NOW);
    assert!(guard.lease().is_some());
    assert!(matches!(
        judged(&mut guard, Order::Release, RESTING),
        Ok(CommandVerdict::Go(_))
    ));
    assert_eq!((guard.lease(), guard.is_start_inhibited()), (None, true));
}
