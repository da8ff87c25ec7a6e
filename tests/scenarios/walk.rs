//! Every model is walked through the whole life of a drive: read, set, run both ways, stopped, let coast, tripped, reset,
//! refused what it must refuse, cut off from its line, and switched off and on. The same orders for all, whatever the
//! vendor; what a model does not have is refused by name. Facts that are not proven are accepted here.

use crate::support::families::{accepting, each, rig_of};
use crate::support::{MQTT, Rig, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::address::Address;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason, RunIntent};
use vfd_gateway::domain::control::{ControlAction, ControlSettings};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::PortKind;
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome, NativeRefusal};
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::drive::view::{RunState, TripEventKind};
use vfd_gateway::gateway::LineInput;
use vfd_gateway::profile::model::{IndicatedState, Model, NeededFor, OrderKind, RegisterRole};

const SECOND: Duration = Duration::from_secs(1);
/// What a frequency in fractions of a full scale may be off, in hundredths of a hertz.
const ROUNDED: i64 = 5;

fn rig(model: &Arc<Model>) -> Rig {
    rig_of(model, accepting())
}

/// A rig with a commander that may be unable to renew its lease for a while.
fn patient(model: &Arc<Model>) -> Rig {
    rig_of(
        model,
        ControlSettings {
            lost_after: SECOND * 60,
            ..accepting()
        },
    )
}

/// Plays `walk` with every model that takes orders.
fn each_that_runs(walk: impl Fn(&Arc<Model>)) {
    each(|model| {
        if model.run.is_some() {
            walk(model);
        }
    });
}

/// Whether the model has this order.
fn has(model: &Model, kind: OrderKind) -> bool {
    model.order(kind).is_some()
}

/// Commands and demands success: confirmed where the model shows it, acknowledged where it does not.
fn does(rig: &mut Rig, order: Order) {
    let told = rig.commanded(MQTT, order.clone());
    let succeeded = matches!(
        told,
        (Outcome::Confirmed | Outcome::Acknowledged, Reason::None)
    );
    assert!(succeeded, "{order:?}: {told:?}");
}

#[track_caller]
fn refuses(rig: &mut Rig, order: Order, reason: Reason) {
    assert_eq!(
        rig.commanded(MQTT, order.clone()),
        (Outcome::Refused, reason),
        "{order:?}"
    );
}

#[track_caller]
fn turns_at(rig: &mut Rig, centihertz: i64) {
    let output = rig.output(1);
    assert!(
        (output - centihertz).abs() <= ROUNDED,
        "{output} and not {centihertz}"
    );
}

/// Runs at 30 Hz.
fn runs_forward(rig: &mut Rig) {
    does(rig, run(Direction::Forward, Some(3000)));
    rig.live(SECOND * 8);
    turns_at(rig, 3000);
}

/// A stop is effective, and the motor comes to rest.
fn stops(rig: &mut Rig) {
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Confirmed, Reason::None)
    );
    rig.live(SECOND * 12);
    assert_eq!(
        (rig.output(1), rig.view(0).run_state),
        (0, RunState::Stopped)
    );
}

#[test]
fn every_polled_register_is_read_and_the_drive_found_at_rest() {
    each(|model| {
        let rig = rig(model);
        let view = rig.view(0);
        assert!(view.is_online());
        for register in model
            .registers
            .iter()
            .filter(|register| register.poll.is_some())
        {
            assert!(
                view.snapshot.reading(register.address).is_some(),
                "{}",
                register.name
            );
        }
        if model.register_for(RegisterRole::OutputFrequency).is_some() {
            assert_eq!(view.run_state, RunState::Stopped);
        }
        assert_ne!(view.trip.active, Some(true));
    });
}

