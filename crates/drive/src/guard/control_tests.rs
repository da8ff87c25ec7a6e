//! Ownership, take-over and interlocks, rule by rule.

use super::tests::{NOW, RESTING, STOP, command, guard_of, mqtt, plc, register, reviewed, run};
use super::{CommandVerdict, DriveFacts, DriveGuard};
use crate::domain::command::{
    CommandRequest, Direction, GoOrder, Order, OrderManner, Origin, Owner, Reason, Rights,
};
use crate::domain::control::{ControlSettings, LeaseMode, Ownership};
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::domain::units::UnitOfMeasure;
use crate::profile::model::{Model, ModelWatchdog, RegisterMemory, RunForm};
use crate::vendors::testing::{control, fact, model};
use std::time::Duration;

const LEASE: Duration = Duration::from_secs(3);
const RUNNING: DriveFacts = DriveFacts {
    at_standstill: false,
    output: Some(Hertz::from_centihertz(2000)),
    ..RESTING
};
const RAMP: u16 = 0x020C;
const LOCAL: Owner = Owner::Local;

fn setpoint(centihertz: u16) -> Order {
    Order::Go(GoOrder::new(Vec::new(), Some(Hertz::from_centihertz(centihertz)), None).unwrap())
}

/// A guard whose drive runs for MQTT.
fn held(settings: ControlSettings) -> DriveGuard {
    let mut guard = guard_of(model(), settings);
    assert_eq!(
        reviewed(&mut guard, &command(mqtt(), run(Direction::Forward))),
        Ok(())
    );
    guard.run_was_acknowledged(Direction::Forward);
    guard
}

fn at(
    guard: &mut DriveGuard,
    origin: Origin,
    order: Order,
    facts: &DriveFacts,
    now: MonoTime,
) -> Result<CommandVerdict, Reason> {
    let command = CommandRequest {
        start_before: now + Duration::from_secs(1),
        ..command(origin, order)
    };
    guard
        .review(&command, facts, now)
        .map_err(|report| report.reason)
}

fn holder(guard: &DriveGuard) -> Option<Owner> {
    guard.lease().map(|(owner, _)| owner)
}

#[test]
fn control_is_taken_only_where_that_is_allowed_and_by_those_who_may_command() {
    let may_stop_only = Origin {
        rights: Rights {
            write: false,
            stop: true,
        },
        ..plc(1)
    };
    for (allow_take, origin, expected) in [
        (false, plc(1), Some(Reason::NoTake)),
        (true, may_stop_only, Some(Reason::NotAllowed)),
        (true, plc(1), None),
    ] {
        let mut guard = held(ControlSettings {
            allow_take,
            ..control()
        });
        let intent = guard.intent();
        let stops = guard.stops();
        let verdict = at(&mut guard, origin, Order::Take, &RUNNING, NOW);
        assert_eq!(verdict.as_ref().err().copied(), expected);
        if expected.is_none() {
            assert!(
                matches!(verdict, Ok(CommandVerdict::Taken(Some(Owner::Mqtt)))),
                "{verdict:?}"
            );
        }
        let owner = if expected.is_none() {
            origin.owner
        } else {
            Owner::Mqtt
        };
        assert_eq!(guard.lease(), Some((owner, NOW + LEASE)));
        assert_eq!(
            (guard.intent(), guard.stops()),
            (intent, stops),
            "the drive continues unchanged"
        );
    }
}

