//! The drive's own watchdog is the last line of defence: it is checked, it stops the motor when the gateway stops
//! sending, and it is not fed on behalf of a lost owner.

use crate::support::families::{LOCAL, accepting, models, register, rig_of, single};
use crate::support::{MQTT, Rig, STOP, control, model, run};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::control::{ControlSettings, FailSafe};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::drive::watchdog::{WatchdogState, WatchdogView};
use vfd_gateway::gateway::{DriveNote, LineInput};
use vfd_gateway::profile::model::{Confidence, Model};

const SECOND: Duration = Duration::from_secs(1);
/// 09-06, time without a request in 0.1 s, and 09-07, what the drive does then: 1 coast, 3 keep running. Typed from the
/// manual.
const TIME: u16 = 0x0906;
const REACTION: u16 = 0x0907;
/// The word for stop, and its register.
const RUN: u16 = 0x2501;

/// Time enough between its frames and the lease.
fn settings() -> ControlSettings {
    ControlSettings {
        lost_after: SECOND * 12,
        ..accepting()
    }
}

/// An E510 whose manual gives the addresses of its watchdog.
fn e510() -> Arc<Model> {
    let mut model = (*model("teco-e510")).clone();
    for register in model
        .registers
        .iter_mut()
        .filter(|it| [TIME, REACTION].contains(&it.address.number()))
    {
        register.confidence = Confidence::Manual;
    }
    assert!(model.watchdog_is_proven());
    Arc::new(model)
}

/// Sets a register at the drive itself.
fn set(rig: &mut Rig, address: u16, word: u16) {
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_locally(now, address.into(), word);
}

/// A drive with a watchdog of 10 s, which coasts then.
fn watched(settings: ControlSettings) -> Rig {
    let mut rig = rig_of(&e510(), settings);
    set(&mut rig, TIME, 100);
    set(&mut rig, REACTION, 1);
    rig.live(SECOND * 61);
    rig
}

fn starts(rig: &mut Rig) {
    let (outcome, reason) = rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    assert_eq!(outcome, Outcome::Confirmed, "{reason:?}");
    rig.live(SECOND * 20);
    assert_eq!(rig.output(1), 3000);
    rig.sent.clear();
}

fn expiries(rig: &mut Rig) -> u64 {
    let now = rig.now;
    let drive = rig.bus.drive_mut(Station(1)).unwrap();
    drive.advance(now);
    drive.report().watchdog_expiries
}

fn state(rig: &Rig) -> WatchdogState {
    rig.view(0).watchdog.unwrap().state
}

#[test]
fn it_is_shown_for_every_model_that_has_one_and_for_no_other() {
    for model in models() {
        let mut rig = rig_of(&model, settings());
        let view = rig.view(0).watchdog;
        assert_eq!(view.is_some(), model.watchdog.is_some(), "{}", model.id);
        let Some(view) = view else { continue };
        let off = WatchdogView {
            state: WatchdogState::Off,
            time: None,
            is_proven: model.watchdog_is_proven(),
        };
        assert_eq!(view, off, "{}: a new drive", model.id);
        assert!(
            rig.notes
                .iter()
                .any(|(_, note)| *note == DriveNote::Watchdog(WatchdogState::Off)),
            "{:?}",
            rig.notes
        );
        let time = model.watchdog.as_ref().unwrap().time;
        set(&mut rig, time.number(), 110);
        rig.live(SECOND * 61);
        let view = rig.view(0).watchdog.unwrap();
        assert_eq!(
            (view.state, view.time),
            (WatchdogState::InOrder, Some(SECOND * 11)),
            "{}",
            model.id
        );
        assert_eq!(
            view.is_in_order(),
            model.watchdog_is_proven(),
            "{}",
            model.id
        );
    }
}

#[test]
fn it_is_read_at_the_start_and_every_minute() {
    let mut rig = rig_of(&e510(), settings());
    rig.live(SECOND * 600);
    let reads = rig.sent.iter().filter(|sent| {
        let (first, count) = (
            u16::from_be_bytes([sent.pdu[1], sent.pdu[2]]),
            u16::from_be_bytes([sent.pdu[3], sent.pdu[4]]),
        );
        sent.pdu[0] == 3 && (first..first + count).contains(&TIME)
    });
    assert!((9..=11).contains(&reads.count()));
    assert!(rig.writes().is_empty(), "it is looked at and never set");
}

