//! Content of announcements: of one drive of each kind in full, and what must hold for those of every model.

use super::entity::EntityComponent;
use super::plant::DiscoveryPlant;
use crate::domain::command::Direction;
use crate::domain::control::{ControlAction, ControlSettings};
use crate::domain::ids::Name;
use crate::domain::version::PROGRAM_VERSION;
use crate::drive::description::{DriveDescription, DriveRatings, PointSettings};
use crate::north::broker::MqttVersion;
use crate::north::mqtt::harness::{drives, identity, name, settings};
use crate::north::mqtt::payload::{self, InputRequest};
use crate::north::mqtt::topics::{MqttInbound, MqttTopics};
use crate::north::mqtt::types::{CombinedEntity, HomeAssistant, Settings};
use crate::north::titles::{PartTitle, PlantTitles};
use crate::profile::catalog::Catalog;
use crate::vendors;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::sync::Arc;

fn speaking(devices: bool) -> Settings {
    let home_assistant = Some(HomeAssistant {
        discovery: true,
        prefix: "homeassistant".into(),
        devices,
        combined: vec![CombinedEntity::Switch, CombinedEntity::Fan],
        page: Some("https://192.0.2.5:8443".into()),
    });
    Settings {
        home_assistant,
        ..settings(MqttVersion::V5)
    }
}

fn catalog() -> Catalog {
    vendors::catalog()
}

fn drive(model: &str, control: Option<ControlSettings>) -> DriveDescription {
    let [_, fan] = <[_; 2]>::try_from(drives()).unwrap();
    let model = catalog().find(model).unwrap().clone();
    DriveDescription {
        name: name("pump-1"),
        model,
        control: control.map(Arc::new),
        ..fan
    }
}

fn forward() -> ControlSettings {
    ControlSettings {
        directions: vec![Direction::Forward],
        ..crate::vendors::testing::control()
    }
}

/// Everything that any model can do.
fn all() -> ControlSettings {
    let control = crate::vendors::testing::control();
    ControlSettings {
        accept_unverified: ControlAction::ALL.to_vec(),
        allow_release: true,
        ..control
    }
}

/// What is announced of these drives, by topic.
fn announced(devices: bool, drives: &[DriveDescription]) -> Map<String, Value> {
    announced_as(&PlantTitles::default(), devices, drives)
}

/// What is announced of drives in a plant with these titles, by topic.
fn announced_as(
    titles: &PlantTitles,
    devices: bool,
    drives: &[DriveDescription],
) -> Map<String, Value> {
    let settings = speaking(devices);
    let lines = [name("hall")];
    let topics = MqttTopics::new(&identity(), &settings);
    let plant = DiscoveryPlant::of(&settings, &topics, titles, &lines, drives).unwrap();
    let mut announced = Map::new();
    for device in (0..).take_while(|device| plant.has_device(*device)) {
        let each = (0..).map_while(|entity| plant.announcement((device, entity)));
        announced.extend(
            each.map(|(topic, payload)| (topic, serde_json::from_slice(&payload).unwrap())),
        );
    }
    announced
}

/// Those of the drive alone.
fn of_drive(drive: DriveDescription) -> Map<String, Value> {
    announced(false, &[drive])
        .into_iter()
        .filter(|(topic, _)| topic.contains("/drive_"))
        .collect()
}

/// Compares with `tests/golden/home_assistant/`, or writes it with UPDATE_GOLDEN set.
fn golden(file: &str, found: Map<String, Value>) {
    let path = format!(
        "{}/../../tests/golden/home_assistant/{file}",
        env!("CARGO_MANIFEST_DIR")
    );
    let found = serde_json::to_string_pretty(&Value::Object(found)).unwrap() + "\n";
    let found = found.replace(&format!("\"{PROGRAM_VERSION}\""), "\"VERSION\"");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&path, &found).unwrap();
    }
    assert_eq!(found, std::fs::read_to_string(&path).unwrap(), "{path}");
}