#[test]
fn a_drive_that_is_only_read_gets_no_order() {
    each(|model| {
        let only_read = model.run.is_none();
        let mut rig = if only_read {
            rig(model)
        } else {
            Rig::new(&read_only(model))
        };
        rig.sent.clear();
        for order in [
            STOP,
            setpoint(3000),
            run(Direction::Forward, Some(3000)),
            Order::Coast,
            Order::Reset,
        ] {
            let (outcome, reason) = rig.commanded(MQTT, order.clone());
            let right = if only_read {
                [Reason::NotCapable, Reason::ReadOnly]
            } else {
                [Reason::ReadOnly; 2]
            };
            assert!(
                outcome == Outcome::Refused && right.contains(&reason),
                "{order:?}: {outcome:?} {reason:?}"
            );
        }
        assert!(rig.writes().is_empty(), "{:X?}", rig.writes());
    });
}

fn read_only(model: &Arc<Model>) -> crate::support::RigOptions {
    crate::support::RigOptions {
        control: None,
        ..crate::support::families::options_of(model, accepting())
    }
}

#[test]
fn every_drive_takes_a_setpoint_runs_both_ways_and_stops() {
    each_that_runs(|model| {
        let mut rig = rig(model);
        does(&mut rig, setpoint(3000));
        for (direction, kind, shown, sign) in [
            (Direction::Forward, OrderKind::Forward, RunState::Forward, 1),
            (
                Direction::Reverse,
                OrderKind::Reverse,
                RunState::Reverse,
                -1,
            ),
        ] {
            if !has(model, kind) {
                refuses(&mut rig, run(direction, None), Reason::NotCapable);
                continue;
            }
            does(&mut rig, run(direction, None));
            rig.live(SECOND * 8);
            turns_at(&mut rig, 3000 * sign);
            assert_eq!(rig.view(0).run_state, shown);
            does(&mut rig, setpoint(2000));
            rig.live(SECOND * 6);
            turns_at(&mut rig, 2000 * sign);
            stops(&mut rig);
            does(&mut rig, setpoint(3000));
        }
        keeps_the_rules(&rig);
    });
}

#[test]
fn every_drive_coasts_or_refuses_by_name() {
    each_that_runs(|model| {
        let mut rig = rig(model);
        runs_forward(&mut rig);
        let can = has(model, OrderKind::Coast);
        let expected = if can {
            (Outcome::Confirmed, Reason::None)
        } else {
            (Outcome::Refused, Reason::NotCapable)
        };
        assert_eq!(rig.commanded(MQTT, Order::Coast), expected);
        rig.live(SECOND);
        let intent = rig.view(0).control.unwrap().intent;
        assert_eq!(intent == RunIntent::Coast, can);
        // Its output is cut off; a stop never stands in for a coast.
        turns_at(&mut rig, if can { 0 } else { 3000 });
    });
}

/// A trip that the model knows, or any number where it knows none.
fn cause(model: &Model) -> u16 {
    model
        .trip_codes
        .iter()
        .map(|it| it.code)
        .find(|code| *code > 0)
        .unwrap_or(2)
}

#[test]
fn every_drive_trips_is_reported_once_and_is_reset() {
    each_that_runs(|model| {
        let mut rig = rig(model);
        runs_forward(&mut rig);
        let (now, cause) = (rig.now, cause(model));
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, cause);
        rig.live(SECOND * 4);
        if model.trip_register().is_none() {
            assert!(
                rig.trips.is_empty(),
                "nothing shows a trip: {:?}",
                rig.trips
            );
            return stops(&mut rig);
        }
        let [(_, event)] = rig.trips.as_slice() else {
            panic!("{:?}", rig.trips)
        };
        let TripEventKind::Tripped { trips: 1, record } = &event.kind else {
            panic!("{event:?}")
        };
        if [
            RegisterRole::TripCode,
            RegisterRole::TripCause,
            RegisterRole::TripBits,
        ]
        .iter()
        .any(|it| model.register_for(*it).is_some())
        {
            assert_eq!(record.code, Some(cause));
        }
        let view = rig.view(0);
        assert_eq!(
            (view.run_state, view.trip.active),
            (RunState::Tripped, Some(true))
        );
        refuses(&mut rig, run(Direction::Forward, None), Reason::Tripped);
        if has(model, OrderKind::Reset) {
            does(&mut rig, Order::Reset);
        } else {
            refuses(&mut rig, Order::Reset, Reason::NotCapable);
            let now = rig.now;
            rig.bus.drive_mut(Station(1)).unwrap().clear_trip(now, None);
        }
        rig.live(SECOND * 4);
        assert_eq!(rig.trips.last().unwrap().1.kind, TripEventKind::Cleared);
        assert_eq!(rig.trips.len(), 2, "{:?}", rig.trips);
        assert_eq!(
            (rig.output(1), rig.view(0).run_state),
            (0, RunState::Stopped),
            "no run is left over"
        );
        does(&mut rig, run(Direction::Forward, Some(3000)));
        rig.live(SECOND * 2);
        assert!(rig.output(1) > 0, "a fresh order runs it");
        keeps_the_rules(&rig);
    });
}

