//! The preconditions of an order are read first: a wrong setting refuses it, another drive is read-only, a wired
//! function is not ordered, and a stop waits for none of that.

use crate::support::families::{accepting, model_with, rig_of};
use crate::support::{MQTT, Rig, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::control::{BusFunctions, ControlSettings, FailSafe};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::profile::model::{Confidence, Fact, Model, ModelIdentity, NeededFor, SetupItem};

const SECOND: Duration = Duration::from_secs(1);
/// A stored setting of the drive, the word that the model requires there, and a wrong one.
const SETTING: u16 = 0x020C;
const RIGHT: u16 = 0;
const WRONG: u16 = 1;
/// Where the drive says what it is.
const IDENTITY: u16 = 0x0B0E;

fn fact(words: &[u16]) -> Fact<Vec<u16>> {
    Fact {
        value: words.to_vec(),
        confidence: Confidence::Manual,
        source: "test".to_owned(),
    }
}

fn needing(needed_for: &[NeededFor]) -> Arc<Model> {
    model_with("frecon-fr500a", |model| {
        assert!(
            model
                .register_at(SETTING)
                .is_some_and(|it| it.access.can_read()),
            "it can be read"
        );
        model.setup.push(SetupItem {
            what: "F02.12".to_owned(),
            text: "stop by the ramp".to_owned(),
            address: Some(SETTING.into()),
            mask: u16::MAX,
            values: fact(&[RIGHT]),
            needed_for: needed_for.to_vec(),
            interface: None,
        });
    })
}

fn set(rig: &mut Rig, address: u16, word: u16) {
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_locally(now, address.into(), word);
}

fn is_taken(rig: &mut Rig, order: Order) {
    let (outcome, reason) = rig.commanded(MQTT, order);
    assert!(
        matches!(outcome, Outcome::Acknowledged | Outcome::Confirmed),
        "{outcome:?} {reason:?}"
    );
}

#[test]
fn a_wrong_setting_refuses_what_rests_on_it_and_nothing_else() {
    let mut rig = rig_of(&needing(&[NeededFor::Run]), accepting());
    set(&mut rig, SETTING, WRONG);
    is_taken(&mut rig, setpoint(3000));
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Refused, Reason::Precondition)
    );
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new(), "nothing was written");
    let last = rig.view(0).control.unwrap().last.unwrap();
    assert_eq!(
        (last.held, last.register),
        (Some(WRONG), Some(SETTING.into())),
        "it says where and what"
    );
    assert!(
        last.message().contains("register 0x020C holds 1"),
        "{}",
        last.message()
    );
    assert_eq!(
        rig.commanded(MQTT, STOP).0,
        Outcome::Confirmed,
        "a stop rests on nothing"
    );
    set(&mut rig, SETTING, RIGHT);
    rig.live(ControlSettings::RESTART_DELAY);
    is_taken(&mut rig, run(Direction::Forward, None));
    rig.live(SECOND * 6);
    assert!(rig.output(1) > 0);
    // It breaks while the motor runs: the motor goes on, and is stopped as ever.
    set(&mut rig, SETTING, WRONG);
    rig.live(SECOND * 2);
    assert_eq!(rig.commanded(MQTT, STOP).0, Outcome::Confirmed);
}

#[test]
fn a_setpoint_may_rest_on_a_setting_as_well() {
    let mut rig = rig_of(&needing(&[NeededFor::Setpoint]), accepting());
    set(&mut rig, SETTING, WRONG);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, setpoint(3000)),
        (Outcome::Refused, Reason::Precondition)
    );
    let both = run(Direction::Forward, Some(3000));
    assert_eq!(
        rig.commanded(MQTT, both.clone()),
        (Outcome::Refused, Reason::Precondition)
    );
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
    set(&mut rig, SETTING, RIGHT);
    is_taken(&mut rig, both);
}

#[test]
fn a_stop_goes_in_front_of_the_read_that_an_order_rests_on() {
    let mut rig = rig_of(&needing(&[NeededFor::Run]), accepting());
    is_taken(&mut rig, setpoint(3000));
    rig.sent.clear();
    let start = rig.command(MQTT, 0, run(Direction::Forward, None));
    let stop = rig.command(MQTT, 0, STOP);
    assert_eq!(rig.outcome_of(start).1, Reason::Stopped);
    assert_eq!(rig.outcome_of(stop).0, Outcome::Confirmed);
    let runs = rig
        .written(0x2000)
        .into_iter()
        .filter(|word| *word == 1)
        .count();
    assert_eq!(runs, 0, "no RUN went out");
}

