//! A drive that needs a pause after a write gets it, and one that hears nothing after a write is stopped as soon as it
//! can hear. Neither delays the other drives of its line.

use crate::support::families::{listing, options_of, register};
use crate::support::{MQTT, Rig, RigOptions, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::drive::snapshot::DrivePresence;
use vfd_gateway::profile::check;

const SECOND: Duration = Duration::from_secs(1);
const CONFIRMED: (Outcome, Reason) = (Outcome::Confirmed, Reason::None);
const MODEL: &str = include_str!("../golden/models/exchange.toml");
/// A stored register, and one after whose write the drive is deaf.
const RAMP: u16 = 0x0100;
const ENTER: u16 = 0x0110;
/// What the manual says.
const PAUSE: Duration = Duration::from_millis(50);
const STORED_PAUSE: Duration = Duration::from_millis(200);
const DEAF: Duration = SECOND;

/// Two drives that run at 30 Hz.
fn running() -> Rig {
    let model = Arc::new(check::model(MODEL).unwrap());
    let mut rig = Rig::new(&RigOptions {
        drives: 2,
        ..options_of(&model, listing(vec![RAMP, ENTER]))
    });
    for drive in [0, 1] {
        let ticket = rig.command(MQTT, drive, run(Direction::Forward, Some(3000)));
        assert_eq!(rig.outcome_of(ticket), CONFIRMED);
    }
    rig.live(SECOND * 2);
    rig.sent.clear();
    rig
}

/// When frames were sent to `station`, and whether each was a write.
fn sent_to(rig: &Rig, station: u8) -> Vec<(MonoTime, bool)> {
    let own = rig.sent.iter().filter(|sent| sent.frame[0] == station);
    own.map(|sent| (sent.at, sent.pdu[0] == 6)).collect()
}

#[test]
fn after_a_write_the_drive_is_left_alone_and_its_neighbour_is_not() {
    let mut rig = running();
    for (order, pause) in [
        (setpoint(4000), PAUSE),
        (register(RAMP, 50), STORED_PAUSE),
        (STOP, PAUSE),
    ] {
        rig.sent.clear();
        let ticket = rig.command(MQTT, 0, order);
        rig.pass(Duration::from_millis(25));
        let other = rig.read(7, 1, RAMP, 1);
        assert_eq!(rig.outcome_of(ticket), CONFIRMED);
        let sent = sent_to(&rig, 1);
        let written = sent
            .iter()
            .position(|(_, is_write)| *is_write)
            .expect("it was written");
        let (write, read) = (sent[written].0, sent[written + 1].0);
        // 8 characters each way and the turnaround.
        let exchange = Duration::from_millis(18);
        assert!(
            read.since(write) >= exchange + pause,
            "{:?}",
            read.since(write)
        );
        assert!(
            read.since(write) < exchange + pause + Duration::from_millis(60),
            "{:?}",
            read.since(write)
        );
        assert!(matches!(rig.answer_to(other), NativeOutcome::Words(_)));
        assert!(
            sent_to(&rig, 2)
                .iter()
                .any(|(at, _)| (write..read).contains(at)),
            "the neighbour is asked meanwhile"
        );
    }
    assert_eq!(rig.bus.report().requests_too_soon, 0);
}

#[test]
fn a_stop_waits_for_the_pause_and_no_longer_than_the_bound() {
    let mut rig = running();
    let bounds = rig.setup.stop_bounds();
    for after in [1, 10, 19, 40, 100, 200] {
        let written = rig.command(MQTT, 0, register(RAMP, 100 + after));
        rig.pass(Duration::from_millis(after.into()));
        let accepted = rig.now;
        rig.sent.clear();
        let stop = rig.command(MQTT, 0, STOP);
        assert_eq!(rig.outcome_of(stop), CONFIRMED);
        let first = sent_to(&rig, 1)
            .iter()
            .find(|(_, is_write)| *is_write)
            .expect("the stop")
            .0;
        assert!(
            first.since(accepted) <= bounds.all_healthy,
            "{:?} of {bounds:?}",
            first.since(accepted)
        );
        assert!(
            rig.told(written)
                .last()
                .is_some_and(|(_, _, is_final)| *is_final)
        );
        rig.live(SECOND * 4);
        assert_eq!(
            rig.commanded(MQTT, run(Direction::Forward, None)),
            CONFIRMED
        );
    }
    assert_eq!(
        rig.bus.report().requests_too_soon,
        0,
        "the drive heard everything"
    );
    assert!(
        bounds.all_healthy >= STORED_PAUSE && bounds.each_further < STORED_PAUSE,
        "{bounds:?}"
    );
}

#[test]
fn a_deaf_drive_is_stopped_when_it_hears_again_and_its_neighbour_at_once() {
    let mut rig = running();
    let enter = rig.command(MQTT, 0, register(ENTER, 0));
    assert_eq!(rig.outcome_of(enter), (Outcome::Acknowledged, Reason::None));
    let hears = rig.now + DEAF;
    rig.pass(Duration::from_millis(100));
    rig.sent.clear();
    let accepted = rig.now;
    let deaf = rig.command_unsettled(MQTT, 0, STOP);
    let other = rig.command(MQTT, 1, STOP);
    assert_eq!(rig.outcome_of(other), CONFIRMED);
    assert!(
        rig.now.since(accepted) < SECOND,
        "{:?}",
        rig.now.since(accepted)
    );
    assert_eq!(
        rig.sent[0].frame[0], 2,
        "the drive that can hear comes first"
    );
    assert_eq!(rig.outcome_of(deaf), CONFIRMED);
    let stops: Vec<_> = sent_to(&rig, 1)
        .into_iter()
        .filter(|(_, is_write)| *is_write)
        .map(|(at, _)| at)
        .collect();
    assert!(stops[0] < hears, "it is tried at once");
    let heard = sent_to(&rig, 1)
        .into_iter()
        .find(|(at, _)| *at >= hears)
        .expect("it is asked again");
    assert!(heard.1, "the stop is the first that it hears");
    assert!(
        heard.0.since(hears) <= rig.setup.stop_bounds().all_healthy,
        "{:?}",
        heard.0.since(hears)
    );
    let reads = sent_to(&rig, 1)
        .into_iter()
        .filter(|(_, is_write)| !is_write);
    assert!(
        reads.into_iter().all(|(at, _)| at >= hears),
        "nothing else is sent meanwhile"
    );
    assert_eq!(rig.view(0).snapshot.presence, DrivePresence::Online);
    rig.live(SECOND * 15);
    assert_eq!((rig.output(1), rig.output(2)), (0, 0));
}

#[test]
fn a_write_without_a_reply_may_have_made_the_drive_deaf() {
    let mut rig = running();
    rig.loses_reply_to = Some(6);
    let enter = rig.command(MQTT, 0, register(ENTER, 0));
    assert_eq!(rig.outcome_of(enter), (Outcome::Unknown, Reason::NoReply));
    let begun = rig.now;
    rig.sent.clear();
    rig.pass(DEAF - Duration::from_millis(1));
    assert_eq!(sent_to(&rig, 1), []);
    assert!(!sent_to(&rig, 2).is_empty());
    rig.live(SECOND * 3);
    assert!(sent_to(&rig, 1)[0].0.since(begun) >= DEAF);
    assert_eq!(rig.view(0).snapshot.presence, DrivePresence::Online);
    assert!(rig.bus.drive(Station(1)).is_some());
}