#[test]
fn what_a_drive_must_not_be_reported_never_reaches_its_line() {
    each_that_runs(|model| {
        let mut rig = rig(model);
        rig.sent.clear();
        for wrong in [
            setpoint(5001),
            setpoint(499),
            run(Direction::Forward, Some(6000)),
        ] {
            refuses(&mut rig, wrong, Reason::OutsideLimits);
        }
        for (address, value) in forbidden(model) {
            let ticket = rig.ask(
                1,
                0,
                NativeAsk::Write {
                    address,
                    values: vec![value],
                },
            );
            let outcome = rig.answer_to(ticket);
            let refused = matches!(outcome, NativeOutcome::Refused(NativeRefusal::Guard(_)));
            assert!(refused, "{address} = {value:04X}: {outcome:?}");
        }
        assert!(rig.writes().is_empty(), "{:X?}", rig.writes());
    });
}

/// Writes to a drive's own registers that are not commands, which no client may make.
fn forbidden(model: &Model) -> Vec<(Address, u16)> {
    let run = model.run.as_ref().unwrap();
    let command = model
        .register_for(RegisterRole::RunCommand)
        .map(|register| register.address);
    let words = (0..16)
        .map(|bit| 1_u16 << bit)
        .chain([3, 0x9000, 0xFFFF])
        .chain(run.never.iter().map(|it| it.value));
    let is_unknown = |at: Address, word: u16| {
        let zero = word == 0 || run.order_in(word).is_some();
        !zero && model.orders_at(at).all(|(_, fact)| fact.value != word)
    };
    let unknown = words
        .filter_map(|word| Some((command?, word)))
        .filter(|(at, word)| is_unknown(*at, *word));
    let commands: Vec<_> = model
        .registers
        .iter()
        .filter(|it| it.role.is_some_and(is_command))
        .collect();
    let guarded = model.registers.iter().filter(|register| {
        commands
            .iter()
            .all(|command| command.address != register.address)
    });
    let elsewhere = run
        .places
        .never
        .iter()
        .map(|(address, fact)| (*address, fact.value));
    unknown
        .chain(elsewhere)
        .chain(guarded.map(|register| (register.address, 1)))
        .collect()
}

const fn is_command(role: RegisterRole) -> bool {
    matches!(
        role,
        RegisterRole::RunCommand | RegisterRole::FrequencyCommand | RegisterRole::Order
    )
}

#[test]
fn every_drive_survives_a_power_cycle_and_does_not_start_by_itself() {
    each_that_runs(|model| {
        let mut rig = patient(model);
        runs_forward(&mut rig);
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), false);
        rig.live(SECOND * 20);
        assert_eq!(rig.view(0).run_state, RunState::Offline);
        rig.sent.clear();
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), true);
        rig.live(SECOND * 45);
        let view = rig.view(0);
        assert_eq!((view.run_state, rig.output(1)), (RunState::Stopped, 0));
        assert!(view.control.unwrap().start_inhibited);
        assert!(rig.writes().is_empty(), "{:X?}", rig.writes());
        does(&mut rig, run(Direction::Forward, Some(3000)));
        rig.live(SECOND * 2);
        assert!(rig.output(1) > 0, "a fresh order runs it");
    });
}

