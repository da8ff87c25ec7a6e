//! One entity as announced to Home Assistant.

use crate::domain::units::UnitOfMeasure;
use serde_json::{Map, Value};

/// A kind of entity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EntityComponent {
    Sensor,
    BinarySensor,
    Number,
    Button,
    Event,
    Switch,
    Fan,
}

impl EntityComponent {
    /// The word as used in topics.
    pub(super) const fn keyword(self) -> &'static str {
        match self {
            Self::Sensor => "sensor",
            Self::BinarySensor => "binary_sensor",
            Self::Number => "number",
            Self::Button => "button",
            Self::Event => "event",
            Self::Switch => "switch",
            Self::Fan => "fan",
        }
    }
}

/// What must be online for an entity to be available.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EntityNeeds {
    /// Nothing: it shows whether something is online.
    Nothing,
    /// The gateway.
    Gateway,
    /// The gateway and the drive.
    Drive,
}

/// One entity.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct DiscoveryEntity {
    pub(super) component: EntityComponent,
    /// Distinguishes it from others of its device; begins with a letter.
    pub(super) key: String,
    pub(super) needs: EntityNeeds,
    /// Everything that is its own.
    pub(super) config: Map<String, Value>,
}

/// If the topic is empty, the value is unknown: a number is none then, and a text this word, which says so.
const NUMBER: &str = "{{ value or None }}";
const TEXT: &str = "{{ value or 'unknown' }}";

impl DiscoveryEntity {
    pub(super) fn new(
        component: EntityComponent,
        key: impl Into<String>,
        name: impl Into<String>,
        needs: EntityNeeds,
    ) -> Self {
        let config = Map::from_iter([("name".to_owned(), Value::from(name.into()))]);
        Self {
            component,
            key: key.into(),
            needs,
            config,
        }
    }

    pub(super) fn with(mut self, key: &str, value: impl Into<Value>) -> Self {
        self.config.insert(key.to_owned(), value.into());
        self
    }

    /// Shows the number, or one of two words, on `topic`.
    pub(super) fn showing(self, topic: String) -> Self {
        self.made_of(topic, NUMBER)
    }

    /// Shows the text on `topic`.
    pub(super) fn showing_text(self, topic: String) -> Self {
        self.made_of(topic, TEXT)
    }

    /// Shows what `template` makes of `topic`.
    pub(super) fn made_of(self, topic: String, template: impl Into<Value>) -> Self {
        self.with("state_topic", topic)
            .with("value_template", template)
    }

    /// The topic carries these words for on and off.
    pub(super) fn words(self, on: &str, off: &str) -> Self {
        self.with("payload_on", on).with("payload_off", off)
    }

    pub(super) fn class(self, class: &str) -> Self {
        self.with("device_class", class)
    }

    /// Shows this icon, where the class has none of its own.
    pub(super) fn icon(self, icon: &str) -> Self {
        self.with("icon", icon)
    }

    /// It describes the equipment, not what the equipment does.
    pub(super) fn diagnostic(self) -> Self {
        self.with("entity_category", "diagnostic")
    }

    /// A measurement in `unit` with this many decimals.
    pub(super) fn measured_in(self, unit: UnitOfMeasure, decimals: Option<u32>) -> Self {
        let (symbol, class) = match unit {
            UnitOfMeasure::Hertz => ("Hz", Some("frequency")),
            UnitOfMeasure::Ampere => ("A", Some("current")),
            UnitOfMeasure::Volt => ("V", Some("voltage")),
            UnitOfMeasure::Kilowatt => ("kW", Some("power")),
            UnitOfMeasure::Percent => ("%", None),
            UnitOfMeasure::Celsius => ("°C", Some("temperature")),
            UnitOfMeasure::Second => ("s", Some("duration")),
            UnitOfMeasure::Hour => ("h", Some("duration")),
            UnitOfMeasure::Rpm => ("rpm", None),
            UnitOfMeasure::KilowattHour => ("kWh", Some("energy")),
            UnitOfMeasure::MegawattHour => ("MWh", Some("energy")),
            UnitOfMeasure::NewtonMetre => ("Nm", None),
            UnitOfMeasure::Bar => ("bar", Some("pressure")),
            UnitOfMeasure::CubicMetrePerHour => ("m³/h", Some("volume_flow_rate")),
            UnitOfMeasure::LitrePerSecond => ("L/s", Some("volume_flow_rate")),
            UnitOfMeasure::Minute => ("min", Some("duration")),
            UnitOfMeasure::Day => ("d", Some("duration")),
            UnitOfMeasure::None => return self,
        };
        let entity = self.with("unit_of_measurement", symbol);
        let entity = if let Some(class) = class {
            entity.class(class)
        } else {
            entity
        };
        match decimals {
            Some(decimals) => entity.with("suggested_display_precision", decimals),
            None => entity,
        }
    }
}

/// A template for a place in a JSON document, which is unknown while the topic is empty.
pub(super) fn json_at(path: &str) -> String {
    format!("{{{{ value_json.{path} if value else None }}}}")
}

/// A name in our vocabulary, formatted for people.
pub(super) fn title(name: &str) -> String {
    let mut words = name.split('_').filter(|word| !word.is_empty());
    let first = words.next().map(|word| match word {
        "dc" | "ac" | "cpu" => word.to_uppercase(),
        word => word
            .chars()
            .take(1)
            .map(|c| c.to_ascii_uppercase())
            .chain(word.chars().skip(1))
            .collect(),
    });
    first
        .into_iter()
        .chain(words.map(str::to_owned))
        .collect::<Vec<_>>()
        .join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_titles() {
        for (name, right) in [
            ("dc_voltage", "DC voltage"),
            ("run_hours", "Run hours"),
            ("a", "A"),
            ("x__y_", "X y"),
        ] {
            assert_eq!(title(name), right);
        }
    }
}
