//! Whom the motor obeys is changed only at standstill and on purpose: control is released where that is allowed, and
//! the sources are set through the local socket.

use crate::support::families::{LOCAL, accepting, address_of, models, rig_of, single};
use crate::support::{MQTT, Rig, STOP, model, plc, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason, RunIntent};
use vfd_gateway::domain::control::{ControlAction, ControlSettings};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::profile::model::RegisterRole;

const SECOND: Duration = Duration::from_secs(1);
/// Models whose words can take control and give it back.
const RELEASING: [&str; 2] = ["toshiba-vf-as1", "toshiba-vf-s15"];
const COMMAND: u16 = 0xFA00;

/// Model, and what is set on it before it obeys the bus: addresses and words in the vendor's order.
const SETUP: &[(&str, &[(u16, u16)])] = &[
    ("hyundai-n700", &[(0x0211, 3), (0x0212, 3)]),
    ("hyundai-n100plus", &[(0x0301, 3), (0x0302, 2)]),
    ("teco-e510", &[(0x0005, 5), (0x0002, 2)]),
    ("teco-e510s", &[(0x0005, 5), (0x0002, 2)]),
    ("frecon-fr500a", &[(0x0006, 0), (0x0101, 3), (0x0200, 2)]),
    ("toshiba-vf-s15", &[(0xF829, 1)]),
];

fn rig(id: &str, control: ControlSettings) -> Rig {
    rig_of(&model(id), control)
}

/// A drive that was run from here and is at standstill again.
fn at_rest(id: &str) -> Rig {
    let mut rig = rig(id, accepting());
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(2000))).0,
        Outcome::Confirmed,
        "{id}"
    );
    rig.live(SECOND * 2);
    assert_eq!(rig.commanded(MQTT, STOP).0, Outcome::Confirmed, "{id}");
    rig.live(SECOND * 8);
    assert_eq!(
        (rig.output(1), rig.view(0).run_state),
        (0, RunState::Stopped),
        "{id}"
    );
    rig.sent.clear();
    rig
}

fn operate_panel(rig: &mut Rig, runs: Option<Direction>) {
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .operate_panel(now, runs);
}

fn refuses(
    rig: &mut Rig,
    origin: vfd_gateway::domain::command::Origin,
    order: Order,
    reason: Reason,
) {
    let told = rig.commanded(origin, order.clone());
    assert_eq!(told, (Outcome::Refused, reason), "{order:?}");
}

#[test]
fn control_is_handed_back_only_where_the_file_allows_it_and_accepts_what_is_unproven() {
    for id in RELEASING {
        let unproven = ControlSettings {
            accept_unverified: vec![ControlAction::Reverse],
            ..accepting()
        };
        for (control, reason) in [
            (
                ControlSettings {
                    allow_release: false,
                    ..accepting()
                },
                Reason::NoRelease,
            ),
            (unproven, Reason::Unverified),
        ] {
            let mut rig = rig(id, control);
            refuses(&mut rig, MQTT, Order::Release, reason);
            assert!(rig.writes().is_empty(), "{id}");
        }
    }
}

#[test]
fn control_is_not_handed_back_while_the_motor_may_turn_or_another_party_holds_it() {
    for id in RELEASING {
        let mut rig = rig(id, accepting());
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        rig.live(SECOND * 3);
        refuses(&mut rig, MQTT, Order::Release, Reason::Moving);
        refuses(&mut rig, plc(1), Order::Release, Reason::OtherOwner);
        let stop = rig.command(MQTT, 0, STOP);
        refuses(&mut rig, MQTT, Order::Release, Reason::StopPending);
        assert_eq!(rig.outcome_of(stop).0, Outcome::Confirmed, "{id}");
        assert!(rig.output(1) > 0);
        refuses(&mut rig, MQTT, Order::Release, Reason::Moving);
        assert!(
            !rig.written(COMMAND).contains(&0),
            "{id}: {:04X?}",
            rig.written(COMMAND)
        );
    }
}

