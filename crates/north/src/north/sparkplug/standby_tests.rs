//! One of several gateways that are the same edge node, one at a time.

use super::harness::*;
use super::types::Settings;
use crate::domain::standby::{LineRole, StandbyReport, StandbyTrouble};

fn set(rig: &mut Rig, role: LineRole) -> Vec<SessionAct> {
    rig.lines[0].report.standby = Some(StandbyReport {
        role,
        take_overs: 0,
        given_up: 0,
        rivals: 0,
        hears_other: true,
        listener: None,
        kept: 0,
        trouble: StandbyTrouble::default(),
    });
    rig.acts()
}

fn half(role: LineRole) -> Rig {
    let mut rig = Rig::with(Settings {
        standby: true,
        ..settings()
    });
    rig.poll(0, 3_000);
    assert!(!rig.session.wants_connection(), "before its role is known");
    assert_eq!(set(&mut rig, role), []);
    rig
}

#[test]
fn only_the_active_one_is_connected_and_born() {
    let mut rig = half(LineRole::Listening);
    assert!(!rig.session.wants_connection());
    assert!(rig.session.counters().is_left_to_another);
    assert_eq!(rig.session.next_wake(), None);
    rig.poll(0, 4_000);
    assert_eq!(rig.acts(), []);
    assert_eq!(set(&mut rig, LineRole::Active), []);
    assert!(rig.session.wants_connection());
    assert!(!rig.session.counters().is_left_to_another);
    rig.connect(3);
    assert_eq!(kinds(&rig.host(true, 1)), ["NBIRTH", "DBIRTH pump"]);
}

#[test]
fn who_gives_the_line_up_dies_and_stays_away() {
    let mut rig = half(LineRole::Active);
    rig.connect(3);
    rig.host(true, 1);
    let acts = set(&mut rig, LineRole::Listening);
    assert!(matches!(acts[..], [SessionAct::Leave(_)]), "{acts:?}");
    let farewell: Vec<_> = rig
        .session
        .farewell(rig.at())
        .into_iter()
        .map(SessionAct::Publish)
        .collect();
    assert_eq!(kinds(&farewell), ["NDEATH"]);
    rig.handle(crate::north::broker::BrokerEvent::Lost);
    assert!(!rig.session.wants_connection());
    rig.poll(0, 1_000);
    assert_eq!(rig.pass(10_000), []);
    // What it has seen since was published by the other one.
    set(&mut rig, LineRole::Active);
    rig.connect(4);
    assert_eq!(kinds(&rig.host(true, 2)), ["NBIRTH", "DBIRTH pump"]);
}

#[test]
fn a_drive_of_a_line_where_another_is_active_is_no_device() {
    let mut rig = half(LineRole::Active);
    let other = crate::north::broker::SessionLine {
        name: name("other"),
        ..rig.lines[0].clone()
    };
    rig.lines.insert(0, other);
    rig.lines[1].report.standby = rig.lines[1].report.standby.map(|it| StandbyReport {
        role: LineRole::Listening,
        ..it
    });
    rig.acts();
    rig.connect(3);
    assert_eq!(kinds(&rig.host(true, 1)), ["NBIRTH"]);
    rig.lines[1].report.standby = rig.lines[0].report.standby;
    assert_eq!(kinds(&rig.acts()), ["DBIRTH pump"]);
}
