//! A trial waives the proof of one action for one command of a person at the host, and nothing else; the motor that it
//! starts is leased to that person.

use crate::support::families::{LOCAL, accepting, model_with, rig_of};
use crate::support::{MQTT, Rig, STOP, model, plc, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Origin, Outcome, Owner, Reason};
use vfd_gateway::domain::control::{ControlAction, ControlSettings, FailSafe, SiteEvidence};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::gateway::DriveNote;
use vfd_gateway::profile::model::{Confidence, Fact, ModelIdentity};

const SECOND: Duration = Duration::from_secs(1);
/// A model of which every action is unproven.
const UNPROVEN: &str = "toshiba-vf-s15";

fn qualifying() -> ControlSettings {
    ControlSettings {
        qualify: true,
        accept_unverified: Vec::new(),
        on_commander_lost: FailSafe::Stop,
        ..accepting()
    }
}

fn tried(rig: &mut Rig, origin: Origin, order: Order, action: ControlAction) -> (Outcome, Reason) {
    let ticket = rig.command_with(origin, 0, order, |command| command.trial = Some(action));
    rig.outcome_of(ticket)
}

fn forward() -> Order {
    run(Direction::Forward, Some(500))
}

fn is_done(told: (Outcome, Reason)) -> bool {
    matches!(told.0, Outcome::Confirmed | Outcome::Acknowledged)
}

#[test]
fn a_person_at_the_host_tries_what_nobody_may_order() {
    for it in ["hyundai-n700", "frecon-fr500a", "teco-e510s", UNPROVEN].map(model) {
        let mut rig = rig_of(&it, qualifying());
        assert!(is_done(rig.commanded(LOCAL, STOP)), "{}", it.id);
        rig.pass(ControlSettings::RESTART_DELAY);
        let told = tried(&mut rig, LOCAL, forward(), ControlAction::Basic);
        assert!(is_done(told), "{}: {told:?}", it.id);
        rig.live(SECOND * 2);
        assert!(rig.output(1) > 0, "{}", it.id);
        assert!(is_done(rig.commanded(LOCAL, STOP)), "{}", it.id);
    }
}

#[test]
fn no_other_way_in_and_no_other_drive() {
    let mut rig = rig_of(&model(UNPROVEN), qualifying());
    for origin in [MQTT, plc(1)] {
        assert_eq!(
            tried(&mut rig, origin, forward(), ControlAction::Basic),
            (Outcome::Refused, Reason::NotAllowed)
        );
    }
    let mut closed = rig_of(
        &model(UNPROVEN),
        ControlSettings {
            qualify: false,
            ..qualifying()
        },
    );
    assert_eq!(
        tried(&mut closed, LOCAL, forward(), ControlAction::Basic),
        (Outcome::Refused, Reason::NotAllowed)
    );
    for rig in [&rig, &closed] {
        assert!(rig.writes().is_empty(), "{:02X?}", rig.writes());
    }
}

#[test]
fn a_trial_opens_nothing_for_the_next_command() {
    let mut rig = rig_of(&model(UNPROVEN), qualifying());
    assert!(is_done(tried(
        &mut rig,
        LOCAL,
        forward(),
        ControlAction::Basic
    )));
    let unverified = (Outcome::Refused, Reason::Unverified);
    for order in [
        forward(),
        setpoint(600),
        run(Direction::Reverse, Some(500)),
        Order::Coast,
    ] {
        assert_eq!(rig.commanded(LOCAL, order.clone()), unverified, "{order:?}");
    }
    assert_eq!(
        tried(&mut rig, LOCAL, Order::Coast, ControlAction::Basic),
        (Outcome::Refused, Reason::Conflict)
    );
    let far = run(Direction::Forward, Some(60_000));
    assert_eq!(
        tried(&mut rig, LOCAL, far, ControlAction::Basic),
        (Outcome::Refused, Reason::OutsideLimits)
    );
    assert!(is_done(rig.commanded(LOCAL, STOP)));
}

#[test]
fn a_person_who_is_gone_loses_control_and_the_motor_stops() {
    let mut rig = rig_of(&model(UNPROVEN), qualifying());
    assert!(is_done(tried(
        &mut rig,
        LOCAL,
        forward(),
        ControlAction::Basic
    )));
    for _ in 0..5 {
        rig.live(SECOND);
        rig.command(LOCAL, 0, Order::Renew);
    }
    assert!(rig.output(1) > 0, "it is renewed");
    rig.live(SECOND * 10);
    let lost = DriveNote::CommanderLost {
        owner: Owner::Local,
        action: FailSafe::Stop,
    };
    assert!(
        rig.notes.iter().any(|(_, note)| *note == lost),
        "{:?}",
        rig.notes
    );
    assert_eq!(rig.output(1), 0);
}

#[test]
fn what_was_confirmed_at_the_drive_is_done_for_everybody() {
    let site = SiteEvidence {
        actions: vec![ControlAction::Basic],
        identity: None,
    };
    let control = ControlSettings {
        accept_unverified: vec![ControlAction::Basic],
        site,
        qualify: false,
        ..accepting()
    };
    let mut rig = rig_of(&model(UNPROVEN), control);
    assert!(is_done(rig.commanded(MQTT, forward())));
    assert_eq!(
        rig.commanded(MQTT, Order::Coast),
        (Outcome::Refused, Reason::Unverified),
        "the rest is as it was"
    );
    assert!(is_done(rig.commanded(MQTT, STOP)));
}

#[test]
fn what_was_confirmed_at_one_drive_moves_no_other_of_the_same_model() {
    const IDENTITY: u16 = 0x0B0E;
    let model = model_with("frecon-fr500a", |model| {
        let values = Fact {
            value: vec![2, 3],
            confidence: Confidence::Manual,
            source: "test".to_owned(),
        };
        let others = Vec::new();
        model.identity = Some(ModelIdentity {
            address: IDENTITY.into(),
            mask: 0x000F,
            values,
            others,
        });
    });
    for (word, expected) in [(0x0012, None), (0x0013, Some(Reason::OtherDrive))] {
        let identity = Some((IDENTITY.into(), 2));
        let site = SiteEvidence {
            actions: vec![ControlAction::Basic],
            identity,
        };
        let mut rig = rig_of(
            &model,
            ControlSettings {
                site,
                ..accepting()
            },
        );
        let now = rig.now;
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .set_locally(now, IDENTITY.into(), word);
        let told = rig.commanded(MQTT, forward());
        match expected {
            None => assert!(is_done(told), "{told:?}"),
            Some(reason) => {
                assert_eq!(
                    told,
                    (Outcome::Refused, reason),
                    "both are of the model, but only one was tried"
                );
                assert!(rig.writes().is_empty(), "{:02X?}", rig.writes());
            }
        }
        assert!(
            is_done(rig.commanded(MQTT, STOP)),
            "a stop waits for none of this"
        );
    }
}