#[test]
fn a_release_ends_the_lease_and_inhibits_the_start() {
    for id in RELEASING {
        let mut rig = rig(id, accepting());
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        rig.live(SECOND * 3);
        // A trip leaves the lease with its owner although the motor is at standstill.
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, 3);
        rig.live(SECOND * 3);
        assert_eq!(
            rig.commanded(MQTT, Order::Reset).0,
            Outcome::Confirmed,
            "{id}"
        );
        rig.live(SECOND * 3);
        assert!(rig.view(0).control.unwrap().lease.is_some(), "{id}");
        rig.sent.clear();
        assert_eq!(
            rig.commanded(MQTT, Order::Release),
            (Outcome::Acknowledged, Reason::None),
            "{id}"
        );
        let control = rig.view(0).control.unwrap();
        assert_eq!(
            (control.lease, control.start_inhibited, control.intent),
            (None, true, RunIntent::Stop),
            "{id}"
        );
        assert_eq!(rig.writes(), [single(COMMAND, 0)], "{id}");
        rig.live(SECOND * 10);
        assert_eq!(rig.writes().len(), 1, "{id}: nobody takes it back");
        refuses(
            &mut rig,
            plc(1),
            run(Direction::Forward, Some(3000)),
            Reason::StartInhibited,
        );
    }
}

#[test]
fn a_closed_terminal_starts_a_released_drive_which_is_seen_and_left_alone_until_it_is_stopped() {
    for id in RELEASING {
        let mut rig = at_rest(id);
        operate_panel(&mut rig, Some(Direction::Forward));
        rig.live(SECOND * 5);
        assert_eq!(rig.output(1), 0, "{id}: the bus has priority");
        assert_eq!(
            rig.commanded(MQTT, Order::Release),
            (Outcome::Acknowledged, Reason::None),
            "{id}"
        );
        rig.live(SECOND * 12);
        assert_eq!(
            (rig.output(1), rig.view(0).run_state),
            (2000, RunState::Forward),
            "{id}"
        );
        assert_eq!(rig.writes(), [single(COMMAND, 0)], "{id}: it is left alone");
        assert_eq!(
            rig.view(0).control.unwrap().intent,
            RunIntent::Stop,
            "{id}: nobody ordered it here"
        );
        assert_eq!(
            rig.commanded(plc(1), STOP),
            (Outcome::Confirmed, Reason::None),
            "{id}"
        );
        rig.live(SECOND * 12);
        assert_eq!(
            (rig.output(1), rig.view(0).run_state),
            (0, RunState::Stopped),
            "{id}: the bus has priority again"
        );
        assert_eq!(
            rig.writes(),
            [single(COMMAND, 0), single(COMMAND, 0xC000)],
            "{id}"
        );
        let held = rig.read(9, 0, COMMAND, 1);
        let expected = vfd_gateway::domain::native::NativeOutcome::Words([0xC000].into());
        assert_eq!(
            rig.answer_to(held),
            expected,
            "{id}: it stays under the bus"
        );
    }
}

#[test]
fn a_stop_takes_a_drive_from_its_panel_where_its_words_can() {
    for id in RELEASING {
        let mut rig = rig(id, accepting());
        rig.commanded(MQTT, setpoint(2000));
        operate_panel(&mut rig, Some(Direction::Forward));
        rig.live(SECOND * 8);
        assert!(rig.output(1) > 0, "{id}: it was never under the bus");
        rig.sent.clear();
        assert_eq!(
            rig.commanded(MQTT, STOP),
            (Outcome::Confirmed, Reason::None),
            "{id}"
        );
        rig.live(SECOND * 8);
        assert_eq!(
            (rig.output(1), rig.writes()),
            (0, vec![single(COMMAND, 0xC000)]),
            "{id}"
        );
    }
}

#[test]
fn what_a_drive_needs_is_set_from_the_gateways_own_side_and_read_back() {
    for (id, items) in SETUP {
        let mut rig = rig(id, accepting());
        let now = rig.now;
        for (address, word) in *items {
            rig.bus
                .drive_mut(Station(1))
                .unwrap()
                .set_locally(now, (*address).into(), word ^ 1);
        }
        rig.sent.clear();
        // In any order of the names.
        let addresses: Vec<_> = items
            .iter()
            .rev()
            .map(|(address, _)| (*address).into())
            .collect();
        assert_eq!(
            rig.commanded(LOCAL, Order::Setup(addresses)),
            (Outcome::Confirmed, Reason::None),
            "{id}"
        );
        let expected: Vec<_> = items
            .iter()
            .map(|(address, word)| single(*address, *word))
            .collect();
        assert_eq!(rig.writes(), expected, "{id}");
        let last = rig.sent.iter().rposition(|sent| sent.pdu[0] == 6).unwrap();
        for (address, word) in *items {
            let pdu = [vec![3], address.to_be_bytes().to_vec(), vec![0, 1]].concat();
            assert!(
                rig.sent[last..].iter().any(|sent| sent.pdu == pdu),
                "{id}: {address:04X} is read back"
            );
            let held = rig.read(9, 0, *address, 1);
            let expected = vfd_gateway::domain::native::NativeOutcome::Words([*word].into());
            assert_eq!(rig.answer_to(held), expected, "{id}");
        }
        assert_eq!(
            rig.view(0).control.unwrap().lease,
            None,
            "{id}: nobody holds it for that"
        );
    }
}

