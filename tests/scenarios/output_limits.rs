//! The output is held against the limits and the setpoint.

use crate::support::families::{accepting, options_of, rig_of};
use crate::support::{MQTT, Rig, RigOptions, STOP, model, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::control::{ControlSettings, OnOutputOutside};
use vfd_gateway::domain::fail_safe::FailSafeCause;
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::gateway::DriveNote;
use vfd_gateway::journal::JournalEntry;

const SECOND: Duration = Duration::from_secs(1);

/// A drive whose highest frequency is 150 Hz, and for which somebody has typed 50 Hz.
fn mistyped(control: ControlSettings) -> Rig {
    let of = |hertz: u32| {
        Arc::new(model("huanyang-gt").with_full_scale(Hertz::from_millihertz(hertz * 1000)))
    };
    let mut rig = Rig::new(&RigOptions {
        really: Some(of(150)),
        keeps: true,
        ..options_of(&of(50), control)
    });
    let told = rig.commanded(MQTT, run(Direction::Forward, Some(2000)));
    assert!(
        matches!(told.0, Outcome::Confirmed | Outcome::Acknowledged),
        "{told:?}"
    );
    rig
}

fn alarms(rig: &Rig) -> usize {
    rig.notes
        .iter()
        .filter(|(_, note)| {
            matches!(
                note,
                DriveNote::OutputOutside {
                    is_scale_typed: true,
                    ..
                }
            )
        })
        .count()
}

#[test]
fn a_motor_above_its_limits_is_an_alarm_and_nothing_makes_it_faster() {
    let mut rig = mistyped(accepting());
    rig.live(SECOND * 20);
    assert_eq!((rig.output(1), alarms(&rig)), (6000, 1), "{:?}", rig.notes);
    assert!(rig.view(0).control.unwrap().output_outside);
    for order in [
        run(Direction::Forward, None),
        run(Direction::Forward, Some(2000)),
        setpoint(3000),
    ] {
        assert_eq!(
            rig.commanded(MQTT, order),
            (Outcome::Refused, Reason::OutputOutside)
        );
    }
    let lower = rig.commanded(MQTT, setpoint(1000));
    assert!(
        matches!(lower.0, Outcome::Confirmed | Outcome::Acknowledged),
        "{lower:?}"
    );
    rig.live(SECOND * 20);
    assert!(
        rig.view(0).control.unwrap().output_outside,
        "30 Hz where 10 Hz was ordered"
    );
    assert_eq!(rig.commanded(MQTT, STOP).0, Outcome::Confirmed);
    rig.live(SECOND * 20);
    assert_eq!((rig.output(1), alarms(&rig)), (0, 1));
    assert!(!rig.view(0).control.unwrap().output_outside, "it stands");
}

#[test]
fn it_is_stopped_where_that_is_configured() {
    let mut rig = mistyped(ControlSettings {
        on_output_outside: OnOutputOutside::Stop,
        ..accepting()
    });
    rig.live(SECOND * 40);
    assert_eq!((rig.output(1), alarms(&rig)), (0, 1));
    let control = rig.view(0).control.unwrap();
    assert!(control.start_inhibited);
    let is_it = |entry: &&&JournalEntry| {
        matches!(
            entry,
            JournalEntry::FailSafe {
                cause: FailSafeCause::OutputOutside,
                ..
            }
        )
    };
    assert_eq!(rig.entries().iter().filter(is_it).count(), 1);
}

#[test]
fn a_ramp_and_a_motor_at_its_setpoint_are_none() {
    for id in [
        "hyundai-n700",
        "frecon-fr500a",
        "teco-e510",
        "toshiba-vf-s15",
    ] {
        let mut rig = rig_of(&model(id), accepting());
        for centihertz in [5000, 500, 3000] {
            rig.commanded(MQTT, run(Direction::Forward, Some(centihertz)));
            rig.live(SECOND * 20);
        }
        let is_alarm = |note: &DriveNote| matches!(note, DriveNote::OutputOutside { .. });
        assert!(
            !rig.notes.iter().any(|(_, note)| is_alarm(note)),
            "{id}: {:?}",
            rig.notes
        );
    }
}

#[test]
fn a_motor_that_others_hold_away_from_the_setpoint_is_told_until_it_is_right() {
    for id in ["hyundai-n700", "frecon-fr500a"] {
        let mut rig = rig_of(&model(id), accepting());
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        rig.live(SECOND * 10);
        let now = rig.now;
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .set_frequency(now, 10);
        rig.live(SECOND * 20);
        assert!(rig.view(0).control.unwrap().output_outside, "{id}");
        let now = rig.now;
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .set_frequency(now, 30);
        rig.live(SECOND * 20);
        assert!(!rig.view(0).control.unwrap().output_outside, "{id}");
        assert!(
            rig.notes
                .iter()
                .any(|(_, note)| *note == DriveNote::OutputRight),
            "{id}"
        );
    }
}

#[test]
fn a_setpoint_that_moves_all_the_time_hides_no_motor_above_its_limits() {
    let mut rig = mistyped(accepting());
    for count in 0..40 {
        rig.command(MQTT, 0, setpoint(2000 + count % 3 * 10));
        rig.live(SECOND / 2);
    }
    assert_eq!(alarms(&rig), 1, "{:?}", rig.notes);
}

/// A drive without a status word shows by its output alone that it does not run.
#[test]
fn a_motor_that_stands_although_it_is_ordered_to_run_is_told() {
    let mut rig = rig_of(&model("hyundai-n700"), accepting());
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.live(SECOND * 10);
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().operate(now, None);
    rig.live(SECOND * 30);
    assert_eq!(rig.output(1), 0);
    let is_alarm = |note: &DriveNote| matches!(note, DriveNote::OutputOutside { .. });
    assert_eq!(
        rig.notes.iter().filter(|(_, note)| is_alarm(note)).count(),
        1,
        "{:?}",
        rig.notes
    );
}
