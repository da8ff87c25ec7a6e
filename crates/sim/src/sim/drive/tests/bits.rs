//! Drives whose run commands are bits and that obey the bus only where their sources say so.

use super::*;

/// Hyundai N100plus: FWD, REV, RST in 0x0002.
#[test]
fn forward_and_reverse_bits_turn_the_motor() {
    let mut drive = ready("hyundai-n100plus");
    take(&mut drive, seconds(0), &[(0x0004, 3000), (0x0002, 1)]);
    assert_eq!(hertz(&drive, seconds(5)), 30);
    take(&mut drive, seconds(5), &[(0x0002, 2)]);
    assert_eq!(hertz(&drive, seconds(15)), -30);
    take(&mut drive, seconds(15), &[(0x0002, 0)]);
    assert_eq!(hertz(&drive, seconds(20)), 0);
    assert_eq!(word(&mut drive, seconds(20), 0x0201), 3000);
}

#[test]
fn a_word_that_must_never_be_written_is_counted_and_not_done() {
    let mut drive = ready("hyundai-n100plus");
    take(&mut drive, seconds(0), &[(0x0004, 3000), (0x0002, 1)]);
    // Refused as everything else here: with the value that the drive kept.
    assert_eq!(write(&mut drive, seconds(5), 0x0002, 3), 1);
    assert_eq!(
        write(&mut drive, seconds(5), 0x0002, 0x0010),
        1,
        "a reserved bit"
    );
    assert_eq!(
        (hertz(&drive, seconds(9)), drive.report().forbidden_words),
        (30, 1)
    );
    let mut drive = ready("frecon-fr500a");
    for jog in [3, 4] {
        assert_eq!(refused(&mut drive, seconds(0), 0x2000, jog), 3);
    }
    assert_eq!(
        (hertz(&drive, seconds(9)), drive.report().forbidden_words),
        (0, 2)
    );
}

#[test]
fn a_reset_acts_when_its_bit_comes_and_never_while_it_stands() {
    let mut drive = ready("hyundai-n100plus");
    drive.trip(seconds(1), 2);
    take(&mut drive, seconds(2), &[(0x0002, 4)]);
    assert!(!drive.is_tripped());
    drive.trip(seconds(3), 2);
    take(&mut drive, seconds(4), &[(0x0002, 4)]);
    assert!(drive.is_tripped(), "the bit was still set");
    assert_eq!(drive.report().resets_held, 1);
    take(
        &mut drive,
        seconds(5),
        &[(0x0002, 0), (0x0002, 4), (0x0002, 0)],
    );
    assert!(!drive.is_tripped());
    assert_eq!(drive.report().resets_held, 1);
}

/// TECO E510: 2501 run, reverse, external fault, reset; 2520 running, reverse, ready, fault.
#[test]
fn state_bits_follow_the_motor() {
    let mut drive = ready("teco-e510");
    assert_eq!(word(&mut drive, seconds(0), 0x2520), 0b0100);
    take(&mut drive, seconds(0), &[(0x2502, 6000), (0x2501, 1)]);
    assert_eq!(word(&mut drive, seconds(0), 0x2520), 0b0101);
    take(&mut drive, seconds(10), &[(0x2501, 3)]);
    assert_eq!(
        word(&mut drive, seconds(19), 0x2520),
        0b0101,
        "still forward"
    );
    assert_eq!(word(&mut drive, seconds(30), 0x2520), 0b0111);
    take(&mut drive, seconds(30), &[(0x2501, 0)]);
    assert_eq!(
        word(&mut drive, seconds(35), 0x2520),
        0b0111,
        "it ramps down"
    );
    assert_eq!(word(&mut drive, seconds(40), 0x2520), 0b0100);
    take(&mut drive, seconds(40), &[(0x2501, 0b0100)]);
    assert_eq!(
        (
            word(&mut drive, seconds(40), 0x2520),
            word(&mut drive, seconds(40), 0x2521)
        ),
        (0b1000, 14)
    );
    assert_eq!(refused(&mut drive, seconds(41), 0x2501, 1), 0x55);
    take(
        &mut drive,
        seconds(41),
        &[(0x2501, 0), (0x2501, 8), (0x2501, 0)],
    );
    assert_eq!(
        (
            word(&mut drive, seconds(41), 0x2520),
            word(&mut drive, seconds(41), 0x2521)
        ),
        (0b0100, 0)
    );
}