#[test]
fn a_gateway_with_a_line() {
    golden("gateway.json", announced(false, &[]));
}

#[test]
fn a_drive_that_is_only_read() {
    let ratings = DriveRatings {
        current_ma: Some(10_000),
        voltage_mv: Some(400_000),
    };
    golden(
        "read_only.json",
        of_drive(DriveDescription {
            ratings,
            ..drive("toshiba-vf-s15", None)
        }),
    );
}

#[test]
fn a_drive_that_runs_forward() {
    let control = ControlSettings {
        strict: true,
        ..forward()
    };
    golden("forward.json", of_drive(drive("teco-e510", Some(control))));
}

#[test]
fn a_drive_that_runs_both_ways_and_coasts() {
    golden(
        "both_ways.json",
        of_drive(drive("frecon-fr500a", Some(all()))),
    );
}

/// Component, key and announcement of each entity of a drive.
fn entities(drive: DriveDescription) -> Vec<(String, String, Value)> {
    let part = |(topic, document): (String, Value)| {
        let levels: Vec<_> = topic.split('/').collect();
        let key = levels[3].strip_prefix("drive_pump-1_").unwrap().to_owned();
        (levels[1].to_owned(), key, document)
    };
    of_drive(drive).into_iter().map(part).collect()
}

fn every_drive() -> Vec<DriveDescription> {
    let catalog = catalog();
    let controls = || {
        [
            None,
            Some(forward()),
            Some(ControlSettings {
                strict: true,
                ..all()
            }),
            Some(all()),
        ]
    };
    catalog
        .ids()
        .flat_map(|id| controls().map(|control| drive(id, control)))
        .collect()
}

#[test]
fn nothing_commands_a_drive_that_takes_no_command_from_here() {
    let elsewhere = ControlSettings {
        from_mqtt: false,
        ..all()
    };
    for control in [None, Some(elsewhere)] {
        for id in catalog().ids() {
            for (component, key, document) in entities(drive(id, control.clone())) {
                assert!(
                    document.get("command_topic").is_none(),
                    "{id}: {component} {key}"
                );
                assert!(
                    !matches!(component.as_str(), "button" | "number" | "switch" | "fan"),
                    "{id}: {component} {key}"
                );
            }
        }
    }
}

#[test]
fn what_is_pressed_is_what_the_topics_take() {
    let topics = MqttTopics::new(&identity(), &speaking(false));
    let mut pressed = 0;
    for drive in every_drive() {
        let model = drive.model.clone();
        let can = crate::north::shown::capabilities(&drive);
        for (component, key, document) in entities(drive) {
            let Some(topic) = document.get("command_topic").and_then(Value::as_str) else {
                continue;
            };
            assert_eq!(document.get("retain"), None, "a command is never kept");
            // Their templates need Home Assistant, which the process tests have.
            if matches!(component.as_str(), "switch" | "fan") {
                continue;
            }
            let Some(MqttInbound::Drive(place)) = topics.parse(topic) else {
                panic!("{topic}")
            };
            let payload = match (component.as_str(), document.get("command_template")) {
                ("number", None) => document["max"].to_string(),
                (_, None) => document["payload_press"].as_str().unwrap().to_owned(),
                (_, Some(template)) => {
                    let press = document["payload_press"].as_str().unwrap();
                    let payload = template.as_str().unwrap().replace("{{ value }}", press);
                    payload.replace("{{ (now().timestamp() * 1000) | int }}", "1767225600000")
                }
            };
            let (_, asked) = payload::read(place.input, payload.as_bytes(), &model);
            assert!(
                matches!(asked, Ok(InputRequest::Order(_))),
                "{key}: {payload}: {asked:?}"
            );
            let word = if key == "set_frequency" {
                "frequency"
            } else {
                key.as_str()
            };
            assert!(can.contains(&word), "{key} is not among {can:?}");
            pressed += 1;
        }
    }
    assert!(pressed > 50, "{pressed}");
}

