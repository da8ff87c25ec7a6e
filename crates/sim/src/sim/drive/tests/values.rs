//! A drive whose run commands are values and that has no status word.

use super::*;
use crate::profile::model::RefusedWrite;

fn drive() -> SimDrive {
    SimDrive::new(n700(), DriveOptions::default())
}

fn output(drive: &mut SimDrive, at: MonoTime) -> u16 {
    read(drive, at, OUTPUT, 1).unwrap()[0]
}

#[test]
fn ramps_follow_f007_and_f008() {
    let mut drive = drive();
    assert_eq!(read(&mut drive, seconds(0), F007, 1), Some(vec![100]));
    assert_eq!(write(&mut drive, seconds(0), F007, 200), 200);
    assert_eq!(write(&mut drive, seconds(0), F008, 300), 300);
    assert_eq!(write(&mut drive, seconds(0), SETPOINT, 6000), 6000);
    assert_eq!(write(&mut drive, seconds(0), RUN, 1), 1);
    assert_eq!(output(&mut drive, seconds(5)), 1500);
    assert_eq!(output(&mut drive, seconds(20)), 6000);
    assert_eq!(write(&mut drive, seconds(100), RUN, 0), 0);
    assert_eq!(output(&mut drive, seconds(115)), 3000);
    assert_eq!(output(&mut drive, seconds(130)), 0);
}

#[test]
fn reverse_runs_through_standstill_and_a_new_setpoint_is_followed() {
    let mut drive = drive();
    write(&mut drive, seconds(0), SETPOINT, 3000);
    write(&mut drive, seconds(0), RUN, 1);
    write(&mut drive, seconds(10), RUN, 2);
    assert_eq!(output(&mut drive, seconds(15)), 0);
    assert_eq!(drive.output(seconds(20)), -30 * MICROHERTZ);
    assert_eq!(output(&mut drive, seconds(20)), 3000);
    assert_eq!(write(&mut drive, seconds(30), SETPOINT, 6000), 6000);
    assert_eq!(drive.output(seconds(40)), -60 * MICROHERTZ);
    assert_eq!(read(&mut drive, seconds(40), F001, 1), Some(vec![6000]));
}

#[test]
fn coast_cuts_the_output_at_once() {
    let mut drive = drive();
    write(&mut drive, seconds(0), SETPOINT, 6000);
    write(&mut drive, seconds(0), RUN, 1);
    assert_eq!(output(&mut drive, seconds(20)), 6000);
    assert_eq!(write(&mut drive, seconds(20), RUN, 3), 3);
    assert_eq!(output(&mut drive, seconds(20)), 0);
    write(&mut drive, seconds(21), SETPOINT, 5000);
    assert_eq!(output(&mut drive, seconds(60)), 0);
}

#[test]
fn a_refused_write_answers_the_old_value() {
    let mut drive = drive();
    assert_eq!(write(&mut drive, seconds(0), SETPOINT, 5000), 5000);
    assert_eq!(write(&mut drive, seconds(0), SETPOINT, 6001), 5000);
    assert_eq!(write(&mut drive, seconds(0), RUN, 5), 0);
    assert_eq!(write(&mut drive, seconds(0), OUTPUT, 1), 0);
    assert_eq!(write(&mut drive, seconds(0), F001, 100), 5000);
    assert_eq!(write(&mut drive, seconds(0), TRIP_COUNT, 9), 0);
}

#[test]
fn run_is_obeyed_only_with_both_sources_at_communication() {
    for (address, source) in [(F010, 2), (F011, 1)] {
        let mut drive = drive();
        write(&mut drive, seconds(0), SETPOINT, 5000);
        assert_eq!(write(&mut drive, seconds(0), address, source), source);
        assert_eq!(write(&mut drive, seconds(0), RUN, 1), 0);
        assert_eq!(drive.output(seconds(50)), 0);
        assert_eq!(write(&mut drive, seconds(50), address, 3), 3);
        assert_eq!(write(&mut drive, seconds(50), RUN, 1), 1);
        assert_eq!(output(&mut drive, seconds(100)), 5000);
        drive.set_locally(seconds(100), (F010).into(), 0);
        assert_eq!(write(&mut drive, seconds(100), SETPOINT, 100), 5000);
    }
    let from_the_factory = DriveOptions {
        sources_at_start: Some(2),
        ..DriveOptions::default()
    };
    assert_eq!(
        write(
            &mut SimDrive::new(n700(), from_the_factory),
            seconds(0),
            RUN,
            1
        ),
        0
    );
}

