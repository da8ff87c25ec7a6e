//! Trips are detected, read with their record, reported once, and cancel every order to run.

use crate::support::families::{accepting, model_with, models, rig_of, single};
use crate::support::{MQTT, Rig, RigOptions, STOP, model, plc, run};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason, RunIntent};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::PortKind;
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::drive::view::{RunState, TripEvent, TripEventKind};
use vfd_gateway::gateway::LineInput;
use vfd_gateway::profile::model::{IndicatedState, Model, RegisterRole, WordOrder};
use vfd_gateway::sim::RefusedStops;

const RUN: u16 = 0x0002;

fn tripped(rig: &mut Rig, cause: u16) {
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, cause);
    rig.pass(Duration::from_millis(1300));
}

fn running() -> Rig {
    let mut rig = Rig::new(&RigOptions::controlled());
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.pass(Duration::from_secs(2));
    rig
}

/// The number of trips reported so far.
fn told(rig: &Rig) -> u32 {
    let trips = |(_, event): &(_, TripEvent)| match event.kind {
        TripEventKind::Tripped { trips, .. } => u32::from(trips),
        TripEventKind::Cleared => 0,
    };
    rig.trips.iter().map(trips).sum()
}

#[test]
fn a_trip_is_reported_once_with_what_was_measured() {
    let mut rig = running();
    let at_trip = rig.output(1);
    tripped(&mut rig, 7);
    rig.pass(Duration::from_secs(5));
    let [(_, event)] = rig.trips.as_slice() else {
        panic!("{:?}", rig.trips)
    };
    let TripEventKind::Tripped { trips: 1, record } = &event.kind else {
        panic!("{event:?}")
    };
    assert_eq!(
        (record.code, event.count, event.while_away),
        (Some(7), Some(1), false)
    );
    assert_eq!(
        record.words[1],
        (0x0114_u16.into(), at_trip as u16),
        "the frequency at the trip"
    );
    let view = rig.view(0);
    assert_eq!(
        (view.run_state, view.trip.active, view.trip.seen),
        (RunState::Tripped, Some(true), 1)
    );
}

#[test]
fn after_a_trip_a_reset_and_a_fresh_order_are_needed() {
    let mut rig = running();
    tripped(&mut rig, 7);
    let control = rig.view(0).control.unwrap();
    assert_eq!(
        (control.intent, control.start_inhibited),
        (RunIntent::Stop, true)
    );
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Refused, Reason::Tripped)
    );
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, Order::Reset),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(
        rig.written(RUN),
        [0, 4, 0],
        "a reset is framed by stops and carries no run order"
    );
    rig.pass(Duration::from_secs(3));
    assert_eq!(rig.trips.last().unwrap().1.kind, TripEventKind::Cleared);
    assert_eq!((rig.output(1), rig.view(0).trip.active), (0, Some(false)));
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)).0,
        Outcome::Acknowledged
    );
    rig.pass(Duration::from_secs(1));
    assert!(rig.output(1) > 0);
}

#[test]
fn a_controller_that_goes_on_writing_run_does_not_restart_a_reset_drive() {
    let mut rig = Rig::new(&RigOptions::controlled());
    rig.commanded(plc(1), Order::Stop { setpoint: None });
    rig.commanded(plc(1), run(Direction::Forward, Some(3000)));
    rig.pass(Duration::from_secs(1));
    tripped(&mut rig, 3);
    assert_eq!(rig.commanded(plc(1), Order::Reset).0, Outcome::Confirmed);
    rig.pass(Duration::from_millis(1500));
    assert_eq!(
        rig.commanded(plc(1), run(Direction::Forward, None)),
        (Outcome::Refused, Reason::StartInhibited)
    );
    rig.pass(Duration::from_secs(2));
    assert_eq!(rig.output(1), 0);
}

#[test]
fn trips_between_two_polls_are_counted() {
    let mut rig = running();
    let now = rig.now;
    for cause in [1, 2, 3] {
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, cause);
    }
    rig.pass(Duration::from_secs(3));
    let TripEventKind::Tripped { trips, record } = &rig.trips[0].1.kind else {
        panic!()
    };
    assert_eq!((*trips, record.code), (3, Some(3)));
    assert_eq!(rig.view(0).trip.seen, 3);
}

