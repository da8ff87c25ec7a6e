//! A drive is removed from the configuration: it takes no more commands, and is stopped first if requested.

use crate::support::{MQTT, Rig, RigOptions, STOP, plc, run};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::ids::{DriveIndex, Station};
use vfd_gateway::gateway::{DriveNote, LineInput};

const RUN: u16 = 0x0002;
const PUMP: DriveIndex = DriveIndex(0);

fn in_use(rig: &Rig) -> Vec<DriveIndex> {
    rig.core.in_use().collect()
}

fn bound(rig: &Rig) -> Vec<DriveIndex> {
    rig.core.bound().collect()
}

fn running() -> Rig {
    let mut rig = Rig::new(&RigOptions::controlled());
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))).0,
        Outcome::Acknowledged
    );
    rig.pass(Duration::from_secs(1));
    rig
}

#[test]
fn a_drive_at_rest_may_leave_and_takes_no_command_meanwhile() {
    for stops in [false, true] {
        let mut rig = Rig::new(&RigOptions::controlled());
        rig.pass(Duration::from_secs(1));
        rig.core.handle(rig.now, LineInput::Leave { stops });
        assert!(in_use(&rig).is_empty() && bound(&rig).is_empty());
        let refused = (Outcome::Refused, Reason::Removed);
        assert_eq!(
            rig.commanded(MQTT, run(Direction::Forward, Some(3000))),
            refused
        );
        assert_eq!(rig.commanded(MQTT, Order::Renew), refused);
        assert_eq!(
            rig.commanded(plc(1), STOP).0,
            Outcome::Confirmed,
            "a stop is always taken"
        );
        rig.core.handle(rig.now, LineInput::Stay);
        assert_eq!(
            rig.commanded(plc(1), run(Direction::Forward, Some(3000))).0,
            Outcome::Acknowledged
        );
        assert!(rig.notes.is_empty(), "{:?}", rig.notes);
    }
}

#[test]
fn a_running_drive_is_in_use_and_left_alone_where_leaving_is_only_asked_for() {
    let mut rig = running();
    rig.core.handle(rig.now, LineInput::Leave { stops: false });
    assert_eq!((in_use(&rig), bound(&rig)), (vec![PUMP], vec![PUMP]));
    rig.pass(Duration::from_secs(1));
    rig.core.handle(rig.now, LineInput::Stay);
    assert_eq!(rig.written(RUN), [1]);
    assert_eq!(
        rig.commanded(MQTT, Order::Renew).0,
        Outcome::Acknowledged,
        "its lease has survived"
    );
}

#[test]
fn a_running_drive_is_stopped_before_it_leaves() {
    let mut rig = running();
    rig.core.handle(rig.now, LineInput::Leave { stops: true });
    rig.settle();
    assert_eq!(bound(&rig), [PUMP]);
    let until = rig.now + Duration::from_secs(1);
    while !bound(&rig).is_empty() {
        assert!(rig.now < until, "the stop takes effect");
        rig.pass(Duration::from_millis(10));
    }
    assert_eq!(rig.written(RUN), [1, 0]);
    assert_eq!(
        rig.notes.iter().map(|(_, note)| *note).collect::<Vec<_>>(),
        [DriveNote::Leaving]
    );
    assert_eq!(rig.view(0).control.unwrap().lease, None);
    assert_eq!(
        in_use(&rig),
        [PUMP],
        "the ramp lasts longer, and nothing more can be done about it"
    );
}

#[test]
fn a_stop_without_effect_keeps_the_drive_bound() {
    let mut rig = running();
    rig.bus.set_powered(rig.now, Station(1), false);
    rig.core.handle(rig.now, LineInput::Leave { stops: true });
    rig.settle();
    rig.pass(Duration::from_secs(5));
    assert_eq!(bound(&rig), [PUMP]);
    rig.core.handle(rig.now, LineInput::Stay);
    rig.settle();
    rig.bus.set_powered(rig.now, Station(1), true);
    rig.pass(Duration::from_secs(30));
    assert!(bound(&rig).is_empty(), "the stop was carried on");
}

#[test]
fn a_drive_that_nobody_may_command_leaves_whatever_it_does() {
    let mut rig = Rig::new(&RigOptions::default());
    rig.pass(Duration::from_secs(1));
    rig.core.handle(rig.now, LineInput::Leave { stops: true });
    assert!(in_use(&rig).is_empty() && bound(&rig).is_empty());
    assert!(rig.written(RUN).is_empty());
}
