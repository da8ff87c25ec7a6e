//! A warning is shown, and does nothing else: it stops no motor, refuses no order and is no trip.

use crate::support::families::{accepting, model_with, rig_of};
use crate::support::{MQTT, Rig, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::drive::warnings;
use vfd_gateway::profile::model::{CodeText, Confidence, Model, PollClass, Register, RegisterRole};

const WARNING: u16 = 0x2540;

fn warning_in(role: RegisterRole) -> Arc<Model> {
    model_with("teco-e510", |model| {
        let trip = model.register_for(RegisterRole::TripCode).cloned().unwrap();
        let register = Register {
            name: "warning".to_owned(),
            address: WARNING.into(),
            role: Some(role),
            poll: Some(PollClass::Second),
            ..trip
        };
        model.registers.push(register);
        model.registers.sort_by_key(|it| it.address);
        let text = |code, text: &str| CodeText {
            code,
            text: text.to_owned(),
            confidence: Confidence::Manual,
            source: "test".to_owned(),
        };
        model.warning_codes = vec![text(1, "heat sink is hot"), text(3, "fan is due")];
    })
}

fn warn(rig: &mut Rig, word: u16) {
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_warning(word.into());
    // Within the lease of the order: its end would stop the motor.
    rig.pass(Duration::from_millis(2500));
}

#[test]
fn a_warning_is_shown_and_neither_stops_the_motor_nor_counts_as_a_trip() {
    for role in [RegisterRole::WarningCode, RegisterRole::WarningBits] {
        let model = warning_in(role);
        let mut rig = rig_of(&model, accepting());
        rig.pass(Duration::from_secs(3));
        for word in [1, 3, 0xFFFF, 0] {
            rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
            let before = rig.writes().len();
            warn(&mut rig, word);
            let view = rig.view(0);
            assert_eq!(
                view.snapshot.reading(WARNING).map(|it| it.raw),
                Some(word),
                "{role:?}"
            );
            assert_eq!(
                (view.run_state, view.trip.seen),
                (RunState::Forward, 0),
                "{role:?} {word}"
            );
            assert!(rig.output(1) > 0, "{role:?} {word}");
            assert_eq!(
                (rig.trips.len(), rig.writes().len()),
                (0, before),
                "{role:?} {word}: nothing is written"
            );
        }
        warn(&mut rig, 5);
        let (outcome, reason) = rig.commanded(MQTT, setpoint(2000));
        assert!(
            matches!(outcome, Outcome::Acknowledged | Outcome::Confirmed),
            "{outcome:?} {reason:?}"
        );
        let shown = warnings::text(&model, 5).unwrap();
        let expected = if role == RegisterRole::WarningBits {
            "heat sink is hot; fan is due"
        } else {
            "code 5"
        };
        assert_eq!(shown, expected);
    }
}