#[test]
fn readings_are_in_the_units_of_their_registers() {
    let mut drive = ready("teco-e510");
    take(&mut drive, seconds(0), &[(0x2502, 6000), (0x2501, 1)]);
    // 60.00 Hz set, 30.00 Hz given out, 200.0 V of 400, 530 V, 7.3 A: a third and half of the rest of 11.0 A.
    assert_eq!(
        read(&mut drive, seconds(5), 0x2523, 5),
        Some(vec![6000, 3000, 2000, 530, 73])
    );
    let mut drive = ready("frecon-fr500a");
    take(&mut drive, seconds(0), &[(0x2001, 6000), (0x2000, 2)]);
    assert_eq!(
        read(&mut drive, seconds(10), 0x3000, 5),
        Some(vec![6000, 6000, 4000, 110, 66])
    );
    assert_eq!(
        (
            word(&mut drive, seconds(10), 0x3006),
            word(&mut drive, seconds(10), 0x3017)
        ),
        (520, 450)
    );
    assert_eq!(word(&mut drive, seconds(2 * 3_600), 0x301B), 2, "run hours");
}

#[test]
fn sources_must_hold_what_the_setup_demands() {
    // Register, another source than communication, the exception code for "not now".
    let families = [
        (
            "teco-e510",
            [(0x0002, 0), (0x0005, 1)],
            [0x2501, 0x2502],
            0x55,
        ),
        (
            "teco-e510s",
            [(0x0002, 0), (0x0005, 1)],
            [0x2501, 0x2502],
            0x03,
        ),
        (
            "frecon-fr500a",
            [(0x0200, 0), (0x0101, 1)],
            [0x2000, 0x2001],
            0x04,
        ),
    ];
    for (id, sources, [run, setpoint], code) in families {
        for (source, other) in sources {
            let mut drive = ready(id);
            let communication = word(&mut drive, seconds(0), source);
            take(&mut drive, seconds(0), &[(setpoint, 3000), (source, other)]);
            assert_eq!(refused(&mut drive, seconds(0), run, 1), code, "{id}");
            take(&mut drive, seconds(0), &[(source, communication), (run, 1)]);
            assert_eq!(hertz(&drive, seconds(9)), 30, "{id}");
        }
    }
    let factory = DriveOptions {
        sources_at_start: Some(0),
        ..DriveOptions::default()
    };
    let mut drive = SimDrive::new(model("hyundai-n100plus"), factory);
    assert!(drive.is_local());
    assert_eq!(write(&mut drive, seconds(0), 0x0002, 1), 0);
    // 3 in A01 but 2 in A02.
    take(
        &mut drive,
        seconds(0),
        &[(0x0301, 3), (0x0302, 2), (0x0002, 1)],
    );
    assert!(!drive.is_local());
}

#[test]
fn codes_and_bits_stand_where_their_words_put_them() {
    let mut drive = ready("frecon-fr500a");
    // 2100 state; 2101 bit 1 direction, bits 2 and 3 the run source: 2 communication.
    let state = |drive: &mut SimDrive, at| read(drive, at, 0x2100, 2).unwrap();
    assert_eq!(state(&mut drive, seconds(0)), [0, 0x0008]);
    take(&mut drive, seconds(0), &[(0x2001, 3000), (0x2000, 2)]);
    assert_eq!(state(&mut drive, seconds(1)), [1, 0x000A]);
    take(&mut drive, seconds(9), &[(0x2000, 5)]);
    assert_eq!(state(&mut drive, seconds(10)), [4, 0x000A]);
    assert_eq!(state(&mut drive, seconds(19)), [0, 0x0008]);
    take(&mut drive, seconds(19), &[(0x2000, 1)]);
    drive.trip(seconds(20), 7);
    assert_eq!(state(&mut drive, seconds(20)), [6, 0x0008]);
    take(&mut drive, seconds(21), &[(0x2000, 7), (0x0200, 0)]);
    assert_eq!(state(&mut drive, seconds(22)), [0, 0x0000], "keypad");
}

#[test]
fn panel_and_terminals_command_while_the_source_names_them() {
    let mut drive = ready("teco-e510");
    drive.operate_panel(seconds(0), Some(Direction::Forward));
    take(&mut drive, seconds(0), &[(0x2502, 3000)]);
    assert_eq!(hertz(&drive, seconds(9)), 0, "the bus commands");
    drive.set_locally(seconds(9), 0x0002_u16.into(), 0);
    assert_eq!((drive.is_local(), hertz(&drive, seconds(20))), (true, 30));
    drive.operate_panel(seconds(20), None);
    assert_eq!(hertz(&drive, seconds(30)), 0);
}
