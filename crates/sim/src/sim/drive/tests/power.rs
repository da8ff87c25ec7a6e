//! Power cycles: deaf times, and the state afterwards.

use super::*;

#[test]
fn a_drive_hears_nothing_for_as_long_as_its_model_says() {
    for (id, deaf_ms) in [
        ("toshiba-vf-as1", 2_000),
        ("toshiba-vf-s15", 1_000),
        ("hyundai-n700", 0),
    ] {
        let mut drive = ready(id);
        let address = if deaf_ms > 0 { 0xFD00 } else { OUTPUT };
        assert!(
            read(&mut drive, ms(0), address, 1).is_some(),
            "one that is on for a while hears"
        );
        drive.set_powered(ms(100), false);
        assert!(read(&mut drive, ms(200), address, 1).is_none());
        drive.set_powered(ms(1_000), true);
        for (after_ms, hears) in [(0, deaf_ms == 0), (deaf_ms, true)] {
            assert_eq!(
                read(&mut drive, ms(1_000 + after_ms), address, 1).is_some(),
                hears,
                "{id} {after_ms}"
            );
        }
        drive.set_powered(ms(10_000), false);
        drive.set_powered(ms(11_000), true);
        if deaf_ms > 0 {
            drive.obey(ms(11_000 + deaf_ms - 1), &[6, 0xFA, 0x01, 0x0B, 0xB8]);
            assert_eq!(read(&mut drive, ms(11_000 + deaf_ms - 1), address, 1), None);
            assert_eq!(
                word(&mut drive, ms(11_000 + deaf_ms), 0xFA01),
                0,
                "nor a broadcast"
            );
        }
    }
}

#[test]
fn what_is_in_ram_is_lost_and_what_is_stored_stays() {
    let mut drive = ready("toshiba-vf-as1");
    take(
        &mut drive,
        seconds(0),
        &[(0x0010, 300), (0xFA01, 3000), (0xFA00, 0xC400), (0xFA20, 7)],
    );
    drive.set_powered(seconds(9), false);
    assert_eq!(hertz(&drive, seconds(9)), 0);
    drive.set_powered(seconds(10), true);
    let found =
        [0x0010, 0xFA01, 0xFA00, 0xFA20].map(|address| word(&mut drive, seconds(12), address));
    assert_eq!((found, drive.is_local()), ([300, 0, 0, 0], true));
}

#[test]
fn a_closed_terminal_starts_the_motor_when_the_power_comes_back() {
    let mut drive = ready("toshiba-vf-as1");
    take(&mut drive, seconds(0), &[(0xFA00, 0xC000)]);
    drive.operate_panel(seconds(0), Some(Direction::Forward));
    drive.set_powered(seconds(1), false);
    drive.operate_panel(seconds(1), Some(Direction::Forward));
    assert_eq!(hertz(&drive, seconds(2)), 0);
    drive.set_locally(seconds(2), 0xFA01_u16.into(), 0);
    drive.set_powered(seconds(3), true);
    assert!(drive.is_local());
    assert_eq!(
        word(&mut drive, seconds(5), 0xFD01) & 0x0400,
        0x0400,
        "it is ordered to run"
    );
}

#[test]
fn a_trip_outlasts_the_power_if_it_is_chosen() {
    for outlasts in [false, true] {
        let options = DriveOptions {
            trip_outlasts_power: outlasts,
            ..DriveOptions::default()
        };
        let mut drive = SimDrive::new(model("teco-e510"), options);
        drive.trip(seconds(1), 19);
        drive.set_powered(seconds(2), false);
        drive.set_powered(seconds(3), true);
        assert_eq!(
            word(&mut drive, seconds(3), 0x2521),
            if outlasts { 19 } else { 0 }
        );
    }
}
