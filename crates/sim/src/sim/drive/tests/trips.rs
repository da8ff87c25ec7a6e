//! Trips as the families show them.

use super::*;

#[test]
fn a_trip_code_holds_until_the_reset_and_the_history_stays() {
    let mut drive = ready("toshiba-vf-as1");
    let history = |drive: &mut SimDrive, at| {
        [0xFE10, 0xFE11, 0xFE12, 0xFE13].map(|address| word(drive, at, address))
    };
    assert_eq!(
        (
            word(&mut drive, seconds(0), 0xFC90),
            history(&mut drive, seconds(0))
        ),
        (0, [0; 4])
    );
    for (cause, at) in (1..).zip([10, 20, 30, 40, 50]) {
        drive.trip(seconds(at), cause);
        assert_eq!(word(&mut drive, seconds(at), 0xFC90), cause);
        take(
            &mut drive,
            seconds(at),
            &[(0xFA00, 0xC000), (0xFA00, 0xE000)],
        );
        take(&mut drive, seconds(at + 2), &[(0xFA00, 0xC000)]);
        assert_eq!(word(&mut drive, seconds(at + 2), 0xFC90), 0);
    }
    assert_eq!(history(&mut drive, seconds(60)), [5, 4, 3, 2]);
}

#[test]
fn records_of_five_words_stand_beside_a_history() {
    let mut drive = ready("frecon-fr500a");
    take(&mut drive, seconds(0), &[(0x2001, 6000), (0x2000, 1)]);
    drive.trip(seconds(5), 7);
    for cause in 8..=12 {
        drive.trip(seconds(10), cause);
    }
    // The newest one at standstill.
    assert_eq!(
        read(&mut drive, seconds(20), 0x3100, 4),
        Some(vec![12, 0, 0, 540])
    );
    let causes = [0x3105, 0x310A, 0x310F, 0x3110, 0x3111, 0x3119];
    assert_eq!(
        causes.map(|address| word(&mut drive, seconds(20), address)),
        [11, 10, 9, 8, 7, 0]
    );
    assert_eq!(
        ask(&mut drive, seconds(20), &[3, 0x31, 0x1A, 0, 1]),
        Some(vec![0x83, 2])
    );
}

#[test]
fn records_of_four_words_end_where_something_else_begins() {
    let mut drive = ready("hyundai-n100plus");
    take(&mut drive, seconds(0), &[(0x0004, 6000), (0x0002, 1)]);
    drive.trip(seconds(5), 2);
    drive.trip(seconds(6), 3);
    assert_eq!(
        read(&mut drive, seconds(6), 0x010D, 8),
        Some(vec![3, 0, 0, 540, 2, 3000, 73, 530])
    );
    assert_eq!(word(&mut drive, seconds(6), 0x011D), 2, "trip count");
    assert_eq!(read(&mut drive, seconds(6), 0x011E, 1), None);
}
