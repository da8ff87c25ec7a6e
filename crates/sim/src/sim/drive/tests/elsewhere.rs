//! Actions on a drive from outside the line.

use super::*;
use crate::domain::command::Direction;
use crate::sim::options::RefusedStops;

#[test]
fn a_key_runs_and_stops_the_motor_whatever_the_sources_say() {
    let mut drive = ready("hyundai-n700");
    drive.set_frequency(seconds(0), 30);
    drive.operate(seconds(0), Some(Direction::Reverse));
    assert_eq!(
        (drive.ordered(), hertz(&drive, seconds(60))),
        (Some(Direction::Reverse), -30)
    );
    // Its register still says stop, and a stop over the line stops it.
    assert_eq!(drive.word(0x0002_u16.into()), Some(0));
    take(&mut drive, seconds(60), &[(0x0002, 0)]);
    assert_eq!((drive.ordered(), hertz(&drive, seconds(120))), (None, 0));
    drive.operate(seconds(120), Some(Direction::Forward));
    drive.operate(seconds(180), None);
    assert_eq!(hertz(&drive, seconds(240)), 0);
}

#[test]
fn a_tripped_drive_runs_again_once_its_trip_is_cleared() {
    let mut drive = ready("teco-e510");
    drive.set_frequency(seconds(0), 20);
    drive.trip(seconds(1), 7);
    drive.operate(seconds(2), Some(Direction::Forward));
    assert_eq!((drive.ordered(), drive.trips()), (None, 1));
    drive.clear_trip(seconds(3), Some(Direction::Forward));
    assert_eq!(
        (drive.is_tripped(), hertz(&drive, seconds(60))),
        (false, 20)
    );
}

#[test]
fn a_stop_is_refused_as_the_model_refuses() {
    let mut drive = ready("frecon-fr500a");
    take(&mut drive, seconds(0), &[(0x2001, 3000), (0x2000, 1)]);
    drive.refuse_stops(RefusedStops::Single);
    refused(&mut drive, seconds(1), 0x2000, 5);
    assert_eq!(drive.ordered(), Some(Direction::Forward));
    drive.refuse_stops(RefusedStops::None);
    take(&mut drive, seconds(2), &[(0x2000, 5)]);
    assert_eq!(drive.ordered(), None);
    let mut drive = ready("teco-e510");
    take(&mut drive, seconds(0), &[(0x2502, 3000), (0x2501, 1)]);
    drive.refuse_stops(RefusedStops::Single);
    refused(&mut drive, seconds(1), 0x2501, 0);
    assert!(
        ask(&mut drive, seconds(2), &[16, 0x25, 1, 0, 1, 2, 0, 0])
            .is_some_and(|reply| reply[0] == 16)
    );
    assert_eq!(drive.ordered(), None);
    // One that answers with the word it holds.
    let mut drive = ready("hyundai-n700");
    take(&mut drive, seconds(0), &[(0x0004, 3000), (0x0002, 1)]);
    drive.refuse_stops(RefusedStops::All);
    assert_eq!(write(&mut drive, seconds(1), 0x0002, 0), 1);
}
