//! Which trees are published, and how each point is: heartbeat, decimals, dead band.

use super::harness::{
    BrokerSession, Rig, SessionAct, drives, identity, name, on, publications, published_texts,
    settings,
};
use super::session::MqttSession;
use super::types::{Settings, TopicTree};
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::{DriveDescription, DriveRatings, PointSettings};
use crate::north::broker::{BrokerEvent, MqttVersion};
use crate::profile::model::RegisterRole;
use serde_json::Value;
use std::sync::Arc;
use std::time::Duration;

fn publishing(trees: &[TopicTree]) -> Rig {
    let mut rig = Rig::with(Settings {
        publish: trees.to_vec(),
        ..settings(MqttVersion::V5)
    });
    rig.poll(0, 3_000);
    rig
}

/// A session whose `pump` is published like this.
fn with_points(version: MqttVersion, points: PointSettings) -> Rig {
    with_drive(version, |drive| drive.points = points)
}

fn with_drive(version: MqttVersion, change: impl FnOnce(&mut DriveDescription)) -> Rig {
    let mut rig = Rig::new(version);
    let mut drives = drives();
    change(&mut drives[0]);
    rig.session = MqttSession::new(
        (identity(), settings(version)),
        drives,
        vec![name("hall")],
        rig.at(),
        7,
    );
    rig.poll(0, 3_000);
    rig.connect();
    rig
}

fn of_output<T>(it: T) -> Vec<(String, T)> {
    vec![("output_frequency".to_owned(), it)]
}

/// Everything that is done up to the next poll this many milliseconds later, which finds no change.
fn polled_after(rig: &mut Rig, millis: u64) -> Vec<SessionAct> {
    let acts = rig.pass(millis);
    rig.poll(0, 3_000);
    [acts, rig.acts()].concat()
}

/// Topics that are not empty in the end.
fn filled(acts: &[SessionAct]) -> Vec<String> {
    published_texts(acts)
        .into_iter()
        .filter(|(_, payload)| !payload.is_empty())
        .map(|(topic, _)| topic)
        .collect()
}

#[test]
fn only_what_is_listed_is_published_and_the_rest_is_cleared_once() {
    let always = [
        "drive/pump/availability",
        "drive/fan/availability",
        "status",
    ];
    for trees in [
        &[][..],
        &[TopicTree::State],
        &[TopicTree::Values],
        &[TopicTree::Line],
        &[TopicTree::Info],
        &TopicTree::ALL,
    ] {
        let mut rig = publishing(trees);
        let acts = rig.connect();
        let filled = filled(&acts);
        let is_there = |topic: &str| filled.iter().any(|it| it == topic);
        let table = [
            (TopicTree::State, "drive/pump/state"),
            (TopicTree::Values, "drive/pump/frequency/output"),
            (TopicTree::Values, "drive/pump/run/state"),
            (TopicTree::Values, "drive/pump/trip/count"),
            (TopicTree::Values, "drive/pump/measure/run_source"),
            (TopicTree::Line, "line/hall/status"),
            (TopicTree::Line, "line/hall/stats"),
            (TopicTree::Info, "info"),
            (TopicTree::Info, "drive/fan/info"),
        ];
        for (tree, topic) in table {
            let is_wanted = trees.contains(&tree);
            assert_eq!(is_there(topic), is_wanted, "{topic} with {trees:?}");
            let clearings = published_texts(&acts)
                .iter()
                .filter(|(it, payload)| it == topic && payload.is_empty())
                .count();
            assert_eq!(clearings, usize::from(!is_wanted), "{topic} with {trees:?}");
        }
        assert!(always.iter().all(|topic| is_there(topic)), "{filled:?}");
        assert!(publications(&acts).iter().all(|it| it.retain));
        // Later only heartbeats of what is published are sent, and no walk is begun without a reason.
        let later = rig.pass(1_000);
        rig.poll(0, 4_000);
        let later = [later, rig.acts()].concat();
        assert!(
            published_texts(&later)
                .iter()
                .all(|(_, payload)| !payload.is_empty()),
            "{:?}",
            published_texts(&later)
        );
        rig.handle(BrokerEvent::Lost);
        let again = published_texts(&rig.connect())
            .iter()
            .filter(|(_, payload)| payload.is_empty())
            .count();
        assert!(
            again > 0 || trees.len() == TopicTree::ALL.len(),
            "a broker may bring an old state back"
        );
    }
}

#[test]
fn commands_and_reads_are_answered_whatever_is_published() {
    let mut rig = publishing(&[]);
    rig.connect();
    assert_eq!(
        super::harness::result(&rig.send("drive/pump/run/set", b"sideways")).0,
        "refused"
    );
    let acts = rig.send("drive/pump/param/F007/get", b"");
    let ticket = super::harness::reads(&acts)[0].ticket;
    let outcome = crate::domain::native::NativeOutcome::Words(vec![105].into());
    let asker = crate::domain::ids::AskerId::MQTT;
    rig.session.native_answer(
        rig.at(),
        &crate::domain::native::NativeAnswer {
            asker,
            ticket,
            outcome,
        },
    );
    let acts = rig.acts();
    assert_eq!(super::harness::results(&acts)[0]["values"]["F007"], 10.5);
    assert_eq!(on(&acts, "drive/pump/param/F007"), None);
}

