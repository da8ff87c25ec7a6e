//! A stop changes nothing but the running: the direction stays as the last order had it.

use crate::support::families::{accepting, each, rig_of, walked, write};
use crate::support::{MQTT, Rig, STOP, run};
use std::cell::Cell;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::journal::RememberedDrive;
use vfd_gateway::profile::model::{
    BitMeaning, IndicatedState, Model, RegisterRole, RunCommand, RunForm,
};
use vfd_gateway::vendors;

const SECOND: Duration = Duration::from_secs(1);

/// The CFW500, whose stop has a bit for the direction.
fn cfw500() -> Arc<Model> {
    let found = walked().iter().find(|model| model.id == "weg-cfw500");
    Arc::clone(found.expect("the model is built in"))
}

fn runs(model: &Arc<Model>, direction: Direction) -> Rig {
    let mut rig = rig_of(model, accepting());
    let told = rig.commanded(MQTT, run(direction, Some(3000)));
    assert!(
        matches!(told.0, Outcome::Confirmed | Outcome::Acknowledged),
        "{told:?}"
    );
    rig.live(SECOND * 8);
    rig.sent.clear();
    rig
}

/// The last word that was written to the register for run commands.
fn last_word(rig: &Rig, model: &Model) -> u16 {
    let address = model
        .register_for(RegisterRole::RunCommand)
        .unwrap()
        .address
        .number();
    *rig.written(address).last().expect("one was written")
}

#[test]
fn a_stop_keeps_the_direction_of_the_order_before() {
    let model = cfw500();
    for (direction, word) in [(Direction::Forward, 0x0006), (Direction::Reverse, 0x0002)] {
        let mut rig = runs(&model, direction);
        assert_eq!(
            rig.commanded(MQTT, STOP),
            (Outcome::Confirmed, Reason::None)
        );
        assert_eq!(last_word(&rig, &model), word, "{direction:?}");
    }
}

#[test]
fn a_stop_of_a_motor_that_runs_by_others_keeps_the_direction_that_it_shows() {
    let model = cfw500();
    for (direction, word) in [(Direction::Forward, 0x0006), (Direction::Reverse, 0x0002)] {
        let mut rig = runs(&model, direction);
        rig.restart(RememberedDrive::default());
        rig.pass(SECOND * 5);
        assert_eq!(
            rig.commanded(MQTT, STOP),
            (Outcome::Confirmed, Reason::None)
        );
        assert_eq!(last_word(&rig, &model), word, "{direction:?}");
    }
    // Where nothing is known, it runs forward rather than in reverse.
    let mut rig = rig_of(&model, accepting());
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(last_word(&rig, &model), 0x0006);
}

#[test]
fn each_form_of_the_stop_that_a_client_writes_is_a_stop() {
    let model = cfw500();
    let address = model
        .register_for(RegisterRole::RunCommand)
        .unwrap()
        .address
        .number();
    for word in [0x0002, 0x0006] {
        let mut rig = runs(&model, Direction::Forward);
        assert_eq!(write(&mut rig, address, &[word]), NativeOutcome::Written);
        assert_eq!(last_word(&rig, &model), 0x0006);
        rig.pass(SECOND * 10);
        assert_eq!(rig.output(1), 0);
    }
}

#[test]
fn a_declared_stop_keeps_the_direction_as_well() {
    let model = cfw500();
    let mut rig = runs(&model, Direction::Forward);
    rig.pass(SECOND * 15);
    assert_eq!((rig.output(1), last_word(&rig, &model)), (0, 0x0006));
}

/// The bits that say the direction of a motor and do not run it.
fn direction_bits(order: &RunCommand) -> u16 {
    let RunForm::Bits { bits, .. } = &order.form else {
        return 0;
    };
    let says = bits
        .iter()
        .filter(|bit| matches!(bit.meaning, BitMeaning::Forward | BitMeaning::Reverse));
    says.fold(0, |all, bit| all | 1 << bit.bit.value)
}

#[test]
fn every_motor_ramps_down_in_the_direction_in_which_it_ran() {
    let kept = Cell::new(0);
    each(|model| {
        let Some(order) = &model.run else { return };
        for direction in [Direction::Forward, Direction::Reverse] {
            if direction == Direction::Reverse && order.reverse.is_none() {
                continue;
            }
            let mut rig = runs(model, direction);
            let ran = rig.output(1).signum();
            let stop = rig.command(MQTT, 0, STOP);
            let end = rig.now + SECOND * 12;
            while rig.now < end {
                rig.step(end);
                assert_ne!(
                    rig.output(1).signum(),
                    -ran,
                    "{}: it turned round",
                    model.id
                );
            }
            assert_eq!(rig.outcome_of(stop).0, Outcome::Confirmed);
            assert!(
                model.status_flag(IndicatedState::Running).is_none()
                    || rig.bus.drive_mut(Station(1)).unwrap().ordered().is_none()
            );
            // A simulated motor asks only whether it is to run: what the word says beside that is seen on the wire. An
            // invented model has no documents.
            let standing = direction_bits(order) & !order.stop_bits.drops;
            if standing != 0 && vendors::catalog().find(&model.id).is_some() {
                let run = if direction == Direction::Forward {
                    Some(&order.forward)
                } else {
                    order.reverse.as_ref()
                };
                let changed = (last_word(&rig, model) ^ run.unwrap().value) & standing;
                assert_eq!(
                    changed, 0,
                    "{direction:?}: the stop asks for another direction"
                );
                kept.set(kept.get() + 1);
            }
        }
    });
    assert!(
        kept.get() >= 4,
        "{}: a CFW300 and a CFW500, in both directions",
        kept.get()
    );
}