#[test]
fn no_other_party_sets_what_a_drive_needs() {
    for (id, items) in SETUP {
        let mut rig = rig(id, accepting());
        for origin in [MQTT, plc(1)] {
            let addresses = items.iter().map(|(address, _)| (*address).into()).collect();
            refuses(
                &mut rig,
                origin,
                Order::Setup(addresses),
                Reason::NotFromHere,
            );
        }
        assert!(rig.writes().is_empty(), "{id}");
    }
}

#[test]
fn nothing_but_what_a_drive_needs_is_set_that_way() {
    for model in models() {
        let mut rig = rig(&model.id, accepting());
        let mut wrong: Vec<u16> = model
            .registers
            .iter()
            .map(|register| register.address.number())
            .collect();
        let right = SETUP
            .iter()
            .find(|(id, _)| *id == model.id)
            .map_or(&[][..], |(_, items)| items);
        wrong.retain(|address| right.iter().all(|(needed, _)| needed != address));
        assert!(wrong.contains(&address_of(&model, RegisterRole::RunCommand)));
        for address in wrong.into_iter().chain([0x7FFF]) {
            let with_right = right
                .iter()
                .map(|(needed, _)| *needed)
                .chain([address])
                .collect();
            for addresses in [vec![address], with_right] {
                let addresses = addresses.into_iter().map(Into::into).collect();
                refuses(&mut rig, LOCAL, Order::Setup(addresses), Reason::NotCapable);
            }
        }
        refuses(
            &mut rig,
            LOCAL,
            Order::Setup(Vec::new()),
            Reason::NotUnderstood,
        );
        assert!(rig.writes().is_empty(), "{}", model.id);
    }
}

#[test]
fn nothing_is_set_while_the_motor_turns_or_somebody_holds_control() {
    for (id, items) in SETUP {
        let mut rig = rig(id, accepting());
        let setup = || Order::Setup(items.iter().map(|(address, _)| (*address).into()).collect());
        rig.commanded(LOCAL, run(Direction::Forward, Some(3000)));
        rig.pass(SECOND);
        rig.sent.clear();
        refuses(&mut rig, LOCAL, setup(), Reason::Moving);
        let stop = rig.command(LOCAL, 0, STOP);
        refuses(&mut rig, LOCAL, setup(), Reason::StopPending);
        rig.outcome_of(stop);
        refuses(&mut rig, LOCAL, setup(), Reason::Moving);
        rig.pass(SECOND * 12);
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        refuses(&mut rig, LOCAL, setup(), Reason::OtherOwner);
        let written: Vec<_> = items
            .iter()
            .flat_map(|(address, _)| rig.written(*address))
            .collect();
        assert!(written.is_empty(), "{id}: {written:?}");
    }
}

#[test]
fn nothing_is_set_while_a_panel_runs_the_motor() {
    for (id, items) in SETUP
        .iter()
        .filter(|(id, _)| id.starts_with("teco") || id.starts_with("frecon"))
    {
        let mut rig = rig(id, accepting());
        rig.commanded(MQTT, setpoint(2000));
        let now = rig.now;
        for (address, _) in *items {
            rig.bus
                .drive_mut(Station(1))
                .unwrap()
                .set_locally(now, (*address).into(), 0);
        }
        operate_panel(&mut rig, Some(Direction::Forward));
        rig.live(SECOND * 5);
        assert!(rig.output(1) > 0, "{id}");
        rig.sent.clear();
        let addresses = items.iter().map(|(address, _)| (*address).into()).collect();
        refuses(&mut rig, LOCAL, Order::Setup(addresses), Reason::Moving);
        assert!(rig.writes().is_empty(), "{id}");
    }
}
