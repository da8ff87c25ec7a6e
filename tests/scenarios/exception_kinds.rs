//! Exceptions by which a drive says more than no: that it is busy, locked or in a trip, or that the request was damaged.

use crate::support::families::{LOCAL, listing, options_of, register, write};
use crate::support::{MQTT, Rig, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::ids::{DriveIndex, Station};
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::drive::snapshot::DrivePresence;
use vfd_gateway::gateway::DriveNote;
use vfd_gateway::profile::check;
use vfd_gateway::profile::model::ExceptionKind::{self, Busy, DamagedFrame, InTrip, Locked};

const SECOND: Duration = Duration::from_secs(1);
const CONFIRMED: (Outcome, Reason) = (Outcome::Confirmed, Reason::None);
const MODEL: &str = include_str!("../golden/models/exchange.toml");
const RAMP: u16 = 0x0100;

/// A drive that runs at 30 Hz.
fn running() -> Rig {
    let model = Arc::new(check::model(MODEL).unwrap());
    let mut rig = Rig::new(&options_of(&model, listing(vec![RAMP])));
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))),
        CONFIRMED
    );
    rig.live(SECOND * 4);
    assert!(rig.output(1) > 0);
    rig.sent.clear();
    rig
}

/// The next `times` requests are answered with such an exception.
fn objects(rig: &mut Rig, kind: ExceptionKind, times: u32) {
    rig.bus.drive_mut(Station(1)).unwrap().object(kind, times);
}

#[test]
fn a_stop_that_the_drive_is_too_busy_for_is_sent_again_soon_and_is_no_refusal() {
    for times in [1, 2, 10] {
        let mut rig = running();
        objects(&mut rig, Busy, times);
        let accepted = rig.now;
        let stop = rig.command(MQTT, 0, STOP);
        assert_eq!(rig.outcome_of(stop), CONFIRMED, "{times}");
        assert!(
            rig.told(stop)
                .iter()
                .all(|(outcome, ..)| *outcome != Outcome::Failed),
            "{:?}",
            rig.told(stop)
        );
        let refused = rig
            .notes
            .iter()
            .any(|(_, note)| *note == DriveNote::StopRefused);
        assert!(!refused, "nobody is told that the drive refuses to stop");
        // Each time it is left alone for 200 ms, but not longer.
        assert!(
            rig.now.since(accepted) < Duration::from_millis(300) * (times + 1),
            "{:?}",
            rig.now.since(accepted)
        );
        rig.live(SECOND * 20);
        assert_eq!(rig.output(1), 0);
    }
}

#[test]
fn a_write_is_not_tried_again_and_its_end_says_that_the_drive_was_busy() {
    for (kind, code, reason) in [
        (Busy, 5, Reason::DriveBusy),
        (Locked, 7, Reason::DriveLocked),
        (InTrip, 8, Reason::DriveInTrip),
    ] {
        let mut rig = running();
        objects(&mut rig, kind, 1);
        let ticket = rig.command(MQTT, 0, register(RAMP, 77));
        assert_eq!(rig.outcome_of(ticket), (Outcome::Failed, reason));
        let report = rig
            .reports
            .iter()
            .rev()
            .find(|(_, answer)| answer.ticket == ticket)
            .unwrap()
            .1
            .report;
        assert_eq!(report.exception, Some(code));
        // A stored register is written once in ten seconds.
        rig.live(SECOND * 11);
        assert_eq!(rig.written(RAMP), [77], "once");
        assert_eq!(
            rig.commanded(MQTT, register(RAMP, 77)),
            CONFIRMED,
            "it may be ordered again"
        );
    }
}