fn identified() -> Arc<Model> {
    model_with("frecon-fr500a", |model| {
        let others = vec![(9, "FR600".to_owned())];
        model.identity = Some(ModelIdentity {
            address: IDENTITY.into(),
            mask: 0x000F,
            values: fact(&[2]),
            others,
        });
    })
}

#[test]
fn another_drive_is_read_only_and_is_found_out_before_the_first_order() {
    let mut rig = rig_of(&identified(), accepting());
    set(&mut rig, IDENTITY, 0x0009);
    rig.sent.clear();
    for order in [setpoint(3000), run(Direction::Forward, Some(3000))] {
        assert_eq!(
            rig.commanded(MQTT, order),
            (Outcome::Refused, Reason::OtherDrive)
        );
    }
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
    assert_eq!(rig.view(0).control.unwrap().last.unwrap().held, Some(9));
    assert_eq!(
        rig.commanded(MQTT, STOP).0,
        Outcome::Confirmed,
        "it can be stopped all the same"
    );
}

/// The drive is a relative that lacks the register, or firmware that came before it.
#[test]
fn an_identity_that_the_drive_does_not_show_is_named() {
    let elsewhere: u16 = 0x0BFF;
    let mut really = Model::clone(&identified());
    let model = model_with("frecon-fr500a", |model| {
        model.identity = really.identity.take().map(|it| ModelIdentity {
            address: elsewhere.into(),
            ..it
        });
    });
    let mut rig = rig_of(&model, accepting());
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, setpoint(3000)),
        (Outcome::Failed, Reason::DriveException)
    );
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
    let last = rig.view(0).control.unwrap().last.unwrap();
    assert_eq!(last.register, Some(elsewhere.into()));
    assert!(
        last.message().contains("rests on register 0x0BFF"),
        "{}",
        last.message()
    );
}

#[test]
fn a_drive_is_identified_once_until_it_has_been_away() {
    let mut rig = rig_of(&identified(), accepting());
    set(&mut rig, IDENTITY, 0x0F02);
    rig.sent.clear();
    let reads = |rig: &Rig| {
        rig.frames()
            .iter()
            .filter(|frame| frame[1..5] == [3, 0x0B, 0x0E, 0])
            .count()
    };
    is_taken(&mut rig, setpoint(3000));
    is_taken(&mut rig, setpoint(3100));
    assert_eq!(reads(&rig), 1, "once for both");
    rig.reopen();
    set(&mut rig, IDENTITY, 0x0009);
    rig.live(SECOND * 2);
    assert_eq!(
        rig.commanded(MQTT, setpoint(3200)),
        (Outcome::Refused, Reason::OtherDrive),
        "it was exchanged"
    );
}

#[test]
fn a_wired_start_is_not_ordered_and_a_stop_says_what_it_did() {
    let wired = ControlSettings {
        bus: BusFunctions::Frequency,
        on_commander_lost: FailSafe::Hold,
        ..accepting()
    };
    let mut rig = rig_of(&model_with("frecon-fr500a", |_| ()), wired);
    is_taken(&mut rig, setpoint(3000));
    rig.sent.clear();
    for order in [run(Direction::Forward, None), Order::Coast, Order::Reset] {
        assert_eq!(
            rig.commanded(MQTT, order),
            (Outcome::Refused, Reason::NotOverBus)
        );
    }
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
    let stop = rig.command(MQTT, 0, STOP);
    rig.live(SECOND);
    assert_eq!(rig.written(0x2000).len(), 1, "it is sent all the same");
    assert!(matches!(
        rig.outcome_of(stop).0,
        Outcome::Confirmed | Outcome::Acknowledged | Outcome::Unknown
    ));
}

#[test]
fn a_wired_speed_is_not_ordered_and_run_needs_none() {
    let wired = ControlSettings {
        bus: BusFunctions::Run,
        ..accepting()
    };
    let mut rig = rig_of(&model_with("frecon-fr500a", |_| ()), wired);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, setpoint(3000)),
        (Outcome::Refused, Reason::NotOverBus)
    );
    let both = run(Direction::Forward, Some(3000));
    assert_eq!(
        rig.commanded(MQTT, both),
        (Outcome::Refused, Reason::NotOverBus)
    );
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
    is_taken(&mut rig, run(Direction::Forward, None));
    assert_eq!(rig.writes().len(), 1, "the run word alone");
    assert_eq!(rig.commanded(MQTT, STOP).0, Outcome::Confirmed);
}