#[test]
fn a_switch_and_a_fan_are_announced_only_where_a_drive_may_be_started_and_stopped() {
    for drive in every_drive() {
        let can = crate::north::shown::capabilities(&drive);
        let may_start = can.contains(&"forward") && can.contains(&"stop");
        let reverses = can.contains(&"reverse");
        let id = drive.model.id.clone();
        let is_strict = drive.control.as_ref().is_some_and(|control| control.strict);
        let all = entities(drive);
        let of = |component: &str| {
            all.iter()
                .find(|(it, ..)| it == component)
                .map(|(_, _, document)| document)
        };
        assert_eq!(of("switch").is_some(), may_start && !is_strict, "{id}");
        for document in of("switch").into_iter().chain(of("fan")) {
            assert_eq!(
                document.get("qos"),
                None,
                "{id}: Home Assistant keeps it for a broker that is away"
            );
            assert_eq!(
                document["command_topic"]
                    .as_str()
                    .unwrap()
                    .ends_with("/command"),
                is_strict,
                "{id}"
            );
            assert_eq!(
                document.to_string().contains("issued_at"),
                is_strict,
                "{id}"
            );
        }
        if let Some(fan) = of("fan") {
            assert_eq!(
                fan.get("direction_command_topic").is_some(),
                reverses,
                "{id}"
            );
        }
    }
}

#[test]
fn everything_hangs_on_gateway_and_drive_but_a_stop_and_what_tells_of_them() {
    for drive in every_drive() {
        for (component, key, document) in entities(drive) {
            let topics: Vec<_> = document["availability"]
                .as_array()
                .unwrap()
                .iter()
                .map(|it| &it["topic"])
                .collect();
            assert_eq!(document["availability_mode"], "all");
            assert_eq!(topics[0], "vfd/plant/status");
            let is_of_the_gateway = matches!(
                key.as_str(),
                "connected"
                    | "stop"
                    | "coast"
                    | "last_command"
                    | "last_reason"
                    | "may_still_run"
                    | "last_seen"
            ) || key.starts_with("usage_");
            let of_drive: Vec<Value> = if is_of_the_gateway {
                Vec::new()
            } else {
                vec!["vfd/plant/drive/pump-1/availability".into()]
            };
            assert_eq!(
                topics[1..],
                of_drive.iter().collect::<Vec<_>>(),
                "{component} {key}"
            );
        }
    }
}

#[test]
fn ids_are_unique_over_gateways_drives_and_entities() {
    let named = |called: &str| DriveDescription {
        name: name(called),
        ..drive("frecon-fr500a", Some(all()))
    };
    let drives: Vec<_> = ["pump-1", "pump.1", "pump_1", "pump"].map(named).into();
    let announced = announced(false, &drives);
    let mut ids: Vec<_> = announced
        .values()
        .map(|it| it["unique_id"].as_str().unwrap())
        .collect();
    assert!(ids.iter().all(|id| id.starts_with("vfd-gateway-plant_")));
    let count = ids.len();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), count);
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '/');
    assert!(
        announced.keys().all(|topic| topic.chars().all(is_allowed)),
        "what Home Assistant takes as levels"
    );
}

