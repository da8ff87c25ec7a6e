//! What the gateway publishes: the topic tree, what is retained of it, and trips.

use super::mosquitto::{Message, Subscriber};
use super::plant::{Plant, Wish};
use super::started::{PATIENCE, until};
use serde_json::Value;

/// Topics under the gateway's, whether the broker keeps them, and their QoS, as `docs/mqtt-topics.md` lists them.
const TREE: &[(&str, u64)] = &[
    ("status", 1),
    ("info", 1),
    ("drive/pump-1/info", 1),
    ("line/hall-1/status", 1),
    ("line/hall-1/stats", 0),
    ("drive/pump-1/stats", 0),
    ("drive/pump-1/availability", 1),
    ("drive/pump-1/state", 0),
    ("drive/pump-1/frequency/output", 0),
    ("drive/pump-1/frequency/setpoint", 0),
    ("drive/pump-1/run/state", 0),
    ("drive/pump-1/trip/count", 0),
    ("drive/pump-1/measure/frequency_source", 0),
    ("drive/pump-1/measure/run_source", 0),
];

#[test]
fn a_subscriber_who_comes_late_finds_the_whole_tree_with_3_1_1_and_with_5() {
    let mut plant = Plant::with(Wish {
        mqtt: "version = 4",
        ..Wish::default()
    });
    finds_the_tree(&plant);
    drop(plant);
    plant = Plant::new();
    finds_the_tree(&plant);
    let info: Value = serde_json::from_str(&kept(&plant, "mqttv5", "info")).unwrap();
    assert_eq!(
        (&info["gateway"], &info["drives"][0]),
        (&"plant".into(), &"pump-1".into())
    );
    let info: Value = serde_json::from_str(&kept(&plant, "mqttv5", "drive/pump-1/info")).unwrap();
    assert_eq!(info["model"], "hyundai-n700");
    let state: Value = serde_json::from_str(&kept(&plant, "mqttv5", "drive/pump-1/state")).unwrap();
    assert_eq!(state["values"]["output_frequency"]["unit"], "Hz");
    assert_eq!(state["values"]["output_frequency"]["quality"], "good");
    assert_eq!(
        state["control"]["start_inhibited"], true,
        "nobody has commanded anything since the start"
    );
}

/// Both versions of the protocol see the same retained tree, whichever the gateway itself speaks.
fn finds_the_tree(plant: &Plant) {
    // What is told for the first time comes without the flag, to whoever is there already.
    let early = plant.subscriber();
    for (topic, _) in TREE {
        early.wait_for(topic, |_| Some(()));
    }
    for version in ["mqttv311", "mqttv5"] {
        for (topic, qos) in TREE {
            let late = Subscriber::new(&plant.broker, version, &format!("vfd/plant/{topic}"));
            let message = late.wait_for(topic, |it| Some(it.clone()));
            assert!(message.retain, "{version} {message:?}");
            assert_eq!(message.qos, *qos, "{version} {message:?}");
        }
        assert_eq!(kept(plant, version, "status"), "online");
        assert_eq!(kept(plant, version, "drive/pump-1/availability"), "online");
        assert_eq!(kept(plant, version, "drive/pump-1/run/state"), "stopped");
        assert_eq!(
            kept(plant, version, "drive/pump-1/frequency/output"),
            "0.00"
        );
        assert_eq!(kept(plant, version, "line/hall-1/status"), "up");
    }
}

/// What the broker keeps on a topic of the gateway.
fn kept(plant: &Plant, version: &str, topic: &str) -> String {
    let late = Subscriber::new(&plant.broker, version, &format!("vfd/plant/{topic}"));
    late.wait_for(topic, |it| it.retain.then(|| it.payload.clone()))
}

#[test]
fn a_trip_is_an_event_once_and_is_over_when_it_was_reset() {
    let plant = Plant::with(Wish {
        simulate: &["--trip-every", "12"],
        ..Wish::default()
    });
    let subscriber = plant.subscriber();
    plant.run_over_mqtt();
    subscriber.wait_for_payload("pump-1/trip/active", "true");
    subscriber.wait_for_payload("run/state", "tripped");
    let event = |index: usize| {
        until("the event comes", PATIENCE, || {
            subscriber.on("trip/event").get(index).cloned()
        })
    };
    let (tripped, words) = (event(0), |it: &Message| {
        serde_json::from_str::<Value>(&it.payload).unwrap()
    });
    assert!(!tripped.retain && tripped.qos == 1, "{tripped:?}");
    let tripped = words(&tripped);
    assert_eq!(
        (&tripped["kind"], &tripped["seq"], &tripped["count"]),
        (&"tripped".into(), &1.into(), &1.into())
    );
    assert_eq!(
        (&tripped["code"], &tripped["while_away"]),
        (&1.into(), &false.into())
    );
    subscriber.wait_for_payload("trip/count", "1");
    subscriber.wait_for_payload("trip/code", "1");
    let last = subscriber.wait_for("trip/last", |it| {
        serde_json::from_str::<Value>(&it.payload).ok()
    });
    assert_eq!(last["code"], 1);

    let written = plant.written().len();
    plant.order("command", r#"{"id": "too-soon", "run": "forward"}"#);
    assert_eq!(
        subscriber.results("too-soon").last().unwrap()["reason"],
        "tripped"
    );
    assert_eq!(
        plant.written().len(),
        written,
        "a tripped drive is not started"
    );
    plant.order("trip/reset", "reset");
    let cleared = words(&event(1));
    assert_eq!(
        (&cleared["kind"], &cleared["seq"]),
        (&"cleared".into(), &2.into())
    );
    subscriber.wait_for_payload("trip/active", "false");
    // Stop, reset, stop: a reset leaves no order to run behind.
    let sequence: Vec<u16> = plant.written()[written..]
        .iter()
        .map(|(_, word)| *word)
        .collect();
    assert_eq!(sequence, [0, 4, 0]);
}
