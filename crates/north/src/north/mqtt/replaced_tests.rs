//! The session across a change of the configuration, on a connection that stays.

use super::harness::{
    BrokerSession, Rig, SessionAct, commands, drives, name, on, publications, published_texts,
    reads, result,
};
use crate::domain::command::{Outcome, Reason};
use crate::drive::description::{DriveDescription, DriveRef};
use crate::drive::view::DriveView;
use crate::north::broker::MqttVersion;
use serde_json::Value;

/// Replaces drives and lines. A drive that existed before keeps its view.
fn replace(rig: &mut Rig, drives: Vec<DriveDescription>, lines: &[&str]) -> Vec<SessionAct> {
    let old: Vec<_> = rig
        .session
        .drives
        .iter()
        .map(|it| it.name.clone())
        .collect();
    let view = |drive: &DriveDescription| {
        old.iter()
            .position(|it| *it == drive.name)
            .and_then(|at| rig.views.get(at))
            .cloned()
            .unwrap_or_default()
    };
    let views: Vec<DriveView> = drives.iter().map(view).collect();
    rig.views = views;
    let line = rig.lines[0].clone();
    rig.lines = lines
        .iter()
        .map(|it| crate::north::broker::SessionLine {
            name: name(it),
            ..line.clone()
        })
        .collect();
    rig.session
        .replace(rig.at(), drives, lines.iter().map(|it| name(it)).collect());
    rig.acts()
}

fn on_another_line(mut drive: DriveDescription, called: &str) -> DriveDescription {
    drive.place = DriveRef {
        line: 7,
        ..drive.place
    };
    drive.name = name(called);
    drive.line = name("yard");
    drive
}

#[test]
fn topics_of_what_is_gone_are_cleared_and_what_stays_is_not_said_again() {
    let mut rig = Rig::born(MqttVersion::V5);
    let [pump, fan] = <[_; 2]>::try_from(drives()).unwrap();
    let added = on_another_line(fan, "mill");
    let acts = replace(&mut rig, vec![added, pump.clone()], &["yard"]);
    let texts = published_texts(&acts);
    let (cleared, said): (Vec<_>, Vec<_>) =
        texts.iter().partition(|(_, payload)| payload.is_empty());
    for topic in [
        "drive/fan/availability",
        "drive/fan/info",
        "drive/fan/state",
        "drive/fan/trip/last",
        "line/hall/status",
        "line/hall/stats",
    ] {
        assert!(
            cleared.iter().any(|(it, _)| it == topic),
            "{topic} in {cleared:?}"
        );
    }
    for topic in [
        "info",
        "drive/mill/info",
        "drive/mill/availability",
        "drive/mill/state",
        "line/yard/status",
    ] {
        assert!(
            said.iter().any(|(it, _)| it == topic),
            "{topic} in {said:?}"
        );
    }
    // Its line is gone, and with it what the line counted.
    let of_pump = texts
        .iter()
        .filter(|(topic, _)| topic.starts_with("drive/pump/"));
    assert!(
        of_pump.map(|(topic, _)| topic).eq(["drive/pump/stats"]),
        "{texts:?}"
    );
    assert!(publications(&acts).iter().all(|it| it.retain));
    let info: Value = serde_json::from_str(&on(&acts, "info").unwrap()).unwrap();
    let names = info["drives"].as_array().unwrap().to_vec();
    assert_eq!(names, ["mill", "pump"]);
    // A drive that comes back is published again, and no longer cleared, also on the next connection.
    let [pump, fan] = <[_; 2]>::try_from(drives()).unwrap();
    let acts = replace(&mut rig, vec![pump, fan], &["hall"]);
    assert_eq!(
        on(&acts, "drive/fan/availability").as_deref(),
        Some("offline")
    );
    rig.handle(crate::north::broker::BrokerEvent::Lost);
    let again = rig.connect();
    assert_eq!(
        on(&again, "drive/fan/availability").as_deref(),
        Some("offline")
    );
    assert_eq!(
        on(&again, "drive/mill/availability").as_deref(),
        Some(""),
        "cleared on each connection"
    );
    assert_eq!(
        on(&again, "drive/pump/availability").as_deref(),
        Some("online")
    );
}

#[test]
fn answers_find_their_drive_in_its_new_place() {
    let mut rig = Rig::born(MqttVersion::V5);
    let acts = rig.send("drive/pump/command", br#"{"id": "one", "run": "stop"}"#);
    let ticket = commands(&acts)[0].ticket;
    let [pump, fan] = <[_; 2]>::try_from(drives()).unwrap();
    replace(
        &mut rig,
        vec![on_another_line(fan, "mill"), pump],
        &["yard", "hall"],
    );
    let acts = rig.answer(ticket, Outcome::Confirmed, Reason::None, true);
    assert_eq!(result(&acts), ("confirmed".to_owned(), "none".to_owned()));
    assert!(on(&acts, "drive/pump/result").is_some());
    let acts = rig.send("drive/pump/run/set", b"stop");
    assert_eq!(commands(&acts)[0].drive, drives()[0].place.drive);
}

#[test]
fn what_was_asked_of_a_drive_that_is_gone_is_answered_at_once() {
    let mut rig = Rig::born(MqttVersion::V5);
    let stop = rig.send("drive/pump/command", br#"{"id": "one", "run": "stop"}"#);
    let read = rig.send("drive/fan/param/F007/get", b"");
    assert_eq!((commands(&stop).len(), reads(&read).len()), (1, 1));
    // The line was restarted: the same drives in other places.
    let again: Vec<_> = drives()
        .into_iter()
        .map(|drive| DriveDescription {
            place: DriveRef {
                line: 9,
                ..drive.place
            },
            ..drive
        })
        .collect();
    let acts = replace(&mut rig, again, &["hall"]);
    let results = super::harness::results(&acts);
    let ends: Vec<_> = results
        .iter()
        .map(|it| (it["outcome"].clone(), it["reason"].clone()))
        .collect();
    assert_eq!(
        ends,
        [
            ("unknown".into(), "removed".into()),
            ("failed".into(), "removed".into())
        ],
        "{results:?}"
    );
    let late = rig.answer(
        commands(&stop)[0].ticket,
        Outcome::Confirmed,
        Reason::None,
        true,
    );
    assert!(
        super::harness::results(&late).is_empty(),
        "it is no longer pending"
    );
    // The id is remembered across the restart.
    let acts = rig.send("drive/pump/command", br#"{"id": "one", "run": "forward"}"#);
    assert!(commands(&acts).is_empty());
}
