//! The identifiers and topics under which Home Assistant knows the gateway's entities. They follow from names only, so
//! that they stay the same over restarts, and no two names give the same.

use crate::domain::ids::Name;

/// The topic level that contains everything of one gateway.
pub(super) fn node(gateway: &Name) -> String {
    format!("vfd-gateway-{}", escaped(gateway))
}

/// The name of the gateway itself below its node.
pub(super) const GATEWAY: &str = "gateway";

/// The name of a drive below its gateway's node.
pub(super) fn drive(name: &Name) -> String {
    format!("drive_{}", escaped(name))
}

/// The name of a device's entity below the node. `key` begins with a letter.
pub(super) fn entity(device: &str, key: &str) -> String {
    format!("{device}_{key}")
}

/// The name of a line's entity among those of the gateway.
pub(super) fn of_line(name: &Name, key: &str) -> String {
    format!("line_{}_{key}", escaped(name))
}

/// Identifies a device or an entity over everything that Home Assistant has.
pub(super) fn unique(node: &str, object: &str) -> String {
    format!("{node}_{object}")
}

/// Where something is announced.
pub(super) fn topic(prefix: &str, component: &str, node: &str, object: &str) -> String {
    format!("{prefix}/{component}/{node}/{object}/config")
}

/// Everything that is announced under `node`.
pub(super) fn filter(prefix: &str, node: &str) -> String {
    format!("{prefix}/+/{node}/+/config")
}

/// Component and object of a topic under `node`; `None` if it cannot be ours.
pub(super) fn parse<'t>(topic: &'t str, prefix: &str, node: &str) -> Option<(&'t str, &'t str)> {
    /// Longer than every object that names can give.
    const OBJECT_MAX_BYTES: usize = 256;
    const COMPONENT_MAX_BYTES: usize = 64;
    let (component, rest) = topic
        .strip_prefix(prefix)?
        .strip_prefix('/')?
        .split_once('/')?;
    let object = rest
        .strip_prefix(node)?
        .strip_prefix('/')?
        .strip_suffix("/config")?;
    let is_word = |text: &str, most| {
        let fits = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_');
        (1..=most).contains(&text.len()) && text.bytes().all(fits)
    };
    (is_word(component, COMPONENT_MAX_BYTES) && is_word(object, OBJECT_MAX_BYTES))
        .then_some((component, object))
}

/// A name in the letters that such a level may have, which exclude the dot. A single `_` is followed by a letter, so
/// the end of the name is unambiguous.
fn escaped(name: &Name) -> String {
    name.as_str().replace('_', "__").replace('.', "_-")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::north::mqtt::harness::name;
    use std::collections::BTreeSet;

    #[test]
    fn different_names_give_different_objects() {
        let names = [
            "a", "a.b", "a_b", "a-b", "a__b", "a_-b", "a.-b", "a_.b", "a_stop", "a_", "a.", "a_-",
            "a__",
        ];
        let keys = ["stop", "b_stop", "b"];
        let objects: BTreeSet<_> = names
            .iter()
            .flat_map(|it| keys.map(|key| entity(&drive(&name(it)), key)))
            .collect();
        assert_eq!(objects.len(), names.len() * keys.len(), "{objects:?}");
    }

    #[test]
    fn own_topics_are_distinguished_from_others() {
        let node = node(&name("plant.a"));
        assert_eq!(node, "vfd-gateway-plant_-a");
        let own = topic("ha/disco", "sensor", &node, "drive_pump_current");
        assert_eq!(
            own,
            "ha/disco/sensor/vfd-gateway-plant_-a/drive_pump_current/config"
        );
        assert_eq!(
            parse(&own, "ha/disco", &node),
            Some(("sensor", "drive_pump_current"))
        );
        for other in [
            "ha/disco/sensor/vfd-gateway-plant_-a/config",
            "ha/disco/sensor/vfd-gateway-plant_-a/x/state",
            "ha/disco/sensor/vfd-gateway-plant_-ab/x/config",
            "ha/disco/sensor/vfd-gateway-plant_-a/x/y/config",
            "ha/disco/sensor/vfd-gateway-plant_-a//config",
            "ha/disco//vfd-gateway-plant_-a/x/config",
            "ha/disco/sensor/vfd-gateway-plant_-a/x+/config",
            "ha/disco2/sensor/vfd-gateway-plant_-a/x/config",
            "",
        ] {
            assert_eq!(parse(other, "ha/disco", &node), None, "{other}");
        }
        let long = topic("ha/disco", "sensor", &node, &"x".repeat(257));
        assert_eq!(parse(&long, "ha/disco", &node), None);
    }
}
