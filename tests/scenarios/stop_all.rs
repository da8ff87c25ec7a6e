//! A stop for every drive of a line is broadcast if the model allows it, and is confirmed one by one.

use crate::support::{MQTT, PROOF, Rig, RigOptions, STOP, Sent, model, run};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Owner, Reason};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::line::budget::BROADCAST_TURNAROUND;
use vfd_gateway::sim::FaultPlan;

const DRIVES: u8 = 3;
/// Typed from the interface manual of the N700: FF hex addresses all, run command 0002, 0 stops.
const TO_ALL: [u8; 6] = [0xFF, 6, 0, 2, 0, 0];

fn running(options: &RigOptions) -> Rig {
    let mut rig = Rig::new(options);
    for index in 0..u16::from(options.drives) {
        let ticket = rig.command(MQTT, index, run(Direction::Forward, Some(3000)));
        let (outcome, _) = rig.outcome_of(ticket);
        assert!(
            matches!(outcome, Outcome::Acknowledged | Outcome::Confirmed),
            "drive {index}: {outcome:?}"
        );
    }
    rig.live(Duration::from_secs(8));
    rig.sent.clear();
    rig
}

fn line() -> RigOptions {
    RigOptions {
        drives: DRIVES,
        ..RigOptions::controlled()
    }
}

/// Stops every drive in one round, as a stop for all does, and returns the frames sent until all are confirmed.
fn stop_all(rig: &mut Rig, drives: u16) -> Vec<Sent> {
    let tickets: Vec<_> = (0..drives)
        .map(|index| rig.command_unsettled(MQTT, index, STOP))
        .collect();
    rig.settle();
    for ticket in tickets {
        assert_eq!(rig.outcome_of(ticket), (Outcome::Confirmed, Reason::None));
    }
    std::mem::take(&mut rig.sent)
}

fn starts<'a>(sent: &'a [Sent], frame: &'a [u8]) -> impl Iterator<Item = MonoTime> + 'a {
    sent.iter()
        .filter(move |sent| sent.frame.starts_with(frame))
        .map(|sent| sent.at)
}

#[test]
fn one_frame_stops_all_and_each_is_confirmed_by_its_own() {
    let mut rig = running(&line());
    let sent = stop_all(&mut rig, DRIVES.into());
    let writes: Vec<_> = sent.iter().filter(|sent| sent.frame[1] == 6).collect();
    assert!(
        writes[0].frame.starts_with(&TO_ALL),
        "{:02X?}",
        writes[0].frame
    );
    assert_eq!(starts(&sent, &TO_ALL).count(), 1);
    // 8 characters of 10 bits at 9600 bit/s, and the turnaround.
    let free = writes[0].at + Duration::from_nanos(8_333_334) + BROADCAST_TURNAROUND;
    let next = sent.iter().find(|sent| sent.at > writes[0].at).unwrap();
    assert_eq!(
        next.at, free,
        "the drives are left alone, and not for longer"
    );
    for station in 1..=DRIVES {
        assert_eq!(
            starts(&sent, &[station, 6, 0, 2, 0, 0]).count(),
            1,
            "station {station}"
        );
    }
    assert_eq!(rig.core.counters().broadcasts, 1);
}

#[test]
fn over_babble_too_the_drives_are_left_alone_after_the_broadcast() {
    let mut rig = running(&line());
    // A request waits, so that the babble jams the line.
    let begun = rig.now;
    rig.read(1, 0, PROOF, 1);
    while rig.now.since(begun) < Duration::from_secs(5) {
        rig.now = rig.now + Duration::from_millis(1);
        if rig.now.since(begun) == Duration::from_millis(2500) {
            rig.sent.clear();
            (0..DRIVES.into()).for_each(|index| _ = rig.command_unsettled(MQTT, index, STOP));
        }
        rig.core.handle(rig.now, LineInput::PathAlive(MQTT.owner));
        rig.core.handle(rig.now, LineInput::Bytes(&[0x55]));
        rig.settle();
    }
    assert_eq!(rig.core.counters().jams, 1);
    let all = starts(&rig.sent, &TO_ALL).next().expect("a broadcast");
    let next = rig
        .sent
        .iter()
        .find(|sent| !sent.frame.starts_with(&TO_ALL))
        .expect("their own stops");
    let alone = Duration::from_nanos(8_333_334) + BROADCAST_TURNAROUND;
    assert!(
        next.at >= all + alone,
        "{:?} after the broadcast",
        next.at.since(all)
    );
}

