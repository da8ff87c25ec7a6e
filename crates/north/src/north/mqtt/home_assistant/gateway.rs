//! What the gateway shows of itself and its lines in Home Assistant.

use super::entity::{DiscoveryEntity, EntityComponent, EntityNeeds};
use super::ids;
use crate::domain::ids::Name;
use crate::north::mqtt::topics::MqttTopics;
use crate::north::titles::{PartTitle, PlantTitles};

const IS_UP: &str = "{{ value == 'up' if value else None }}";

/// The entities of the gateway with these lines.
pub(super) fn entities(
    topics: &MqttTopics,
    lines: &[Name],
    titles: &PlantTitles,
) -> Vec<DiscoveryEntity> {
    let connected = DiscoveryEntity::new(
        EntityComponent::BinarySensor,
        "connected",
        "Connected",
        EntityNeeds::Nothing,
    );
    let connected = connected
        .showing(topics.gateway("status"))
        .words("online", "offline")
        .class("connectivity");
    let version = DiscoveryEntity::new(
        EntityComponent::Sensor,
        "version",
        "Version",
        EntityNeeds::Gateway,
    );
    let version = version.made_of(
        topics.gateway("info"),
        "{{ value_json.version if value else 'unknown' }}",
    );
    let own = [connected.diagnostic(), version.diagnostic()];
    own.into_iter()
        .chain(lines.iter().flat_map(|name| line(topics, name, titles)))
        .collect()
}

fn line(topics: &MqttTopics, name: &Name, titles: &PlantTitles) -> Vec<DiscoveryEntity> {
    let title = titles.lines.get(name.as_str());
    let called = title.map_or(name.as_str().into(), PartTitle::isolated);
    let topic = || topics.line(name.as_str(), "status");
    let entity = |component, key, title: String| {
        DiscoveryEntity::new(
            component,
            ids::of_line(name, key),
            title,
            EntityNeeds::Gateway,
        )
        .diagnostic()
    };
    let up = entity(
        EntityComponent::BinarySensor,
        "up",
        format!("Line {called}"),
    );
    let status = entity(
        EntityComponent::Sensor,
        "status",
        format!("Line {called} status"),
    );
    let active = topics.half().map(|_| {
        let active = entity(
            EntityComponent::Sensor,
            "active",
            format!("Line {called} active gateway"),
        );
        active.showing_text(topics.line(name.as_str(), "active"))
    });
    let up = up
        .made_of(topic(), IS_UP)
        .words("True", "False")
        .class("connectivity");
    [up, status.showing_text(topic())]
        .into_iter()
        .chain(active)
        .collect()
}
