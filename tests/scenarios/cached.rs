//! Native reads that cover polls take their place, and what they bring may be answered from memory, never staler than
//! declared.

use crate::support::{MQTT, PROOF, Rig, RigOptions, STOP, Sent, model, plc, run};
use std::collections::HashMap;
use std::time::Duration;
use vfd_gateway::domain::address::Address;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::ids::{DriveIndex, Name, Station, UnitId};
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::drive::description::{DriveDescription, DriveRatings, DriveRef, PointSettings};
use vfd_gateway::drive::plan::PollPace;
use vfd_gateway::drive::view::{RunState, TripEventKind};
use vfd_gateway::north::modbus::{WordBuffer, memory};
use vfd_gateway::sim::BadRequest;

const OUTPUT: u16 = 0x0101;
const TRIP_COUNT: u16 = 0x0112;
const F001: u16 = 0x0201;
const F010: u16 = 0x0211;
const RUN: u16 = 0x0002;
const SETPOINT: u16 = 0x0004;

const PERIOD: Duration = Duration::from_secs(1);

/// Drives that are polled every second and may be commanded.
fn rig(drives: u8) -> Rig {
    let mut rig = Rig::new(&RigOptions {
        drives,
        poll: PERIOD,
        ..RigOptions::controlled()
    });
    rig.pass(Duration::from_secs(5));
    rig.sent.clear();
    rig
}

/// The drive of the rig as a listener knows it.
fn description() -> DriveDescription {
    let unit = |number| UnitId::new(number).unwrap();
    DriveDescription {
        place: DriveRef {
            line: 0,
            drive: DriveIndex(0),
        },
        name: Name::new("pump").unwrap(),
        line: Name::new("hall").unwrap(),
        model: model("hyundai-n700"),
        unit: unit(1),
        uniform_unit: unit(101),
        group: None,
        pace: PollPace::new(PERIOD, 1.0),
        ratings: DriveRatings::default(),
        control: None,
        points: PointSettings::default(),
    }
}

/// What a listener with `cached` answers from memory, and the age of that. The line has taken all orders.
fn recalled(rig: &Rig, index: u16, address: u16, count: u16) -> Option<(Vec<u16>, Duration)> {
    let view = rig.view(index);
    let mut words = WordBuffer::default();
    let read = (Address::holding(address), count);
    let age = memory::recall(
        &description(),
        &view,
        view.orders.taken,
        read,
        rig.now,
        &mut words,
    )?;
    Some((words.as_slice().to_vec(), age))
}

/// From memory, or else from the drive.
fn cached_read(rig: &mut Rig, address: u16) -> Vec<u16> {
    if let Some((words, _)) = recalled(rig, 0, address, 1) {
        return words;
    }
    let ticket = rig.read(1, 0, address, 1);
    let NativeOutcome::Words(words) = rig.answer_to(ticket) else {
        panic!("no words")
    };
    words.to_vec()
}

fn reads_of(rig: &Rig, station: u8, address: u16) -> impl Iterator<Item = &Sent> {
    let place = address.to_be_bytes();
    rig.sent
        .iter()
        .filter(move |sent| sent.frame[0] == station && sent.pdu[0] == 3 && sent.pdu[1..3] == place)
}

#[test]
fn a_client_that_reads_what_is_polled_pays_once() {
    let mut rig = rig(1);
    let mut asked = 0;
    let until = rig.now + Duration::from_secs(30);
    while rig.now < until {
        let ticket = rig.read(1, 0, OUTPUT, 1);
        asked += 1;
        assert!(matches!(rig.answer_to(ticket), NativeOutcome::Words(_)));
        rig.pass(Duration::from_millis(300));
    }
    assert_eq!(reads_of(&rig, 1, OUTPUT).count(), asked, "no poll besides");
    let others = reads_of(&rig, 1, TRIP_COUNT).count();
    assert!((29..=31).contains(&others), "other polls go on: {others}");
    // Once the client is gone, the polls come as before.
    rig.sent.clear();
    rig.pass(Duration::from_secs(10));
    let polls = reads_of(&rig, 1, OUTPUT).count();
    assert!((9..=11).contains(&polls), "{polls}");
}