#[test]
fn a_line_that_is_lost_under_way_invents_no_motion_and_a_stop_works_after_it() {
    each_that_runs(|model| {
        let mut rig = patient(model);
        runs_forward(&mut rig);
        rig.sent.clear();
        rig.core
            .handle(rig.now, LineInput::PortDown(LineFault::Gone));
        rig.settle();
        rig.live(SECOND * 5);
        assert!(
            rig.sent.is_empty(),
            "nothing is sent to a port that is gone"
        );
        refuses(&mut rig, setpoint(2000), Reason::LineDown);
        rig.core
            .handle(rig.now, LineInput::PortUp(PortKind::Serial));
        rig.settle();
        rig.live(SECOND * 8);
        assert!(rig.writes().is_empty(), "{:X?}", rig.writes());
        turns_at(&mut rig, 3000);
        let found = rig.view(0).run_state;
        assert!(
            matches!(found, RunState::Forward | RunState::Running),
            "{found:?}: it is told as it is found"
        );
        stops(&mut rig);
    });
}

#[test]
fn another_drive_is_only_read_and_can_be_stopped() {
    each_that_runs(|model| {
        let Some(identity) = &model.identity else {
            return;
        };
        let mut rig = rig(model);
        let others = identity.others.iter().map(|(word, _)| *word);
        let wrong = others
            .chain(0..=u16::MAX)
            .find(|word| !identity.is_right(*word))
            .unwrap();
        set(&mut rig, identity.address, wrong);
        rig.sent.clear();
        for order in [setpoint(3000), run(Direction::Forward, Some(3000))] {
            refuses(&mut rig, order, Reason::OtherDrive);
        }
        assert!(rig.writes().is_empty(), "{:X?}", rig.writes());
        assert_eq!(rig.commanded(MQTT, STOP).0, Outcome::Confirmed);
    });
}

#[test]
fn a_setting_on_which_an_order_rests_is_read_before_it() {
    each_that_runs(|model| {
        for item in model
            .setup
            .iter()
            .filter(|item| !item.needed_for.is_empty())
        {
            let Some(address) = item.address else {
                panic!("{}: it cannot be read", item.what)
            };
            let mut rig = rig(model);
            let right = rig
                .bus
                .drive_mut(Station(1))
                .unwrap()
                .word(address)
                .unwrap();
            let wrong = (0..=u16::MAX)
                .map(|word| right ^ word)
                .find(|word| !item.is_right(*word))
                .unwrap();
            for need in &item.needed_for {
                let (order, kind) = match need {
                    NeededFor::Setpoint => (setpoint(3000), OrderKind::Forward),
                    NeededFor::Run => (run(Direction::Forward, None), OrderKind::Forward),
                    NeededFor::Reverse => (run(Direction::Reverse, None), OrderKind::Reverse),
                };
                if !has(model, kind) {
                    continue;
                }
                does(&mut rig, setpoint(2500));
                set(&mut rig, address, wrong);
                rig.sent.clear();
                let (outcome, reason) = rig.commanded(MQTT, order.clone());
                // The wrong setting may be what frequencies are fractions of.
                let right_reason =
                    matches!(reason, Reason::Precondition | Reason::FullScaleUnknown);
                assert!(
                    outcome == Outcome::Refused && right_reason,
                    "{}: {outcome:?} {reason:?}",
                    item.what
                );
                assert!(
                    rig.writes().is_empty(),
                    "{}: {:X?}",
                    item.what,
                    rig.writes()
                );
                // A stop rests on nothing; but a drive that does not obey the bus refuses it.
                assert_ne!(rig.commanded(MQTT, STOP).0, Outcome::Refused);
                assert!(!rig.writes().is_empty(), "{}: no stop was sent", item.what);
                set(&mut rig, address, right);
                // Until the stop that may have been refused is over; only one that is taken allows a start.
                rig.live(SECOND * 5);
                assert_eq!(
                    rig.commanded(MQTT, STOP),
                    (Outcome::Confirmed, Reason::None)
                );
                rig.live(ControlSettings::RESTART_DELAY);
                does(&mut rig, order);
                rig.live(SECOND);
                stops(&mut rig);
            }
        }
    });
}

