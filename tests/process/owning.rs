//! Commanders with names of their own: each is an owner, and the broker says who may use which name.

use super::mosquitto::Subscriber;
use super::plant::{LOST_AFTER, Plant, Wish};
use super::raw::Raw;
use super::started::{PATIENCE, until};
use serde_json::Value;

/// Without a password the broker takes any user at his word; what each may do is what matters here. The gateway comes
/// without a user.
const ACCESS: &str = "\
topic readwrite #
user alice
topic write vfd/plant/by/alice/#
topic read vfd/plant/#
user bob
topic write vfd/plant/by/bob/#
topic read vfd/plant/#
";

const START: &str = r#"{"id": "ID", "run": "forward", "frequency_hz": 30}"#;

fn start(plant: &Plant, user: &str, name: &str, id: &str) {
    let (topic, payload) = (
        format!("vfd/plant/by/{name}/drive/pump-1/command"),
        START.replace("ID", id),
    );
    plant
        .broker
        .publish_with(&["-V", "mqttv311", "-u", user, "-t", &topic, "-m", &payload]);
}

fn told(subscriber: &Subscriber, id: &str) -> Value {
    subscriber.results(id).pop().unwrap()
}

#[test]
fn the_second_commander_is_refused_with_the_name_of_the_first() {
    let plant = Plant::with(Wish {
        access: ACCESS,
        ..Wish::default()
    });
    let subscriber = plant.subscriber();
    start(&plant, "alice", "alice", "a1");
    let result = told(&subscriber, "a1");
    assert_eq!(
        (&result["by"], &result["outcome"]),
        (&"alice".into(), &"acknowledged".into()),
        "{result}"
    );
    plant.wait_until_it_turns();
    subscriber.wait_for_payload("control/owner", "mqtt alice");
    let seen = plant.written().len();

    start(&plant, "bob", "bob", "b1");
    let result = told(&subscriber, "b1");
    assert_eq!(
        (&result["by"], &result["reason"]),
        (&"bob".into(), &"other_owner".into()),
        "{result}"
    );
    assert_eq!(result["owner"], "mqtt alice");
    assert_eq!(result["message"], "mqtt alice holds control of the drive");
    // The commander without a name is somebody else too.
    plant.order("frequency/set", "20");
    subscriber.wait_for("/result", |it| {
        let result: Value = serde_json::from_str(&it.payload).ok()?;
        (result["owner"] == "mqtt alice" && result.get("by").is_none()).then_some(())
    });

    // The way through the broker keeps the lease of each.
    std::thread::sleep(LOST_AFTER * 2);
    assert!(plant.output() > Some(200));
    assert_eq!(plant.written().len(), seen);

    // A stop by anybody ends it, and then it is free.
    let stop = "vfd/plant/by/bob/drive/pump-1/run/set";
    plant
        .broker
        .publish_with(&["-V", "mqttv311", "-u", "bob", "-t", stop, "-m", "stop"]);
    plant.wait_until_it_stands();
    subscriber.wait_for_payload("control/owner", "");
    until("bob has it", PATIENCE, || {
        let id = format!("b{}", subscriber.on("/result").len());
        start(&plant, "bob", "bob", &id);
        (told(&subscriber, &id)["outcome"] == "acknowledged").then_some(())
    });
    subscriber.wait_for_payload("control/owner", "mqtt bob");
}

#[test]
fn nobody_commands_under_a_name_that_the_broker_does_not_grant() {
    let plant = Plant::with(Wish {
        access: ACCESS,
        ..Wish::default()
    });
    let subscriber = plant.subscriber();
    start(&plant, "bob", "alice", "forged");
    let common = Plant::topic("run/set");
    plant.broker.publish_with(&[
        "-V", "mqttv311", "-u", "bob", "-t", &common, "-m", "forward",
    ]);
    start(&plant, "alice", "alice", "real");
    assert_eq!(told(&subscriber, "real")["outcome"], "acknowledged");
    let results = subscriber.on("/result");
    assert!(
        results.iter().all(|it| it.payload.contains("real")),
        "{results:?}"
    );
    plant.order("run/set", "stop");
    plant.wait_until_it_stands();
}

#[test]
fn control_is_not_taken_over_where_nothing_allows_that() {
    let plant = Plant::new();
    let subscriber = plant.subscriber();
    let mut client = Raw::connect(plant.modbus);
    plant.run_over_modbus(&mut client);
    plant
        .broker
        .publish("vfd/plant/by/bob/drive/pump-1/control/take", "take");
    let reason = subscriber.wait_for("/result", |it| {
        let result: Value = serde_json::from_str(&it.payload).ok()?;
        (result["by"] == "bob").then(|| result["reason"].as_str().unwrap().to_owned())
    });
    assert!(reason == "no_take" || reason == "other_owner", "{reason}");
    subscriber.wait_for_payload("control/owner", "modbus-tcp 127.0.0.1");
}

#[test]
fn telemetry_of_an_outage_comes_behind_it_once_in_order_and_marked() {
    let mut plant = Plant::with(Wish {
        mqtt: "keep_telemetry = 1000",
        ..Wish::default()
    });
    drop(Subscriber::lasting(
        &plant.broker,
        "historian",
        "vfd/plant/drive/pump-1/history",
    ));
    plant.run_over_mqtt();
    until("it is at its setpoint", PATIENCE, || {
        (plant.output() >= Some(2_950)).then_some(())
    });
    plant.broker.end();
    plant.wait_until_shown_as_stopped();
    plant.broker.start_again();
    plant.wait_until_ready();
    let historian =
        Subscriber::lasting(&plant.broker, "historian", "vfd/plant/drive/pump-1/history");
    let parsed = |payload: &str| serde_json::from_str::<Value>(payload).unwrap();
    historian.wait_for("/history", |it| {
        (parsed(&it.payload)["value"] == "stopped").then_some(())
    });
    let told: Vec<Value> = historian
        .on("/history")
        .iter()
        .map(|it| parsed(&it.payload))
        .collect();
    assert!(historian.on("/history").iter().all(|it| !it.retain));
    assert!(
        told.iter()
            .all(|it| it["is_historical"] == true && it["at"].is_string()),
        "{told:?}"
    );
    let output: Vec<f64> = told
        .iter()
        .filter(|it| it["topic"] == "frequency/output")
        .map(|it| it["value"].as_f64().unwrap())
        .collect();
    let top = output
        .iter()
        .position(|hertz| *hertz > 29.0)
        .expect("the top");
    assert!(
        output[top..].len() > 3 && output.last() == Some(&0.0),
        "it ramps down: {output:?}"
    );
    let moments: Vec<&str> = told.iter().map(|it| it["at"].as_str().unwrap()).collect();
    assert!(moments.is_sorted(), "{moments:?}");
    plant.subscriber().wait_for_payload("run/state", "stopped");
}