#[test]
fn a_poll_that_is_due_and_a_client_that_waits_for_the_same_share_an_exchange() {
    let mut rig = rig(1);
    let mut asked = 0;
    for round in 0..20 {
        let ticket = rig.read(1, 0, OUTPUT, 1);
        assert!(matches!(rig.answer_to(ticket), NativeOutcome::Words(_)));
        // Polls and reads take turns: the next poll finds it once its own turn, once that of the read.
        for n in 0..=round % 2 {
            rig.read(3, 0, PROOF + n, 1);
        }
        rig.pass(PERIOD - Duration::from_millis(30));
        // The poll falls due while this is on the wire and the client waits.
        rig.read(2, 0, PROOF, 8);
        let ticket = rig.read(1, 0, OUTPUT, 1);
        assert!(matches!(rig.answer_to(ticket), NativeOutcome::Words(_)));
        asked += 2;
        // What is left of others.
        rig.pass(Duration::from_millis(100));
    }
    assert_eq!(reads_of(&rig, 1, OUTPUT).count(), asked, "no poll besides");
}

#[test]
fn a_part_of_a_poll_group_takes_nothing_into_the_picture() {
    let mut rig = rig(1);
    // F010 and F011 are polled in one frame.
    let before = rig.view(0).snapshot;
    let ticket = rig.read(1, 0, F010, 1);
    assert!(matches!(rig.answer_to(ticket), NativeOutcome::Words(_)));
    assert_eq!(rig.view(0).snapshot.reading(F010), before.reading(F010));
    let ticket = rig.read(1, 0, F010, 2);
    assert!(matches!(rig.answer_to(ticket), NativeOutcome::Words(_)));
    let snapshot = rig.view(0).snapshot;
    assert_eq!(
        snapshot.reading(F010).unwrap().at,
        snapshot.reading(F010 + 1).unwrap().at
    );
    assert!(snapshot.reading(F010).unwrap().at > before.reading(F010).unwrap().at);
}

#[test]
fn nothing_is_served_that_is_staler_than_declared() {
    let mut rig = rig(4);
    let (mut seed, mut from_memory, mut from_line) = (1_u32, 0, 0);
    let periods = HashMap::from([(OUTPUT, PERIOD), (TRIP_COUNT, PERIOD), (F001, PERIOD * 4)]);
    let until = rig.now + Duration::from_secs(300);
    while rig.now < until {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let index = (seed >> 8) as u16 % 4;
        let address = [OUTPUT, TRIP_COUNT, F001][(seed >> 16) as usize % 3];
        // From time to time the line is too busy for its polls.
        let pause = if (rig.now.since(MonoTime::ZERO).as_secs() / 20).is_multiple_of(2) {
            7
        } else {
            130
        };
        if seed >> 24 < 8 {
            for n in 0..30 {
                rig.read(9, index, PROOF + n, 8);
            }
        }
        if let Some((_, age)) = recalled(&rig, index, address, 1) {
            from_memory += 1;
            assert!(age <= periods[&address], "{age:?} at {:?}", rig.now);
            // The age is the true one: the drive was asked before, and its answer takes a moment.
            let read_at = rig.now.before(age);
            let newest = reads_of(&rig, index as u8 + 1, address)
                .filter(|sent| sent.at <= read_at)
                .last();
            let took = newest.map(|sent| read_at.since(sent.at));
            let is_known = took.is_none_or(|took| took < Duration::from_millis(100));
            assert!(is_known || read_at < rig.sent[0].at, "{took:?}");
        } else {
            from_line += 1;
            rig.read(1, index, address, 1);
        }
        rig.pass(Duration::from_millis(pause));
    }
    assert!(
        from_memory > 1000 && from_line > 100,
        "{from_memory} {from_line}"
    );
}