#[test]
fn motors_ramp_down_from_the_broadcast_on() {
    let mut rig = running(&line());
    rig.bus.set_faults(FaultPlan {
        lost: 1000,
        ..FaultPlan::NONE
    });
    for index in 0..DRIVES.into() {
        rig.command_unsettled(MQTT, index, STOP);
    }
    rig.settle();
    rig.pass(Duration::from_millis(150));
    assert!(
        (1..=DRIVES).all(|station| rig.output(station) < 3000),
        "also those whose own stop has not come yet"
    );
    assert!(
        (0..DRIVES.into()).all(|index| rig.view(index).control.is_some_and(|it| it.stop_pending)),
        "none confirms"
    );
}

#[test]
fn lost_commanders_of_all_drives_are_answered_by_one_frame_too() {
    let mut rig = running(&line());
    rig.core.handle(rig.now, LineInput::PathAlive(Owner::Mqtt));
    rig.pass(Duration::from_secs(5));
    assert_eq!(starts(&rig.sent, &TO_ALL).count(), 1);
    rig.pass(Duration::from_secs(40));
    assert!((1..=DRIVES).all(|station| rig.output(station) == 0));
}

#[test]
fn where_one_drive_goes_on_there_is_no_broadcast() {
    let mut rig = running(&line());
    let sent = stop_all(&mut rig, u16::from(DRIVES) - 1);
    assert_eq!(starts(&sent, &[0xFF]).count(), 0);
    assert_eq!(rig.output(DRIVES), 3000);
}

#[test]
fn where_no_broadcast_is_proven_or_a_drive_is_not_under_control_there_is_none() {
    let teco = RigOptions {
        model: model("teco-e510"),
        control: Some(crate::support::families::accepting()),
        proof_words: None,
        ..line()
    };
    let alone = RigOptions {
        drives: 1,
        ..line()
    };
    for (options, drives) in [(teco, u16::from(DRIVES)), (alone, 1)] {
        let mut rig = running(&options);
        stop_all(&mut rig, drives);
        assert_eq!(rig.core.counters().broadcasts, 0);
    }
}

#[test]
fn a_drive_whose_stop_has_no_effect_yet_does_not_keep_the_others_from_one_frame() {
    let mut rig = running(&line());
    rig.bus
        .set_powered(rig.now, vfd_gateway::domain::ids::Station(1), false);
    rig.command(MQTT, 0, STOP);
    rig.pass(Duration::from_millis(300));
    rig.sent.clear();
    (0..DRIVES.into()).for_each(|index| _ = rig.command_unsettled(MQTT, index, STOP));
    rig.settle();
    rig.pass(Duration::from_secs(2));
    assert_eq!(starts(&rig.sent, &TO_ALL).count(), 1);
    assert!((2..=DRIVES).all(|station| rig.output(station) < 3000));
}

#[test]
fn a_single_drive_is_sent_its_own_stop_also_where_the_others_wait_for_theirs() {
    let mut rig = running(&line());
    for station in 1..DRIVES {
        rig.bus
            .set_powered(rig.now, vfd_gateway::domain::ids::Station(station), false);
        rig.command(MQTT, u16::from(station) - 1, STOP);
        rig.pass(Duration::from_millis(300));
    }
    rig.sent.clear();
    rig.command(MQTT, u16::from(DRIVES) - 1, STOP);
    rig.pass(Duration::from_secs(2));
    assert_eq!(starts(&rig.sent, &TO_ALL).count(), 0);
    assert!(
        starts(&rig.sent, &[DRIVES, 6, 0, 2, 0, 0]).next().is_some() && rig.output(DRIVES) < 3000
    );
}
