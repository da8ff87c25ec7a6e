//! Every built-in drive is walked through its whole life: read, set, run both ways, stopped, let coast, tripped, reset,
//! refused what it must refuse, and switched off and on. The same orders for all, whatever the vendor.

use crate::support::families::{accepting, models, rig_of};
use crate::support::{MQTT, Rig, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason, RunIntent};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome, Refusal};
use vfd_gateway::drive::view::{RunState, TripEventKind};
use vfd_gateway::profile::model::{Flag, Model, Role};

/// Trip number of the walk: every known table of trips has it.
const CAUSE: u16 = 2;

fn rig(model: &Arc<Model>) -> Rig {
    rig_of(model, accepting())
}

/// Commands and demands success: confirmed where the model shows it, acknowledged where it does not.
fn does(rig: &mut Rig, model: &Model, order: Order) {
    let told = rig.commanded(MQTT, order.clone());
    let succeeded = matches!(told, (Outcome::Confirmed | Outcome::Acknowledged, Reason::None));
    assert!(succeeded, "{}: {order:?}: {told:?}", model.id);
}

/// A stop is effective, and the motor comes to rest.
fn stops(rig: &mut Rig, model: &Model) {
    assert_eq!(rig.commanded(MQTT, STOP), (Outcome::Confirmed, Reason::None), "{}", model.id);
    rig.live(Duration::from_secs(12));
    assert_eq!((rig.output(1), rig.view(0).run_state), (0, RunState::Stopped), "{}", model.id);
}

#[test]
fn every_polled_register_is_read_and_the_drive_found_at_rest() {
    for model in models() {
        let rig = rig(&model);
        let view = rig.view(0);
        assert!(view.is_online(), "{}", model.id);
        for register in model.registers.iter().filter(|register| register.poll.is_some()) {
            assert!(view.snapshot.reading(register.address).is_some(), "{}: {}", model.id, register.name);
        }
        assert_eq!(view.run_state, RunState::Stopped, "{}", model.id);
        assert_ne!(view.trip.active, Some(true), "{}", model.id);
    }
}

#[test]
fn every_drive_takes_a_setpoint_runs_both_ways_and_stops() {
    for model in models() {
        let mut rig = rig(&model);
        does(&mut rig, &model, setpoint(3000));
        for (direction, state, sign) in
            [(Direction::Forward, RunState::Forward, 1), (Direction::Reverse, RunState::Reverse, -1)]
        {
            does(&mut rig, &model, run(direction, None));
            rig.live(Duration::from_secs(8));
            assert_eq!((rig.output(1), rig.view(0).run_state), (3000 * sign, state), "{}", model.id);
            does(&mut rig, &model, setpoint(2000));
            rig.live(Duration::from_secs(6));
            assert_eq!(rig.output(1), 2000 * sign, "{}", model.id);
            stops(&mut rig, &model);
            does(&mut rig, &model, setpoint(3000));
        }
        keeps_the_rules(&rig, &model);
    }
}

#[test]
fn every_drive_coasts_or_refuses_by_name() {
    for model in models() {
        let mut rig = rig(&model);
        does(&mut rig, &model, run(Direction::Forward, Some(3000)));
        rig.live(Duration::from_secs(8));
        let can = model.run.as_ref().is_some_and(|run| run.coast.is_some());
        let expected = if can { (Outcome::Confirmed, Reason::None) } else { (Outcome::Refused, Reason::NotCapable) };
        assert_eq!(rig.commanded(MQTT, Order::Coast), expected, "{}", model.id);
        rig.live(Duration::from_secs(1));
        let intent = rig.view(0).control.unwrap().intent;
        assert_eq!(intent == RunIntent::Coast, can, "{}", model.id);
        if can {
            assert_eq!(rig.output(1), 0, "{}: the output is cut off", model.id);
        } else {
            assert_eq!(rig.output(1), 3000, "{}: a stop never stands in for a coast", model.id);
        }
    }
}

#[test]
fn every_drive_trips_is_told_once_and_is_reset() {
    for model in models() {
        let mut rig = rig(&model);
        does(&mut rig, &model, run(Direction::Forward, Some(3000)));
        rig.live(Duration::from_secs(8));
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, CAUSE);
        rig.live(Duration::from_secs(4));
        let [(_, event)] = rig.trips.as_slice() else { panic!("{}: {:?}", model.id, rig.trips) };
        let TripEventKind::Tripped { trips: 1, record } = &event.kind else { panic!("{}: {event:?}", model.id) };
        assert_eq!(record.code, Some(CAUSE), "{}", model.id);
        if let Some(register) = model.register_for(Role::TripFrequency) {
            let at_trip = record.words.iter().find(|(address, _)| *address == register.address).map(|(_, word)| *word);
            assert_eq!(at_trip, Some(3000), "{}", model.id);
        }
        let view = rig.view(0);
        assert_eq!((view.run_state, view.trip.active), (RunState::Tripped, Some(true)), "{}", model.id);
        assert_eq!(rig.commanded(MQTT, run(Direction::Forward, None)), (Outcome::Refused, Reason::Tripped));
        does(&mut rig, &model, Order::Reset);
        rig.live(Duration::from_secs(4));
        assert_eq!(rig.trips.last().unwrap().1.kind, TripEventKind::Cleared, "{}", model.id);
        assert_eq!(rig.trips.len(), 2, "{}: {:?}", model.id, rig.trips);
        assert_eq!((rig.output(1), rig.view(0).run_state), (0, RunState::Stopped), "{}: no run left over", model.id);
        does(&mut rig, &model, run(Direction::Forward, Some(3000)));
        rig.live(Duration::from_secs(2));
        assert!(rig.output(1) > 0, "{}: a fresh order runs it", model.id);
        keeps_the_rules(&rig, &model);
    }
}