#[test]
fn what_changed_in_an_outage_is_reported_though_its_topic_is_left_out() {
    let mut rig = Rig::with(Settings {
        publish: vec![TopicTree::State],
        keep_telemetry: 10,
        ..settings(MqttVersion::V5)
    });
    rig.poll(0, 3_000);
    rig.connect();
    rig.pass(1_000);
    rig.poll(0, 3_500);
    rig.acts();
    rig.handle(BrokerEvent::Lost);
    rig.acts();
    rig.pass(1_000);
    rig.poll(0, 4_000);
    rig.acts();
    let acts = rig.connect();
    let history: Vec<_> = published_texts(&acts)
        .into_iter()
        .filter(|(topic, _)| topic == "drive/pump/history")
        .collect();
    assert_eq!(
        history.len(),
        1,
        "what came before the outage is no part of it: {history:?}"
    );
    assert_eq!(
        serde_json::from_str::<Value>(&history[0].1).unwrap()["value"],
        40.0
    );
}

#[test]
fn drives_that_come_later_have_their_left_out_topics_cleared_too() {
    let mut rig = publishing(&[TopicTree::State]);
    rig.connect();
    let mut renamed = drives();
    renamed[0].name = name("mixer");
    rig.session.replace(rig.at(), renamed, vec![name("hall")]);
    let acts = rig.acts();
    for topic in [
        "drive/mixer/frequency/output",
        "drive/pump/state",
        "drive/pump/availability",
    ] {
        assert_eq!(on(&acts, topic).as_deref(), Some(""), "{topic}");
    }
    assert!(filled(&acts).contains(&"drive/mixer/state".to_owned()));
}

#[test]
fn a_point_with_a_heartbeat_of_its_own_comes_by_that_and_expires_by_it() {
    let points = PointSettings {
        heartbeats: of_output(Duration::from_secs(5)),
        ..PointSettings::default()
    };
    for version in [MqttVersion::V4, MqttVersion::V5] {
        let mut rig = with_points(version, points.clone());
        let mut times = 0;
        for _ in 0..118 {
            let acts = polled_after(&mut rig, 500);
            times += published_texts(&acts)
                .iter()
                .filter(|(topic, _)| topic == "drive/pump/frequency/output")
                .count();
            let expiry = |topic: &str| {
                publications(&acts)
                    .iter()
                    .find(|it| it.topic.ends_with(topic))
                    .map(|it| it.expiry)
            };
            let expected = (version == MqttVersion::V5).then(|| Duration::from_secs(15));
            assert!(expiry("pump/frequency/output").is_none_or(|it| it == expected));
            assert_eq!(
                expiry("pump/frequency/setpoint"),
                None,
                "the others have theirs"
            );
        }
        assert_eq!(times, 11, "in 59 seconds");
    }
}

#[test]
fn a_longer_heartbeat_of_its_own_is_kept_too() {
    let points = PointSettings {
        heartbeats: of_output(Duration::from_secs(120)),
        ..PointSettings::default()
    };
    let mut rig = with_points(MqttVersion::V5, points);
    let mut seen = Vec::new();
    for second in 0..130 {
        let acts = polled_after(&mut rig, 1_000);
        for it in publications(&acts)
            .iter()
            .filter(|it| it.topic.ends_with("pump/frequency/output"))
        {
            seen.push((second, it.expiry));
        }
    }
    assert_eq!(seen, [(119, Some(Duration::from_secs(360)))]);
}

#[test]
fn decimals_round_everywhere_and_what_looks_the_same_is_no_news() {
    let points = PointSettings {
        decimals: of_output(1),
        ..PointSettings::default()
    };
    let mut rig = with_points(MqttVersion::V5, points);
    let table = [
        (3_004, None),
        (3_005, Some(("30.1", 30.1))),
        (3_014, None),
        (3_015, Some(("30.2", 30.2))),
        (4, Some(("0.1", 0.1))),
        (0, Some(("0.0", 0.0))),
        (1, Some(("0.1", 0.1))),
    ];
    for (output, expected) in table {
        rig.pass(1_000);
        rig.poll(0, output);
        let acts = rig.acts();
        let (text, number) = expected.unzip();
        assert_eq!(
            on(&acts, "drive/pump/frequency/output").as_deref(),
            text,
            "{output}"
        );
        let state =
            on(&acts, "drive/pump/state").map(|text| serde_json::from_str::<Value>(&text).unwrap());
        let shown = state.and_then(|state| state["values"]["output_frequency"]["value"].as_f64());
        assert_eq!(shown, number, "{output}");
    }
}

#[test]
fn a_dead_band_holds_for_the_value_in_amperes_too() {
    let mut rig = with_drive(MqttVersion::V5, |drive| {
        let mut model = drive.model.as_ref().clone();
        let register = model
            .registers
            .iter_mut()
            .find(|it| it.address == 0x0201)
            .unwrap();
        register.role = Some(RegisterRole::OutputCurrent);
        register.unit = UnitOfMeasure::Percent;
        register.scale = 100;
        let called = register.name.clone();
        drive.model = Arc::new(model);
        drive.ratings = DriveRatings {
            current_ma: Some(10_000),
            voltage_mv: None,
        };
        drive.points = PointSettings {
            dead_bands: vec![(called.clone(), 1.0)],
            decimals: vec![(called, 1)],
            ..PointSettings::default()
        };
    });
    // 40.00 % of 10 A, and then by how much it changes.
    for (per_cent, expected) in [
        (4_099, None),
        (4_100, Some("4.1")),
        (4_199, None),
        (5_004, Some("5.0")),
        (1, Some("0.1")),
    ] {
        let now = rig.now();
        rig.views[0]
            .snapshot
            .take(0x0201_u16.into(), &[per_cent], now);
        assert_eq!(
            on(&rig.acts(), "drive/pump/measure/current").as_deref(),
            expected,
            "{per_cent}"
        );
    }
}
