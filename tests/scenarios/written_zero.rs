//! A written 0 is a STOP unless fresh facts show that the drive does not run, whatever was written before and by whom:
//! for every way of writing it, however the motor was started, on every model.

use crate::support::families::{accepting, address_of, models, options_of};
use crate::support::{MQTT, ORIGIN, Rig, RigOptions, STOP, plc, run};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Owner, Reason};
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeAsk;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::gateway::DriveNote;
use vfd_gateway::profile::model::{Model, RegisterRole};
use vfd_gateway::sim::FaultPlan;

const SECOND: Duration = Duration::from_secs(1);
/// On a line that is polled often, a motor that was started elsewhere is seen by then.
const SEEN: Duration = Duration::from_millis(800);

/// What started the motor, while a controller still believes that it has stopped it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Starter {
    /// An operator at the panel, which has control.
    Panel,
    /// A terminal that was closed before it got control.
    Terminal,
    /// Another master writes the run command over the bus.
    OtherMaster,
    /// Another client of this gateway.
    OtherOwner,
    /// The drive itself, after its power was away.
    Itself,
}

const STARTERS: [Starter; 5] = [
    Starter::Panel,
    Starter::Terminal,
    Starter::OtherMaster,
    Starter::OtherOwner,
    Starter::Itself,
];

fn both(centihertz: u16) -> Order {
    Order::Stop {
        setpoint: Some(Hertz::from_centihertz(centihertz)),
    }
}

/// A drive that the controller has stopped and that is at standstill.
fn stopped(model: &Arc<Model>) -> Rig {
    let options = RigOptions {
        poll: Duration::from_millis(200),
        ..options_of(model, accepting())
    };
    let mut rig = Rig::new(&options);
    rig.commanded(MQTT, run(Direction::Forward, Some(1000)));
    rig.live(SECOND);
    assert_eq!(
        rig.commanded(ORIGIN, STOP).0,
        Outcome::Confirmed,
        "{}",
        model.id
    );
    rig.live(SECOND * 8);
    assert_eq!(rig.output(1), 0, "{}", model.id);
    assert_eq!(
        rig.commanded(ORIGIN, STOP),
        (Outcome::Acknowledged, Reason::Unchanged),
        "{}",
        model.id
    );
    // What the drive shows afterwards confirms that.
    rig.live(SECOND);
    rig.sent.clear();
    rig
}

/// Panel or terminals have control, where the model has a register for that.
fn hand_to_panel(rig: &mut Rig, model: &Model) {
    let now = rig.now;
    let drive = rig.bus.drive_mut(Station(1)).unwrap();
    for address in model.setup.iter().filter_map(|item| item.address) {
        drive.set_locally(now, address, 0);
    }
}

fn operate_panel(rig: &mut Rig, runs: Option<Direction>) {
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .operate_panel(now, runs);
}

/// Another master orders RUN behind the gateway's back.
fn other_master_runs(rig: &mut Rig, model: &Model, direction: Direction) {
    other_master_orders(rig, model, direction, 2000);
}

fn other_master_orders(rig: &mut Rig, model: &Model, direction: Direction, setpoint: u16) {
    let at = address_of(model, RegisterRole::RunCommand);
    let run = model.run.as_ref().unwrap();
    let word = match direction {
        Direction::Forward => run.forward.value,
        Direction::Reverse => run.reverse.as_ref().unwrap().value,
    };
    for (address, value) in [
        (address_of(model, RegisterRole::FrequencyCommand), setpoint),
        (at, word),
    ] {
        let pdu = [
            vec![6],
            address.to_be_bytes().to_vec(),
            value.to_be_bytes().to_vec(),
        ]
        .concat();
        let now = rig.now;
        let mut reply = Vec::new();
        assert!(
            rig.bus
                .drive_mut(Station(1))
                .unwrap()
                .answer(now, &pdu, 0, &mut reply),
            "{}",
            model.id
        );
    }
}

fn start(rig: &mut Rig, model: &Model, starter: Starter) {
    match starter {
        Starter::Panel => {
            hand_to_panel(rig, model);
            release_priority(rig, model);
            operate_panel(rig, Some(Direction::Forward));
        }
        Starter::Terminal => {
            operate_panel(rig, Some(Direction::Forward));
            hand_to_panel(rig, model);
            release_priority(rig, model);
            operate_panel(rig, Some(Direction::Forward));
        }
        Starter::OtherMaster => other_master_runs(rig, model, Direction::Forward),
        Starter::OtherOwner => {
            rig.live(SECOND * 3);
            let (outcome, reason) = rig.commanded(MQTT, run(Direction::Forward, Some(2000)));
            assert!(
                matches!(outcome, Outcome::Acknowledged | Outcome::Confirmed),
                "{}: {reason:?}",
                model.id
            );
        }
        Starter::Itself => {
            let now = rig.now;
            let drive = rig.bus.drive_mut(Station(1)).unwrap();
            drive.trip(now, 2);
            drive.set_powered(now, false);
            drive.set_powered(now + Duration::from_millis(50), true);
            rig.live(SECOND * 4);
            other_master_runs(rig, model, Direction::Forward);
        }
    }
}

