//! The drive's own watchdog. TECO E510: 09-06 time (0906, 0.1 s), 09-07 reaction. Frecon FR500A: F15.03 time (0F03).

use super::*;

/// Runs at 60 Hz since 10 s, with a watchdog of 2 s and `reaction`, and was last asked at 30 s.
fn running(reaction: u16) -> SimDrive {
    let mut drive = ready("teco-e510");
    take(
        &mut drive,
        seconds(0),
        &[
            (0x0906, 20),
            (0x0907, reaction),
            (0x2502, 6000),
            (0x2501, 1),
        ],
    );
    for at in 1..=30 {
        assert_eq!(word(&mut drive, seconds(at), 0x2520), 0b0101);
    }
    drive
}

#[test]
fn a_silent_bus_stops_the_motor_as_the_reaction_says() {
    // Output just before, at once after, and 5 s after the end of the two seconds.
    for (reaction, outputs) in [
        (0, [60, 60, 30]),
        (1, [60, 0, 0]),
        (2, [60, 60, 30]),
        (3, [60, 60, 60]),
    ] {
        let mut drive = running(reaction);
        let found = [31_999, 32_000, 37_000].map(|at| hertz(&drive, ms(at)));
        assert_eq!(found, outputs, "{reaction}");
        drive.advance(ms(31_999));
        assert_eq!(drive.report().watchdog_expiries, 0);
        assert_eq!(hertz(&drive, ms(37_000)), outputs[2]);
        drive.advance(ms(32_000));
        drive.advance(ms(60_000));
        assert_eq!(
            (drive.report().watchdog_expiries, drive.is_tripped()),
            (1, false)
        );
        assert_eq!(
            word(&mut drive, seconds(60), 0x2524) / 100,
            if reaction == 3 { 60 } else { 0 }
        );
    }
}

#[test]
fn what_the_drive_cannot_serve_does_not_feed_it() {
    let mut drive = running(1);
    ask(&mut drive, ms(31_500), &[4, 0x25, 0x20, 0, 1]);
    assert_eq!(hertz(&drive, ms(32_000)), 0);
    let mut drive = running(1);
    ask(&mut drive, ms(31_500), &[8, 0, 0, 1, 2]);
    assert_eq!(hertz(&drive, ms(33_000)), 60, "a loop test does");
}

#[test]
fn off_or_without_a_motor_to_stop_it_does_nothing() {
    let mut drive = ready("teco-e510");
    take(&mut drive, seconds(0), &[(0x2502, 6000), (0x2501, 1)]);
    drive.advance(seconds(1_000));
    assert_eq!(
        (
            hertz(&drive, seconds(1_000)),
            drive.report().watchdog_expiries
        ),
        (60, 0)
    );
    take(&mut drive, seconds(1_000), &[(0x2501, 0), (0x0906, 20)]);
    drive.advance(seconds(2_000));
    assert_eq!(drive.report().watchdog_expiries, 0);
}

#[test]
fn a_drive_that_has_a_number_for_it_trips() {
    let mut drive = ready("frecon-fr500a");
    take(
        &mut drive,
        seconds(0),
        &[(0x0F03, 15), (0x2001, 6000), (0x2000, 1)],
    );
    assert_eq!(drive.output(ms(1_499)), 8_994_000);
    assert_eq!(drive.output(ms(1_500)), 0);
    assert_eq!(read(&mut drive, ms(9_000), 0x3100, 2), Some(vec![18, 900]));
    assert_eq!(
        (word(&mut drive, ms(9_000), 0x2100), drive.is_tripped()),
        (6, true)
    );
}
