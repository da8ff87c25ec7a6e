//! The wall clock is set while the session runs: this affects only labels and `issued_at`. No other machine of the
//! gateway is ever given the wall clock.

use super::harness::{BrokerSession, EPOCH_MS, Rig, SessionAct, commands, result};
use crate::domain::command::{Outcome, Reason};
use crate::domain::time::MonoTime;
use crate::north::broker::{BrokerEvent, MqttVersion, Publication};
use serde_json::Value;

const HOUR_MS: i64 = 3_600_000;
const YEAR_MS: i64 = 365 * 24 * HOUR_MS;

/// A payload without its labels.
fn unlabelled(publication: &Publication) -> (String, String) {
    let text = String::from_utf8(publication.payload.clone()).expect("text");
    let Ok(mut value) = serde_json::from_str(&text) else {
        return (publication.topic.clone(), text);
    };
    take_labels(&mut value);
    (publication.topic.clone(), value.to_string())
}

fn take_labels(value: &mut Value) {
    let Value::Object(object) = value else { return };
    for label in ["at", "started", "lease_until"] {
        object.remove(label);
    }
    object.values_mut().for_each(take_labels);
}

/// What is done, without labels. A trip that is shown with its moment is shown again when that moment changes.
fn done(acts: Vec<SessionAct>) -> Vec<String> {
    let outcome = |act: SessionAct| match act {
        SessionAct::Publish(it) if it.topic.ends_with("/trip/last") => None,
        SessionAct::Publish(it) => Some(format!(
            "{:?} {:?}",
            unlabelled(&it),
            (it.retain, it.qos, it.expiry)
        )),
        other => Some(format!("{other:?}")),
    };
    acts.into_iter().filter_map(outcome).collect()
}

/// Ten minutes of a plant with all features, with the wall clock set as `steps` say, one after each part.
fn played(steps: &[i64]) -> Vec<String> {
    let mut steps = steps.iter().copied().cycle();
    let mut rig = Rig::born(MqttVersion::V5);
    let mut all = Vec::new();
    let mut part = |rig: &mut Rig, acts: Vec<SessionAct>| {
        all.extend(done(acts));
        all.push(format!(
            "{:?} {:?}",
            rig.session.next_wake().map(MonoTime::as_nanos),
            rig.session.is_path_alive(rig.at())
        ));
        rig.wall_set_by += steps.next().unwrap_or(0);
    };
    for round in 0..10_u16 {
        rig.poll(0, 3_000 + round * 100);
        let acts = rig.pass(20_000);
        part(&mut rig, acts);
        let order = format!(r#"{{"id": "{round}", "run": "forward", "ttl_ms": 500}}"#);
        let acts = rig.send("drive/pump/command", order.as_bytes());
        let ticket = commands(&acts)[0].ticket;
        part(&mut rig, acts);
        let acts = rig.answer(ticket, Outcome::Acknowledged, Reason::None, true);
        part(&mut rig, acts);
        let acts = rig.send("drive/pump/command", order.as_bytes());
        assert!(
            commands(&acts).is_empty(),
            "a repeat is known whatever the wall clock says"
        );
        part(&mut rig, acts);
        // This one is never answered: it is given up in time.
        let acts = rig.send("drive/pump/frequency/set", b"30.0");
        part(&mut rig, acts);
        let acts = rig.pass(40_000);
        part(&mut rig, acts);
        if round % 4 == 3 {
            rig.handle(BrokerEvent::Lost);
            let acts = rig.connect();
            part(&mut rig, acts);
        }
    }
    all
}

#[test]
fn a_wall_clock_that_is_set_changes_labels_only() {
    let right = played(&[0]);
    assert!(right.len() > 300, "{}", right.len());
    for steps in [
        &[HOUR_MS][..],
        &[-HOUR_MS],
        &[YEAR_MS, -2 * YEAR_MS, 5],
        &[700, -900],
        &[-50 * YEAR_MS, 50 * YEAR_MS],
    ] {
        let played = played(steps);
        let differ = right
            .iter()
            .zip(&played)
            .find(|(right, played)| right != played);
        assert_eq!((differ, played.len()), (None, right.len()), "{steps:?}");
    }
}

#[test]
fn issued_at_is_held_against_the_wall_clock_as_it_is_now() {
    let mut rig = Rig::born(MqttVersion::V5);
    for set_by in [0, HOUR_MS, -HOUR_MS, YEAR_MS] {
        rig.wall_set_by = set_by;
        rig.pass(2_000);
        let now = rig.at().wall.unix_ms;
        let run = |issued_at: i64| format!(r#"{{"run": "forward", "issued_at": {issued_at}}}"#);
        let acts = rig.send("drive/pump/command", run(now - 100).as_bytes());
        assert_eq!(commands(&acts).len(), 1, "{set_by}");
        assert_eq!(
            commands(&acts)[0].start_before,
            rig.now() + std::time::Duration::from_secs(1)
        );
        let acts = rig.send("drive/pump/command", run(now - 5_000).as_bytes());
        assert_eq!(result(&acts).1, "stale", "{set_by}");
        if set_by != 0 {
            let acts = rig.send("drive/pump/command", run(EPOCH_MS).as_bytes());
            assert!(
                commands(&acts).is_empty(),
                "by the clock as it was: {set_by}"
            );
        }
    }
}