#[test]
fn who_lost_control_to_another_is_refused_and_the_taker_commands() {
    let mut guard = held(ControlSettings {
        allow_take: true,
        ..control()
    });
    at(&mut guard, plc(1), Order::Take, &RUNNING, NOW).unwrap();
    assert_eq!(
        at(&mut guard, mqtt(), setpoint(3000), &RUNNING, NOW).unwrap_err(),
        Reason::OtherOwner
    );
    guard.path_alive(Owner::Mqtt, NOW + Duration::from_secs(1));
    assert_eq!(
        guard.lease(),
        Some((plc(1).owner, NOW + LEASE)),
        "the old one renews nothing"
    );
    assert!(matches!(
        at(&mut guard, plc(1), run(Direction::Forward), &RUNNING, NOW),
        Ok(CommandVerdict::Go(_))
    ));
    assert!(
        matches!(
            at(&mut guard, mqtt(), STOP, &RUNNING, NOW),
            Ok(CommandVerdict::Stop(_))
        ),
        "whoever may, stops"
    );
    assert_eq!(holder(&guard), None);
}

#[test]
fn a_free_drive_is_taken_only_while_it_may_turn() {
    let settings = ControlSettings {
        allow_take: true,
        ..control()
    };
    let mut guard = guard_of(model(), settings.clone());
    assert!(matches!(
        at(&mut guard, plc(1), Order::Take, &RESTING, NOW),
        Ok(CommandVerdict::Unchanged)
    ));
    assert_eq!(holder(&guard), None, "there is nothing to hold");
    assert!(matches!(
        at(&mut guard, plc(1), Order::Take, &RUNNING, NOW),
        Ok(CommandVerdict::Taken(None))
    ));
    assert_eq!(holder(&guard), Some(plc(1).owner));
    let later = NOW + Duration::from_secs(1);
    assert!(matches!(
        at(&mut guard, plc(1), Order::Take, &RUNNING, later),
        Ok(CommandVerdict::Unchanged)
    ));
    assert_eq!(
        guard.lease(),
        Some((plc(1).owner, later + LEASE)),
        "it renews the lease"
    );
    let unlike = ControlSettings {
        allow_take: false,
        ..settings
    };
    assert_eq!(
        at(
            &mut guard_of(model(), unlike),
            plc(1),
            Order::Take,
            &RESTING,
            NOW
        )
        .unwrap_err(),
        Reason::NoTake
    );
}

#[test]
fn where_anybody_may_command_control_goes_to_the_last_who_did() {
    let mut guard = held(ControlSettings {
        ownership: Ownership::Any,
        ..control()
    });
    assert!(matches!(
        at(&mut guard, plc(1), setpoint(3000), &RUNNING, NOW),
        Ok(CommandVerdict::Go(_))
    ));
    assert_eq!(holder(&guard), Some(plc(1).owner));
    guard.setpoint_was_acknowledged(plc(1).owner, Hertz::from_centihertz(3000), NOW);
    // Two controllers that repeat the same do not take it from each other, and nothing goes to the line.
    for last in [2, 3, 2, 3] {
        let later = NOW + Duration::from_secs(u64::from(last));
        assert!(matches!(
            at(&mut guard, plc(last), setpoint(3000), &RUNNING, later),
            Ok(CommandVerdict::Unchanged)
        ));
        assert_eq!(guard.lease(), Some((plc(1).owner, later + LEASE)));
    }
    let reader = Origin {
        rights: Rights {
            write: false,
            stop: false,
        },
        ..plc(4)
    };
    assert_eq!(
        at(&mut guard, reader, setpoint(1000), &RUNNING, NOW).unwrap_err(),
        Reason::NotAllowed
    );
}

#[test]
fn a_parameter_that_a_controller_sets_is_no_sign_of_life() {
    for (owner, renews) in [(plc(1), false), (mqtt(), true)] {
        let mut guard = guard_of(model(), control());
        at(&mut guard, owner, STOP, &RESTING, NOW).unwrap();
        let start = CommandRequest {
            epoch: Some(guard.epoch()),
            ..command(owner, run(Direction::Forward))
        };
        reviewed(&mut guard, &start).unwrap();
        let later = NOW + Duration::from_secs(1);
        assert!(matches!(
            at(&mut guard, owner, register(RAMP.into(), 1), &RUNNING, later),
            Ok(CommandVerdict::Go(_))
        ));
        let renewed_at = if renews { later } else { NOW };
        assert_eq!(guard.lease(), Some((owner.owner, renewed_at + LEASE)));
    }
}

