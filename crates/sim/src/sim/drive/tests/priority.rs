//! A drive whose commands can take control whatever its panel says: Toshiba VF-AS1. FA00 command, FA01 frequency, FD01
//! status: bit 1 tripped, 2 alarm, 9 reverse, 10 running, 14 ready.

use super::*;

const COMMAND: u16 = 0xFA00;
const FREQUENCY: u16 = 0xFA01;
const STATUS: u16 = 0xFD01;
const FC90: u16 = 0xFC90;

fn drive() -> SimDrive {
    ready("toshiba-vf-as1")
}

fn closed_terminal() -> SimDrive {
    let options = DriveOptions {
        panel_runs: Some(Direction::Reverse),
        panel_frequency_hz: Some(20),
        ..DriveOptions::default()
    };
    SimDrive::new(model("toshiba-vf-as1"), options)
}

#[test]
fn words_with_priority_command_the_motor() {
    let mut drive = drive();
    take(
        &mut drive,
        seconds(0),
        &[(FREQUENCY, 3000), (COMMAND, 0xC400)],
    );
    assert_eq!(
        (
            hertz(&drive, seconds(5)),
            word(&mut drive, seconds(5), STATUS)
        ),
        (30, 0x4400)
    );
    take(&mut drive, seconds(5), &[(COMMAND, 0xC600)]);
    assert_eq!(
        (
            hertz(&drive, seconds(15)),
            word(&mut drive, seconds(15), STATUS)
        ),
        (-30, 0x4600)
    );
    take(&mut drive, seconds(15), &[(COMMAND, 0xC000)]);
    assert_eq!(
        (
            hertz(&drive, seconds(20)),
            word(&mut drive, seconds(20), STATUS)
        ),
        (0, 0x4000)
    );
    take(&mut drive, seconds(20), &[(COMMAND, 0xC500)]);
    assert_eq!(hertz(&drive, seconds(30)), 5, "jog");
    take(&mut drive, seconds(30), &[(COMMAND, 0xC400)]);
    assert_eq!(hertz(&drive, seconds(40)), 30);
    take(&mut drive, seconds(40), &[(COMMAND, 0xC800)]);
    assert_eq!(hertz(&drive, seconds(40)), 0, "coast");
    assert_eq!(word(&mut drive, seconds(40), COMMAND), 0xC800);
    drive.set_alarm(true);
    drive.set_locally(seconds(40), STATUS.into(), 0xFFFF);
    assert_eq!(
        word(&mut drive, seconds(40), STATUS),
        0xF9FD,
        "bits that no flag names are as they were set"
    );
}

#[test]
fn a_word_without_priority_changes_nothing_while_the_panel_commands() {
    let mut drive = drive();
    assert!(drive.is_local());
    take(
        &mut drive,
        seconds(0),
        &[(FREQUENCY, 3000), (COMMAND, 0x0400)],
    );
    assert_eq!(hertz(&drive, seconds(20)), 0);
    let mut drive = closed_terminal();
    assert_eq!(hertz(&drive, seconds(20)), -20);
    take(
        &mut drive,
        seconds(20),
        &[(FREQUENCY, 3000), (COMMAND, 0x0800)],
    );
    assert_eq!(hertz(&drive, seconds(20)), -20, "not even a coast");
}

#[test]
fn a_stop_takes_control_and_a_release_lets_a_closed_terminal_start_the_motor() {
    let mut drive = closed_terminal();
    take(&mut drive, seconds(10), &[(COMMAND, 0xC000)]);
    assert_eq!((drive.is_local(), hertz(&drive, seconds(30))), (false, 0));
    take(
        &mut drive,
        seconds(30),
        &[(FREQUENCY, 5000), (COMMAND, 0xC400)],
    );
    assert_eq!(hertz(&drive, seconds(50)), 50);
    take(&mut drive, seconds(50), &[(COMMAND, 0x0000)]);
    assert_eq!((drive.is_local(), hertz(&drive, seconds(80))), (true, -20));
    let mut drive = self::drive();
    take(
        &mut drive,
        seconds(0),
        &[(FREQUENCY, 5000), (COMMAND, 0xC400)],
    );
    take(&mut drive, seconds(20), &[(COMMAND, 0x0000)]);
    assert_eq!(
        hertz(&drive, seconds(40)),
        0,
        "nobody at the panel: it ramps down"
    );
}

