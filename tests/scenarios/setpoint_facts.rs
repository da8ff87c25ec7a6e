//! Whether a written setpoint is in force is decided by what the drive shows, not by what was once written.

use crate::support::families::{accepting, address_of, options_of, rig_of, write};
use crate::support::{MQTT, ORIGIN, Rig, RigOptions, STOP, model, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::profile::model::RegisterRole;

const SECOND: Duration = Duration::from_secs(1);
/// Models that show their own setting.
const SHOWING: [&str; 4] = [
    "frecon-fr500a",
    "teco-e510",
    "hyundai-n700",
    "mitsubishi-fr-d700",
];

/// A drive that its cyclic client has started at 30 Hz, and that runs at it.
fn running(id: &str) -> Rig {
    let mut rig = rig_of(&model(id), accepting());
    running_at(&mut rig, id, 3000);
    rig
}

fn running_at(rig: &mut Rig, id: &str, centihertz: u16) {
    assert_eq!(rig.commanded(ORIGIN, STOP).0, Outcome::Confirmed, "{id}");
    rig.pass(ControlSettings::RESTART_DELAY);
    let told = rig.commanded(ORIGIN, run(Direction::Forward, Some(centihertz)));
    assert!(
        matches!(told.0, Outcome::Confirmed | Outcome::Acknowledged),
        "{id}: {told:?}"
    );
    supervised(rig, SECOND * 10);
    rig.sent.clear();
}

/// Lets `time` pass while the client renews its lease by its order to run.
fn supervised(rig: &mut Rig, time: Duration) {
    let end = rig.now + time;
    while rig.now < end {
        let told = rig.commanded(ORIGIN, run(Direction::Forward, None));
        assert_eq!(told, (Outcome::Acknowledged, Reason::Unchanged));
        rig.pass(SECOND);
    }
}

/// Somebody sets another frequency at the drive.
fn is_set_to(rig: &mut Rig, hertz: u16) {
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_frequency(now, hertz);
    supervised(rig, SECOND * 8);
}

/// The frames that gave a setpoint.
fn setpoints(rig: &Rig, id: &str) -> usize {
    let address = address_of(&model(id), RegisterRole::FrequencyCommand).to_be_bytes();
    rig.writes()
        .iter()
        .filter(|pdu| pdu[1..3] == address)
        .count()
}

#[test]
fn a_setpoint_that_the_drive_no_longer_holds_is_sent_again() {
    for id in SHOWING {
        let mut rig = running(id);
        for _ in 0..3 {
            assert_eq!(
                rig.commanded(ORIGIN, setpoint(3000)),
                (Outcome::Acknowledged, Reason::Unchanged),
                "{id}"
            );
        }
        assert_eq!(setpoints(&rig, id), 0, "{id}: it holds it");
        is_set_to(&mut rig, 10);
        let told = rig.commanded(ORIGIN, setpoint(3000));
        assert_eq!(told, (Outcome::Confirmed, Reason::None), "{id}");
        assert_eq!(setpoints(&rig, id), 1, "{id}");
        for _ in 0..3 {
            assert_eq!(
                rig.commanded(ORIGIN, setpoint(3000)),
                (Outcome::Acknowledged, Reason::Unchanged),
                "{id}"
            );
        }
        assert_eq!(setpoints(&rig, id), 1, "{id}: it holds it again");
        supervised(&mut rig, SECOND * 10);
        assert_eq!(rig.output(1), 3000, "{id}");
    }
}

#[test]
fn the_same_beside_a_run_that_is_in_force_and_by_the_drives_own_registers() {
    for id in SHOWING {
        let mut rig = running(id);
        is_set_to(&mut rig, 10);
        assert_eq!(
            rig.commanded(ORIGIN, run(Direction::Forward, Some(3000))).0,
            Outcome::Confirmed,
            "{id}"
        );
        assert_eq!(setpoints(&rig, id), 1, "{id}");
        is_set_to(&mut rig, 10);
        let at = model(id);
        let scale = at
            .register_for(RegisterRole::FrequencyCommand)
            .unwrap()
            .scale;
        let word = u16::try_from(30 * scale).unwrap();
        assert_eq!(
            write(
                &mut rig,
                address_of(&at, RegisterRole::FrequencyCommand),
                &[word]
            ),
            NativeOutcome::Written,
            "{id}"
        );
        assert_eq!(setpoints(&rig, id), 2, "{id}");
    }
}

/// A drive that acknowledges every setpoint and takes none above 50 Hz, running at 30 Hz.
fn clamping(id: &str) -> Rig {
    let most = Hertz::from_centihertz(6000);
    let options = options_of(
        &model(id),
        ControlSettings {
            most,
            ..accepting()
        },
    );
    let mut rig = Rig::new(&RigOptions { ..options });
    rig.bus.drive_mut(Station(1)).unwrap().clamp(Some(50));
    running_at(&mut rig, id, 3000);
    rig
}

#[test]
fn where_a_drive_keeps_another_value_each_write_is_told_so() {
    for id in SHOWING {
        let mut rig = clamping(id);
        assert_eq!(
            rig.commanded(ORIGIN, setpoint(6000)),
            (Outcome::Failed, Reason::NotReadBack),
            "{id}"
        );
        let first = setpoints(&rig, id);
        assert_eq!(first, 1, "{id}");
        let end = rig.now + SECOND * 30;
        let mut writes = 0;
        while rig.now < end {
            let ticket = rig.command(ORIGIN, 0, setpoint(6000));
            assert_eq!(
                rig.outcome_of(ticket),
                (Outcome::Failed, Reason::NotReadBack),
                "{id}"
            );
            assert_eq!(rig.told(ticket).len(), 1, "{id}: no answer before it");
            rig.pass(SECOND / 10);
            writes += 1;
        }
        assert!(writes > 100, "{id}: {writes}");
        let again = setpoints(&rig, id) - first;
        assert!(
            (2..=6).contains(&again),
            "{id}: {again} frames for {writes} writes"
        );
        assert_eq!(
            rig.view(0).control.unwrap().lease.map(|(owner, _)| owner),
            Some(ORIGIN.owner),
            "{id}"
        );
        // Another one is taken, and the old one too once the drive takes it.
        assert_eq!(
            rig.commanded(ORIGIN, setpoint(4000)),
            (Outcome::Confirmed, Reason::None),
            "{id}"
        );
        rig.bus.drive_mut(Station(1)).unwrap().clamp(None);
        // A higher one than the drive held for so long, once the output was seen right.
        for _ in 0..10 {
            rig.command(ORIGIN, 0, setpoint(4000));
            rig.pass(SECOND);
        }
        assert_eq!(
            rig.commanded(ORIGIN, setpoint(6000)),
            (Outcome::Confirmed, Reason::None),
            "{id}"
        );
        assert_eq!(
            rig.commanded(ORIGIN, setpoint(6000)),
            (Outcome::Acknowledged, Reason::Unchanged),
            "{id}"
        );
    }
}

#[test]
fn a_message_is_sent_whatever_is_in_force() {
    for id in SHOWING {
        let mut rig = clamping(id);
        assert_eq!(rig.commanded(ORIGIN, STOP).0, Outcome::Confirmed, "{id}");
        rig.pass(SECOND * 15);
        rig.sent.clear();
        for count in 1..=2 {
            let ticket = rig.command(MQTT, 0, setpoint(6000));
            assert_eq!(
                rig.outcome_of(ticket),
                (Outcome::Failed, Reason::NotReadBack),
                "{id}"
            );
            assert_eq!(setpoints(&rig, id), count, "{id}");
        }
    }
}
