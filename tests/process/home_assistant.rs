//! Home Assistant at the broker: it finds the drives, commands them with what it was told, and its end is noticed.

use super::hass::{self, Hass};
use super::mosquitto::{Mosquitto, Subscriber};
use super::outsiders::documents_of;
use super::plant::{FREQUENCY, LOST_AFTER, MARGIN, Plant, RUN, Wish};
use super::started::{PATIENCE, until};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;
use vfd_gateway::domain::version::PROGRAM_VERSION;

const ON: &str = "home_assistant = { discovery = true, combined = [\"switch\", \"fan\"] }";
/// An answer to a birth may take so long, and a hundred of them a second go out.
const BIRTH: Duration = Duration::from_secs(10);

fn plant(more: &str) -> Plant {
    let mqtt = format!("{ON}\n{more}");
    Plant::with(Wish {
        mqtt: &mqtt,
        ..Wish::default()
    })
}

/// What the broker has retained of announcements, by topic. The fan, which is announced last of all, is waited for.
fn announced(broker: &Mosquitto) -> BTreeMap<String, Value> {
    until("everything is announced", PATIENCE, || {
        let subscriber = Subscriber::new(broker, "mqttv311", "homeassistant/#");
        // What is retained comes before this.
        broker.publish("homeassistant/marker", "here");
        subscriber.wait_for("/marker", |_| Some(()));
        let retained = subscriber.on("/config").into_iter().filter(|it| it.retain);
        let parsed = retained.map(|it| (it.topic, serde_json::from_str(&it.payload).unwrap()));
        let found: BTreeMap<_, Value> = parsed.collect();
        found
            .keys()
            .any(|topic| topic.ends_with("/drive_pump-1_fan/config"))
            .then_some(found)
    })
}

fn of<'a>(announced: &'a BTreeMap<String, Value>, component: &str, object: &str) -> &'a Value {
    &announced[&format!("homeassistant/{component}/vfd-gateway-plant/{object}/config")]
}

/// Presses a button as Home Assistant does.
fn press(plant: &Plant, announced: &BTreeMap<String, Value>, button: &str) {
    let button = of(announced, "button", &format!("drive_pump-1_{button}"));
    plant.broker.publish(
        button["command_topic"].as_str().unwrap(),
        button["payload_press"].as_str().unwrap(),
    );
}

#[test]
fn what_is_announced_commands_the_drive() {
    for version in ["version = 4", "version = 5"] {
        let plant = plant(version);
        let announced = announced(&plant.broker);
        let number = of(&announced, "number", "drive_pump-1_set_frequency");
        plant
            .broker
            .publish(number["command_topic"].as_str().unwrap(), "20.5");
        plant.wait_for_write(0, (FREQUENCY, 2050), PATIENCE);
        press(&plant, &announced, "forward");
        plant.wait_until_it_turns();
        press(&plant, &announced, "stop");
        plant.wait_until_it_stands();
        assert_eq!(plant.written(), [(FREQUENCY, 2050), (RUN, 1), (RUN, 0)]);
        // Each value that it is told of stands where it was told.
        let subscriber = plant.subscriber();
        for (topic, document) in &announced {
            let Some(state) = document.get("state_topic").and_then(Value::as_str) else {
                continue;
            };
            let is_passing = state.ends_with("/result") || state.ends_with("/trip/event");
            // Without a trip nothing stands there.
            if !is_passing && !state.ends_with("/trip/text") {
                subscriber.wait_for(state, |it| (it.topic == state).then_some(()));
            }
            assert!(topic.starts_with("homeassistant/"), "{topic}");
        }
    }
}

#[test]
fn its_end_stops_the_drive_and_its_birth_brings_the_announcements_again() {
    let plant = plant("version = 4");
    let before = announced(&plant.broker);
    plant.broker.publish("homeassistant/status", "online");
    let seen = plant.run_over_mqtt();
    std::thread::sleep(LOST_AFTER * 2);
    assert!(
        plant.output() > Some(0),
        "a session lease lasts while both are there"
    );
    plant.broker.publish("homeassistant/status", "offline");
    plant.wait_for_write(seen, (RUN, 0), LOST_AFTER + MARGIN);
    plant.wait_until_it_stands();
    let subscriber = Subscriber::new(&plant.broker, "mqttv5", "homeassistant/+/+/+/config");
    let lively = || {
        subscriber
            .on("/config")
            .into_iter()
            .filter(|it| !it.retain)
            .count()
    };
    until("what was retained has come", PATIENCE, || {
        (subscriber.on("/config").len() >= before.len()).then_some(())
    });
    assert_eq!(lively(), 0);
    plant.broker.publish("homeassistant/status", "online");
    // MQTT 5 without retain as published, so what comes now is no retained message.
    until("all of it comes again", BIRTH, || {
        (lively() >= before.len()).then_some(())
    });
    plant.assert_nothing_was_written_since(plant.written().len());
}

