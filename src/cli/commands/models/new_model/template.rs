//! Device templates of wb-mqtt-serial: their channels become registers that are only read. What a template states of orders
//! is left out, because it does not say what stops the motor.

use super::facts::{CitedDocuments, FactEvidence, ModelFacts, RegisterFacts};
use crate::cli::tools::CommandFailure;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// Most channels that are taken.
const CHANNELS_MAX: usize = 500;
/// Finest step that is taken, as steps in one unit.
const SCALE_MAX: u32 = 10_000;

/// The model called `id` from the template `text` in `file`.
pub fn facts(id: &str, file: &Path, text: &str) -> Result<ModelFacts, CommandFailure> {
    let wrong = |what: String| CommandFailure::wrong(format!("{}: {what}", file.display()));
    let json: Value =
        serde_json::from_str(text).map_err(|error| wrong(format!("it is not JSON: {error}")))?;
    let device = &json["device"];
    let Some(channels) = device["channels"].as_array() else {
        return Err(wrong(
            "it has no `device.channels`, and is no device template of wb-mqtt-serial".to_owned(),
        ));
    };
    let name = file
        .file_name()
        .map(|name| name.to_string_lossy().into_owned())
        .unwrap_or_default();
    let title = device["name"]
        .as_str()
        .or(json["device_type"].as_str())
        .unwrap_or(id);
    let (maker, series) = id.split_once('-').unwrap_or((id, id));
    let mut registers = TemplateRegisters::default();
    for channel in channels.iter().take(CHANNELS_MAX) {
        registers.add(channel);
    }
    if channels.len() > CHANNELS_MAX {
        registers
            .left_out
            .push(format!("all channels after the first {CHANNELS_MAX}"));
    }
    if device["setup"]
        .as_array()
        .is_some_and(|setup| !setup.is_empty())
    {
        registers
            .left_out
            .push("`setup`, which writes to the drive".to_owned());
    }
    if registers.taken.is_empty() {
        return Err(wrong(
            "no channel of it is a whole 16-bit register with decimal steps".to_owned(),
        ));
    }
    let evidence = FactEvidence::Template("not stated there".to_owned());
    Ok(ModelFacts {
        id: id.to_owned(),
        vendor: maker.to_owned(),
        title: series.to_owned(),
        documents: CitedDocuments {
            template: Some(format!("{title}, {name} of wb-mqtt-serial")),
            ..CitedDocuments::default()
        },
        link: None,
        max_words: (1, evidence.clone()),
        functions: (registers.functions(), evidence.clone()),
        evidence,
        run: None,
        flags: Vec::new(),
        setup: Vec::new(),
        registers: registers.taken,
        left_out: registers.left_out,
    })
}

#[derive(Default)]
struct TemplateRegisters {
    taken: Vec<RegisterFacts>,
    known: BTreeSet<(Option<&'static str>, u16)>,
    names: BTreeSet<String>,
    left_out: Vec<String>,
}

impl TemplateRegisters {
    fn add(&mut self, channel: &Value) {
        let title = channel["name"]
            .as_str()
            .unwrap_or("a channel without a name")
            .replace(['\n', '\r'], " ");
        match self.register(channel, &title) {
            Ok(register) => self.taken.push(register),
            Err(why) => self.left_out.push(format!("{title}: {why}")),
        }
    }

    fn register(&mut self, channel: &Value, title: &str) -> Result<RegisterFacts, String> {
        let table = match channel["reg_type"].as_str() {
            Some("holding") => None,
            Some("input") => Some("input"),
            Some("coil") => Some("coil"),
            Some("discrete") => Some("discrete"),
            other => {
                return Err(format!(
                    "registers of type {} are not known here",
                    other.unwrap_or("none")
                ));
            }
        };
        let address = address(&channel["address"])?;
        let signed = match channel["format"].as_str().unwrap_or("u16") {
            "u16" => false,
            "s16" => true,
            // The low byte is the value; the high byte is not said to be 0.
            other => return Err(format!("format {other} is not a whole 16-bit word")),
        };
        let scale = scale(channel["scale"].as_f64().unwrap_or(1.0))?;
        if channel["offset"]
            .as_f64()
            .is_some_and(|offset| offset != 0.0)
        {
            return Err("it has an offset".to_owned());
        }
        if !self.known.insert((table, address)) {
            return Err(format!("0x{address:04X} is there already"));
        }
        let is_off = channel["enabled"].as_bool() == Some(false);
        Ok(RegisterFacts {
            name: self.name(title, address),
            title: title.to_owned(),
            address,
            table,
            scale,
            unit: unit(channel, title),
            signed,
            access: "read",
            role: None,
            // What the template leaves off is read on request.
            poll: (!is_off || self.taken.is_empty()).then_some("slow"),
            evidence: FactEvidence::Template(format!("channel {title}")),
        })
    }

    /// A name of the model file, which is unique.
    fn name(&mut self, title: &str, address: u16) -> String {
        let mut name = String::new();
        for letter in title.chars().map(|letter| letter.to_ascii_lowercase()) {
            match letter {
                'a'..='z' => name.push(letter),
                '0'..='9' if !name.is_empty() => name.push(letter),
                _ if !name.is_empty() && !name.ends_with('_') => name.push('_'),
                _ => (),
            }
        }
        let mut name = name.trim_end_matches('_').to_owned();
        if name.is_empty() || self.names.contains(&name) {
            name = format!("register_{address:04x}_{}", self.names.len());
        }
        self.names.insert(name.clone());
        name
    }

