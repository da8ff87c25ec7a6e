//! Client identifiers at the broker: of two connections with the same one the broker ends the first.

use super::file::{ConfigFile, MqttFile, SparkplugFile};
use crate::domain::ids::Name;
use crate::domain::problem::Problem;
use crate::toml_file::{KeyLocation, OptionalKey};

const ENDED: &str = "the broker would close one connection when the other opens";

/// The Sparkplug connection has another identifier than that of `[mqtt]`, of this gateway and of its partner. The Sparkplug
/// connections of a pair have the same one: there is one at a time.
pub(super) fn are_distinct(file: &ConfigFile, mqtt: &MqttFile, problems: &mut Vec<Problem>) {
    let Some(sparkplug) = mqtt.sparkplug.valid().map(|it| &it.value) else {
        return;
    };
    let Some((of_mqtt, own)) = written(file, mqtt, sparkplug) else {
        return;
    };
    let halves = halves(file);
    let others = halves
        .iter()
        .map(|(half, location)| (format!("{of_mqtt}-{half}"), Some((half, *location))));
    let alone = halves.is_empty().then(|| (of_mqtt.clone(), None));
    let Some((_, whose)) = others.chain(alone).find(|(id, _)| *id == own) else {
        return;
    };
    match (sparkplug.client_id.valid(), whose) {
        (Some(written), None) => {
            let what = format!("the same as `client_id` in `[mqtt]`: {ENDED}");
            written.refuse(what, "another one, or leave it out", problems);
        }
        (Some(written), Some((half, _))) => {
            let what = format!(
                "the gateway `{half}` has this one for `[mqtt]`, with its `half` behind it: {ENDED}"
            );
            written.refuse(what, "another one, or leave it out", problems);
        }
        (None, Some((_, location))) => {
            let what =
                format!("`{own}` would be the identifier for `[mqtt]` and for Sparkplug: {ENDED}");
            let right = "another name, or `client_id` in `[mqtt.sparkplug]`";
            location.refuse(what, right, problems);
        }
        // What is left out has an end that the other one has not.
        (None, None) => {}
    }
}

/// The identifiers for `[mqtt]`, without a half, and for Sparkplug; `None` if a key is invalid.
fn written(
    file: &ConfigFile,
    mqtt: &MqttFile,
    sparkplug: &SparkplugFile,
) -> Option<(String, String)> {
    let id = |key: &OptionalKey<String>| key.clone().optional();
    let name = file.gateway.name.clone().optional()?;
    // The host's name, which is not known here, is one that no key has.
    let name = name.as_ref().map_or("?", Name::as_str);
    let of_mqtt = id(&mqtt.client_id)?.unwrap_or_else(|| format!("vfd-gateway-{name}"));
    let own = id(&sparkplug.client_id)?.unwrap_or_else(|| format!("{of_mqtt}-sparkplug"));
    Some((of_mqtt, own))
}

/// The names of the gateways of a pair; none if there is only one.
fn halves(file: &ConfigFile) -> Vec<(&str, &KeyLocation)> {
    let Some(standby) = file.standby.valid().map(|it| &it.value) else {
        return Vec::new();
    };
    let names = [standby.half.as_ref(), standby.partner.as_ref()]
        .into_iter()
        .flatten();
    names
        .map(|name| (name.value.as_str(), &name.location))
        .collect()
}