#[test]
fn what_is_gone_is_taken_back_over_a_restart_and_a_reload() {
    for version in ["version = 4", "version = 5"] {
        let mut plant = plant(version);
        let before = announced(&plant.broker);
        let stale = |topic: &str| before.contains_key(topic) && topic.contains("drive_pump-1_");
        let subscriber = Subscriber::new(&plant.broker, "mqttv311", "homeassistant/#");
        let cleared = || {
            subscriber
                .on("/config")
                .into_iter()
                .filter(|it| it.payload.is_empty() && stale(&it.topic))
                .count()
        };
        let old = before.keys().filter(|topic| stale(topic)).count();
        assert!(old > 10);
        // Another name for the drive, while nobody is there to see it go.
        plant.gateway.terminate();
        assert!(plant.gateway.end_within(PATIENCE).success());
        let text = std::fs::read_to_string(&plant.file).unwrap();
        std::fs::write(&plant.file, text.replace("\"pump-1\"", "\"fan-9\"")).unwrap();
        plant.start_gateway_again();
        until("the entities of the old name are gone", PATIENCE, || {
            (cleared() >= old).then_some(())
        });
        until("those of the new one are there", PATIENCE, || {
            subscriber.has("drive_fan-9_last_reason").then_some(())
        });
        // Discovery is switched off.
        let text = std::fs::read_to_string(&plant.file).unwrap();
        std::fs::write(
            &plant.file,
            text.replace("discovery = true", "discovery = false"),
        )
        .unwrap();
        plant.gateway.signal("HUP");
        until("nothing is announced any more", PATIENCE, || {
            let all = subscriber.on("/config");
            let last: BTreeMap<_, _> = all
                .iter()
                .map(|it| (&it.topic, it.payload.is_empty()))
                .collect();
            last.values().all(|is_empty| *is_empty).then_some(())
        });
    }
}

