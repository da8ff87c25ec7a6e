//! What is stored, what is lost with the power, and what is counted.

use super::*;

#[test]
fn a_stored_twin_is_written_and_never_read() {
    let mut drive = ready("frecon-fr500a");
    // F03.00, acceleration time; 8300 is its stored twin.
    take(&mut drive, seconds(0), &[(0x8300, 200)]);
    assert_eq!(word(&mut drive, seconds(0), 0x0300), 200);
    assert_eq!(
        ask(&mut drive, seconds(0), &[3, 0x83, 0x00, 0, 1]),
        Some(vec![0x83, 2])
    );
    assert_eq!(
        (
            drive.stored_writes(0x0300_u16.into()),
            drive.report().stored_writes
        ),
        (1, 1)
    );
    take(&mut drive, seconds(0), &[(0x0300, 50), (0x2001, 6000)]);
    assert_eq!(word(&mut drive, seconds(0), 0x0300), 50);
    assert_eq!(
        drive.report().stored_writes,
        1,
        "without the bit it is in RAM"
    );
    drive.set_powered(seconds(1), false);
    drive.set_powered(seconds(2), true);
    assert_eq!(
        (
            word(&mut drive, seconds(2), 0x0300),
            word(&mut drive, seconds(2), 0x3001)
        ),
        (200, 0)
    );
    take(&mut drive, seconds(2), &[(0x2001, 6000), (0x2000, 1)]);
    assert_eq!(hertz(&drive, seconds(12)), 30, "20 s to 60 Hz");
    // Commands have no twin, measurements none either, and there is no second bit.
    for (address, value) in [(0xA000, 1), (0xA001, 100), (0xB000, 1), (0x8999, 1)] {
        assert_eq!(
            refused(&mut drive, seconds(12), address, value),
            2,
            "{address:04X}"
        );
    }
    let mut plain = ready("teco-e510");
    assert_eq!(refused(&mut plain, seconds(0), 0x800E, 1), 0x52);
}

#[test]
fn writes_to_stored_registers_are_counted_by_register() {
    let mut drive = ready("teco-e510");
    take(
        &mut drive,
        seconds(0),
        &[(0x000E, 50), (0x000E, 50), (0x000F, 60)],
    );
    take(
        &mut drive,
        seconds(0),
        &[(0x2502, 3000), (0x2501, 1), (0x2501, 0)],
    );
    let counted =
        [0x000E, 0x000F, 0x2501, 0x2502, 0x9999].map(|address| drive.stored_writes(address.into()));
    assert_eq!(
        (counted, drive.report().stored_writes),
        ([2, 1, 0, 0, 0], 3)
    );
    // A second way to the setpoint is stored.
    take(&mut drive, seconds(0), &[(0x0008, 2000)]);
    assert_eq!(
        (
            word(&mut drive, seconds(0), 0x2523),
            drive.stored_writes(0x0008_u16.into())
        ),
        (2000, 1)
    );
    let mut drive = ready("toshiba-vf-as1");
    take(
        &mut drive,
        seconds(0),
        &[(0x0010, 100), (0xFA01, 3000), (0xFA00, 0xC000)],
    );
    assert_eq!(
        (
            drive.stored_writes(0x0010_u16.into()),
            drive.report().stored_writes
        ),
        (1, 1)
    );
    drive.set_locally(seconds(0), 0x0010_u16.into(), 200);
    assert_eq!(drive.report().stored_writes, 1, "the panel is not the bus");
}

#[test]
fn ranges_are_enforced_in_the_form_of_the_model() {
    // Station of the N100plus: 1 to 32. It refuses with the value that it kept.
    let mut drive = ready("hyundai-n100plus");
    assert_eq!(word(&mut drive, seconds(0), 0x0411), 1);
    assert_eq!(write(&mut drive, seconds(0), 0x0411, 33), 1);
    assert_eq!(write(&mut drive, seconds(0), 0x0411, 32), 32);
    // Loss detection time of the E510: 0.0 to 25.5 s.
    let mut drive = ready("teco-e510");
    assert_eq!(refused(&mut drive, seconds(0), 0x0906, 256), 0x54);
    take(&mut drive, seconds(0), &[(0x0906, 255)]);
    // Torque of the FR500A: -300.0 to 300.0 %; F01.08 from 20.00 Hz on.
    let mut drive = ready("frecon-fr500a");
    take(
        &mut drive,
        seconds(0),
        &[(0x2004, 0x10000_u32.wrapping_sub(3000) as u16)],
    );
    assert_eq!(refused(&mut drive, seconds(0), 0x2004, 3001), 3);
    assert_eq!(refused(&mut drive, seconds(0), 0x0108, 1999), 3);
}
