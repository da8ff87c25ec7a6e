//! What a drive shows for a moment and cannot be so is not believed: no trip, no sum and no order follows from it.

use crate::support::families::{accepting, model_with, options_of, rig_of};
use crate::support::{MQTT, Rig, RigOptions, STOP, model, run};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Owner, RunIntent};
use vfd_gateway::domain::ids::{DriveIndex, Station};
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::drive::view::{RunState, TripEventKind};
use vfd_gateway::gateway::{DriveNote, LineInput};
use vfd_gateway::journal::{RememberedDrive, RememberedStop};
use vfd_gateway::profile::model::{IndicatedState, PollClass, RegisterRole};
use vfd_gateway::sim::SimDrive;

const SECOND: Duration = Duration::from_secs(1);

fn drive(rig: &mut Rig) -> &mut SimDrive {
    rig.bus.drive_mut(Station(1)).unwrap()
}

/// A drive that has tripped five times before it was first seen, and runs at 30 Hz.
fn running(id: &str) -> Rig {
    let mut rig = rig_of(&model(id), accepting());
    let now = rig.now;
    for cause in [1, 2, 3, 4, 5] {
        drive(&mut rig).trip(now, cause);
        drive(&mut rig).clear_trip(now, None);
    }
    rig.live(SECOND * 5);
    rig.commanded(MQTT, Order::Reset);
    rig.live(SECOND * 5);
    rig.trips.clear();
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.live(SECOND * 12);
    rig
}

/// Plays reads of `word` for some time, and then a true trip.
fn for_a_while(rig: &mut Rig, word: u16, time: Duration) {
    let before = rig.view(0).usage.totals;
    let count = rig.view(0).trip.count;
    assert_eq!(count, Some(5));
    drive(rig).shows_everywhere(word);
    rig.live(time);
    drive(rig).shows_the_truth();
    rig.live(SECOND * 20);
    let told = format!("0x{word:04X} for {time:?}");
    assert!(rig.trips.is_empty(), "{told}: {:?}", rig.trips);
    assert_eq!(
        (rig.view(0).trip.count, rig.view(0).usage.totals.trips),
        (count, before.trips),
        "{told}"
    );
    let view = rig.view(0);
    assert_eq!(
        (view.control.unwrap().intent, view.run_state),
        (RunIntent::Run(Direction::Forward), RunState::Forward)
    );
}

#[test]
fn zeros_or_ones_for_a_moment_are_no_trips() {
    for word in [0, u16::MAX] {
        for time in [SECOND, SECOND * 2] {
            let mut rig = running("hyundai-n700");
            for_a_while(&mut rig, word, time);
            let now = rig.now;
            drive(&mut rig).trip(now, 7);
            rig.live(SECOND * 5);
            let [(_, event)] = rig.trips.as_slice() else {
                panic!("{:?}", rig.trips)
            };
            assert!(
                matches!(event.kind, TripEventKind::Tripped { trips: 1, .. }),
                "{event:?}"
            );
        }
    }
}

/// Once an hour is how often it is polled.
#[test]
fn a_block_that_is_doubted_is_read_again_a_second_later() {
    let places = [0x0211, 0x0212];
    let hourly = model_with("hyundai-n700", |model| {
        for register in model
            .registers
            .iter_mut()
            .filter(|it| places.contains(&it.address.number()))
        {
            register.poll = Some(PollClass::Hourly);
        }
    });
    let mut rig = rig_of(&hourly, accepting());
    rig.live(SECOND * 5);
    drive(&mut rig).shows_everywhere(u16::MAX);
    rig.sent.clear();
    rig.live(SECOND * 3700);
    let reads: Vec<_> = rig
        .sent
        .iter()
        .filter(|sent| sent.pdu.starts_with(&[3, 0x02, 0x11]))
        .map(|it| it.at)
        .collect();
    let [first, again] = reads.as_slice() else {
        panic!("{reads:?}")
    };
    assert!(
        (SECOND..SECOND * 2).contains(&again.since(*first)),
        "{reads:?}"
    );
}