#[test]
fn a_device_as_a_whole_holds_what_its_entities_do() {
    let drives = [
        drive("frecon-fr500a", Some(all())),
        DriveDescription {
            name: name("fan"),
            ..drive("teco-e510", None)
        },
    ];
    let single = announced(false, &drives);
    let whole = announced(true, &drives);
    let topics: Vec<_> = whole.keys().map(String::as_str).collect();
    let topic = |object: &str| format!("homeassistant/device/vfd-gateway-plant/{object}/config");
    assert_eq!(topics, ["drive_fan", "drive_pump-1", "gateway"].map(topic));
    let mut held = 0;
    for (topic, device) in &whole {
        let object = topic.split('/').nth(3).unwrap();
        for (key, component) in device["components"].as_object().unwrap() {
            let mut component = component.as_object().unwrap().clone();
            let platform = component.remove("platform").unwrap();
            let topic = format!(
                "homeassistant/{}/vfd-gateway-plant/{object}_{key}/config",
                platform.as_str().unwrap()
            );
            for shared in ["device", "origin"] {
                component.insert(shared.to_owned(), device[shared].clone());
            }
            assert_eq!(single[&topic], Value::Object(component), "{topic}");
            held += 1;
        }
    }
    assert_eq!(held, single.len());
}

#[test]
fn a_setpoint_that_cannot_be_chosen_is_no_number() {
    let least = forward().least;
    let fixed = entities(drive(
        "hyundai-n700",
        Some(ControlSettings {
            most: least,
            ..forward()
        }),
    ));
    assert!(
        fixed
            .iter()
            .all(|(component, ..)| component != EntityComponent::Number.keyword())
    );
    assert!(fixed.iter().any(|(_, key, _)| key == "forward"));
}

#[test]
fn a_value_is_shown_with_as_many_decimals_as_are_published() {
    let precision = |decimals| {
        let points = PointSettings {
            decimals,
            ..PointSettings::default()
        };
        let all = entities(DriveDescription {
            points,
            ..drive("hyundai-n700", None)
        });
        let output = all
            .into_iter()
            .find(|(_, key, _)| key == "output_frequency")
            .unwrap();
        output.2["suggested_display_precision"].clone()
    };
    assert_eq!(precision(Vec::new()), 2);
    assert_eq!(precision(vec![("output_frequency".to_owned(), 1)]), 1);
}

#[test]
fn lines_are_shown_by_their_names() {
    let settings = speaking(false);
    let topics = MqttTopics::new(&identity(), &settings);
    let lines = ["a_b", "a.b"].map(|it| Name::new(it).unwrap());
    let titles = PlantTitles::default();
    let plant = DiscoveryPlant::of(&settings, &topics, &titles, &lines, &[]).unwrap();
    let each: Vec<_> = (0..)
        .map_while(|entity| plant.announcement((0, entity)))
        .map(|(topic, _)| topic)
        .collect();
    for object in [
        "gateway_line_a__b_up",
        "gateway_line_a_-b_up",
        "gateway_line_a_-b_status",
    ] {
        assert!(
            each.iter()
                .any(|topic| topic.split('/').nth(3) == Some(object)),
            "{object} in {each:?}"
        );
    }
}

#[test]
fn a_title_is_shown_in_place_of_the_name_and_changes_no_topic_and_no_identifier() {
    let title = |text| PartTitle::new(text).unwrap();
    let titles = PlantTitles {
        drives: BTreeMap::from([("pump-1".to_owned(), title("مضخة 2"))]),
        gateway: Some(title("Werk \"Süd\" <b>")),
        groups: BTreeMap::new(),
        lines: BTreeMap::from([("hall".to_owned(), title("قاعة"))]),
    };
    for devices in [false, true] {
        let drives = [drive("hyundai-n700", Some(forward()))];
        let plain = announced(devices, &drives);
        let titled = announced_as(&titles, devices, &drives);
        let text_of = |all: &Map<String, Value>| Value::Object(all.clone()).to_string();
        let renamed = text_of(&titled)
            .replace("\"name\":\"مضخة 2\"", "\"name\":\"pump-1\"")
            .replace("\"name\":\"Werk \\\"Süd\\\" <b>\"", "\"name\":\"plant\"")
            .replace(
                "\"name\":\"Line \u{2068}قاعة\u{2069}",
                "\"name\":\"Line hall",
            );
        assert_ne!(text_of(&plain), text_of(&titled));
        assert_eq!(text_of(&plain), renamed);
    }
}