#[test]
fn what_a_drive_must_not_be_told_never_reaches_its_line() {
    for model in models() {
        let mut rig = rig(&model);
        rig.sent.clear();
        for wrong in [setpoint(5001), setpoint(499), run(Direction::Forward, Some(6000))] {
            assert_eq!(rig.commanded(MQTT, wrong), (Outcome::Refused, Reason::OutsideLimits), "{}", model.id);
        }
        for (address, value) in forbidden(&model) {
            let ticket = rig.ask(1, 0, NativeAsk::Write { address: address.into(), values: vec![value] });
            let outcome = rig.answer_to(ticket);
            let refused = matches!(outcome, NativeOutcome::Refused(Refusal::Guard(_)));
            assert!(refused, "{}: 0x{address:04X} = {value}: {outcome:?}", model.id);
        }
        assert!(rig.writes().is_empty(), "{}: {:X?}", model.id, rig.writes());
    }
}

/// Writes to a drive's own registers that are not commands, which no client may make.
fn forbidden(model: &Model) -> Vec<(u16, u16)> {
    let run = model.run.as_ref().unwrap();
    let command = model.register_for(Role::RunCommand).unwrap().address.number();
    let known = [Some(&run.stop), Some(&run.forward), run.reverse.as_ref(), run.coast.as_ref(), run.reset.as_ref()];
    let known: Vec<u16> = known.into_iter().chain([run.release.as_ref()]).flatten().map(|fact| fact.value).collect();
    let words = (0..16).map(|bit| 1_u16 << bit).chain([3, 0x9000, 0xFFFF]).chain(run.never.iter().map(|it| it.value));
    let unknown = words.filter(|word| !known.contains(word)).map(|word| (command, word));
    let guarded = model.registers.iter().filter(|register| {
        let is_command = matches!(register.role, Some(Role::RunCommand | Role::FrequencyCommand));
        !is_command
    });
    unknown.chain(guarded.map(|register| (register.address.number(), 1))).collect()
}

#[test]
fn every_drive_survives_a_power_cycle_and_does_not_start_by_itself() {
    for model in models() {
        let mut rig = rig(&model);
        does(&mut rig, &model, run(Direction::Forward, Some(3000)));
        rig.live(Duration::from_secs(8));
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), false);
        rig.live(Duration::from_secs(20));
        assert_eq!(rig.view(0).run_state, RunState::Offline, "{}", model.id);
        rig.sent.clear();
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), true);
        rig.live(Duration::from_secs(45));
        let view = rig.view(0);
        assert_eq!((view.run_state, rig.output(1)), (RunState::Stopped, 0), "{}", model.id);
        assert!(view.control.unwrap().start_inhibited, "{}", model.id);
        assert!(rig.writes().is_empty(), "{}: {:X?}", model.id, rig.writes());
        does(&mut rig, &model, run(Direction::Forward, Some(3000)));
        rig.live(Duration::from_secs(2));
        assert!(rig.output(1) > 0, "{}: a fresh order runs it", model.id);
    }
}

#[test]
fn control_is_handed_back_at_standstill_only_where_the_model_can() {
    for model in models() {
        let mut rig = rig(&model);
        let can = model.run.as_ref().is_some_and(|run| run.release.is_some());
        does(&mut rig, &model, run(Direction::Forward, Some(3000)));
        rig.live(Duration::from_secs(3));
        let while_running = if can { Reason::Moving } else { Reason::NotCapable };
        assert_eq!(rig.commanded(MQTT, Order::Release), (Outcome::Refused, while_running), "{}", model.id);
        stops(&mut rig, &model);
        let told = rig.commanded(MQTT, Order::Release);
        let expected = if can { (Outcome::Acknowledged, Reason::None) } else { (Outcome::Refused, Reason::NotCapable) };
        assert_eq!(told, expected, "{}", model.id);
        assert!(!can || rig.view(0).control.unwrap().start_inhibited, "{}", model.id);
    }
}

#[test]
fn a_drive_that_is_run_at_its_panel_is_seen_and_left_alone() {
    for model in models().iter().filter(|model| model.status_flag(Flag::Running).is_some()) {
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
        rig.pass(Duration::from_secs(12));
        assert_eq!(rig.view(0).run_state, RunState::Forward, "{}", model.id);
        assert!(rig.writes().is_empty(), "{}: {:X?}", model.id, rig.writes());
    }
}

/// No word that must never be written, and no reset that is held.
fn keeps_the_rules(rig: &Rig, model: &Model) {
    let report = rig.bus.drive(Station(1)).unwrap().report();
    assert_eq!((report.forbidden_words, report.resets_held), (0, 0), "{}", model.id);
    assert_eq!(report.stored_writes, 0, "{}: nothing stored is written in operation", model.id);
}