#[test]
fn a_path_that_is_open_keeps_session_leases_alone() {
    for (lease, until) in [
        (LeaseMode::Session, NOW + LEASE + LEASE),
        (LeaseMode::Explicit, NOW + LEASE),
    ] {
        let mut guard = held(ControlSettings { lease, ..control() });
        guard.path_alive(Owner::Mqtt, NOW + LEASE);
        assert_eq!(guard.lease(), Some((Owner::Mqtt, until)), "{lease:?}");
    }
}

#[test]
fn a_motor_is_not_started_again_too_soon() {
    let minute = Duration::from_secs(60);
    let settings = ControlSettings {
        min_start_interval: minute,
        ..control()
    };
    let order = || run(Direction::Forward);
    let after = |facts: &DriveFacts, time| {
        let mut guard = held(settings.clone());
        guard.started(NOW);
        guard.inhibit(NOW.before(settings.restart_delay));
        at(&mut guard, mqtt(), order(), facts, NOW + time).map(drop)
    };
    assert_eq!(
        after(&RESTING, minute - Duration::from_millis(1)),
        Err(Reason::StartsTooOften)
    );
    assert_eq!(after(&RESTING, minute), Ok(()));
    assert_eq!(
        after(
            &DriveFacts {
                output: None,
                ..RUNNING
            },
            Duration::ZERO
        ),
        Err(Reason::StartsTooOften),
        "it may stand"
    );
    assert_eq!(
        after(&RUNNING, Duration::ZERO),
        Ok(()),
        "it turns: that is no start"
    );
    let mut never = guard_of(model(), settings.clone());
    assert!(
        at(&mut never, mqtt(), order(), &RESTING, NOW).is_ok(),
        "it was never started"
    );
    let mut ordered = held(settings);
    ordered.started(NOW);
    assert!(
        at(&mut ordered, mqtt(), order(), &RESTING, NOW).is_ok(),
        "it is ordered to run, at 0 Hz"
    );
}

#[test]
fn a_drive_that_obeys_its_panel_is_not_commanded_but_stopped() {
    let local = DriveFacts {
        is_local: Some(true),
        ..RESTING
    };
    for order in [run(Direction::Forward), setpoint(2000)] {
        let judged = |facts: &DriveFacts, model: Model| {
            at(
                &mut guard_of(model, control()),
                mqtt(),
                order.clone(),
                facts,
                NOW,
            )
            .map(drop)
        };
        assert_eq!(
            judged(&local, model()),
            Err(Reason::LocalControl),
            "{order:?}"
        );
        assert_eq!(
            judged(
                &DriveFacts {
                    is_local: Some(false),
                    ..RESTING
                },
                model()
            ),
            Ok(())
        );
        assert_eq!(
            judged(
                &DriveFacts {
                    is_local: None,
                    ..RESTING
                },
                model()
            ),
            Ok(()),
            "it cannot tell"
        );
        let mut overruling = model();
        overruling.run.as_mut().unwrap().form = RunForm::Bits {
            bits: Vec::new(),
            fields: Vec::new(),
            priority: 0x8000,
        };
        assert_eq!(
            judged(&local, overruling),
            Ok(()),
            "its commands overrule the panel"
        );
    }
    let mut guard = guard_of(model(), control());
    assert!(matches!(
        at(&mut guard, mqtt(), STOP, &local, NOW),
        Ok(CommandVerdict::Stop(_))
    ));
    let ramp = at(
        &mut guard_of(model(), control()),
        mqtt(),
        register(RAMP.into(), 50),
        &local,
        NOW,
    );
    assert!(ramp.is_ok(), "a parameter moves nothing");
}