#[test]
fn a_client_reads_what_it_has_written() {
    let mut rig = rig(1);
    for (number, setpoint) in (0..40_u16).map(|number| (number, 1000 + number * 17)) {
        cached_read(&mut rig, F001);
        let written = rig.ask(
            1,
            0,
            NativeAsk::Write {
                address: SETPOINT.into(),
                values: vec![setpoint],
            },
        );
        assert_eq!(recalled(&rig, 0, F001, 1), None, "a write that waits");
        assert_eq!(rig.answer_to(written), NativeOutcome::Written);
        assert_eq!(cached_read(&mut rig, F001), [setpoint], "{number}");
        assert_eq!(cached_read(&mut rig, F001), [setpoint], "{number}");
        rig.pass(Duration::from_millis(u64::from(number) * 37));
    }
}

#[test]
fn a_stop_by_anyone_makes_older_readings_no_answer() {
    let mut rig = rig(1);
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.live(Duration::from_secs(3));
    cached_read(&mut rig, OUTPUT);
    assert!(recalled(&rig, 0, OUTPUT, 1).is_some());
    // The stop waits for what is on the wire.
    rig.read(1, 0, PROOF, 8);
    let stop = rig.command(plc(7), 0, STOP);
    assert_ne!(rig.written(RUN).last(), Some(&0));
    while rig.told(stop).iter().all(|(_, _, is_final)| !is_final) {
        assert_eq!(recalled(&rig, 0, OUTPUT, 1), None);
        rig.step(rig.now + PERIOD);
    }
    let stopped_at = rig.sent.iter().rfind(|sent| sent.pdu[0] == 6).unwrap().at;
    assert_eq!(rig.outcome_of(stop), (Outcome::Confirmed, Reason::None));
    let (_, age) = recalled(&rig, 0, OUTPUT, 1).expect("the look that showed the effect");
    assert!(rig.now.before(age) > stopped_at);
}

/// A drive that is polled once an hour and runs at 30 Hz.
fn unpolled_and_running() -> Rig {
    let mut rig = Rig::new(&RigOptions {
        poll: Duration::from_secs(3600),
        ..RigOptions::controlled()
    });
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.live(Duration::from_secs(5));
    rig.sent.clear();
    rig
}

#[test]
fn a_read_that_was_sent_before_a_stop_shows_no_effect_of_it() {
    let mut rig = unpolled_and_running();
    rig.read(1, 0, OUTPUT, 1);
    assert_eq!(rig.sent.len(), 1, "on the wire");
    let stop = rig.command(plc(7), 0, STOP);
    let confirmed = rig.outcome_of(stop);
    assert_eq!(confirmed, (Outcome::Confirmed, Reason::None));
    let asked: Vec<_> = rig.sent.iter().map(|sent| sent.pdu[0]).collect();
    assert_eq!(asked[..2], [3, 6], "the stop follows the read");
    assert!(
        asked[2..].contains(&3),
        "its effect is read after it: {asked:?}"
    );
}

#[test]
fn what_clients_read_shows_that_a_stop_takes_effect() {
    let mut rig = unpolled_and_running();
    let stop = rig.command(plc(7), 0, STOP);
    while rig.written(RUN).is_empty() || rig.told(stop).is_empty() {
        rig.step(rig.now + PERIOD);
    }
    rig.sent.clear();
    // The next look is not due yet: the client's readings come first.
    let mut shown = 0;
    while !rig.told(stop).iter().any(|(_, _, is_final)| *is_final) {
        let ticket = rig.read(1, 0, OUTPUT, 1);
        assert!(matches!(rig.answer_to(ticket), NativeOutcome::Words(_)));
        shown += 1;
        assert!(shown < 10, "{:?}", rig.told(stop));
    }
    let reads = reads_of(&rig, 1, OUTPUT).count();
    assert!(reads >= shown, "{reads} {shown}");
    assert_eq!(rig.outcome_of(stop), (Outcome::Confirmed, Reason::None));
    rig.pass(Duration::from_secs(20));
    assert_eq!(rig.output(1), 0);
}

