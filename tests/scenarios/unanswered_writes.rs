//! Writes that a drive takes without an answer: sent once, the drive is left alone, and what is read afterwards decides.

use crate::support::families::{LOCAL, listing, options_of, register, write};
use crate::support::{MQTT, ORIGIN, Rig, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::drive::snapshot::DrivePresence;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::profile::check;

const SECOND: Duration = Duration::from_secs(1);
const CONFIRMED: (Outcome, Reason) = (Outcome::Confirmed, Reason::None);
const MODEL: &str = include_str!("../golden/models/unanswered.toml");
/// Typed a second time.
const RUN: u16 = 0x0001;
const RESTART: u16 = 0x0200;
const APPLICATION: u16 = 0x0101;
const CLEAR: u16 = 0x0102;

fn at_rest() -> Rig {
    let model = Arc::new(check::model(MODEL).unwrap());
    let mut rig = Rig::new(&options_of(&model, listing(vec![APPLICATION, CLEAR])));
    assert_eq!(rig.commanded(ORIGIN, STOP), CONFIRMED);
    rig.live(SECOND * 4);
    rig.sent.clear();
    rig
}

fn tripped() -> Rig {
    let mut rig = at_rest();
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, 3);
    rig.live(SECOND * 4);
    assert_eq!(rig.view(0).run_state, RunState::Tripped);
    rig.sent.clear();
    rig
}

/// The times between the write of `address` and the next frame to the drive.
fn pause_after(rig: &Rig, address: u16) -> Duration {
    let place = address.to_be_bytes();
    let at = rig
        .sent
        .iter()
        .position(|sent| sent.pdu[0] != 3 && sent.pdu[1..3] == place)
        .expect("it was written");
    rig.sent[at + 1].at.since(rig.sent[at].at)
}

#[test]
fn a_parameter_is_written_once_and_confirmed_by_what_is_read() {
    let mut rig = at_rest();
    let silent = rig.core.counters().silent;
    let ticket = rig.command(MQTT, 0, register(APPLICATION, 7));
    assert_eq!(rig.outcome_of(ticket), CONFIRMED);
    assert!(
        rig.told(ticket)
            .iter()
            .all(|(outcome, ..)| *outcome != Outcome::Acknowledged),
        "{:?}",
        rig.told(ticket)
    );
    assert_eq!(rig.written(APPLICATION), [7]);
    assert!(
        pause_after(&rig, APPLICATION) >= SECOND * 2,
        "it is left alone: {:?}",
        pause_after(&rig, APPLICATION)
    );
    assert_eq!(
        rig.core.counters().silent,
        silent,
        "nothing is wrong with the line"
    );
    assert_eq!(rig.view(0).snapshot.presence, DrivePresence::Online);
    rig.live(SECOND * 11);
    assert_eq!(
        write(&mut rig, APPLICATION, &[8]),
        NativeOutcome::Written,
        "a client gets its answer from the reading"
    );
    assert_eq!(rig.written(APPLICATION), [7, 8]);
}

#[test]
fn what_nothing_shows_is_unknown_and_never_sent_again() {
    let mut rig = at_rest();
    assert_eq!(
        rig.commanded(MQTT, register(CLEAR, 1)),
        (Outcome::Unknown, Reason::NoReply)
    );
    rig.live(SECOND * 11);
    assert_eq!(rig.written(CLEAR), [1]);
    assert_eq!(write(&mut rig, CLEAR, &[1]), NativeOutcome::NoReply);
}

#[test]
fn a_reset_by_a_restart_is_seen_by_the_trip_that_is_gone() {
    let mut rig = tripped();
    assert_eq!(rig.commanded(MQTT, Order::Reset), CONFIRMED);
    assert_eq!(
        (rig.written(RUN), rig.written(RESTART)),
        (vec![1], vec![9]),
        "the stop comes first, and is answered"
    );
    assert!(pause_after(&rig, RESTART) >= SECOND);
    rig.live(SECOND * 4);
    assert_eq!(
        (rig.view(0).run_state, rig.view(0).trip.active),
        (RunState::Stopped, Some(false))
    );
    assert_eq!(rig.output(1), 0, "nothing starts");
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))),
        CONFIRMED
    );
}

#[test]
fn a_write_that_never_arrived_is_no_success() {
    let mut rig = tripped();
    rig.swallows = Some(vec![6, 0x02, 0x00, 0x00, 0x09]);
    assert_eq!(
        rig.commanded(MQTT, Order::Reset),
        (Outcome::Failed, Reason::NotReadBack)
    );
    assert_eq!(rig.written(RESTART), [9], "it is sent once");
    assert_eq!(rig.view(0).trip.active, Some(true));

    let mut rig = at_rest();
    rig.swallows = Some(vec![6, 0x01, 0x01, 0x00, 0x07]);
    assert_eq!(
        rig.commanded(LOCAL, register(APPLICATION, 7)),
        (Outcome::Failed, Reason::NotReadBack)
    );
    assert_eq!(rig.written(APPLICATION), [7]);
}

#[test]
fn a_drive_that_does_not_come_back_leaves_it_unknown() {
    let mut rig = at_rest();
    let ticket = rig.command(MQTT, 0, register(APPLICATION, 7));
    while rig.written(APPLICATION).is_empty() {
        rig.step(rig.now + SECOND);
    }
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), false);
    assert_eq!(rig.outcome_of(ticket), (Outcome::Unknown, Reason::NoReply));
    rig.live(SECOND * 10);
    assert_eq!(rig.view(0).snapshot.presence, DrivePresence::Offline);
    assert_eq!(rig.written(APPLICATION), [7]);
}

#[test]
fn a_stop_does_not_wait_for_the_drive_to_hear_again() {
    let mut rig = at_rest();
    assert_eq!(rig.commanded(MQTT, setpoint(2000)), CONFIRMED);
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        CONFIRMED
    );
    rig.live(SECOND * 3);
    rig.sent.clear();
    let parameter = rig.command(MQTT, 0, register(APPLICATION, 7));
    while rig.written(APPLICATION).is_empty() {
        rig.step(rig.now + SECOND);
    }
    let accepted = rig.now;
    let stop = rig.command(MQTT, 0, STOP);
    while rig.written(RUN).is_empty() {
        rig.step(rig.now + SECOND);
    }
    assert!(
        rig.now.since(accepted) < Duration::from_millis(700),
        "{:?}",
        rig.now.since(accepted)
    );
    assert_eq!(
        rig.outcome_of(stop),
        CONFIRMED,
        "it is sent again when the drive hears"
    );
    assert!(rig.written(RUN).len() > 1);
    assert_eq!(rig.outcome_of(parameter).0, Outcome::Unknown);
    rig.live(SECOND * 10);
    assert_eq!((rig.output(1), rig.written(APPLICATION)), (0, vec![7]));
}
