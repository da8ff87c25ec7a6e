//! No drive is started at an unknown frequency: it is read from the drive just before, or was accepted here and is
//! written with the order to run.

use crate::support::families::{accepting, models, rig_of, single};
use crate::support::{MQTT, Rig, STOP, model, plc, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Origin, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::gateway::DriveNote;

const SECOND: Duration = Duration::from_secs(1);

/// Model, addresses of run command, frequency command and the drive's own setting, and the word for run.
const SHOWING: &[(&str, u16, u16, u16, u16)] = &[
    ("hyundai-n700", 0x0002, 0x0004, 0x0201, 1),
    ("hyundai-n100plus", 0x0002, 0x0004, 0x0201, 1),
    ("toshiba-vf-as1", 0xFA00, 0xFA01, 0xFA01, 0xC400),
    ("toshiba-vf-s15", 0xFA00, 0xFA01, 0xFA01, 0xC400),
    ("teco-e510", 0x2501, 0x2502, 0x2523, 1),
    ("frecon-fr500a", 0x2000, 0x2001, 0x3001, 1),
];
const UNSURE: &str = "teco-e510s";

/// Another party gives the drive a setpoint in hundredths of a hertz.
fn set_elsewhere(rig: &mut Rig, frequency_command: u16, centihertz: u16) {
    let now = rig.now;
    let pdu = single(frequency_command, centihertz);
    assert!(
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .answer(now, &pdu, 0, &mut Vec::new())
    );
}

/// A fresh rig whose drive has shown its constants.
fn fresh(id: &str) -> Rig {
    let mut rig = rig_of(&model(id), accepting());
    rig.pass(SECOND * 3);
    rig.sent.clear();
    rig
}

fn forward() -> Order {
    run(Direction::Forward, None)
}

#[test]
fn a_drive_without_a_setpoint_is_not_started() {
    for model in models() {
        let mut rig = fresh(&model.id);
        assert_eq!(
            rig.commanded(MQTT, forward()),
            (Outcome::Refused, Reason::SetpointUnknown),
            "{}",
            model.id
        );
        assert!(
            rig.writes().is_empty(),
            "{}: {:02X?}",
            model.id,
            rig.writes()
        );
        rig.pass(SECOND * 2);
        assert_eq!(rig.output(1), 0, "{}", model.id);
    }
}

#[test]
fn a_setting_outside_the_limits_is_refused_with_an_alarm() {
    for (id, _, frequency, ..) in SHOWING {
        for outside in [400, 5500] {
            let mut rig = fresh(id);
            set_elsewhere(&mut rig, *frequency, outside);
            assert_eq!(
                rig.commanded(MQTT, forward()),
                (Outcome::Refused, Reason::SetpointUnknown),
                "{id}"
            );
            assert!(
                rig.notes
                    .iter()
                    .any(|(_, note)| *note == DriveNote::SetpointOutside),
                "{id}: {:?}",
                rig.notes
            );
            assert!(rig.writes().is_empty(), "{id}: {:02X?}", rig.writes());
        }
    }
}

#[test]
fn a_setting_within_the_limits_is_read_right_before_run() {
    for (id, command, frequency, setting, word) in SHOWING {
        let mut rig = fresh(id);
        set_elsewhere(&mut rig, *frequency, 2500);
        let told = rig.commanded(MQTT, forward());
        assert!(
            matches!(told.0, Outcome::Confirmed | Outcome::Acknowledged),
            "{id}: {told:?}"
        );
        assert_eq!(
            rig.writes(),
            [single(*command, *word)],
            "{id}: the setpoint is not written again"
        );
        let run = rig.sent.iter().position(|sent| sent.pdu[0] == 6).unwrap();
        let before = &rig.sent[run - 1];
        assert_eq!(
            before.pdu[..3],
            [3, (setting >> 8) as u8, (setting & 0xFF) as u8],
            "{id}: {:02X?}",
            before.pdu
        );
        rig.live(SECOND * 8);
        assert_eq!(rig.output(1), 2500, "{id}");
    }
}

#[test]
fn a_setting_that_has_changed_since_it_was_accepted_is_the_one_that_counts() {
    for (id, _, frequency, ..) in SHOWING {
        let mut rig = fresh(id);
        assert_eq!(
            rig.commanded(MQTT, setpoint(3000)).0,
            Outcome::Confirmed,
            "{id}"
        );
        set_elsewhere(&mut rig, *frequency, 0);
        rig.sent.clear();
        assert_eq!(
            rig.commanded(MQTT, forward()),
            (Outcome::Refused, Reason::SetpointUnknown),
            "{id}"
        );
        assert!(rig.writes().is_empty(), "{id}: {:02X?}", rig.writes());
    }
}

#[test]
fn a_drive_whose_setting_cannot_be_relied_on_gets_the_last_one_with_each_run() {
    let mut rig = fresh(UNSURE);
    set_elsewhere(&mut rig, 0x2502, 2500);
    assert_eq!(
        rig.commanded(MQTT, forward()),
        (Outcome::Refused, Reason::SetpointUnknown),
        "none came through here"
    );
    assert!(rig.writes().is_empty());
    assert_eq!(rig.commanded(MQTT, setpoint(3000)).0, Outcome::Confirmed);
    let with_run = [vec![6, 0x25, 0x02, 0x0B, 0xB8], vec![6, 0x25, 0x01, 0, 1]];
    for _ in 0..3 {
        set_elsewhere(&mut rig, 0x2502, 2500);
        rig.sent.clear();
        assert_eq!(rig.commanded(MQTT, forward()).0, Outcome::Confirmed);
        assert_eq!(rig.writes(), with_run);
        rig.live(SECOND * 7);
        assert_eq!(rig.output(1), 3000);
        assert_eq!(rig.commanded(MQTT, STOP).0, Outcome::Confirmed);
        rig.live(SECOND * 8);
    }
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), false);
    rig.live(SECOND * 10);
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), true);
    rig.live(SECOND * 45);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, forward()).0,
        Outcome::Confirmed,
        "also after the drive was without power"
    );
    assert_eq!(rig.writes(), with_run);
}

