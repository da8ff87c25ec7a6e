//! Functions, limits and exception codes of each family.

use super::*;

/// Requests that the drive cannot serve or refuses, with its exception codes, both typed from the manuals.
#[test]
fn each_family_answers_with_its_own_codes() {
    let cases: [(&str, &[u8], u8); 31] = [
        ("teco-e510", &[4, 0x25, 0x20, 0, 1], 0x51),
        ("teco-e510", &[8, 0, 1, 0, 1], 0x51),
        ("teco-e510", &[3, 0x30, 0x00, 0, 1], 0x52),
        ("teco-e510", &[3, 0x25, 0x20, 0, 38], 0x53),
        ("teco-e510", &[3, 0x25, 0x20, 0, 0], 0x53),
        ("teco-e510", &[3, 0x25, 0x20], 0x53),
        ("teco-e510", &[3, 0x25, 0x01, 0, 1], 0x52),
        ("teco-e510", &[6, 0x25, 0x02, 0x17, 0x71], 0x54),
        ("teco-e510", &[6, 0x25, 0x01, 0, 0x10], 0x54),
        ("teco-e510", &[6, 0x25, 0x24, 0, 1], 0x52),
        ("teco-e510", &[16, 0x00, 0x0E, 0, 1, 2, 0, 50], 0x52),
        (
            "teco-e510",
            &[16, 0x25, 0x01, 0, 3, 6, 0, 0, 0, 0, 0, 0],
            0x53,
        ),
        ("teco-e510", &[16, 0x25, 0x02, 0, 2, 4, 0, 0, 0, 0], 0x52),
        ("teco-e510", &[16, 0x25, 0x01, 0, 2, 2, 0, 0], 0x53),
        ("teco-e510s", &[4, 0x25, 0x20, 0, 1], 0x01),
        ("teco-e510s", &[3, 0x30, 0x00, 0, 1], 0x02),
        ("teco-e510s", &[3, 0x25, 0x20, 0, 33], 0x04),
        ("teco-e510s", &[6, 0x25, 0x02, 0x17, 0x71], 0x03),
        ("frecon-fr500a", &[16, 0x20, 0x00, 0, 1, 2, 0, 1], 0x01),
        ("frecon-fr500a", &[3, 0x20, 0x00, 0, 1], 0x02),
        ("frecon-fr500a", &[3, 0x30, 0x00, 0, 9], 0x03),
        ("frecon-fr500a", &[3, 0x40, 0x00, 0, 1], 0x02),
        ("frecon-fr500a", &[6, 0x20, 0x01, 0x17, 0x71], 0x03),
        ("toshiba-vf-as1", &[8, 0, 0, 0, 1], 0x01),
        ("toshiba-vf-as1", &[3, 0xFD, 0x00, 0, 2], 0x03),
        ("toshiba-vf-as1", &[3, 0xFD, 0x0A, 0, 1], 0x02),
        ("toshiba-vf-as1", &[6, 0xFD, 0x00, 0, 1], 0x02),
        ("toshiba-vf-s15", &[43, 14, 1, 0], 0x01),
        (
            "toshiba-vf-s15",
            &[16, 0xFA, 0x00, 0, 2, 4, 0xC4, 0, 0x17, 0x70],
            0x03,
        ),
        ("toshiba-vf-s15", &[16, 0xFD, 0x00, 0, 1, 2, 0, 1], 0x02),
        ("toshiba-vf-s15", &[8, 0, 0, 0, 1], 0x01),
    ];
    for (id, pdu, code) in cases {
        assert_eq!(
            ask(&mut ready(id), seconds(0), pdu),
            Some(vec![pdu[0] | 0x80, code]),
            "{id} {pdu:02X?}"
        );
    }
}

#[test]
fn where_exceptions_are_listed_they_can_still_be_switched_off() {
    let options = DriveOptions {
        bad_request: BadRequest::Silence,
        ..DriveOptions::default()
    };
    let mut drive = SimDrive::new(model("frecon-fr500a"), options);
    assert_eq!(ask(&mut drive, seconds(0), &[3, 0x40, 0x00, 0, 1]), None);
    assert_eq!(refused(&mut drive, seconds(0), 0x2001, 6001), 3);
    assert_eq!(
        ask(
            &mut ready("hyundai-n100plus"),
            seconds(0),
            &[3, 0x40, 0x00, 0, 1]
        ),
        None
    );
}

#[test]
fn a_loop_test_comes_back_byte_for_byte() {
    for id in ["teco-e510", "teco-e510s", "frecon-fr500a"] {
        let pdu = [8, 0, 0, 0xA5, 0x37];
        assert_eq!(ask(&mut ready(id), seconds(0), &pdu), Some(pdu.to_vec()));
    }
}

#[test]
fn a_block_is_written_whole_or_not_at_all() {
    let mut drive = ready("teco-e510");
    let block = |run: u8, setpoint: u16| {
        let [high, low] = setpoint.to_be_bytes();
        [16, 0x25, 0x01, 0, 2, 4, 0, run, high, low]
    };
    assert_eq!(
        ask(&mut drive, seconds(0), &block(1, 3000)),
        Some(vec![16, 0x25, 0x01, 0, 2])
    );
    assert_eq!(hertz(&drive, seconds(9)), 30);
    assert_eq!(
        ask(&mut drive, seconds(9), &block(0, 6001)),
        Some(vec![0x90, 0x54])
    );
    assert_eq!(
        hertz(&drive, seconds(20)),
        30,
        "the stop in it was not taken either"
    );
    // One of the two alone.
    assert!(
        ask(
            &mut drive,
            seconds(20),
            &[16, 0x25, 0x02, 0, 1, 2, 0x07, 0xD0]
        )
        .is_some()
    );
    assert_eq!(hertz(&drive, seconds(30)), 20);
    let mut single = ready("toshiba-vf-s15");
    let one = [16, 0xFA, 0x01, 0, 1, 2, 0x17, 0x70];
    assert_eq!(ask(&mut single, seconds(0), &one), Some(one[..5].to_vec()));
    assert_eq!(word(&mut single, seconds(0), 0xFA01), 6000);
}

#[test]
fn decimal_numbers_follow_each_other() {
    let mut model = (*model("toshiba-vf-as1")).clone();
    model.read.max_words.value = 4;
    let mut drive = SimDrive::new(Arc::new(model), DriveOptions::default());
    drive.set_locally(seconds(0), 0xFE09_u16.into(), 0x0102);
    drive.trip(seconds(0), 5);
    drive.trip(seconds(0), 6);
    assert_eq!(
        read(&mut drive, seconds(0), 0xFE08, 4),
        Some(vec![0, 0x0102, 6, 5])
    );
    // FE15 does not exist, and spoils the whole range.
    assert_eq!(
        ask(&mut drive, seconds(0), &[3, 0xFE, 0x14, 0, 3]),
        Some(vec![0x83, 2])
    );
    use super::super::memory::following;
    assert_eq!(
        [0xFD99_u16, 0xFE09, 0xFE19, 0xFE10].map(|it| following(it.into(), true)),
        [0xFE00_u16, 0xFE10, 0xFE20, 0xFE11].map(|it| Some(it.into()))
    );
    assert_eq!(
        (
            following(0xFE09_u16.into(), false),
            following(0xFFFF_u16.into(), false)
        ),
        (Some(0xFE0A_u16.into()), None)
    );
}
