//! How a drive is commanded from Home Assistant: only if commands over MQTT are accepted, and only what is allowed.

use super::entity::{DiscoveryEntity, EntityComponent, EntityNeeds};
use crate::domain::command::Outcome;
use crate::domain::control::ControlSettings;
use crate::drive::description::DriveDescription;
use crate::north::mqtt::topics::MqttTopics;
use crate::north::shown::capabilities;
use crate::profile::model::RegisterRole;

/// RUN carries the time at which it was ordered, for drives that accept no other.
pub(super) const WITH_MOMENT: &str =
    r#"{"run": "{{ value }}", "issued_at": {{ (now().timestamp() * 1000) | int }}}"#;

/// Inputs of `drive` and the outcome of its last command; empty if commands over MQTT are not accepted.
pub(super) fn entities(topics: &MqttTopics, drive: &DriveDescription) -> Vec<DiscoveryEntity> {
    let Some(control) = drive.control.as_deref().filter(|control| control.from_mqtt) else {
        return Vec::new();
    };
    let topic = |rest: &str| topics.drive(drive.name.as_str(), rest);
    let can = capabilities(drive);
    let mut entities: Vec<_> = setpoint(drive, control, &topic).into_iter().collect();
    for (run, name, icon) in [
        ("forward", "Forward", "mdi:play"),
        ("reverse", "Reverse", "mdi:rotate-left"),
    ] {
        if can.contains(&run) {
            let button = button(run, name, EntityNeeds::Drive, run).icon(icon);
            entities.push(if control.strict {
                button
                    .with("command_topic", topic("command"))
                    .with("command_template", WITH_MOMENT)
            } else {
                button.with("command_topic", topic("run/set"))
            });
        }
    }
    for (run, name, icon) in [
        ("stop", "Stop", "mdi:stop-circle"),
        ("coast", "Coast", "mdi:stop-circle-outline"),
    ] {
        if can.contains(&run) {
            // A stop is accepted, and kept, also for a drive that does not answer. And it may arrive late.
            let button = button(run, name, EntityNeeds::Gateway, run)
                .icon(icon)
                .with("qos", 1);
            entities.push(button.with("command_topic", topic("run/set")));
        }
    }
    if can.contains(&"reset") {
        let reset =
            button("reset", "Reset trip", EntityNeeds::Drive, "reset").icon("mdi:restart-alert");
        entities.push(reset.with("command_topic", topic("trip/reset")));
    }
    entities.extend(last_command(&topic("result")));
    entities
}

fn button(key: &str, name: &str, needs: EntityNeeds, payload: &str) -> DiscoveryEntity {
    DiscoveryEntity::new(EntityComponent::Button, key, name, needs).with("payload_press", payload)
}

/// The setpoint within its limits. A setpoint of the drive that lies outside is shown by the sensor only: here it would
/// be an error.
fn setpoint(
    drive: &DriveDescription,
    control: &ControlSettings,
    topic: &dyn Fn(&str) -> String,
) -> Option<DiscoveryEntity> {
    let least = control.least.as_f64();
    let most = control.most.as_f64();
    let command = drive.model.register_for(RegisterRole::FrequencyCommand)?;
    let scale = if command.is_exact() {
        command.scale
    } else {
        100
    };
    if least >= most {
        return None;
    }
    let template = format!("{{{{ value if {least} <= (value | float(-1)) <= {most} else None }}}}");
    let number = DiscoveryEntity::new(
        EntityComponent::Number,
        "set_frequency",
        "Set frequency",
        EntityNeeds::Drive,
    );
    let number = number
        .made_of(topic("frequency/setpoint"), template)
        .with("command_topic", topic("frequency/set"));
    let number = number
        .with("min", least)
        .with("max", most)
        .with("step", 1.0 / f64::from(scale))
        .with("mode", "box");
    Some(number.with("unit_of_measurement", "Hz").class("frequency"))
}

/// The result is not retained by the broker: both are unknown until there is one.
fn last_command(topic: &str) -> [DiscoveryEntity; 2] {
    let sensor = |key: &str, name: &str, template: &str| {
        let entity = DiscoveryEntity::new(EntityComponent::Sensor, key, name, EntityNeeds::Gateway);
        entity.made_of(topic.to_owned(), template).diagnostic()
    };
    let words: Vec<_> = Outcome::ALL
        .iter()
        .map(|outcome| outcome.keyword())
        .collect();
    [
        sensor("last_command", "Last command", "{{ value_json.outcome }}")
            .class("enum")
            .with("options", words)
            .with("json_attributes_topic", topic),
        sensor(
            "last_reason",
            "Last command reason",
            "{{ value_json.reason }}",
        ),
    ]
}