#[test]
fn a_trip_is_recorded_and_run_is_refused_until_reset() {
    let mut drive = drive();
    write(&mut drive, seconds(0), SETPOINT, 6000);
    write(&mut drive, seconds(0), RUN, 1);
    drive.trip(seconds(5), 4);
    assert!(drive.is_tripped());
    assert_eq!(output(&mut drive, seconds(5)), 0);
    // 33 % + 67 % * 50 % of 11.0 A; 540 V less half of 20 V.
    assert_eq!(
        read(&mut drive, seconds(5), TRIP_COUNT, 5),
        Some(vec![1, 4, 3000, 73, 530])
    );
    assert_eq!(write(&mut drive, seconds(6), RUN, 1), 0);
    assert_eq!(write(&mut drive, seconds(6), RUN, 2), 0);
    assert_eq!(write(&mut drive, seconds(6), RUN, 0), 0);
    assert_eq!(write(&mut drive, seconds(6), RUN, 4), 4);
    assert!(!drive.is_tripped());
    assert_eq!(output(&mut drive, seconds(20)), 0);
    assert_eq!(write(&mut drive, seconds(20), RUN, 1), 1);
    drive.trip(seconds(50), 9);
    assert_eq!(
        read(&mut drive, seconds(50), TRIP_COUNT, 6),
        Some(vec![2, 9, 6000, 110, 520, 4])
    );
    assert_eq!(
        read(&mut drive, seconds(50), 0x0117, 4),
        Some(vec![4, 3000, 73, 530])
    );
    assert_eq!(read(&mut drive, seconds(50), 0x0127, 4), Some(vec![0; 4]));
    assert_eq!(read(&mut drive, seconds(50), 0x012B, 1), None);
}

#[test]
fn bad_requests_are_met_with_silence_or_an_exception() {
    let bad = [
        (&[3, 0x01, 0x02, 0, 1][..], 0x02),
        (&[3, 0x00, 0x02, 0, 1], 0x02),
        (&[3, 0x01, 0x12, 0, 0], 0x03),
        (&[3, 0x01, 0x12, 0, 9], 0x03),
        (&[3, 0x01, 0xFF, 0, 2], 0x03),
        (&[3, 0xFF, 0xFF, 0, 2], 0x03),
        (&[6, 0x02, 0x03, 0, 100], 0x02),
        (&[4, 0x01, 0x01, 0, 1], 0x01),
        (&[8, 0, 0, 0, 1], 0x01),
        (&[16, 0x02, 0x0C, 0, 1, 2, 0, 1], 0x01),
    ];
    let options = DriveOptions {
        bad_request: BadRequest::Exception,
        ..DriveOptions::default()
    };
    let mut talkative = SimDrive::new(n700(), options);
    for (pdu, code) in bad {
        assert_eq!(ask(&mut drive(), seconds(0), pdu), None, "{pdu:?}");
        assert_eq!(
            ask(&mut talkative, seconds(0), pdu),
            Some(vec![pdu[0] | 0x80, code]),
            "{pdu:?}"
        );
    }
}

#[test]
fn a_model_may_refuse_by_exception() {
    let mut model = (*n700()).clone();
    model.write.refused.value = RefusedWrite::Exception;
    let mut drive = SimDrive::new(Arc::new(model), DriveOptions::default());
    assert_eq!(
        ask(&mut drive, seconds(0), &[6, 0, 4, 0x17, 0x71]),
        Some(vec![0x86, 0x03])
    );
    assert_eq!(write(&mut drive, seconds(0), SETPOINT, 6000), 6000);
}

#[test]
fn registers_without_a_role_keep_what_is_written() {
    let mut model = (*n700()).clone();
    for register in &mut model.registers {
        register.role = register
            .role
            .filter(|role| *role != RegisterRole::RunSource);
    }
    let mut drive = SimDrive::new(Arc::new(model), DriveOptions::default());
    assert_eq!(read(&mut drive, seconds(0), F011, 1), Some(vec![3]));
    assert_eq!(write(&mut drive, seconds(0), F011, 0xABCD), 0xABCD);
    assert_eq!(read(&mut drive, seconds(0), F011, 1), Some(vec![0xABCD]));
    // A model without a source register always listens.
    assert_eq!(write(&mut drive, seconds(0), RUN, 1), 1);
}

#[test]
fn a_power_cycle_stops_and_resets_but_keeps_settings_and_records() {
    let mut drive = drive();
    write(&mut drive, seconds(0), SETPOINT, 6000);
    write(&mut drive, seconds(0), RUN, 1);
    drive.trip(seconds(10), 1);
    drive.set_powered(seconds(20), false);
    drive.trip(seconds(21), 1);
    assert!(!drive.is_powered());
    assert_eq!(ask(&mut drive, seconds(21), &[3, 1, 1, 0, 1]), None);
    drive.set_powered(seconds(30), true);
    assert!(!drive.is_tripped());
    assert_eq!(output(&mut drive, seconds(60)), 0);
    assert_eq!(read(&mut drive, seconds(60), F001, 1), Some(vec![6000]));
    assert_eq!(
        read(&mut drive, seconds(60), TRIP_COUNT, 2),
        Some(vec![1, 1])
    );
}

#[test]
fn proof_words_show_the_low_half_of_the_exchange_number() {
    let options = DriveOptions {
        proof_words: Some(0x3000..=0x3FFF),
        ..DriveOptions::default()
    };
    let mut drive = SimDrive::new(n700(), options);
    assert_eq!(read(&mut drive, seconds(0), 0x3ABC, 2), Some(vec![7, 7]));
    assert_eq!(read(&mut drive, seconds(0), 0x4000, 1), None);
}