fn set(rig: &mut Rig, address: Address, word: u16) {
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_locally(now, address, word);
}

#[test]
fn what_is_not_proven_is_refused_until_it_is_accepted() {
    each_that_runs(|model| {
        let mut rig = rig_of(
            model,
            ControlSettings {
                accept_unverified: Vec::new(),
                ..accepting()
            },
        );
        rig.sent.clear();
        let may = model.may_be_ordered(&[]);
        if !may {
            refuses(
                &mut rig,
                run(Direction::Forward, Some(3000)),
                Reason::Unverified,
            );
            assert!(rig.writes().is_empty(), "{:X?}", rig.writes());
        }
        let unproven = model
            .run
            .iter()
            .flat_map(|run| run.unproven())
            .map(|(action, _)| action);
        for action in unproven {
            let order = match action {
                ControlAction::Coast => Order::Coast,
                ControlAction::Reset => Order::Reset,
                _ => continue,
            };
            refuses(&mut rig, order, Reason::Unverified);
        }
        assert!(rig.writes().is_empty(), "{:X?}", rig.writes());
        assert_eq!(
            rig.commanded(MQTT, STOP).0,
            Outcome::Confirmed,
            "a stop is never refused for that"
        );
    });
}

#[test]
fn control_is_handed_back_at_standstill_only_where_the_model_can() {
    each_that_runs(|model| {
        let mut rig = rig(model);
        let can = has(model, OrderKind::Release);
        does(&mut rig, run(Direction::Forward, Some(3000)));
        rig.live(SECOND * 3);
        refuses(
            &mut rig,
            Order::Release,
            if can {
                Reason::Moving
            } else {
                Reason::NotCapable
            },
        );
        stops(&mut rig);
        let told = rig.commanded(MQTT, Order::Release);
        let expected = if can {
            (Outcome::Acknowledged, Reason::None)
        } else {
            (Outcome::Refused, Reason::NotCapable)
        };
        assert_eq!(told, expected);
        assert!(!can || rig.view(0).control.unwrap().start_inhibited);
    });
}

#[test]
fn a_drive_that_is_run_at_its_panel_is_seen_and_left_alone() {
    each_that_runs(|model| {
        if model.status_flag(IndicatedState::Running).is_none() {
            return;
        }
        let mut rig = rig(model);
        rig.sent.clear();
        let now = rig.now;
        let drive = rig.bus.drive_mut(Station(1)).unwrap();
        for item in &model.setup {
            if let Some(address) = item.address {
                drive.set_locally(now, address, 0);
            }
        }
        drive.operate_panel(now, Some(Direction::Forward));
        if !drive.is_local() {
            // No register says whom it obeys.
            drive.operate(now, Some(Direction::Forward));
        }
        rig.pass(SECOND * 12);
        let tells_direction = model.status_flag(IndicatedState::Reverse).is_some();
        let expected = if tells_direction {
            RunState::Forward
        } else {
            RunState::Running
        };
        assert_eq!(rig.view(0).run_state, expected);
        assert!(rig.writes().is_empty(), "{:X?}", rig.writes());
    });
}

/// No word that must never be written, and no reset that is held.
fn keeps_the_rules(rig: &Rig) {
    let report = rig.bus.drive(Station(1)).unwrap().report();
    assert_eq!((report.forbidden_words, report.resets_held), (0, 0));
    assert_eq!(
        report.stored_writes, 0,
        "nothing stored is written in operation"
    );
}