#[test]
fn a_count_that_was_cleared_at_the_drive_is_believed_after_ten_seconds() {
    let mut rig = running("hyundai-n700");
    let count = model("hyundai-n700")
        .register_for(RegisterRole::TripCount)
        .unwrap()
        .address;
    drive(&mut rig).shows_at(count, 0);
    rig.live(SECOND * 8);
    assert_eq!((rig.view(0).trip.count, rig.trips.len()), (Some(5), 0));
    rig.live(SECOND * 8);
    assert_eq!((rig.view(0).trip.count, rig.trips.len()), (Some(0), 0));
    drive(&mut rig).shows_at(count, 1);
    rig.live(SECOND * 5);
    let is_trip = |event: &TripEventKind| matches!(event, TripEventKind::Tripped { trips: 1, .. });
    let trips = rig.trips.iter().filter(|(_, event)| is_trip(&event.kind));
    assert_eq!(trips.count(), 1, "it counts on from there");
}

#[test]
fn an_energy_counter_that_falls_for_a_moment_adds_nothing() {
    // In tenths of a kilowatt hour, so little that a drive could have used it all at once.
    let model = model("invertek-optidrive-e3");
    let energy = model.register_for(RegisterRole::Energy).unwrap().address;
    let mut rig = rig_of(&model, accepting());
    // The part below a step: no block of zeros.
    drive(&mut rig).shows_at(energy.checked_add(1).unwrap(), 5);
    let is_read = |rig: &mut Rig, steps: u16| {
        drive(rig).shows_at(energy, steps);
        let shown = |rig: &Rig| {
            rig.view(0)
                .snapshot
                .reading(energy)
                .map(|reading| reading.raw)
        };
        // It is read once a minute.
        for _ in 0..65 {
            if shown(rig) == Some(steps) {
                break;
            }
            rig.live(SECOND);
        }
        assert_eq!(shown(rig), Some(steps));
    };
    is_read(&mut rig, 1);
    let before = rig.view(0).usage.totals.energy_mj;
    for _ in 0..5 {
        is_read(&mut rig, 0);
        is_read(&mut rig, 1);
    }
    assert_eq!(rig.view(0).usage.totals.energy_mj, before);
}

#[test]
fn a_block_of_zeros_is_believed_only_when_it_was_read_again_a_second_later() {
    let model = model("frecon-fr500a");
    let link = model
        .register_for(RegisterRole::DcLinkVoltage)
        .unwrap()
        .address;
    let mut rig = rig_of(&model, accepting());
    rig.live(SECOND * 5);
    let shown = |rig: &Rig| {
        rig.view(0)
            .snapshot
            .reading(link)
            .map(|reading| reading.raw)
    };
    let before = shown(&rig);
    assert!(before.is_some_and(|volts| volts > 0), "{before:?}");
    for _ in 0..5 {
        let reads = rig.sent.len();
        drive(&mut rig).shows_everywhere(0);
        for _ in 0..9 {
            rig.live(SECOND / 10);
            assert_eq!(shown(&rig), before, "after one read");
        }
        assert!(rig.sent.len() > reads);
        drive(&mut rig).shows_the_truth();
        rig.live(SECOND * 5 + SECOND / 7);
    }
    drive(&mut rig).shows_everywhere(0);
    rig.live(SECOND * 5);
    assert_eq!(shown(&rig), Some(0), "it has lost its supply");
}

#[test]
fn an_output_beyond_twice_the_range_is_no_reading() {
    let model = model_with("teco-e510", |model| {
        let command = model
            .registers
            .iter_mut()
            .find(|it| it.role == Some(RegisterRole::FrequencyCommand))
            .unwrap();
        command.range = Some(0..=30_000);
    });
    let output = model
        .register_for(RegisterRole::OutputFrequency)
        .unwrap()
        .address;
    let mut rig = rig_of(&model, accepting());
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.live(SECOND * 12);
    let shown = |rig: &Rig| {
        rig.view(0)
            .snapshot
            .reading(output)
            .map(|reading| reading.raw)
    };
    assert!(shown(&rig).is_some());
    drive(&mut rig).shows_at(output, 65_000);
    rig.live(SECOND * 5);
    let told = (shown(&rig), rig.view(0).run_state);
    drive(&mut rig).shows_the_truth();
    rig.live(SECOND * 5);
    assert!(shown(&rig).is_some());
    assert_eq!(told, (None, RunState::Forward));
}