#[test]
fn a_trip_that_only_a_client_has_read_is_reported_once() {
    let mut rig = unpolled_and_running();
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, 7);
    rig.pass(Duration::from_secs(1));
    assert!(rig.trips.is_empty(), "it was not looked at");
    for _ in 0..5 {
        let ticket = rig.read(1, 0, TRIP_COUNT, 1);
        assert!(matches!(rig.answer_to(ticket), NativeOutcome::Words(_)));
        rig.pass(Duration::from_millis(500));
    }
    let [(_, event)] = rig.trips.as_slice() else {
        panic!("{:?}", rig.trips)
    };
    let TripEventKind::Tripped { trips: 1, record } = &event.kind else {
        panic!("{event:?}")
    };
    assert_eq!((record.code, event.count), (Some(7), Some(1)));
    assert_eq!(rig.view(0).run_state, RunState::Tripped);
}

#[test]
fn a_refused_read_delays_no_poll() {
    let bad_request = BadRequest::Exception;
    let mut rig = Rig::new(&RigOptions {
        poll: PERIOD,
        bad_request,
        ..RigOptions::default()
    });
    rig.sent.clear();
    let until = rig.now + Duration::from_secs(10);
    while rig.now < until {
        // The group with a number that the drive does not have.
        let ticket = rig.read(1, 0, OUTPUT, 2);
        assert!(matches!(
            rig.answer_to(ticket),
            NativeOutcome::DriveException { .. }
        ));
        rig.pass(Duration::from_millis(100));
    }
    let polls = reads_of(&rig, 1, OUTPUT)
        .filter(|sent| sent.pdu[4] == 1)
        .count();
    assert!((9..=11).contains(&polls), "{polls}");
}

#[test]
fn polls_cost_a_client_nothing_that_walks_over_the_same_registers() {
    // All that is polled, and as many words that are not.
    let polled = [(OUTPUT, 1), (TRIP_COUNT, 1), (F001, 1), (F010, 2)];
    let others = [(PROOF, 1), (PROOF + 1, 1), (PROOF + 2, 1), (PROOF + 3, 2)];
    let rate = |poll: Duration, reads: [(u16, u16); 4]| {
        let mut rig = Rig::new(&RigOptions {
            drives: 8,
            poll,
            ..RigOptions::default()
        });
        rig.keeps_sent = false;
        let (mut at, mut right) = (0_u16, 0);
        let mut ask = move |rig: &mut Rig| {
            let (address, count) = reads[usize::from(at / 8 % 4)];
            rig.read(0, at % 8, address, count);
            at += 1;
        };
        ask(&mut rig);
        rig.run_until(rig.now + Duration::from_secs(60), |rig, answer| {
            right += u32::from(matches!(answer.outcome, NativeOutcome::Words(_)));
            ask(rig);
        });
        f64::from(right) / 60.0
    };
    let hour = Duration::from_secs(3600);
    let (bare, beside, along) = (
        rate(hour, polled),
        rate(PERIOD, others),
        rate(PERIOD, polled),
    );
    println!(
        "reads/s: {bare:.2} of the bare line, {beside:.2} beside the polls, {along:.2} of what is polled"
    );
    assert!(beside < 0.7 * bare, "{beside} {bare}");
    assert!(along > 0.97 * bare, "{along} {bare}");
}

#[test]
fn a_walk_that_may_be_answered_from_memory_leaves_the_wire_to_others() {
    let mut rig = rig(1);
    let (mut memory, mut line) = (0, 0);
    let until: MonoTime = rig.now + Duration::from_secs(20);
    while rig.now < until {
        if recalled(&rig, 0, OUTPUT, 1).is_some() {
            memory += 1;
        } else {
            let ticket = rig.read(1, 0, OUTPUT, 1);
            rig.answer_to(ticket);
            line += 1;
        }
        rig.pass(Duration::from_millis(20));
    }
    let reads = reads_of(&rig, 1, OUTPUT).count();
    assert!(reads <= 21, "at most one a period: {reads}");
    assert!(memory > 900 && line <= 21, "{memory} {line}");
}