#[test]
fn each_change_is_reported_once_and_what_does_not_fit_is_an_alarm() {
    for (time, reaction, seen) in [
        (0, 1, WatchdogState::Off),
        (5, 1, WatchdogState::TooShort),
        (121, 1, WatchdogState::TooLong),
        (100, 3, WatchdogState::KeepsRunning),
        (100, 1, WatchdogState::InOrder),
    ] {
        let mut rig = rig_of(&e510(), settings());
        rig.notes.clear();
        set(&mut rig, TIME, time);
        set(&mut rig, REACTION, reaction);
        rig.live(SECOND * 300);
        assert_eq!(state(&rig), seen);
        let told = rig
            .notes
            .iter()
            .filter(|(_, note)| *note == DriveNote::Watchdog(seen))
            .count();
        assert_eq!(
            told,
            usize::from(seen != WatchdogState::Off),
            "{seen:?}: {:?}",
            rig.notes
        );
        let is_alarm = DriveNote::Watchdog(seen).to_string().starts_with("ALARM");
        assert_eq!(is_alarm, seen != WatchdogState::InOrder);
    }
}

#[test]
fn a_gateway_that_goes_silent_lets_the_drive_stop_itself() {
    let mut rig = watched(settings());
    starts(&mut rig);
    rig.core
        .handle(rig.now, LineInput::PortDown(LineFault::Gone));
    rig.pass(SECOND * 9);
    assert_eq!((rig.output(1), expiries(&mut rig)), (3000, 0));
    rig.pass(SECOND * 2);
    assert_eq!((rig.output(1), expiries(&mut rig)), (0, 1));

    // A drive that trips then, as its maker delivers it.
    let mut rig = rig_of(&model("frecon-fr500a"), settings());
    set(&mut rig, 0x0F03, 100);
    let (outcome, reason) = rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    assert_ne!(outcome, Outcome::Refused, "{reason:?}");
    rig.live(SECOND * 5);
    rig.core
        .handle(rig.now, LineInput::PortDown(LineFault::Gone));
    rig.pass(SECOND * 11);
    assert_eq!(expiries(&mut rig), 1);
    assert!(rig.bus.drive(Station(1)).unwrap().is_tripped());
}

#[test]
fn polling_keeps_it_fed_while_the_commander_lives() {
    let mut rig = watched(settings());
    starts(&mut rig);
    rig.live(SECOND * 600);
    assert_eq!((rig.output(1), expiries(&mut rig)), (3000, 0));
}

#[test]
fn a_declared_stop_that_works_needs_no_watchdog() {
    let mut rig = watched(settings());
    starts(&mut rig);
    rig.pass(SECOND * 60);
    assert_eq!((rig.output(1), expiries(&mut rig)), (0, 0));
    assert!(
        !rig.notes
            .iter()
            .any(|(_, note)| *note == DriveNote::LeftToWatchdog),
        "{:?}",
        rig.notes
    );
}

/// The owner is lost, and no stop reaches the drive, whose polls are answered.
fn stop_does_not_reach(rig: &mut Rig) {
    starts(rig);
    rig.swallows = Some(single(RUN, 0));
    rig.sent.clear();
    rig.pass(SECOND * 13);
    assert!(rig.written(RUN).contains(&0), "the declared stop goes out");
    assert_eq!(rig.output(1), 3000);
}

#[test]
fn a_declared_stop_without_effect_is_left_to_the_watchdog() {
    let mut rig = watched(settings());
    stop_does_not_reach(&mut rig);
    // 5 s for the stop, 10 s for the watchdog, 1 s more.
    rig.pass(SECOND * 18);
    assert!(
        rig.notes
            .iter()
            .any(|(_, note)| *note == DriveNote::LeftToWatchdog),
        "{:?}",
        rig.notes
    );
    assert_eq!((rig.output(1), expiries(&mut rig)), (0, 1));
    let gap = rig
        .sent
        .windows(2)
        .map(|pair| pair[1].at.since(pair[0].at))
        .max()
        .unwrap();
    assert!(gap >= SECOND * 11 && gap < SECOND * 12, "{gap:?}");
    // The stop goes on until the drive has taken it.
    rig.swallows = None;
    rig.pass(SECOND * 10);
    assert!(!rig.view(0).control.unwrap().stop_pending);
}

#[test]
fn a_stop_by_a_person_goes_out_at_once_into_that_silence() {
    let mut rig = watched(settings());
    stop_does_not_reach(&mut rig);
    rig.pass(SECOND * 7);
    assert!(
        rig.now.since(rig.sent.last().unwrap().at) > SECOND,
        "nothing is sent"
    );
    rig.swallows = None;
    let at = rig.now;
    let ticket = rig.command(MQTT, 0, STOP);
    rig.pass(SECOND / 2);
    let sent = rig.sent.last().unwrap();
    assert!(
        sent.at >= at && sent.pdu == single(RUN, 0),
        "{:02X?}",
        sent.pdu
    );
    assert_eq!(rig.outcome_of(ticket).0, Outcome::Confirmed);
    rig.pass(SECOND * 30);
    assert_eq!(rig.output(1), 0);
}