/// It runs, and its order has ended with an outage of the line; the lease is still held.
fn running_without_an_order() -> Rig {
    let mut rig = running("hyundai-n700");
    rig.close(LineFault::Gone);
    rig.open();
    rig.live(SECOND * 2);
    let control = rig.view(0).control.unwrap();
    assert_eq!(
        (control.intent, rig.view(0).run_state),
        (RunIntent::Stop, RunState::Running)
    );
    assert!(control.lease.is_some());
    rig
}

fn shows_standstill_for(rig: &mut Rig, time: Duration) {
    let output = model("hyundai-n700")
        .register_for(RegisterRole::OutputFrequency)
        .unwrap()
        .address;
    drive(rig).shows_at(output, 0);
    rig.pass(time);
}

#[test]
fn a_motor_that_reads_as_standing_for_two_seconds_may_still_run() {
    let mut rig = running_without_an_order();
    shows_standstill_for(&mut rig, SECOND * 2);
    rig.close(LineFault::Gone);
    assert!(rig.view(0).sight.may_still_run);
    let mut rig = running_without_an_order();
    shows_standstill_for(&mut rig, SECOND * 8);
    rig.close(LineFault::Gone);
    assert!(
        !rig.view(0).sight.may_still_run,
        "it was stopped from elsewhere"
    );
}

#[test]
fn a_motor_that_reads_as_standing_right_after_an_outage_gets_the_declared_stop() {
    let lost_after = accepting().lost_after;
    let mut rig = running("hyundai-n700");
    rig.close(LineFault::Gone);
    rig.pass(lost_after - SECOND);
    rig.open();
    shows_standstill_for(&mut rig, SECOND * 2);
    drive(&mut rig).shows_the_truth();
    rig.pass(lost_after + SECOND * 30);
    assert_eq!(rig.output(1), 0);
}

#[test]
fn a_stop_that_waits_for_its_drive_to_come_back_is_not_settled_by_such_a_moment() {
    let mut rig = Rig::new(&RigOptions {
        keeps: true,
        ..options_of(&model("hyundai-n700"), accepting())
    });
    rig.live(SECOND * 5);
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.live(SECOND * 12);
    drive(&mut rig).shows_everywhere(0);
    rig.restart(RememberedDrive {
        stop: Some(RememberedStop { coast: false }),
        ..RememberedDrive::default()
    });
    rig.pass(SECOND * 2);
    assert!(rig.view(0).control.unwrap().stop_pending);
    drive(&mut rig).shows_the_truth();
    rig.pass(SECOND * 30);
    assert_eq!(rig.output(1), 0);
}

#[test]
fn a_motor_that_reads_as_standing_behind_a_trip_stands() {
    let mut rig = running("hyundai-n700");
    let now = rig.now;
    drive(&mut rig).trip(now, 7);
    rig.live(SECOND * 2);
    assert_eq!(rig.output(1), 0);
    rig.close(LineFault::Gone);
    assert!(!rig.view(0).sight.may_still_run);
}

#[test]
fn a_lease_that_ends_in_such_a_moment_is_followed_by_the_declared_stop() {
    let lost_after = accepting().lost_after;
    for seconds in 0..=u32::try_from(lost_after.as_secs()).unwrap() {
        let mut rig = running_without_an_order();
        rig.pass(SECOND * seconds);
        shows_standstill_for(&mut rig, SECOND * 2);
        drive(&mut rig).shows_the_truth();
        rig.pass(lost_after + SECOND * 30);
        assert_eq!(rig.output(1), 0, "zeros from second {seconds} on");
    }
}