#[test]
fn a_read_is_tried_once_more_after_a_while() {
    let mut rig = running();
    // No poll may take the exception.
    rig.run_until(rig.now + Duration::from_millis(600), |_, _| {});
    objects(&mut rig, Busy, 1);
    let begun = rig.now;
    let read = rig.read(1, 0, RAMP, 1);
    assert!(matches!(rig.answer_to(read), NativeOutcome::Words(_)));
    assert!(
        rig.now.since(begun) >= Duration::from_millis(200),
        "it is left alone for a while"
    );
    rig.pass(Duration::from_millis(600));
    objects(&mut rig, Busy, 100);
    let read = rig.read(1, 0, RAMP, 1);
    let busy = NativeOutcome::DriveException {
        code: 5,
        reason: Reason::DriveBusy,
    };
    assert_eq!(rig.answer_to(read), busy, "then its client decides");
    objects(&mut rig, Locked, 1);
    rig.pass(SECOND);
    assert_eq!(rig.view(0).snapshot.presence, DrivePresence::Online);
}

#[test]
fn whoever_reads_or_writes_natively_is_told_what_the_drive_means() {
    for (kind, code, reason) in [
        (Locked, 7, Reason::DriveLocked),
        (InTrip, 8, Reason::DriveInTrip),
    ] {
        let mut rig = running();
        // No poll may take the exception.
        rig.run_until(rig.now + Duration::from_millis(600), |_, _| {});
        objects(&mut rig, kind, 1);
        let read = rig.read(1, 0, RAMP, 1);
        assert_eq!(
            rig.answer_to(read),
            NativeOutcome::DriveException { code, reason }
        );
        // Whoever runs the motor keeps others from writing.
        assert_eq!(rig.commanded(MQTT, STOP), CONFIRMED);
        rig.live(SECOND * 10);
        objects(&mut rig, kind, 1);
        assert_eq!(
            write(&mut rig, RAMP, &[77]),
            NativeOutcome::DriveException { code, reason }
        );
    }
}

#[test]
fn a_read_back_waits_until_the_drive_is_no_longer_busy() {
    let mut rig = running();
    let ticket = rig.command(MQTT, 0, register(RAMP, 77));
    // The write is answered well, the reads of it are not.
    while rig.told(ticket).is_empty() {
        rig.step(rig.now + SECOND);
    }
    objects(&mut rig, Busy, 2);
    assert_eq!(rig.outcome_of(ticket), CONFIRMED);
    assert_eq!(rig.written(RAMP), [77]);
}

#[test]
fn a_damaged_request_in_the_middle_of_a_burst_is_treated_as_a_damaged_reply() {
    let mut rig = running();
    rig.pass(Duration::from_millis(600));
    let garbled = rig.core.counters().garbled;
    let burst: Vec<_> = (0..4)
        .map(|n| rig.read(n, 0, RAMP + n as u16 * 0x10, 1))
        .collect();
    rig.pass(Duration::from_millis(10));
    objects(&mut rig, DamagedFrame, 2);
    for ticket in burst {
        let answer = rig.answer_to(ticket);
        assert!(
            !matches!(answer, NativeOutcome::DriveException { .. }),
            "it is no refusal: {answer:?}"
        );
    }
    assert_eq!(rig.core.counters().garbled, garbled + 2);
    // A setpoint whose request was damaged was not taken: that is read, and nothing is written again.
    rig.sent.clear();
    objects(&mut rig, DamagedFrame, 1);
    let ticket = rig.command(MQTT, 0, setpoint(4000));
    assert_eq!(rig.outcome_of(ticket), (Outcome::Failed, Reason::NoReply));
    assert_eq!(rig.written(0x0002), [4000]);
    assert_eq!(
        rig.core.snapshot(DriveIndex(0)).unwrap().presence,
        DrivePresence::Online
    );
}

#[test]
fn a_stop_whose_request_was_damaged_is_sent_again_at_once() {
    let mut rig = running();
    objects(&mut rig, DamagedFrame, 1);
    let accepted = rig.now;
    assert_eq!(rig.commanded(LOCAL, STOP), CONFIRMED);
    assert_eq!(rig.written(0x0001), [1, 1]);
    assert!(
        rig.now.since(accepted) < Duration::from_millis(700),
        "{:?}",
        rig.now.since(accepted)
    );
}