#[test]
fn run_waits_for_a_watchdog_where_one_is_required_and_a_setpoint_does_not() {
    for (require_watchdog, is_watched, expected) in [
        (false, false, Ok(())),
        (true, true, Ok(())),
        (true, false, Err(Reason::Watchdog)),
    ] {
        let settings = ControlSettings {
            require_watchdog,
            ..control()
        };
        let facts = DriveFacts {
            is_watched,
            ..RESTING
        };
        let mut guard = guard_of(model(), settings);
        assert_eq!(
            at(&mut guard, mqtt(), setpoint(2000), &facts, NOW).map(drop),
            Ok(())
        );
        assert_eq!(
            at(&mut guard, mqtt(), run(Direction::Forward), &facts, NOW).map(drop),
            expected
        );
    }
}

#[test]
fn a_stored_register_is_written_seldom_and_others_as_often_as_one_likes() {
    let interval = Duration::from_secs(10);
    for (memory, expected) in [
        (Some(RegisterMemory::Stored), Err(Reason::WrittenTooOften)),
        (None, Err(Reason::WrittenTooOften)),
        (Some(RegisterMemory::Ram), Ok(())),
    ] {
        let mut kept = model();
        kept.registers
            .iter_mut()
            .find(|register| register.address == RAMP)
            .unwrap()
            .memory = memory;
        let mut guard = guard_of(
            kept.clone(),
            ControlSettings {
                stored_write_interval: interval,
                ..control()
            },
        );
        let mut write = |value, time| {
            at(
                &mut guard,
                mqtt(),
                register(RAMP.into(), value),
                &RESTING,
                NOW + time,
            )
            .map(drop)
        };
        assert_eq!(write(50, Duration::ZERO), Ok(()));
        assert_eq!(
            write(60, interval - Duration::from_millis(1)),
            expected,
            "{memory:?}"
        );
        assert_eq!(write(60, interval * 2), Ok(()));
        let twice = [50, 60].map(|value| crate::domain::command::RegisterWrite::new(RAMP, value));
        let twice = Order::Go(GoOrder::new(twice.to_vec(), None, None).unwrap());
        assert_eq!(
            at(&mut guard_of(kept, control()), mqtt(), twice, &RESTING, NOW).map(drop),
            expected,
            "in one order"
        );
    }
}

#[test]
fn another_register_is_not_held_up() {
    let mut guard = guard_of(model(), control());
    assert!(at(&mut guard, mqtt(), register(RAMP.into(), 50), &RESTING, NOW).is_ok());
    assert!(
        at(
            &mut guard,
            mqtt(),
            register(0x020E_u16.into(), 50),
            &RESTING,
            NOW
        )
        .is_ok()
    );
    assert_eq!(
        at(&mut guard, plc(1), register(RAMP.into(), 50), &RESTING, NOW).unwrap_err(),
        Reason::WrittenTooOften
    );
}