/// Home Assistant's own rules for announcements and its own templates, applied to real ones and to what stands on their
/// topics.
#[test]
fn its_own_schemas_and_templates_take_what_is_announced() {
    let Some(python) = hass::program().map(|hass| hass.with_file_name("python")) else {
        return;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/process/discovery.py");
    let plant = plant("version = 5");
    let announced = announced(&plant.broker);
    plant.order("command", r#"{"id": "a1", "run": "stop"}"#);
    let subscriber = plant.subscriber();
    plant.order("command", r#"{"id": "a2", "run": "stop"}"#);
    subscriber.results("a2");
    subscriber.wait_for_payload("run/state", "stopped");
    subscriber.wait_for("pump-1/state", |it| {
        it.payload.contains(r#""local":false"#).then_some(())
    });
    let mut child = Command::new(&python)
        .arg(script)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap_or_else(|error| {
            panic!(
                "{}: {error}; run tests/run, which installs it",
                python.display()
            )
        });
    let mut input = child.stdin.take().unwrap();
    // Those of every kind of drive first.
    for kind in ["gateway", "read_only", "forward", "both_ways"] {
        let file = format!(
            "{}/tests/golden/home_assistant/{kind}.json",
            env!("CARGO_MANIFEST_DIR")
        );
        let golden: BTreeMap<String, Value> =
            serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
        for (topic, document) in golden {
            writeln!(
                input,
                "{}",
                json!({ "topic": topic, "payload": document.to_string(), "state": null })
            )
            .unwrap();
        }
    }
    for (topic, document) in &announced {
        let state = document
            .get("state_topic")
            .and_then(Value::as_str)
            .unwrap_or("-");
        let last = subscriber
            .on(state)
            .into_iter()
            .next_back()
            .map(|it| it.payload);
        let line = json!({ "topic": topic, "payload": document.to_string(), "state": last });
        writeln!(input, "{line}").unwrap();
    }
    drop(input);
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    let shown: BTreeMap<String, Value> = serde_json::from_slice(&output.stdout).unwrap();
    assert!(shown.len() > announced.len());
    let of_state = |object: &str| {
        shown[object]["state"]
            .as_str()
            .unwrap_or_else(|| panic!("{object}"))
    };
    for (object, right) in [
        ("drive_pump-1_connected", "online"),
        ("drive_pump-1_run_state", "stopped"),
        ("drive_pump-1_running", "False"),
        ("drive_pump-1_output_frequency", "0.00"),
        ("drive_pump-1_local", "False"),
        ("drive_pump-1_not_effective", "False"),
        ("drive_pump-1_last_command", "confirmed"),
        ("drive_pump-1_last_reason", "none"),
        ("drive_pump-1_owner", "nobody"),
        ("gateway_connected", "online"),
        ("gateway_line_hall-1_up", "True"),
        ("gateway_version", PROGRAM_VERSION),
    ] {
        if shown.contains_key(object) {
            assert_eq!(of_state(object), right, "{object}");
        } else {
            panic!("{object} is not among {:?}", shown.keys());
        }
    }
    // Nothing on the topic: unknown, and no error.
    for (object, it) in &shown {
        let Some(cleared) = it["cleared"].as_str() else {
            continue;
        };
        assert!(
            ["None", "unknown", "nobody"].contains(&cleared),
            "{object}: {cleared}"
        );
    }
}

/// Home Assistant shows the drive, commands it, and when it dies the drive stops. Of what goes wrong meanwhile its log
/// would tell.
#[test]
fn home_assistant_itself_shows_and_commands_the_drive() {
    let Some(program) = hass::program() else {
        return;
    };
    let plant = plant("version = 5");
    let mut hass = Hass::start(program, &plant.place, plant.broker.address());
    for (id, state) in [
        ("sensor.pump_1_output_frequency", "0.00"),
        ("sensor.pump_1_run_state", "stopped"),
        ("binary_sensor.pump_1_running", "off"),
        ("binary_sensor.pump_1_connected", "on"),
        ("binary_sensor.pump_1_local_control", "off"),
        ("binary_sensor.pump_1_stop_without_effect", "off"),
        ("binary_sensor.plant_connected", "on"),
        ("binary_sensor.plant_line_hall_1", "on"),
        ("sensor.plant_line_hall_1_status", "up"),
        ("sensor.pump_1_control_held_by", "nobody"),
        ("sensor.pump_1_trip_text", "unknown"),
        ("event.pump_1_trip", "unknown"),
    ] {
        hass.wait_for(id, state);
    }
    let number = "number.pump_1_set_frequency";
    let limits = hass.entity(number).unwrap();
    assert_eq!(
        (&limits["attributes"]["mode"], &limits["attributes"]["step"]),
        (&"box".into(), &0.01.into())
    );
    hass.call(
        "number/set_value",
        &json!({ "entity_id": number, "value": 20.5 }),
    );
    plant.wait_for_write(0, (FREQUENCY, 2050), PATIENCE);
    hass.wait_for("sensor.pump_1_last_command", "confirmed");
    hass.wait_for(number, "20.5");
    let press = |button: &str| {
        hass.call(
            "button/press",
            &json!({ "entity_id": format!("button.pump_1_{button}") }),
        )
    };
    press("forward");
    plant.wait_until_it_turns();
    hass.wait_for("sensor.pump_1_run_state", "forward");
    hass.wait_for("binary_sensor.pump_1_running", "on");
    hass.wait_for("sensor.pump_1_control_held_by", "mqtt");
    std::thread::sleep(LOST_AFTER * 2);
    assert!(
        plant.output() > Some(0),
        "a session lease lasts while Home Assistant is there"
    );
    press("stop");
    plant.wait_until_it_stands();
    assert_eq!(plant.written(), [(FREQUENCY, 2050), (RUN, 1), (RUN, 0)]);
    a_switch_and_a_fan_command_it(&hass, &plant);
    the_delivered_package_works(&hass, &plant);
    let at = until("a start is taken again", PATIENCE, || {
        let seen = plant.written().len();
        press("forward");
        std::thread::sleep(Duration::from_millis(500));
        (plant.written().len() > seen).then_some(seen + 1)
    });
    plant.wait_until_it_turns();
    let gone: Vec<_> = hass
        .entities()
        .into_iter()
        .filter(|it| it["state"] == "unavailable")
        .collect();
    assert_eq!(gone, Vec::<Value>::new());
    let text = hass.program.text();
    let bad: Vec<_> = text
        .lines()
        .filter(|it| it.contains("mqtt") && (it.contains("ERROR") || it.contains("WARN")))
        .collect();
    assert_eq!(bad, Vec::<&str>::new());
    hass.program.kill();
    plant.wait_for_write(at, (RUN, 0), LOST_AFTER + MARGIN);
    plant.wait_until_it_stands();
}

/// The same drive as one switch and as one fan.
fn a_switch_and_a_fan_command_it(hass: &Hass, plant: &Plant) {
    let (switch, fan) = ("switch.pump_1_run", "fan.pump_1_fan");
    hass.wait_for(switch, "off");
    hass.wait_for(fan, "off");
    let order = |service: &str, id: &str, more: Value| {
        let mut call = json!({ "entity_id": id });
        call.as_object_mut()
            .unwrap()
            .extend(more.as_object().unwrap().clone());
        hass.call(service, &call);
    };
    let starts = |service: &str, id: &str| {
        until("the start is taken", PATIENCE, || {
            let seen = plant.written().len();
            order(service, id, json!({}));
            std::thread::sleep(Duration::from_millis(500));
            plant.written()[seen..].contains(&(RUN, 1)).then_some(())
        });
        plant.wait_until_it_turns();
        hass.wait_for(id, "on");
    };
    starts("switch/turn_on", switch);
    assert_eq!(
        hass.entity(switch).unwrap()["attributes"]["start_inhibited"],
        false
    );
    order("switch/turn_off", switch, json!({}));
    plant.wait_until_it_stands();
    hass.wait_for(switch, "off");
    // A direction that is chosen at rest starts nothing.
    let seen = plant.written().len();
    order("fan/set_direction", fan, json!({ "direction": "reverse" }));
    order("fan/set_percentage", fan, json!({ "percentage": 60 }));
    plant.wait_for_write(seen, (FREQUENCY, 3000), PATIENCE);
    assert!(
        plant.written()[seen..]
            .iter()
            .all(|(register, _)| *register != RUN),
        "{:?}",
        plant.written()
    );
    starts("fan/turn_on", fan);
    until("the share is shown", PATIENCE, || {
        (hass.entity(fan)?["attributes"]["percentage"] == 60).then_some(())
    });
    order("fan/turn_off", fan, json!({}));
    plant.wait_until_it_stands();
    hass.wait_for(fan, "off");
}

/// Its automations are on and its script starts the drive, which then is stopped; whatever package and dashboard name is there.
fn the_delivered_package_works(hass: &Hass, plant: &Plant) {
    let entities = hass.entities();
    let states = |kind: &str| -> Vec<_> {
        let of_kind = |it: &&Value| {
            it["entity_id"]
                .as_str()
                .is_some_and(|id| id.starts_with(kind))
        };
        entities
            .iter()
            .filter(of_kind)
            .map(|it| it["state"].as_str().unwrap())
            .collect()
    };
    let automations = states("automation.");
    assert!(
        automations.len() == hass::package().matches("alias: ").count() - 1,
        "{automations:?}"
    );
    assert!(
        automations.iter().all(|state| *state == "on"),
        "{automations:?}"
    );
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/home-assistant");
    let files = ["package.yaml", "dashboard.yaml"].map(|name| folder.join(name));
    let named = entity_ids(&Value::Array(documents_of("yaml", &files)));
    assert!(named.len() > 15, "{named:?}");
    let missing: Vec<_> = named
        .iter()
        .filter(|id| entities.iter().all(|it| it["entity_id"] != id.as_str()))
        .collect();
    assert_eq!(missing, Vec::<&String>::new());

    let at = plant.written().len();
    until("the script's start is taken", PATIENCE, || {
        hass.call("script/pump_1_start", &json!({ "frequency_hz": 25.5 }));
        plant.written()[at..].contains(&(RUN, 1)).then_some(())
    });
    assert!(plant.written()[at..].contains(&(FREQUENCY, 2550)));
    plant.wait_until_it_turns();
    hass.call(
        "button/press",
        &json!({ "entity_id": "button.pump_1_stop" }),
    );
    plant.wait_until_it_stands();
}

/// Every entity that stands in `value`, however deep.
fn entity_ids(value: &Value) -> BTreeSet<String> {
    const KINDS: [&str; 6] = [
        "sensor.",
        "binary_sensor.",
        "button.",
        "number.",
        "event.",
        "input_boolean.",
    ];
    match value {
        Value::String(text) if KINDS.iter().any(|kind| text.starts_with(kind)) => {
            // A service is named like an entity.
            BTreeSet::from([text.clone()])
                .into_iter()
                .filter(|it| it != "button.press" && it != "number.set_value")
                .collect()
        }
        Value::Array(items) => items.iter().flat_map(entity_ids).collect(),
        Value::Object(fields) => fields.values().flat_map(entity_ids).collect(),
        _ => BTreeSet::new(),
    }
}