/// A drive whose words take control must be released before panel or terminals can command it.
fn release_priority(rig: &mut Rig, model: &Model) {
    if let Some(release) = model.run.as_ref().and_then(|run| run.release.as_ref()) {
        let at = address_of(model, RegisterRole::RunCommand).to_be_bytes();
        let pdu = [vec![6], at.to_vec(), release.value.to_be_bytes().to_vec()].concat();
        let now = rig.now;
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .answer(now, &pdu, 0, &mut Vec::new());
    }
}

fn stop_word(model: &Model) -> u16 {
    model.run.as_ref().unwrap().stop.value
}

fn stops(rig: &Rig, model: &Model) -> usize {
    let word = stop_word(model);
    rig.written(address_of(model, RegisterRole::RunCommand))
        .into_iter()
        .filter(|it| *it == word)
        .count()
}

/// The ways in which a controller writes a 0, as orders: the uniform units make the same order of word 256, a mask, a
/// block, coil 0 and coil 1, and of `vfd-gateway write ... run stop`.
#[test]
fn a_written_zero_stops_a_motor_that_was_started_elsewhere() {
    for model in models() {
        for starter in STARTERS {
            for order in [STOP, both(5000)] {
                let mut rig = stopped(&model);
                start(&mut rig, &model, starter);
                rig.live(SEEN);
                let what = format!("{} {starter:?} {order:?}", model.id);
                assert!(rig.output(1) > 0, "{what}: it runs");
                rig.sent.clear();
                let ticket = rig.command(ORIGIN, 0, order);
                let (outcome, reason) = rig.outcome_of(ticket);
                let sent = stops(&rig, &model);
                assert!(sent >= 1, "{what}: {outcome:?} {reason:?}");
                let setpoint = address_of(&model, RegisterRole::FrequencyCommand);
                assert!(rig.written(setpoint).is_empty(), "{what}");
                let owner = rig.view(0).control.unwrap().lease.map(|(owner, _)| owner);
                assert_eq!(owner, None, "{what}: a stop opens no lease");
                // A drive that obeys its panel accepts no stop from the bus: that is reported, and never as a success.
                let obeys = !rig.bus.drive(Station(1)).unwrap().is_local();
                assert_eq!(
                    (outcome == Outcome::Confirmed, sent == 1),
                    (obeys, obeys || sent == 1),
                    "{what}: {reason:?}"
                );
                rig.live(SECOND * 12);
                assert_eq!(rig.output(1) == 0, obeys, "{what}");
            }
        }
    }
}

#[test]
fn a_zero_in_the_native_run_command_is_one_too() {
    for model in models() {
        for starter in STARTERS {
            let mut rig = stopped(&model);
            start(&mut rig, &model, starter);
            rig.live(SEEN);
            rig.sent.clear();
            let address = address_of(&model, RegisterRole::RunCommand);
            let ask = NativeAsk::Write {
                address: address.into(),
                values: vec![stop_word(&model)],
            };
            let ticket = rig.ask(1, 0, ask);
            let answer = rig.answer_to(ticket);
            assert_eq!(
                stops(&rig, &model),
                1,
                "{} {starter:?}: {answer:?}",
                model.id
            );
            rig.live(SECOND * 12);
            let obeys = !rig.bus.drive(Station(1)).unwrap().is_local();
            assert_eq!(rig.output(1) == 0, obeys, "{} {starter:?}", model.id);
            assert!(
                obeys || rig.view(0).control.unwrap().stop_pending,
                "{} {starter:?}: {answer:?}",
                model.id
            );
        }
    }
}

/// It was answered from a view that is older than the start.
#[test]
fn a_single_zero_between_two_polls_stops_a_motor_that_had_just_been_started() {
    for model in models() {
        for ms in [1, 60, 150, 199] {
            let mut rig = stopped(&model);
            other_master_runs(&mut rig, &model, Direction::Forward);
            rig.pass(Duration::from_millis(ms));
            rig.command(ORIGIN, 0, STOP);
            rig.pass(SECOND * 10);
            assert_eq!(rig.output(1), 0, "{} {ms} ms", model.id);
            assert_eq!(stops(&rig, &model), 1, "{} {ms} ms", model.id);
        }
    }
}

