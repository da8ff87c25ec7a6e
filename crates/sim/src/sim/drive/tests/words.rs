//! Drives whose run words have bits with every sense, fields, and a run order that stays. 2000 run command, 2001
//! setpoint in hundredths of a hertz, 2100 status: bit 0 running, 1 in reverse.

use super::*;
use crate::profile::check;
use std::sync::Arc;

const RUN: u16 = 0x2000;
const SETPOINT: u16 = 0x2001;
const STATUS: u16 = 0x2100;

fn drive(text: &str) -> SimDrive {
    let mut drive = SimDrive::new(
        Arc::new(check::model(text).unwrap()),
        DriveOptions::default(),
    );
    take(&mut drive, seconds(0), &[(SETPOINT, 3000)]);
    drive
}

fn ignoring() -> SimDrive {
    drive(include_str!(
        "../../../../../../tests/golden/models/zero-ignored.toml"
    ))
}

fn latching() -> SimDrive {
    drive(include_str!(
        "../../../../../../tests/golden/models/zero-nothing.toml"
    ))
}

fn coasting() -> SimDrive {
    drive(include_str!(
        "../../../../../../tests/golden/models/zero-coast.toml"
    ))
}

#[test]
fn a_word_that_is_not_taken_is_answered_and_changes_nothing() {
    let mut drive = ignoring();
    take(&mut drive, seconds(0), &[(RUN, 0x047C)]);
    // 0, a coast, a reverse and a stop, all without bit 10.
    for word in [0x0000, 0x0034, 0x807C, 0x003C] {
        take(&mut drive, seconds(5), &[(RUN, word)]);
        assert_eq!(
            (hertz(&drive, seconds(9)), word_of(&mut drive)),
            (30, 1),
            "{word:04X}"
        );
    }
    assert_eq!(
        refused(&mut drive, seconds(9), RUN, 0x087C),
        3,
        "bit 11 is not declared"
    );
}

fn word_of(drive: &mut SimDrive) -> u16 {
    word(drive, seconds(9), STATUS)
}

#[test]
fn meanings_hold_while_their_bits_are_0() {
    for (stop, at_once) in [
        (0x043C, false),
        (0x0434, true),
        (0x042C, false),
        (0x0438, false),
    ] {
        let mut drive = ignoring();
        take(&mut drive, seconds(0), &[(RUN, 0x847C)]);
        assert_eq!(hertz(&drive, seconds(9)), -30);
        take(&mut drive, seconds(9), &[(RUN, stop)]);
        assert_eq!(hertz(&drive, seconds(9)) == 0, at_once, "{stop:04X}");
        assert_eq!(hertz(&drive, seconds(20)), 0, "{stop:04X}");
    }
    // Direction by a bit that is 1 for forward.
    let mut drive = coasting();
    take(&mut drive, seconds(0), &[(RUN, 0x0003)]);
    assert_eq!(hertz(&drive, seconds(9)), -30);
    take(&mut drive, seconds(9), &[(RUN, 0x0007)]);
    assert_eq!(hertz(&drive, seconds(30)), 30);
    take(&mut drive, seconds(30), &[(RUN, 0x0000)]);
    assert_eq!(hertz(&drive, seconds(30)), 0, "it coasts");
}

#[test]
fn a_frozen_output_stays_where_it_is() {
    let mut drive = ignoring();
    take(&mut drive, seconds(0), &[(RUN, 0x047C)]);
    // 60 Hz in 10 s.
    assert_eq!(hertz(&drive, seconds(3)), 18);
    take(&mut drive, seconds(3), &[(RUN, 0x045C)]);
    assert_eq!(hertz(&drive, seconds(20)), 18);
    take(&mut drive, seconds(20), &[(RUN, 0x047C)]);
    assert_eq!(hertz(&drive, seconds(30)), 30);
}

#[test]
fn a_run_order_stays_until_a_stop() {
    let mut drive = latching();
    take(&mut drive, seconds(0), &[(RUN, 0x0000), (RUN, 0x0010)]);
    assert_eq!(
        hertz(&drive, seconds(9)),
        0,
        "a direction alone starts nothing"
    );
    take(&mut drive, seconds(9), &[(RUN, 0x0012), (RUN, 0x0000)]);
    assert_eq!(hertz(&drive, seconds(20)), 30);
    take(&mut drive, seconds(20), &[(RUN, 0x0020)]);
    assert_eq!(
        hertz(&drive, seconds(40)),
        -30,
        "a direction turns a motor that runs"
    );
    take(&mut drive, seconds(40), &[(RUN, 0x0030)]);
    assert_eq!(hertz(&drive, seconds(60)), 30, "and so does the other one");
    take(&mut drive, seconds(60), &[(RUN, 0x0013)]);
    assert_eq!(
        hertz(&drive, seconds(80)),
        0,
        "a stop is stronger than a run order beside it"
    );
    take(&mut drive, seconds(80), &[(RUN, 0x0000)]);
    assert_eq!(hertz(&drive, seconds(90)), 0);
}