#[test]
fn no_trip_is_lost_on_a_bad_line() {
    let mut rig = running();
    rig.bus
        .set_faults("noise=50,lost=50,late=20,cut=20,flip=50".parse().unwrap());
    for cause in 1..=50 {
        tripped(&mut rig, cause);
        rig.pass(Duration::from_secs(4));
    }
    rig.bus.set_faults(vfd_gateway::sim::FaultPlan::NONE);
    rig.pass(Duration::from_secs(60));
    assert_eq!(told(&rig), 50);
}

#[test]
fn a_trip_while_the_line_was_down_is_reported_as_one_that_nobody_saw_happen() {
    for model in models()
        .into_iter()
        .filter(|model| model.trip_register().is_some())
    {
        let mut rig = rig_of(&model, accepting());
        rig.core
            .handle(rig.now, LineInput::PortDown(LineFault::Gone));
        rig.settle();
        rig.pass(Duration::from_secs(2));
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, 2);
        rig.core
            .handle(rig.now, LineInput::PortUp(PortKind::Serial));
        rig.live(Duration::from_secs(10));
        let [(_, event)] = rig.trips.as_slice() else {
            panic!("{}: {:?}", model.id, rig.trips)
        };
        let TripEventKind::Tripped { trips: 1, record } = &event.kind else {
            panic!("{}: {event:?}", model.id)
        };
        assert_eq!(
            (event.while_away, record.code),
            (true, Some(2)),
            "{}",
            model.id
        );
    }
}

#[test]
fn a_trip_is_reported_while_stops_are_refused_and_replies_were_late() {
    for id in ["teco-e510", "frecon-fr500a"] {
        let model = model(id);
        let control = Some(accepting());
        let poll = Duration::from_secs(2);
        let mut rig = Rig::new(&RigOptions {
            model,
            control,
            poll,
            proof_words: None,
            ..RigOptions::controlled()
        });
        rig.commanded(MQTT, run(Direction::Forward, Some(2000)));
        rig.live(Duration::from_secs(3));
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .refuse_stops(RefusedStops::All);
        // Replies beyond the maximum lateness make the next ones doubtful.
        rig.bus.set_faults("beyond=200".parse().unwrap());
        let stop = rig.command(MQTT, 0, STOP);
        rig.outcome_of(stop);
        rig.pass(Duration::from_secs(10));
        rig.bus.set_faults(vfd_gateway::sim::FaultPlan::NONE);
        rig.pass(Duration::from_secs(120));
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, 2);
        rig.pass(Duration::from_secs(5));
        assert_eq!(
            told(&rig),
            1,
            "{id}: the exceptions to the stops made no reply doubtful"
        );
    }
}

#[test]
fn a_trip_whose_record_is_being_read_when_the_line_is_left_is_reported() {
    let mut rig = running();
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, 7);
    let limit = now + Duration::from_secs(10);
    while rig.view(0).trip.active != Some(true) {
        assert!(rig.step(limit), "no trip is seen");
    }
    rig.core.end_attempts(rig.now);
    rig.settle();
    assert_eq!((told(&rig), rig.view(0).trip.active), (1, Some(true)));
}

#[test]
fn a_trip_that_takes_the_power_with_it_is_reported_while_the_drive_is_away_and_only_once() {
    for model in models()
        .into_iter()
        .filter(|model| model.trip_register().is_some())
    {
        let mut rig = rig_of(&model, accepting());
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, 2);
        let limit = now + Duration::from_secs(10);
        while rig.view(0).trip.active != Some(true) {
            assert!(rig.step(limit), "{}: no trip is seen", model.id);
        }
        assert_eq!(rig.trips, [], "{}: its record was not read yet", model.id);
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), false);
        rig.live(Duration::from_secs(10));
        assert_eq!(
            (told(&rig), rig.view(0).trip.active),
            (1, None),
            "{}: {:?}",
            model.id,
            rig.trips
        );
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), true);
        rig.live(Duration::from_secs(20));
        assert_eq!(
            (told(&rig), rig.view(0).trip.seen),
            (1, 1),
            "{}: {:?}",
            model.id,
            rig.trips
        );
    }
}