#[test]
fn a_drive_that_forgets_its_setpoint_in_a_reset_or_without_power_is_not_started_without_one() {
    for id in ["toshiba-vf-as1", "toshiba-vf-s15"] {
        for by_power in [false, true] {
            let mut rig = fresh(id);
            rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
            rig.live(SECOND * 2);
            let now = rig.now;
            if by_power {
                rig.bus.set_powered(now, Station(1), false);
                rig.live(SECOND * 10);
                let now = rig.now;
                rig.bus.set_powered(now, Station(1), true);
                rig.live(SECOND * 45);
            } else {
                rig.bus.drive_mut(Station(1)).unwrap().trip(now, 3);
                rig.live(SECOND * 2);
                let reset = Order::Reset;
                assert_eq!(rig.commanded(MQTT, reset).0, Outcome::Confirmed, "{id}");
            }
            rig.live(SECOND * 3);
            rig.sent.clear();
            let told = rig.commanded(MQTT, forward());
            assert_eq!(
                told,
                (Outcome::Refused, Reason::SetpointUnknown),
                "{id}, power {by_power}"
            );
            assert!(
                rig.writes().is_empty(),
                "{id}: what the drive has forgotten is not written again by itself"
            );
            assert_eq!(
                rig.commanded(MQTT, run(Direction::Forward, Some(3000))).0,
                Outcome::Confirmed,
                "{id}"
            );
        }
    }
}

/// Forward at 30 Hz is ordered.
fn is_taken(rig: &mut Rig, by: Origin) {
    let (outcome, reason) = rig.commanded(by, run(Direction::Forward, Some(3000)));
    assert!(
        matches!(outcome, Outcome::Acknowledged | Outcome::Confirmed),
        "{outcome:?} {reason:?}"
    );
}

#[test]
fn a_controller_that_repeats_its_setpoint_runs_at_that_whatever_was_set_while_the_motor_stood() {
    let plc = plc(1);
    for (id, _, frequency, ..) in SHOWING {
        for elsewhere in [0, 4900, 5500] {
            let mut rig = fresh(id);
            rig.commanded(plc, STOP);
            is_taken(&mut rig, plc);
            rig.pass(SECOND * 2);
            for _ in 0..15 {
                rig.commanded(plc, STOP);
                rig.pass(SECOND);
            }
            assert_eq!(rig.output(1), 0, "{id}");
            set_elsewhere(&mut rig, *frequency, elsewhere);
            rig.sent.clear();
            is_taken(&mut rig, plc);
            // Alone before the order to run, or in one block with it.
            let written = rig.writes();
            assert!(
                written[0].ends_with(&3000_u16.to_be_bytes()),
                "{id}: {written:02X?}"
            );
            for _ in 0..10 {
                is_taken(&mut rig, plc);
                rig.pass(SECOND);
            }
            assert_eq!(rig.output(1), 3000, "{id}, {elsewhere} set elsewhere");
            assert_eq!(rig.writes(), written, "{id}: what repeats it goes nowhere");
        }
    }
}
