//! Two gateways of a line show each other what they must share: the orders before a hand-over, and their drives.

use crate::support::pair::{Pair, Sent};
use crate::support::{MQTT, ORIGIN, RigOptions, control, model, run};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::Direction;
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::standby::{LineRole, OnGatewayLost, StandbyTrouble};
use vfd_gateway::gateway::{DriveNote, DriveSetup, LineInput};

const SECOND: Duration = Duration::from_secs(1);

fn options(id: &str) -> RigOptions {
    let settings = ControlSettings {
        on_gateway_lost: Some(OnGatewayLost::Stop),
        ..control()
    };
    let poll = Duration::from_millis(250);
    RigOptions {
        control: Some(settings),
        poll,
        model: model(id),
        ..RigOptions::controlled()
    }
}

/// The listener of these models cannot read the direction from the drive.
#[test]
fn a_line_is_handed_over_without_a_stop_to_a_listener_that_was_started_after_the_order() {
    for id in ["hyundai-n700", "hyundai-n100plus"] {
        for direction in [Direction::Forward, Direction::Reverse] {
            let mut pair = Pair::running(&options(id));
            pair.kill(1);
            pair.command(0, MQTT, 0, run(direction, Some(3000)));
            let alive = |pair: &mut Pair| {
                for _ in 0..12 {
                    pair.tell(0, LineInput::PathAlive(MQTT.owner));
                    pair.pass(SECOND);
                }
            };
            alive(&mut pair);
            pair.start(1);
            alive(&mut pair);
            let asked = pair.now;
            pair.tell(0, LineInput::Yield);
            assert!(
                pair.until(SECOND * 2, |pair| pair.role(1) == LineRole::Active)
                    .is_some(),
                "{id}"
            );
            for _ in 0..10 {
                pair.command(1, ORIGIN, 0, run(direction, Some(3000)));
                pair.pass(SECOND);
            }
            assert_eq!(pair.output(1).abs(), 3000, "{id} {direction:?}");
            // Its client sends the setpoint again, which the drive holds.
            let writes = |sent: &&Sent| sent.at >= asked && matches!(sent.pdu[0], 6 | 16);
            assert!(
                pair.sent.iter().filter(writes).count() <= 1,
                "{id} {direction:?}: no order was sent"
            );
        }
    }
}

/// Their files differ: the active one only reads the drive, and cannot tell by which order it runs.
#[test]
fn a_line_is_not_handed_over_to_a_listener_that_would_stop_a_drive_that_runs() {
    let mut pair = Pair::new(2, &options("hyundai-n700"));
    pair.halves[0].setup.drives[0].control = None;
    (0..2).for_each(|half| pair.start(half));
    pair.pass(SECOND * 12);
    let now = pair.now;
    let drive = pair.bus.drive_mut(Station(1)).unwrap();
    drive.set_frequency(now, 30);
    drive.operate(now, Some(Direction::Forward));
    pair.pass(SECOND * 12);
    assert_eq!(pair.output(1), 3000);
    pair.tell(0, LineInput::Yield);
    pair.pass(SECOND * 10);
    assert_eq!(
        [pair.role(0), pair.role(1)],
        [LineRole::Active, LineRole::Listening]
    );
    let told = pair.halves[1]
        .notes
        .iter()
        .filter(|(_, note)| *note == DriveNote::HandOverRefused);
    assert_eq!((told.count(), pair.output(1)), (1, 3000));
}

/// Whether two gateways of a line say that their files differ, if that of the second one is changed.
fn is_told(of: &RigOptions, change: impl Fn(&mut DriveSetup)) -> bool {
    let mut pair = Pair::new(2, of);
    pair.halves[1].setup.drives.iter_mut().for_each(change);
    pair.start(0);
    pair.start(1);
    pair.pass(SECOND * 10);
    pair.core(0).report().standby.unwrap().trouble.files_differ
}

#[test]
fn what_makes_a_difference_to_the_motor_is_compared_and_nothing_else() {
    let settings = |directions: [Direction; 2]| {
        let directions = directions.to_vec();
        ControlSettings {
            directions,
            on_gateway_lost: Some(OnGatewayLost::Stop),
            ..control()
        }
    };
    let (forward_first, reverse_first) = (
        settings([Direction::Forward, Direction::Reverse]),
        settings([Direction::Reverse, Direction::Forward]),
    );
    let of = RigOptions {
        control: Some(forward_first),
        ..options("hyundai-n700")
    };
    assert!(
        !is_told(&of, |drive| drive.control =
            Some(Arc::new(reverse_first.clone()))),
        "another order of the words"
    );
    let scaled = |hertz: u32| {
        Arc::new(model("huanyang-gt").with_full_scale(Hertz::from_millihertz(hertz * 1000)))
    };
    let of = RigOptions {
        model: scaled(50),
        ..options("hyundai-n700")
    };
    assert!(!is_told(&of, |_| {}));
    assert!(
        is_told(&of, |drive| drive.model = scaled(400)),
        "each setpoint would be wrong by 8"
    );
}

#[test]
fn gateways_with_different_drives_say_so_as_long_as_that_lasts() {
    let mut pair = Pair::new(
        2,
        &RigOptions {
            drives: 2,
            ..options("hyundai-n700")
        },
    );
    let all = pair.halves[1].setup.drives.clone();
    pair.halves[1].setup.drives.pop();
    pair.start(0);
    pair.start(1);
    pair.pass(SECOND * 10);
    let trouble = |pair: &mut Pair, half: usize| pair.core(half).report().standby.unwrap().trouble;
    let differ = StandbyTrouble {
        files_differ: true,
        ..StandbyTrouble::default()
    };
    assert_eq!(trouble(&mut pair, 0), differ);
    assert_eq!(
        trouble(&mut pair, 1),
        StandbyTrouble {
            unknown_station: Some(Station(2)),
            ..differ
        }
    );
    pair.kill(1);
    pair.halves[1].setup.drives = all;
    pair.start(1);
    pair.pass(SECOND * 130);
    for half in [0, 1] {
        assert_eq!(
            trouble(&mut pair, half),
            StandbyTrouble::default(),
            "{half}"
        );
    }
}