/// The drive goes offline before it has shown that the stop was needed: it stays in force for as long as one that waits
/// for an absent drive.
#[test]
fn a_zero_that_was_answered_before_the_drive_was_lost_stops_it_when_it_is_back() {
    for model in models() {
        for (away, stops_it) in [(5, true), (650, false)] {
            let mut rig = stopped(&model);
            other_master_runs(&mut rig, &model, Direction::Forward);
            assert_eq!(
                rig.commanded(ORIGIN, STOP),
                (Outcome::Acknowledged, Reason::Unchanged),
                "{}",
                model.id
            );
            rig.bus.set_faults("lost=1000".parse().unwrap());
            rig.pass(SECOND * away);
            assert!(!rig.view(0).is_online(), "{}: {away} s", model.id);
            rig.bus.set_faults(FaultPlan::default());
            rig.pass(SECOND * 60);
            assert_eq!(rig.output(1) == 0, stops_it, "{}: {away} s", model.id);
        }
    }
}

#[test]
fn what_stands_still_gets_no_frame_for_a_cyclic_zero() {
    for model in models() {
        let mut rig = stopped(&model);
        for n in 0..300 {
            let order = if n % 2 == 0 { STOP } else { both(5000) };
            rig.command(ORIGIN, 0, order);
            rig.pass(SECOND / 10);
        }
        assert_eq!(rig.writes(), Vec::<Vec<u8>>::new(), "{}", model.id);
        let control = rig.view(0).control.unwrap();
        assert_eq!(control.lease, None, "{}", model.id);
    }
}

#[test]
fn a_setpoint_beside_a_stop_is_never_taken_and_goes_beside_run() {
    for model in models() {
        let mut rig = stopped(&model);
        let before = rig.view(0).control.unwrap().setpoint;
        assert_eq!(
            rig.commanded(ORIGIN, both(2500)),
            (Outcome::Acknowledged, Reason::Unchanged),
            "{}",
            model.id
        );
        assert_eq!(
            rig.view(0).control.unwrap().setpoint,
            before,
            "{}: word 257 shows what was accepted",
            model.id
        );
        let (outcome, reason) = rig.commanded(ORIGIN, run(Direction::Forward, Some(2500)));
        assert!(
            matches!(outcome, Outcome::Acknowledged | Outcome::Confirmed),
            "{}: {reason:?}",
            model.id
        );
        rig.pass(SECOND);
        assert_eq!(
            rig.view(0).control.unwrap().setpoint,
            Some(Hertz::from_centihertz(2500)),
            "{}",
            model.id
        );
    }
}

/// A controller that writes 0 in every cycle holds the drive stopped against all others, at the cost of a few frames
/// for each start, and the log names it.
#[test]
fn a_controller_that_writes_zero_in_every_cycle_holds_the_drive_stopped() {
    for model in models() {
        let mut rig = stopped(&model);
        const STARTS: usize = 6;
        for _ in 0..STARTS {
            other_master_runs(&mut rig, &model, Direction::Forward);
            for _ in 0..40 {
                rig.command(ORIGIN, 0, STOP);
                rig.pass(SECOND / 10);
            }
            assert_eq!(
                rig.output(1),
                0,
                "{}: stopped before it turned fast",
                model.id
            );
        }
        let sent = stops(&rig, &model);
        assert!(
            (STARTS..=2 * STARTS).contains(&sent),
            "{}: {sent} stops for {STARTS} starts",
            model.id
        );
        let told = rig.notes.iter().filter(
            |(_, note)| matches!(note, DriveNote::StoppedAgain { by } if *by == ORIGIN.owner),
        );
        assert_eq!(told.count(), 1, "{}: {:?}", model.id, rig.notes);
        let shown = rig.view(0).control.unwrap().stopped_again.expect("shown");
        assert_eq!(
            (shown.by, usize::from(shown.times)),
            (ORIGIN.owner, STARTS),
            "{}",
            model.id
        );
    }
}

/// A drive that was started elsewhere, and that the controller has stopped: it ramps down.
fn ramping_down(model: &Arc<Model>) -> Rig {
    let mut rig = stopped(model);
    other_master_runs(&mut rig, model, Direction::Forward);
    rig.pass(SECOND * 6);
    assert_eq!(
        rig.commanded(ORIGIN, STOP).0,
        Outcome::Confirmed,
        "{}",
        model.id
    );
    rig.pass(SECOND);
    assert!(rig.output(1) > 0, "{}: it ramps down", model.id);
    rig.sent.clear();
    rig
}