#[test]
fn the_watchdog_is_set_by_the_gateways_own_tool_at_standstill_alone() {
    let mut watched = model();
    for register in watched
        .registers
        .iter_mut()
        .filter(|register| register.address == RAMP)
    {
        register.unit = UnitOfMeasure::Second;
        register.scale = 10;
        register.range = Some(0..=255);
    }
    watched.watchdog = Some(ModelWatchdog {
        time: RAMP.into(),
        off: fact(0),
        action: None,
        action_digit: None,
        keeps_running: Vec::new(),
        stops: Vec::new(),
    });
    let local = Origin {
        owner: LOCAL,
        rights: Rights {
            write: true,
            stop: false,
        },
        manner: OrderManner::Once,
    };
    let judged = |origin, order, facts: &DriveFacts| {
        let mut guard = guard_of(watched.clone(), control());
        let verdict = at(&mut guard, origin, order, facts, NOW);
        assert_eq!(holder(&guard), None, "it takes no control");
        verdict
    };
    assert!(matches!(
        judged(local, register(RAMP.into(), 50), &RESTING),
        Ok(CommandVerdict::Go(_))
    ));
    for (origin, value, facts, reason) in [
        (local, 50, RUNNING, Reason::Moving),
        (
            local,
            50,
            DriveFacts {
                stop_pending: true,
                ..RESTING
            },
            Reason::StopPending,
        ),
        (local, 256, RESTING, Reason::OutsideRange),
        (mqtt(), 50, RESTING, Reason::NotAllowed),
        (plc(1), 50, RESTING, Reason::NotAllowed),
    ] {
        assert_eq!(
            judged(origin, register(RAMP.into(), value), &facts).unwrap_err(),
            reason,
            "{origin:?} {value}"
        );
    }
    let mut guard = guard_of(watched.clone(), control());
    assert_eq!(
        reviewed(&mut guard, &command(mqtt(), run(Direction::Forward))),
        Ok(())
    );
    let held = at(&mut guard, local, register(RAMP.into(), 50), &RESTING, NOW).unwrap_err();
    assert_eq!(held, Reason::OtherOwner);
}

#[test]
fn a_parameter_is_written_back_by_the_gateways_own_tool_at_standstill_listed_or_not() {
    const FREQUENCY_SOURCE: u16 = 0x0211;
    const RUN: u16 = 0x0002;
    let unlisted = ControlSettings {
        native_write: Vec::new(),
        ..control()
    };
    let released = ControlSettings {
        allow_release: true,
        ..unlisted.clone()
    };
    let local = Origin {
        owner: LOCAL,
        rights: Rights {
            write: true,
            stop: false,
        },
        manner: OrderManner::Once,
    };
    let mut doors = model();
    for register in doors
        .registers
        .iter_mut()
        .filter(|register| register.address == 0x020E)
    {
        register.back_door = Some("another way in".to_owned());
    }
    for (settings, origin, address, value, facts, expected) in [
        (&unlisted, local, RAMP, 50, RESTING, Ok(())),
        (&unlisted, mqtt(), RAMP, 50, RESTING, Err(Reason::NotListed)),
        (&unlisted, plc(1), RAMP, 50, RESTING, Err(Reason::NotListed)),
        (&unlisted, local, RAMP, 50, RUNNING, Err(Reason::Moving)),
        (
            &unlisted,
            local,
            RAMP,
            50,
            DriveFacts {
                stop_pending: true,
                ..RESTING
            },
            Err(Reason::StopPending),
        ),
        (
            &unlisted,
            local,
            0x020E,
            50,
            RESTING,
            Err(Reason::NotAllowed),
        ),
        (&unlisted, local, RUN, 1, RESTING, Err(Reason::NotAllowed)),
        (&unlisted, local, 0x7000, 1, RESTING, Err(Reason::NotListed)),
        (&unlisted, local, FREQUENCY_SOURCE, 3, RESTING, Ok(())),
        (
            &unlisted,
            local,
            FREQUENCY_SOURCE,
            1,
            RESTING,
            Err(Reason::NoRelease),
        ),
        (&released, local, FREQUENCY_SOURCE, 1, RESTING, Ok(())),
    ] {
        let mut guard = guard_of(doors.clone(), settings.clone());
        let verdict = at(
            &mut guard,
            origin,
            register(address.into(), value),
            &facts,
            NOW,
        );
        assert_eq!(verdict.map(drop), expected, "{origin:?} {address:04X}");
        assert_eq!(holder(&guard), None, "it takes no control");
    }
    let mut guard = guard_of(doors, unlisted);
    assert!(at(&mut guard, local, register(RAMP.into(), 50), &RESTING, NOW).is_ok());
    let again = at(&mut guard, local, register(RAMP.into(), 60), &RESTING, NOW).unwrap_err();
    assert_eq!(
        again,
        Reason::WrittenTooOften,
        "a stored register wears out"
    );
}
