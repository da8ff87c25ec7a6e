//! A drive whose registers are not where its model has them is not believed: none of its readings is shown as good, no trip
//! follows from them, and it takes no order but a stop, until it shows what every drive of its model shows.

use crate::support::families::{accepting, model_with, options_of, rig_of};
use crate::support::{MQTT, Rig, RigOptions, STOP, model, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::gateway::DriveNote;
use vfd_gateway::profile::model::{Model, Register, RegisterRole};

const SECOND: Duration = Duration::from_secs(1);

/// The model that asks for it, and whose addresses are those of its siblings.
const ASKS: &str = "ls-ig5a";

/// A drive that counts its addresses from 0 where its model counts from 1.
fn off_by_one() -> Rig {
    let asks = model(ASKS);
    let mut really = Model::clone(&asks);
    // It has a register in front of them as well.
    let before = Register {
        name: "before".to_owned(),
        role: None,
        poll: None,
        ..really.registers[0].clone()
    };
    for register in &mut really.registers {
        register.address = register.address.checked_add(1).unwrap();
    }
    for flag in &mut really.status {
        flag.address = flag.address.checked_add(1).unwrap();
    }
    really.registers.insert(0, before);
    Rig::new(&RigOptions {
        really: Some(Arc::new(really)),
        control: None,
        ..options_of(&asks, accepting())
    })
}

fn turns(rig: &mut Rig) {
    let now = rig.now;
    let drive = rig.bus.drive_mut(Station(1)).unwrap();
    drive.set_frequency(now, 50);
    drive.operate(now, Some(Direction::Forward));
    rig.live(SECOND * 15);
    assert!(rig.output(1) > 4900);
}

#[test]
fn a_drive_whose_addresses_are_off_by_one_shows_nothing_as_good_at_standstill_and_while_it_turns() {
    let mut rig = off_by_one();
    for is_turning in [false, true] {
        if is_turning {
            turns(&mut rig);
            // It comes into sight while it turns.
            rig.reopen();
            rig.live(SECOND * 15);
        }
        let view = rig.view(0);
        assert!(
            view.is_online() && view.snapshot.is_implausible,
            "turning: {is_turning}"
        );
        assert_eq!(view.run_state, RunState::Unknown, "turning: {is_turning}");
        assert!(rig.trips.is_empty(), "{:?}", rig.trips);
    }
    let told = rig
        .notes
        .iter()
        .filter(|(_, note)| matches!(note, DriveNote::Implausible { .. }))
        .count();
    assert!((1..=4).contains(&told), "{:?}", rig.notes);
}

#[test]
fn a_drive_that_is_one_of_its_model_is_believed_at_once() {
    let mut rig = Rig::new(&RigOptions {
        control: None,
        ..options_of(&model(ASKS), accepting())
    });
    assert!(!rig.view(0).snapshot.is_implausible);
    assert_eq!(rig.view(0).run_state, RunState::Stopped);
    turns(&mut rig);
    assert_eq!(rig.view(0).run_state, RunState::Forward);
    rig.reopen();
    rig.live(SECOND * 5);
    assert_eq!(
        (rig.view(0).snapshot.is_implausible, rig.view(0).run_state),
        (false, RunState::Forward)
    );
    let is_doubted = rig
        .notes
        .iter()
        .any(|(_, note)| matches!(note, DriveNote::Implausible { .. }));
    assert!(!is_doubted, "{:?}", rig.notes);
}

#[test]
fn orders_are_refused_with_the_reason_and_a_stop_goes_out() {
    let asks = model_with("frecon-fr500a", |model| {
        let dc_link = model
            .registers
            .iter_mut()
            .find(|it| it.role == Some(RegisterRole::DcLinkVoltage))
            .unwrap();
        dc_link.plausible = Some(10..=20);
    });
    let mut rig = rig_of(&asks, accepting());
    rig.sent.clear();
    for order in [setpoint(3000), run(Direction::Forward, Some(3000))] {
        assert_eq!(
            rig.commanded(MQTT, order),
            (Outcome::Refused, Reason::Implausible)
        );
    }
    assert!(rig.writes().is_empty());
    rig.command(MQTT, 0, STOP);
    rig.live(SECOND);
    assert!(!rig.writes().is_empty(), "a stop asks for nothing");
}