#[test]
fn run_that_was_held_through_a_trip_does_not_start_the_motor_when_the_drive_is_reset_at_its_panel()
{
    // Model, run command, and the word there that resets.
    for (id, command, reset) in [("frecon-fr500a", 0x2000, 7), ("teco-e510", 0x2501, 8)] {
        let mut rig = rig_of(&model(id), accepting());
        let held = || run(Direction::Forward, Some(3000));
        rig.commanded(plc(1), STOP);
        assert_eq!(rig.commanded(plc(1), held()).0, Outcome::Confirmed, "{id}");
        rig.pass(Duration::from_secs(3));
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, 2);
        rig.pass(Duration::from_secs(3));
        rig.commanded(plc(1), STOP);
        assert_eq!(
            rig.commanded(plc(1), held()),
            (Outcome::Refused, Reason::Tripped),
            "{id}"
        );
        let now = rig.now;
        let drive = rig.bus.drive_mut(Station(1)).unwrap();
        assert!(
            drive.answer(now, &single(command, reset), 0, &mut Vec::new()) && !drive.is_tripped()
        );
        rig.pass(Duration::from_secs(3));
        assert_eq!(rig.view(0).trip.active, Some(false), "{id}");
        assert_eq!(
            rig.commanded(plc(1), held()),
            (Outcome::Refused, Reason::StartInhibited),
            "{id}"
        );
        rig.pass(Duration::from_secs(2));
        assert_eq!(rig.output(1), 0, "{id}");
        rig.commanded(plc(1), STOP);
        assert_eq!(
            rig.commanded(plc(1), held()).0,
            Outcome::Confirmed,
            "{id}: ordered anew"
        );
    }
}

/// A drive whose present trip stands in a register with `role`, with or without a flag beside it.
fn showing(role: RegisterRole, has_flag: bool) -> Arc<Model> {
    model_with("teco-e510", |model| {
        model
            .status
            .retain(|it| has_flag || it.flag != IndicatedState::Tripped);
        for register in &mut model.registers {
            if register.role == Some(RegisterRole::TripCode) {
                register.role = Some(role);
            }
        }
    })
}

/// The code and the words of each trip that was told, in order.
fn codes(rig: &Rig) -> Vec<(Option<u16>, Vec<u16>)> {
    let trip = |(_, event): &(_, TripEvent)| match &event.kind {
        TripEventKind::Tripped { record, .. } => Some((
            record.code,
            record.words.iter().map(|(_, word)| *word).collect(),
        )),
        TripEventKind::Cleared => None,
    };
    rig.trips.iter().filter_map(trip).collect()
}

#[test]
fn two_bits_at_once_are_one_trip_that_tells_both() {
    for has_flag in [true, false] {
        let mut rig = rig_of(&showing(RegisterRole::TripBits, has_flag), accepting());
        rig.pass(Duration::from_secs(3));
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, 7);
        tripped(&mut rig, 4);
        rig.pass(Duration::from_secs(5));
        assert_eq!(
            codes(&rig),
            [(Some(4), vec![0b0100_1000])],
            "flag: {has_flag}"
        );
        assert_eq!(
            (rig.view(0).run_state, rig.view(0).trip.seen),
            (RunState::Tripped, 1)
        );
    }
}

#[test]
fn a_second_bit_while_the_first_holds_is_another_trip_and_one_that_clears_is_none() {
    for has_flag in [true, false] {
        let mut rig = rig_of(&showing(RegisterRole::TripBits, has_flag), accepting());
        rig.pass(Duration::from_secs(3));
        tripped(&mut rig, 4);
        rig.pass(Duration::from_secs(3));
        tripped(&mut rig, 7);
        rig.pass(Duration::from_secs(3));
        let both = [(Some(4), vec![0b0000_1000]), (Some(4), vec![0b0100_1000])];
        assert_eq!(codes(&rig), both, "flag: {has_flag}");
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .keep_trip_bits(0b0100_0000);
        rig.pass(Duration::from_secs(5));
        assert_eq!(
            (codes(&rig).len(), rig.view(0).trip.active),
            (2, Some(true)),
            "flag: {has_flag}"
        );
        tripped(&mut rig, 4);
        rig.pass(Duration::from_secs(3));
        assert_eq!(
            codes(&rig).len(),
            3,
            "the bit is set again; flag: {has_flag}"
        );
    }
}

