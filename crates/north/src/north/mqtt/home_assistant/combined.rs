//! A drive as one switch or one fan, for dashboards and voice assistants that know nothing else. Both do what the buttons
//! and the number do, under the same rules; what keeps them from it is among their attributes.

use super::control::WITH_MOMENT;
use super::drive::RUNNING;
use super::entity::{DiscoveryEntity, EntityComponent, EntityNeeds};
use crate::domain::control::ControlSettings;
use crate::drive::description::DriveDescription;
use crate::north::mqtt::topics::MqttTopics;
use crate::north::mqtt::types::CombinedEntity;
use crate::north::shown::capabilities;
use crate::profile::model::RegisterRole;

/// What may keep a start from its effect, and who commands.
const HINDRANCES: &str = "{% set control = value_json.control if value else None %}\
    {{ {'start_inhibited': control.start_inhibited, 'stop_without_effect': control.not_effective, \
    'owner': control.owner, 'last_outcome': control.outcome, 'last_reason': control.reason} | tojson if control else '{}' }}";
/// The run state as a fan has it. It is unknown while the topic is empty.
const FAN_STATE: &str = "{{ 'None' if value in ('', 'unknown') else 'on' if value in ('forward', 'reverse', 'running', 'stopping') else 'off' }}";
/// A fan that is switched on turns as it turned, or forward.
const FAN_RUN: &str =
    "{{ (state_attr(entity_id, 'direction') or 'forward') if value == 'on' else 'stop' }}";
const FAN_FORWARD: &str = "{{ 'forward' if value == 'on' else 'stop' }}";
/// A direction that is chosen at rest starts nothing: an empty message orders nothing.
const FAN_DIRECTION: &str = "{{ value if is_state(entity_id, 'on') else '' }}";

/// The `wanted` combined entities of `drive`; empty if it takes no run command over MQTT.
pub(super) fn entities(
    topics: &MqttTopics,
    drive: &DriveDescription,
    wanted: &[CombinedEntity],
) -> Vec<DiscoveryEntity> {
    let Some(control) = drive.control.as_deref().filter(|control| control.from_mqtt) else {
        return Vec::new();
    };
    let can = capabilities(drive);
    if !["forward", "stop"].iter().all(|run| can.contains(run)) {
        return Vec::new();
    }
    let made = wanted.iter().filter_map(|kind| match kind {
        CombinedEntity::Switch => switch(topics, drive, control),
        CombinedEntity::Fan => fan(topics, drive, control, can.contains(&"reverse")),
    });
    let state = topics.drive(drive.name.as_str(), "state");
    made.map(|entity| {
        entity
            .with("json_attributes_topic", state.clone())
            .with("json_attributes_template", HINDRANCES)
    })
    .collect()
}

/// `None` for a drive that accepts only orders with their time: releases of Home Assistant in use send a switch's words as
/// they are.
fn switch(
    topics: &MqttTopics,
    drive: &DriveDescription,
    control: &ControlSettings,
) -> Option<DiscoveryEntity> {
    if control.strict {
        return None;
    }
    let topic = |rest: &str| topics.drive(drive.name.as_str(), rest);
    let switch = DiscoveryEntity::new(
        EntityComponent::Switch,
        "run_switch",
        "Run",
        EntityNeeds::Drive,
    )
    .icon("mdi:engine");
    let switch = switch
        .made_of(topic("run/state"), RUNNING)
        .with("state_on", "True")
        .with("state_off", "False");
    let switch = switch
        .with("payload_on", "forward")
        .with("payload_off", "stop");
    Some(switch.with("command_topic", topic("run/set")))
}

/// `None` if there is no setpoint to choose.
fn fan(
    topics: &MqttTopics,
    drive: &DriveDescription,
    control: &ControlSettings,
    reverses: bool,
) -> Option<DiscoveryEntity> {
    let (least, most) = (control.least.as_f64(), control.most.as_f64());
    drive.model.register_for(RegisterRole::FrequencyCommand)?;
    if least >= most {
        return None;
    }
    let topic = |rest: &str| topics.drive(drive.name.as_str(), rest);
    let fan = DiscoveryEntity::new(EntityComponent::Fan, "fan", "Fan", EntityNeeds::Drive)
        .icon("mdi:fan");
    let fan = fan
        .with("state_topic", topic("run/state"))
        .with("state_value_template", FAN_STATE);
    let fan = fan.with("payload_on", "on").with("payload_off", "off");
    let fan = ordering(
        fan,
        "command",
        &topic,
        control,
        if reverses { FAN_RUN } else { FAN_FORWARD },
    );
    let shown = format!(
        "{{{{ [[(value | float(0) * 100 / {most}) | round | int, 0] | max, 100] | min if value else 'None' }}}}"
    );
    let chosen = format!("{{{{ [{least}, value | float * {most} / 100] | max | round(2) }}}}");
    let fan = fan
        .with("percentage_state_topic", topic("frequency/setpoint"))
        .with("percentage_value_template", shown);
    let fan = fan
        .with("percentage_command_topic", topic("frequency/set"))
        .with("percentage_command_template", chosen);
    if !reverses {
        return Some(fan);
    }
    let turns = "{{ 'reverse' if value == 'reverse' else 'forward' }}";
    let fan = fan
        .with("direction_state_topic", topic("run/state"))
        .with("direction_value_template", turns);
    Some(ordering(
        fan,
        "direction_command",
        &topic,
        control,
        FAN_DIRECTION,
    ))
}

/// `entity`, whose run commands under `key` are what `template` makes of the value: with the time at which they were ordered
/// for drives that accept no other.
fn ordering(
    entity: DiscoveryEntity,
    key: &str,
    topic: &dyn Fn(&str) -> String,
    control: &ControlSettings,
    template: &str,
) -> DiscoveryEntity {
    let to = if control.strict { "command" } else { "run/set" };
    let entity = entity.with(&format!("{key}_topic"), topic(to));
    let template = if control.strict {
        WITH_MOMENT.replace("{{ value }}", template)
    } else {
        template.to_owned()
    };
    entity.with(&format!("{key}_template"), template)
}