#[test]
fn without_a_watchdog_that_stops_the_motor_the_stop_is_repeated_for_ever() {
    for (time, reaction) in [(0, 1), (100, 3), (250, 1)] {
        let mut rig = rig_of(&e510(), settings());
        set(&mut rig, TIME, time);
        set(&mut rig, REACTION, reaction);
        rig.live(SECOND * 61);
        stop_does_not_reach(&mut rig);
        let from = rig.now;
        rig.pass(SECOND * 120);
        assert!(
            !rig.notes
                .iter()
                .any(|(_, note)| *note == DriveNote::LeftToWatchdog),
            "{time} {reaction}"
        );
        let gap = rig
            .sent
            .windows(2)
            .map(|pair| pair[1].at.since(pair[0].at))
            .max()
            .unwrap();
        assert!(gap < SECOND, "{gap:?}");
        assert!(
            rig.sent
                .iter()
                .filter(|sent| sent.at > from && sent.pdu == single(RUN, 0))
                .count()
                >= 25
        );
    }
}

#[test]
fn with_hold_the_drive_goes_on_and_is_looked_at() {
    let mut rig = watched(ControlSettings {
        on_commander_lost: FailSafe::Hold,
        ..settings()
    });
    starts(&mut rig);
    rig.pass(SECOND * 120);
    assert_eq!((rig.output(1), expiries(&mut rig)), (3000, 0));
    assert!(rig.now.since(rig.sent.last().unwrap().at) < SECOND);
}

#[test]
fn run_waits_for_it_where_it_is_required() {
    let mut rig = rig_of(
        &e510(),
        ControlSettings {
            require_watchdog: true,
            ..settings()
        },
    );
    let start = run(Direction::Forward, Some(3000));
    assert_eq!(
        rig.commanded(MQTT, start.clone()),
        (Outcome::Refused, Reason::Watchdog)
    );
    set(&mut rig, TIME, 250);
    rig.live(SECOND * 61);
    assert_eq!(
        rig.commanded(MQTT, start.clone()),
        (Outcome::Refused, Reason::Watchdog),
        "it takes too long"
    );
    assert_eq!(
        rig.commanded(LOCAL, register(TIME, 100)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(
        rig.commanded(MQTT, start.clone()).0,
        Outcome::Confirmed,
        "it was read back"
    );
    rig.live(SECOND * 5);
    assert_eq!(rig.commanded(MQTT, STOP).0, Outcome::Confirmed);
    rig.live(SECOND * 30);
    // It returns, perhaps from a loss of power, and is checked before it runs.
    rig.bus.set_faults("lost=1000".parse().unwrap());
    rig.pass(SECOND * 60);
    rig.bus.set_faults(vfd_gateway::sim::FaultPlan::NONE);
    set(&mut rig, TIME, 0);
    rig.pass(SECOND * 20);
    assert_eq!(
        rig.commanded(MQTT, start),
        (Outcome::Refused, Reason::Watchdog)
    );
}

#[test]
fn it_is_set_by_the_gateways_own_tool_alone_and_at_standstill() {
    for model in models() {
        let Some(watchdog) = &model.watchdog else {
            continue;
        };
        let all = (0..=u16::MAX).collect();
        let mut rig = rig_of(
            &model,
            ControlSettings {
                native_write: all,
                ..settings()
            },
        );
        let order = || register(watchdog.time.number(), 100);
        for address in [Some(watchdog.time), watchdog.action].into_iter().flatten() {
            let told = rig.commanded(MQTT, register(address.number(), 1));
            assert_eq!(told, (Outcome::Refused, Reason::NotAllowed), "{}", model.id);
        }
        assert_eq!(
            rig.commanded(LOCAL, order()),
            (Outcome::Confirmed, Reason::None),
            "{}",
            model.id
        );
        assert_eq!(
            rig.view(0).watchdog.unwrap().time,
            Some(SECOND * 10),
            "{}",
            model.id
        );
        assert_eq!(
            rig.writes()
                .iter()
                .filter(|pdu| **pdu == single(watchdog.time.number(), 100))
                .count(),
            1,
            "{}",
            model.id
        );
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        rig.live(SECOND * 3);
        let (outcome, reason) = rig.commanded(LOCAL, order());
        assert_eq!(
            (outcome, reason),
            (Outcome::Refused, Reason::OtherOwner),
            "{}",
            model.id
        );
        rig.commanded(MQTT, STOP);
        let (outcome, reason) = rig.commanded(LOCAL, order());
        assert_eq!(outcome, Outcome::Refused, "{}: {reason:?}", model.id);
    }
    let mut rig = rig_of(&model("hyundai-n700"), control());
    assert_eq!(
        rig.commanded(LOCAL, register(0x0906, 100)),
        (Outcome::Refused, Reason::NotListed)
    );
}
