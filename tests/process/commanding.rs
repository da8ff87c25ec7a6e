//! Commands over MQTT: they are answered, they move the motor, and what is no command moves nothing.

use super::outsiders::requester;
use super::plant::{FREQUENCY, Plant, RUN, Wish};
use super::started::{PATIENCE, until};
use serde_json::{Value, json};

#[test]
fn a_setpoint_and_a_run_order_move_the_motor() {
    for version in ["version = 4", "version = 5"] {
        let plant = Plant::with(Wish {
            mqtt: version,
            ..Wish::default()
        });
        let subscriber = plant.subscriber();
        plant.order("frequency/set", "42.5");
        subscriber.wait_for_payload("frequency/setpoint", "42.50");
        assert_eq!(plant.output(), Some(0), "a setpoint alone starts nothing");
        plant.order("run/set", " Forward\n");
        subscriber.wait_for_payload("run/state", "forward");
        plant.wait_until_it_turns();
        let risen = |it: &str| it.parse::<f64>().is_ok_and(|hertz| hertz > 2.0);
        subscriber.wait_for("frequency/output", |it| risen(&it.payload).then_some(()));
        plant.order("run/set", "stop");
        plant.wait_until_it_stands();
        subscriber.wait_for_payload("run/state", "stopping");
        assert_eq!(
            plant.written(),
            [(FREQUENCY, 4250), (RUN, 1), (RUN, 0)],
            "each once"
        );
    }
}