    fn functions(&self) -> Vec<u8> {
        let function = |register: &RegisterFacts| match register.table {
            Some("coil") => 0x01,
            Some("discrete") => 0x02,
            Some(_) => 0x04,
            None => 0x03,
        };
        self.taken
            .iter()
            .map(function)
            .collect::<BTreeSet<u8>>()
            .into_iter()
            .collect()
    }
}

/// A whole register: a number, or its text in decimal or hexadecimal.
fn address(value: &Value) -> Result<u16, String> {
    let number = match value {
        Value::Number(number) => number.as_u64(),
        Value::String(text) if text.contains(':') => {
            return Err(format!("{text} is a part of a register"));
        }
        Value::String(text) => match text.strip_prefix("0x") {
            Some(digits) => u64::from_str_radix(digits, 16).ok(),
            None => text.parse().ok(),
        },
        _ => None,
    };
    number
        .and_then(|number| u16::try_from(number).ok())
        .ok_or_else(|| format!("{value} is no address"))
}

/// Steps in one unit; a template states the size of a step.
fn scale(step: f64) -> Result<u32, String> {
    let scales = [1, 10, 100, 1000, SCALE_MAX];
    let fits = |scale: &u32| (step * f64::from(*scale) - 1.0).abs() < 1e-6;
    scales
        .into_iter()
        .find(fits)
        .ok_or_else(|| format!("a step of {step} is not 1, 0.1, 0.01, ..."))
}

/// By the type of the channel, or by what stands in brackets in its name. Power is in W there and in kW here.
fn unit(channel: &Value, title: &str) -> &'static str {
    let named = ["Hz", "A", "V", "%"]
        .into_iter()
        .find(|unit| title.contains(&format!("({unit})")));
    let stated = channel["units"].as_str().and_then(|stated| {
        [
            ("Hz", "Hz"),
            ("A", "A"),
            ("V", "V"),
            ("%", "%"),
            ("deg C", "degC"),
            ("rpm", "rpm"),
            ("s", "s"),
            ("h", "h"),
        ]
        .into_iter()
        .find_map(|(theirs, ours)| (theirs == stated).then_some(ours))
    });
    let of_type = match channel["type"].as_str() {
        Some("voltage") => Some("V"),
        Some("current") => Some("A"),
        Some("temperature") => Some("degC"),
        _ => None,
    };
    stated.or(named).or(of_type).unwrap_or("-")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vendors;

    /// In the form of such templates; an invented drive.
    const TEMPLATE: &str = r#"{
        "device_type": "acme_flux",
        "device": {
            "name": "Acme Flux",
            "setup": [{ "title": "take over", "address": 1, "value": 2 }],
            "channels": [
                { "name": "Output Frequency (Hz)", "reg_type": "holding", "address": "0x2101", "format": "u16", "scale": 0.01, "readonly": true },
                { "name": "Motor current", "reg_type": "input", "address": 12, "type": "current", "scale": 0.1 },
                { "name": "Motor current", "reg_type": "input", "address": "13", "type": "current", "scale": 0.1 },
                { "name": "Torque", "reg_type": "holding", "address": 14, "format": "s16", "enabled": false },
                { "name": "Running", "reg_type": "holding", "address": "0x2100:0:1", "type": "switch" },
                { "name": "Energy", "reg_type": "holding", "address": 15, "format": "u32" },
                { "name": "Setpoint (%)", "reg_type": "holding", "address": 16, "scale": 0.0061035 },
                { "name": "Again", "reg_type": "holding", "address": 14 }
            ]
        }
    }"#;

    #[test]
    fn a_template_becomes_a_sound_model_that_is_only_read() {
        let facts = facts("acme-flux", Path::new("config-acme-flux.json"), TEMPLATE).unwrap();
        let text = facts.text();
        let catalog = vendors::catalog()
            .with_texts([("flux.toml", &text)])
            .unwrap_or_else(|found| panic!("{found:?}"));
        let model = catalog.find("acme-flux").unwrap();
        assert!(model.run.is_none());
        let names: BTreeSet<_> = model.registers.iter().map(|it| it.name.as_str()).collect();
        assert_eq!(
            names,
            BTreeSet::from([
                "motor_current",
                "output_frequency_hz",
                "register_000d_2",
                "torque"
            ])
        );
        for word in [
            "setup",
            "Running: 0x2100:0:1 is a part",
            "Energy: format u32",
            "0.0061035",
            "Again: 0x000E is there",
        ] {
            assert!(
                facts.left_out.iter().any(|it| it.contains(word)),
                "{word}: {:?}",
                facts.left_out
            );
        }
        assert!(text.contains("# Left out: Energy"), "{text}");
    }

    #[test]
    fn what_is_no_template_is_refused() {
        let refused = |text| {
            facts("acme-flux", Path::new("x.json"), text)
                .unwrap_err()
                .to_string()
        };
        assert!(refused("[").contains("x.json: it is not JSON"));
        assert!(refused("{}").contains("no `device.channels`"));
        assert!(refused(r#"{"device": {"channels": []}}"#).contains("no channel"));
    }
}