/// The motor is started again while it still ramps down from the controller's own stop.
#[test]
fn a_start_into_the_ramp_of_a_stop_is_seen() {
    for model in models() {
        let mut rig = ramping_down(&model);
        other_master_runs(&mut rig, &model, Direction::Forward);
        rig.pass(SECOND * 4);
        assert!(rig.view(0).run_state != RunState::Stopping, "{}", model.id);
        rig.command(ORIGIN, 0, STOP);
        rig.pass(SECOND * 8);
        assert_eq!((rig.output(1), stops(&rig, &model)), (0, 1), "{}", model.id);
    }
}

/// A ramp does not confirm a stop that was answered from memory: the output of a motor that was started the other way
/// falls as well.
#[test]
fn a_start_into_the_ramp_ends_at_the_stop_that_was_answered_there() {
    for model in models() {
        for direction in [Direction::Forward, Direction::Reverse] {
            let mut rig = ramping_down(&model);
            assert_eq!(
                rig.commanded(ORIGIN, STOP).1,
                Reason::Unchanged,
                "{}: by a stop of ours",
                model.id
            );
            other_master_runs(&mut rig, &model, direction);
            rig.pass(SECOND * 20);
            assert_eq!(
                (rig.output(1), stops(&rig, &model)),
                (0, 1),
                "{} {direction:?}",
                model.id
            );
        }
    }
}

#[test]
fn an_output_that_does_not_fall_is_no_ramp() {
    for model in models() {
        let mut rig = ramping_down(&model);
        // Started again just as fast as it is: the output neither rises nor falls.
        let at = rig.output(1) as u16;
        other_master_orders(&mut rig, &model, Direction::Forward, at);
        rig.pass(SECOND);
        rig.commanded(ORIGIN, STOP);
        assert_eq!(stops(&rig, &model), 1, "{}", model.id);
    }
}

#[test]
fn a_drive_out_of_sight_gets_a_bounded_number_of_frames_for_a_cyclic_zero() {
    for model in models() {
        let mut rig = stopped(&model);
        rig.bus.set_faults("lost=1000".parse().unwrap());
        for _ in 0..600 {
            rig.command(ORIGIN, 0, STOP);
            rig.pass(SECOND / 10);
        }
        let sent = stops(&rig, &model);
        assert!(
            (1..=60 / 3 + 3).contains(&sent),
            "{}: {sent} in a minute",
            model.id
        );
        rig.bus.set_faults(FaultPlan::NONE);
        rig.pass(SECOND * 10);
        assert!(!rig.view(0).control.unwrap().stop_pending, "{}", model.id);
    }
}

#[test]
fn two_controllers_that_write_zero_do_not_flood_the_line() {
    for model in models() {
        let mut rig = stopped(&model);
        for _ in 0..100 {
            rig.command(plc(1), 0, STOP);
            rig.command(plc(2), 0, STOP);
            rig.pass(SECOND / 10);
        }
        assert!(
            stops(&rig, &model) <= 4,
            "{}: {} frames in 10 s",
            model.id,
            stops(&rig, &model)
        );
        let (outcome, reason) = rig.commanded(plc(2), run(Direction::Forward, Some(2000)));
        assert!(
            outcome != Outcome::Refused,
            "{}: both have commanded stop: {reason:?}",
            model.id
        );
        let owner = rig.view(0).control.unwrap().lease.map(|(owner, _)| owner);
        assert_eq!(owner, Some(plc(2).owner), "{}", model.id);
        assert_ne!(owner, Some(Owner::Mqtt));
    }
}

/// The drive is present, but none of its replies is sound: earlier values prove nothing any more.
#[test]
fn a_zero_goes_out_and_nothing_is_set_up_by_values_that_have_grown_stale() {
    for model in models() {
        let mut rig = stopped(&model);
        rig.bus.set_faults("cut=1000".parse().unwrap());
        rig.pass(SECOND * 2);
        let told = rig.commanded(ORIGIN, Order::Release);
        assert_eq!(told.0, Outcome::Refused, "{}: {:?}", model.id, told.1);
        rig.sent.clear();
        rig.command(ORIGIN, 0, STOP);
        rig.pass(SECOND / 2);
        assert!(stops(&rig, &model) >= 1, "{}", model.id);
    }
}
