//! What the gateway shows of itself and its lines in Home Assistant.

use super::entity::{Component, Entity, Needs};
use super::ids;
use crate::domain::ids::Name;
use crate::north::mqtt::topics::Topics;

const IS_UP: &str = "{{ value == 'up' if value else None }}";

/// The entities of the gateway with these lines.
pub(super) fn entities(topics: &Topics, lines: &[Name]) -> Vec<Entity> {
    let connected = Entity::new(
        Component::BinarySensor,
        "connected",
        "Connected",
        Needs::Nothing,
    );
    let connected = connected
        .showing(topics.gateway("status"))
        .words("online", "offline")
        .class("connectivity");
    let version = Entity::new(Component::Sensor, "version", "Version", Needs::Gateway);
    let version = version.made_of(
        topics.gateway("info"),
        "{{ value_json.version if value else 'unknown' }}",
    );
    let own = [connected.diagnostic(), version.diagnostic()];
    own.into_iter()
        .chain(lines.iter().flat_map(|name| line(topics, name)))
        .collect()
}

fn line(topics: &Topics, name: &Name) -> Vec<Entity> {
    let topic = || topics.line(name.as_str(), "status");
    let entity = |component, key, title: String| {
        Entity::new(component, ids::of_line(name, key), title, Needs::Gateway).diagnostic()
    };
    let up = entity(Component::BinarySensor, "up", format!("Line {name}"));
    let status = entity(Component::Sensor, "status", format!("Line {name} status"));
    let active = topics.half().map(|_| {
        let active = entity(
            Component::Sensor,
            "active",
            format!("Line {name} active gateway"),
        );
        active.telling(topics.line(name.as_str(), "active"))
    });
    let up = up
        .made_of(topic(), IS_UP)
        .words("True", "False")
        .class("connectivity");
    [up, status.telling(topic())]
        .into_iter()
        .chain(active)
        .collect()
}