/// A drive whose trips are the bits of two words.
fn of_two_words(order: WordOrder, has_flag: bool) -> Arc<Model> {
    let mut model = Model::clone(&showing(RegisterRole::TripBits, has_flag));
    let register = model
        .registers
        .iter_mut()
        .find(|it| it.role == Some(RegisterRole::TripBits))
        .unwrap();
    register.address = 0x2540_u16.into();
    register.form.pair = Some(order);
    model.registers.sort_by_key(|it| it.address);
    Arc::new(model)
}

#[test]
fn trips_of_two_words_are_all_told_once_also_after_the_line_was_lost() {
    for (order, has_flag) in [
        (WordOrder::HighFirst, true),
        (WordOrder::LowFirst, true),
        (WordOrder::HighFirst, false),
    ] {
        let mut rig = rig_of(&of_two_words(order, has_flag), accepting());
        rig.pass(Duration::from_secs(3));
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, 20);
        tripped(&mut rig, 4);
        rig.pass(Duration::from_secs(5));
        let words = |bits| order.words(bits).to_vec();
        let first = [(Some(4), words(0x0008_0008))];
        assert_eq!(codes(&rig), first, "{order:?} {has_flag}");
        rig.reopen();
        rig.pass(Duration::from_secs(10));
        assert_eq!(
            codes(&rig),
            first,
            "{order:?} {has_flag}: it holds as before"
        );
        tripped(&mut rig, 32);
        rig.pass(Duration::from_secs(5));
        let [first] = first;
        assert_eq!(
            codes(&rig),
            [first, (Some(4), words(0x8008_0008))],
            "{order:?} {has_flag}"
        );
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .keep_trip_bits(0x8000_0000);
        rig.pass(Duration::from_secs(5));
        assert_eq!(
            (codes(&rig).len(), rig.view(0).trip.active),
            (2, Some(true)),
            "{order:?} {has_flag}"
        );
    }
}

#[test]
fn a_trip_in_the_high_word_alone_is_a_trip_and_ends_as_one() {
    let mut rig = rig_of(&of_two_words(WordOrder::HighFirst, false), accepting());
    rig.pass(Duration::from_secs(3));
    tripped(&mut rig, 17);
    rig.pass(Duration::from_secs(5));
    assert_eq!(codes(&rig), [(Some(17), vec![1, 0])]);
    rig.bus.drive_mut(Station(1)).unwrap().keep_trip_bits(0);
    rig.pass(Duration::from_secs(5));
    assert_eq!((rig.trips.len(), rig.view(0).trip.active), (2, Some(false)));
}

#[test]
fn bits_that_clear_end_the_trip_once() {
    let mut rig = rig_of(&showing(RegisterRole::TripBits, false), accepting());
    rig.pass(Duration::from_secs(3));
    tripped(&mut rig, 4);
    rig.bus.drive_mut(Station(1)).unwrap().keep_trip_bits(0);
    rig.pass(Duration::from_secs(5));
    assert_eq!(
        (codes(&rig).len(), rig.trips.len(), rig.view(0).trip.active),
        (1, 2, Some(false))
    );
    assert_eq!(rig.trips.last().unwrap().1.kind, TripEventKind::Cleared);
}

#[test]
fn an_old_cause_while_the_flag_is_clear_is_no_trip() {
    let model = showing(RegisterRole::TripCause, true);
    let mut rig = rig_of(&model, accepting());
    rig.pass(Duration::from_secs(3));
    tripped(&mut rig, 4);
    assert_eq!(rig.commanded(MQTT, Order::Reset).0, Outcome::Confirmed);
    rig.pass(Duration::from_secs(30));
    assert_eq!((told(&rig), rig.trips.len()), (1, 2), "{:?}", rig.trips);
    rig.reopen();
    rig.pass(Duration::from_secs(30));
    assert_eq!(
        (told(&rig), rig.view(0).trip.active),
        (1, Some(false)),
        "the cause is still shown"
    );
}