#[test]
fn emergency_off_trips_and_a_reset_leaves_the_drive_deaf_without_orders() {
    let mut drive = drive();
    take(
        &mut drive,
        seconds(0),
        &[(FREQUENCY, 3000), (COMMAND, 0xC400)],
    );
    take(&mut drive, seconds(9), &[(COMMAND, 0x9000)]);
    assert_eq!((drive.is_tripped(), hertz(&drive, seconds(9))), (true, 0));
    // 17: emergency stop.
    assert_eq!(
        (
            word(&mut drive, seconds(9), FC90),
            word(&mut drive, seconds(9), STATUS)
        ),
        (17, 0x0002)
    );
    assert_eq!(refused(&mut drive, seconds(9), COMMAND, 0xC400), 4);
    take(
        &mut drive,
        seconds(10),
        &[(COMMAND, 0xC000), (COMMAND, 0xE000)],
    );
    for silent in [10_000, 11_999] {
        assert_eq!(read(&mut drive, ms(silent), STATUS, 1), None, "{silent} ms");
    }
    assert_eq!(word(&mut drive, ms(12_000), STATUS), 0x4000);
    assert_eq!(
        (
            word(&mut drive, ms(12_000), COMMAND),
            word(&mut drive, ms(12_000), FREQUENCY)
        ),
        (0, 0)
    );
    // Held, the bit is one thing too many, and does nothing more.
    take(&mut drive, seconds(12), &[(COMMAND, 0xE000)]);
    assert_eq!(drive.report().resets_held, 1);
    take(
        &mut drive,
        seconds(12),
        &[(COMMAND, 0xC000), (FREQUENCY, 3000), (COMMAND, 0xC400)],
    );
    assert_eq!(hertz(&drive, seconds(30)), 30);
}

#[test]
fn a_reset_hands_a_closed_terminal_the_motor() {
    let mut drive = closed_terminal();
    take(&mut drive, seconds(0), &[(COMMAND, 0xC000)]);
    drive.trip(seconds(30), 1);
    take(&mut drive, seconds(31), &[(COMMAND, 0xE000)]);
    assert_eq!(hertz(&drive, seconds(60)), -20);
    // Not where the sources name the bus.
    let options = DriveOptions {
        panel_runs: Some(Direction::Reverse),
        panel_frequency_hz: Some(20),
        sources_at_start: Some(DriveOptions::default().communication),
        ..DriveOptions::default()
    };
    let mut drive = SimDrive::new(model("toshiba-vf-as1"), options);
    drive.trip(seconds(1), 1);
    take(&mut drive, seconds(2), &[(COMMAND, 0xE000)]);
    assert_eq!(hertz(&drive, seconds(60)), 0);
}

#[test]
fn readings_are_per_cent_of_what_is_rated() {
    let mut drive = drive();
    take(
        &mut drive,
        seconds(0),
        &[(FREQUENCY, 6000), (COMMAND, 0xC400)],
    );
    let found =
        [0xFD00, 0xFD03, 0xFD04, 0xFD05].map(|address| word(&mut drive, seconds(5), address));
    // Half the speed: 33 % and half of 67 %, 530 of 540 V, half the voltage.
    assert_eq!(found, [3000, 6650, 9814, 5000]);
    drive.trip(seconds(5), 24);
    let live =
        [0xFD00, 0xFD03, 0xFD04, 0xFD05].map(|address| word(&mut drive, seconds(6), address));
    let frozen = [0xFE00, 0xFE03, 0xFE04].map(|address| word(&mut drive, seconds(6), address));
    assert_eq!((live, frozen), ([0, 0, 10_000, 0], [3000, 6650, 9814]));
}

#[test]
fn the_maximum_frequency_limits_the_setpoint_and_is_locked_while_the_motor_runs() {
    let mut drive = drive();
    assert_eq!(word(&mut drive, seconds(0), 0x0011), 6000);
    take(&mut drive, seconds(0), &[(0x0011, 4000), (FREQUENCY, 4000)]);
    assert_eq!(refused(&mut drive, seconds(0), FREQUENCY, 4001), 3);
    take(&mut drive, seconds(0), &[(COMMAND, 0xC400)]);
    assert_eq!(refused(&mut drive, seconds(1), 0x0011, 5000), 4);
    take(&mut drive, seconds(1), &[(COMMAND, 0xC000), (0x0011, 5000)]);
}

#[test]
fn every_built_in_back_door_that_moves_the_frequency_is_played() {
    use super::super::back_door::BackDoor;
    let doors = |id: &str| -> Vec<_> {
        let model = model(id);
        model
            .registers
            .iter()
            .filter_map(|it| Some((it.address.number(), BackDoor::of(it)?)))
            .collect()
    };
    use BackDoor::{Frequency, Limit};
    assert_eq!(doors("hyundai-n700"), []);
    assert_eq!(doors("hyundai-n100plus"), [(0x0304, Limit)]);
    for id in ["toshiba-vf-as1", "toshiba-vf-s15"] {
        assert_eq!(doors(id), [(0x0011, Limit), (0x0012, Limit)]);
    }
    for id in ["teco-e510", "teco-e510s"] {
        assert_eq!(doors(id), [(0x0008, Frequency)]);
    }
    assert_eq!(doors("frecon-fr500a"), [(0x0108, Limit), (0x0109, Limit)]);
}