#[test]
fn a_command_with_an_id_is_acknowledged_then_confirmed_and_carried_out_once() {
    let plant = Plant::new();
    let subscriber = plant.subscriber();
    let outcomes = |id: &str| -> Vec<String> {
        subscriber
            .results(id)
            .iter()
            .map(|it| it["outcome"].as_str().unwrap().to_owned())
            .collect()
    };
    plant.order("command", r#"{"id": "a1", "frequency_hz": 42.5}"#);
    assert_eq!(outcomes("a1"), ["acknowledged", "confirmed"]);
    assert_eq!(
        subscriber.results("a1")[1]["values"]["frequency_hz"],
        42.5,
        "read back"
    );
    plant.order(
        "command",
        r#"{"id": "a2", "run": "reverse", "frequency_hz": 20}"#,
    );
    // Nothing can be read back on this model that shows the direction.
    assert_eq!(outcomes("a2").last().unwrap(), "acknowledged");
    plant.wait_until_it_turns();
    plant.order("command", r#"{"id": "a3", "run": "stop"}"#);
    assert_eq!(outcomes("a3"), ["acknowledged", "confirmed"]);
    let written = [(FREQUENCY, 4250), (FREQUENCY, 2000), (RUN, 2), (RUN, 0)];
    assert_eq!(plant.written(), written);
    // The same message again, as a broker may deliver it, and the id for something else.
    plant.order(
        "command",
        r#"{"id": "a2", "run": "reverse", "frequency_hz": 20}"#,
    );
    subscriber.wait_for("/result", |it| {
        it.payload.contains("\"repeat\":true").then_some(())
    });
    plant.order("command", r#"{"id": "a2", "run": "forward"}"#);
    subscriber.wait_for("/result", |it| {
        it.payload.contains("\"duplicate\"").then_some(())
    });
    plant.assert_nothing_was_written_since(written.len());
}

#[test]
fn a_requester_with_mqtt_5_gets_its_response_with_its_correlation_data() {
    let plant = Plant::with(Wish {
        mqtt: "response_prefix = \"answers\"",
        ..Wish::default()
    });
    let port = plant.broker.address().port();
    let command = r#"{"id": "r1", "frequency_hz": 33.3}"#;
    let answers = requester(
        port,
        &Plant::topic("command"),
        command,
        "answers/me",
        "42-a",
    );
    let told: Vec<_> = answers
        .iter()
        .map(|it| (&it["correlation"], &it["payload"]["outcome"]))
        .collect();
    assert_eq!(
        told,
        [
            (&json!("42-a"), &json!("acknowledged")),
            (&json!("42-a"), &json!("confirmed"))
        ]
    );
    let answers = requester(
        port,
        &Plant::topic("frequency/set"),
        "fast",
        "answers/me",
        "43",
    );
    assert_eq!(
        (&answers[0]["correlation"], &answers[0]["payload"]["reason"]),
        (&json!("43"), &json!("not_a_number"))
    );
    // Outside of the configured prefix, into an input of the gateway's own, nothing is answered: the requester waits
    // for the answer on `result` then, to see that there was none.
    let into_ourselves = Plant::topic("run/set");
    let answers = requester(
        port,
        &Plant::topic("command"),
        r#"{"id": "r2", "frequency_hz": 34}"#,
        &into_ourselves,
        "x",
    );
    assert_eq!(answers, Vec::<Value>::new());
    assert_eq!(plant.written(), [(FREQUENCY, 3330), (FREQUENCY, 3400)]);
}

/// Input, payload, reason. Each is refused; nothing of it reaches the line.
const NO_COMMANDS: &[(&str, &str, &str)] = &[
    ("frequency/set", "fast", "not_a_number"),
    ("frequency/set", "NaN", "not_a_number"),
    ("frequency/set", "inf", "not_a_number"),
    ("frequency/set", "4,5", "not_a_number"),
    ("frequency/set", "1e1", "not_a_number"),
    ("frequency/set", "4.9", "outside_limits"),
    ("frequency/set", "50.01", "outside_limits"),
    ("frequency/set", "-20", "outside_limits"),
    ("frequency/set", "20.001", "between_steps"),
    ("run/set", "start", "not_understood"),
    ("run/set", "1", "not_understood"),
    ("trip/reset", "yes", "not_understood"),
    ("command", "forward", "not_understood"),
    ("command", "[1, 2]", "not_understood"),
    ("command", "{}", "not_understood"),
    ("command", r#"{"run": "forward""#, "not_understood"),
    ("command", r#"{"run": true}"#, "not_understood"),
    ("command", r#"{"frequency": 20}"#, "not_understood"),
    (
        "command",
        r#"{"frequency_hz": 10, "frequency_hz": 20}"#,
        "not_understood",
    ),
    ("command", r#"{"frequency_hz": "20"}"#, "not_a_number"),
    ("command", r#"{"frequency_hz": 60}"#, "outside_limits"),
    (
        "command",
        r#"{"reset": true, "frequency_hz": 20}"#,
        "conflict",
    ),
    (
        "command",
        r#"{"run": "forward", "reset": true}"#,
        "conflict",
    ),
    (
        "command",
        r#"{"frequency_hz": 20, "epoch": 1}"#,
        "stale_epoch",
    ),
    (
        "command",
        r#"{"frequency_hz": 20, "issued_at": 1000}"#,
        "stale",
    ),
    (
        "command",
        r#"{"frequency_hz": 20, "ttl_ms": 0}"#,
        "not_understood",
    ),
    ("command", r#"{"param": {"F999": 1}}"#, "not_listed"),
    ("command", r#"{"param": {"F007": 1}}"#, "not_listed"),
    ("param/F007/set", "1", "not_listed"),
    ("run/set", "forward", "setpoint_unknown"),
];

#[test]
fn what_is_no_command_is_refused_with_its_reason_and_never_reaches_the_line() {
    let plant = Plant::new();
    let subscriber = plant.subscriber();
    for (place, (input, payload, reason)) in NO_COMMANDS.iter().enumerate() {
        plant.order(input, payload);
        let result = until("the result comes", PATIENCE, || {
            let last = subscriber
                .on("pump-1/result")
                .into_iter()
                .filter(|it| it.payload.contains("\"final\":true"));
            last.into_iter().nth(place)
        });
        let result: Value = serde_json::from_str(&result.payload).unwrap();
        let told = (
            result["outcome"].as_str().unwrap(),
            result["reason"].as_str().unwrap(),
        );
        assert_eq!(told, ("refused", *reason), "{input} {payload}");
    }
    plant
        .broker
        .publish("vfd/plant/drive/pump-2/run/set", "forward");
    let unknown = subscriber.wait_for("pump-2/result", |it| Some(it.payload.clone()));
    assert!(
        unknown.contains("\"unknown_drive\"") && unknown.contains("is it `pump-1`?"),
        "{unknown}"
    );
    plant.broker.publish("vfd/plant/all/run/set", "forward");
    subscriber.wait_for("all/result", |it| {
        it.payload.contains("\"not_understood\"").then_some(())
    });
    plant.assert_nothing_was_written_since(0);
}

#[test]
fn a_message_of_5_mb_costs_a_reconnect_at_most() {
    for version in ["version = 4", "version = 5"] {
        let plant = Plant::with(Wish {
            mqtt: version,
            ..Wish::default()
        });
        let subscriber = plant.subscriber();
        let large = plant.place.write("large", &"8".repeat(5_000_000));
        plant.broker.publish_with(&[
            "-t",
            &Plant::topic("frequency/set"),
            "-f",
            large.to_str().unwrap(),
        ]);
        // A message that this side takes and no command is.
        let medium = plant.place.write("medium", &"8".repeat(20_000));
        // It may be on its way back to the broker for a while after the large one.
        until("the medium one is refused", PATIENCE, || {
            plant.broker.publish_with(&[
                "-t",
                &Plant::topic("frequency/set"),
                "-f",
                medium.to_str().unwrap(),
            ]);
            subscriber
                .on("/result")
                .iter()
                .any(|it| it.payload.contains("\"too_large\""))
                .then_some(())
        });
        let connections = plant
            .logged(|line| line.contains("connected to the broker").then_some(()))
            .len();
        assert!(connections <= 2, "{version}: {connections} connections");
        plant.wait_until_ready();
        plant.assert_nothing_was_written_since(0);
    }
}
