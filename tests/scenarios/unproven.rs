//! What a model's documents do not prove is done only where the file accepts it, and what a drive cannot do is refused
//! by that name.

use crate::support::families::{accepting, models, rig_of};
use crate::support::{MQTT, Rig, model, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::control::{ControlAction, ControlSettings};
use vfd_gateway::domain::ids::Station;

use ControlAction::{Basic, Coast, Release, Reset, Reverse};

const ACTIONS: [ControlAction; 5] = [Basic, Reverse, Coast, Reset, Release];
const SECOND: Duration = Duration::from_secs(1);

/// Model, what its documents do not prove, and what it cannot do; typed from them.
const FACTS: &[(&str, &[ControlAction], &[ControlAction])] = &[
    ("hyundai-n700", &[], &[Release]),
    ("hyundai-n100plus", &[], &[Coast, Release]),
    (
        "toshiba-vf-as1",
        &[Basic, Reverse, Coast, Reset, Release],
        &[],
    ),
    (
        "toshiba-vf-s15",
        &[Basic, Reverse, Coast, Reset, Release],
        &[],
    ),
    ("teco-e510", &[Basic, Reverse, Reset], &[Coast, Release]),
    ("teco-e510s", &[Basic, Reverse, Reset], &[Coast, Release]),
    ("frecon-fr500a", &[], &[Release]),
];

fn rig(id: &str, accept_unverified: Vec<ControlAction>) -> Rig {
    rig_of(
        &model(id),
        ControlSettings {
            accept_unverified,
            ..accepting()
        },
    )
}

fn order_of(action: ControlAction) -> Order {
    match action {
        Basic => run(Direction::Forward, Some(2000)),
        Reverse => run(Direction::Reverse, Some(2000)),
        Coast => Order::Coast,
        Reset => Order::Reset,
        Release => Order::Release,
    }
}

/// A rig in which nothing but the proof is missing for `action`.
fn ready_for(action: ControlAction, id: &str, accepted: Vec<ControlAction>) -> Rig {
    let mut rig = rig(id, accepted);
    if action == Reset {
        rig.commanded(MQTT, run(Direction::Forward, Some(2000)));
        rig.live(SECOND * 2);
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, 2);
        rig.live(SECOND * 3);
    }
    rig.sent.clear();
    rig
}

#[test]
fn every_model_is_in_the_table() {
    let known: Vec<_> = models().iter().map(|model| model.id.clone()).collect();
    let mut named: Vec<_> = FACTS.iter().map(|(id, ..)| (*id).to_owned()).collect();
    named.sort();
    assert_eq!(known, named);
}

#[test]
fn an_unproven_action_is_off_until_the_file_accepts_that_very_one() {
    for (id, unproven, cannot) in FACTS {
        for action in ACTIONS {
            let others: Vec<_> = ACTIONS
                .into_iter()
                .filter(|other| *other != action)
                .collect();
            let mut rig = ready_for(action, id, others);
            let told = rig.commanded(MQTT, order_of(action));
            let refusal = if cannot.contains(&action) {
                Some(Reason::NotCapable)
            } else {
                unproven.contains(&action).then_some(Reason::Unverified)
            };
            match refusal {
                Some(reason) => {
                    assert_eq!(told, (Outcome::Refused, reason), "{id}: {action:?}");
                    assert!(
                        rig.writes().is_empty(),
                        "{id}: {action:?}: {:02X?}",
                        rig.writes()
                    );
                }
                None => assert_eq!(told.1, Reason::None, "{id}: {action:?}: {told:?}"),
            }
        }
    }
}

#[test]
fn what_is_accepted_is_done() {
    for (id, unproven, _) in FACTS {
        for action in *unproven {
            let mut rig = ready_for(*action, id, vec![Basic, *action]);
            let (outcome, reason) = rig.commanded(MQTT, order_of(*action));
            assert!(
                matches!(outcome, Outcome::Confirmed | Outcome::Acknowledged),
                "{id}: {action:?}: {reason:?}"
            );
            assert!(!rig.writes().is_empty(), "{id}: {action:?}");
        }
    }
}

#[test]
fn forward_needs_what_it_rests_on_and_a_stop_is_never_refused_for_that() {
    for (id, unproven, _) in FACTS {
        let mut rig = rig(id, Vec::new());
        for order in [
            run(Direction::Forward, Some(2000)),
            run(Direction::Forward, None),
            setpoint(2000),
        ] {
            let (outcome, reason) = rig.commanded(MQTT, order);
            if unproven.contains(&Basic) {
                assert_eq!(
                    (outcome, reason),
                    (Outcome::Refused, Reason::Unverified),
                    "{id}"
                );
                assert!(rig.writes().is_empty(), "{id}: {:02X?}", rig.writes());
            } else {
                assert!(
                    matches!(outcome, Outcome::Confirmed | Outcome::Acknowledged),
                    "{id}: {reason:?}"
                );
            }
        }
        let stop = Order::Stop { setpoint: None };
        assert_eq!(
            rig.commanded(MQTT, stop),
            (Outcome::Confirmed, Reason::None),
            "{id}"
        );
    }
}