#[test]
fn a_drive_that_no_longer_shows_what_its_motor_does_may_run() {
    let model = model("frecon-fr500a");
    let places = [
        model.status_flag(IndicatedState::Running).unwrap().address,
        model
            .register_for(RegisterRole::OutputFrequency)
            .unwrap()
            .address,
    ];
    let mut rig = rig_of(&model, accepting());
    rig.live(SECOND * 5);
    assert_eq!(rig.view(0).run_state, RunState::Stopped);
    for place in places {
        drive(&mut rig).refuses_at(place);
    }
    rig.live(SECOND * 12);
    assert_eq!(
        (rig.view(0).run_state, rig.view(0).sight.may_still_run),
        (RunState::Unknown, false)
    );
    drive(&mut rig).shows_the_truth();
    rig.live(SECOND * 15);
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.live(SECOND * 12);
    for place in places {
        drive(&mut rig).refuses_at(place);
    }
    rig.live(SECOND * 12);
    assert_eq!(
        (rig.view(0).run_state, rig.view(0).sight.may_still_run),
        (RunState::Unknown, true)
    );
    assert_eq!(
        rig.view(0).control.unwrap().intent,
        RunIntent::Run(Direction::Forward),
        "its order holds"
    );
    drive(&mut rig).shows_the_truth();
    rig.live(SECOND * 15);
    assert_eq!(
        (rig.view(0).run_state, rig.view(0).sight.may_still_run),
        (RunState::Forward, false)
    );
}

#[test]
fn a_run_order_that_a_drive_takes_which_shows_nothing_is_reported_and_outlasts_what_a_person_confirmed()
 {
    let model = model("frecon-fr500a");
    let places = [
        model.status_flag(IndicatedState::Running).unwrap().address,
        model
            .register_for(RegisterRole::OutputFrequency)
            .unwrap()
            .address,
    ];
    let mut rig = rig_of(&model, accepting());
    rig.live(SECOND * 5);
    for place in places {
        drive(&mut rig).refuses_at(place);
    }
    rig.live(SECOND * 12);
    for times in 1..=2 {
        assert!(!rig.view(0).sight.may_still_run);
        rig.command(MQTT, 0, run(Direction::Forward, Some(3000)));
        rig.live(SECOND * 2);
        assert!(rig.view(0).sight.may_still_run, "order {times}");
        let reports = rig
            .notes
            .iter()
            .filter(|(_, note)| matches!(note, DriveNote::MayStillRun(_)));
        assert_eq!(reports.count(), times);
        rig.core.handle(
            rig.now,
            LineInput::ConfirmStandstill(DriveIndex(0), Owner::Local),
        );
        rig.settle();
    }
}

#[test]
fn a_drive_that_shows_zero_once_and_is_silent_again_is_stopped_like_one_that_is_away() {
    let mut rig = Rig::new(&RigOptions {
        keeps: true,
        ..options_of(&model("hyundai-n700"), accepting())
    });
    rig.live(SECOND * 5);
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.live(SECOND * 12);
    let power = |rig: &mut Rig, is_on| {
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), is_on);
    };
    power(&mut rig, false);
    rig.live(SECOND * 5);
    rig.command(MQTT, 0, STOP);
    rig.live(SECOND * 20);
    power(&mut rig, true);
    rig.pass(SECOND * 2);
    power(&mut rig, false);
    let before = rig.writes().len();
    rig.pass(SECOND * 40);
    let repeats = rig.writes().len() - before;
    assert!((3..=5).contains(&repeats), "{repeats} while it is away");
    drive(&mut rig).shows_everywhere(0);
    power(&mut rig, true);
    rig.pass(SECOND * 4);
    assert!(rig.view(0).control.unwrap().stop_pending, "no 3 s of zeros");
    rig.pass(SECOND * 4);
    assert!(!rig.view(0).control.unwrap().stop_pending);
}
