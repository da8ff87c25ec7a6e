//! What a person wants added to the configuration, as the page sends it. Everything that is not exactly known is refused
//! by name.

use super::CommissioningRefusal;
use crate::config::words::FAIL_SAFES;
use crate::config::written::NewControl;
use serde_json::{Map, Value};

/// Most drives of a line.
const DRIVES_MAX: usize = 247;
/// Highest frequency in Hz.
const FREQUENCY_MAX_HZ: f64 = 1000.0;
/// Longest time in seconds that a commander may be silent.
const LOST_AFTER_MAX_S: u64 = 86_400;

/// What is to be added.
#[derive(Clone, Debug)]
pub enum WantedAddition {
    /// A line with drives that a scan has found.
    Line {
        /// Its name.
        name: String,
        /// Its drives.
        drives: Vec<WantedDrive>,
    },
    /// Control of a drive that has none.
    Control {
        /// The drive's name.
        drive: String,
        /// Its rules.
        control: NewControl,
    },
}

/// One drive that a scan has found.
#[derive(Clone, Debug)]
pub struct WantedDrive {
    /// Its name.
    pub name: String,
    /// Its station.
    pub station: u8,
    /// Its model.
    pub model: String,
    /// The frequency that stands for 100 %, for models that need it.
    pub full_scale_hz: Option<f64>,
    /// Who may command it; `None`: no client.
    pub control: Option<NewControl>,
}

/// What `body` wants, and the digest of the file that it is meant for, if it names one.
///
/// # Errors
/// What is wrong.
pub fn parse_addition(
    body: &[u8],
) -> Result<(WantedAddition, Option<String>), CommissioningRefusal> {
    let body: Value =
        serde_json::from_slice(body).map_err(|error| invalid_body(format!("no JSON: {error}")))?;
    let mut body = ObjectReader::new("", &body)?;
    let digest = body
        .optional("digest")
        .map(|value| text("digest", value))
        .transpose()?;
    let wanted = match body.optional("drive") {
        Some(drive) => WantedAddition::Control {
            drive: text("drive", drive)?,
            control: control("control", body.required("control")?)?,
        },
        None => {
            let mut line = ObjectReader::new("line", body.required("line")?)?;
            let name = text("line.name", line.required("name")?)?;
            line.finish()?;
            let drives = body
                .required("drives")?
                .as_array()
                .filter(|it| (1..=DRIVES_MAX).contains(&it.len()));
            let drives = drives.ok_or_else(|| {
                invalid_body(format!("`drives` must be a list of 1 to {DRIVES_MAX}"))
            })?;
            let drives = (0..)
                .zip(drives)
                .map(|(at, it)| drive(&format!("drives[{at}]"), it));
            WantedAddition::Line {
                name,
                drives: drives.collect::<Result<_, _>>()?,
            }
        }
    };
    body.finish()?;
    Ok((wanted, digest))
}

fn drive(place: &str, value: &Value) -> Result<WantedDrive, CommissioningRefusal> {
    let mut table = ObjectReader::new(place, value)?;
    let drive = WantedDrive {
        name: text(&format!("{place}.name"), table.required("name")?)?,
        station: table
            .required("station")?
            .as_u64()
            .and_then(|it| u8::try_from(it).ok())
            .filter(|it| (1..=247).contains(it))
            .ok_or_else(|| {
                invalid_body(format!("`{place}.station` must be a number from 1 to 247"))
            })?,
        model: text(&format!("{place}.model"), table.required("model")?)?,
        full_scale_hz: table
            .optional("full_scale_hz")
            .map(|value| frequency(&format!("{place}.full_scale_hz"), value))
            .transpose()?,
        control: table
            .optional("control")
            .map(|value| control(&format!("{place}.control"), value))
            .transpose()?,
    };
    table.finish()?;
    Ok(drive)
}

fn control(place: &str, value: &Value) -> Result<NewControl, CommissioningRefusal> {
    let mut table = ObjectReader::new(place, value)?;
    let at = |key: &str| format!("{place}.{key}");
    let from = table
        .required("from")?
        .as_array()
        .ok_or_else(|| invalid_body(format!("`{place}.from` must be a list")))?;
    let from = from
        .iter()
        .map(|it| text(&at("from"), it))
        .collect::<Result<Vec<_>, _>>()?;
    let least = frequency(&at("min_frequency_hz"), table.required("min_frequency_hz")?)?;
    let most = frequency(&at("max_frequency_hz"), table.required("max_frequency_hz")?)?;
    let has_reverse = match table.required("directions")?.as_str() {
        Some("forward") => false,
        Some("both") => true,
        _ => {
            return Err(invalid_body(format!(
                "`{place}.directions` must be \"forward\" or \"both\""
            )));
        }
    };
    let mut action = |key: &'static str| {
        let word = text(&at(key), table.required(key)?)?;
        let known = FAIL_SAFES.map(|(word, _)| word);
        if known.contains(&word.as_str()) {
            return Ok(word);
        }
        Err(invalid_body(format!(
            "`{place}.{key}` must be one of {}",
            known.join(", ")
        )))
    };
    let (on_commander_lost, on_shutdown) = (action("on_commander_lost")?, action("on_shutdown")?);
    let lost_after = table
        .required("lost_after_s")?
        .as_u64()
        .filter(|it| (1..=LOST_AFTER_MAX_S).contains(it));
    let lost_after = lost_after.ok_or_else(|| {
        invalid_body(format!(
            "`{place}.lost_after_s` must be from 1 to {LOST_AFTER_MAX_S}"
        ))
    })?;
    let accepts_unproven = match table.optional("accept_unverified") {
        None => false,
        Some(value) => value.as_bool().ok_or_else(|| {
            invalid_body(format!("`{place}.accept_unverified` must be true or false"))
        })?,
    };
    table.finish()?;
    let lost_after = format!("{lost_after}s");
    let limits_hz = (least, most);
    Ok(NewControl {
        from,
        limits_hz,
        has_reverse,
        on_commander_lost,
        lost_after,
        on_shutdown,
        accepts_unproven,
    })
}

fn frequency(place: &str, value: &Value) -> Result<f64, CommissioningRefusal> {
    let hz = value
        .as_f64()
        .filter(|hz| (0.0..=FREQUENCY_MAX_HZ).contains(hz));
    hz.ok_or_else(|| {
        invalid_body(format!(
            "`{place}` must be a frequency from 0 to {FREQUENCY_MAX_HZ} Hz"
        ))
    })
}

/// A text that stands in one line of a file, without control characters.
fn text(place: &str, value: &Value) -> Result<String, CommissioningRefusal> {
    let text = value
        .as_str()
        .filter(|text| text.len() <= 256 && !text.chars().any(char::is_control));
    text.map(str::to_owned)
        .ok_or_else(|| invalid_body(format!("`{place}` must be a text of one line")))
}

fn invalid_body(what: String) -> CommissioningRefusal {
    CommissioningRefusal::Wrong(what)
}

/// An object whose keys are taken one by one.
struct ObjectReader<'v> {
    place: String,
    keys: &'v Map<String, Value>,
    taken: Vec<&'static str>,
}

impl<'v> ObjectReader<'v> {
    fn new(place: &str, value: &'v Value) -> Result<Self, CommissioningRefusal> {
        let object = || {
            invalid_body(format!(
                "{} must be an object",
                if place.is_empty() { "the body" } else { place }
            ))
        };
        Ok(Self {
            place: place.to_owned(),
            keys: value.as_object().ok_or_else(object)?,
            taken: Vec::new(),
        })
    }

    /// The value of `key`, unless it is absent or null.
    fn optional(&mut self, key: &'static str) -> Option<&'v Value> {
        self.taken.push(key);
        self.keys.get(key).filter(|value| !value.is_null())
    }

    fn required(&mut self, key: &'static str) -> Result<&'v Value, CommissioningRefusal> {
        self.optional(key)
            .ok_or_else(|| invalid_body(format!("`{}` is missing", self.path(key))))
    }

    fn path(&self, key: &str) -> String {
        if self.place.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.place)
        }
    }

    /// Refuses keys that were not taken.
    fn finish(self) -> Result<(), CommissioningRefusal> {
        match self
            .keys
            .keys()
            .find(|key| !self.taken.contains(&key.as_str()))
        {
            Some(key) => Err(invalid_body(format!(
                "`{}` is not known here",
                self.path(key)
            ))),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn rules() -> Value {
        json!({
            "from": ["page"], "min_frequency_hz": 5, "max_frequency_hz": 50.5, "directions": "both",
            "on_commander_lost": "stop", "lost_after_s": 10, "on_shutdown": "coast",
        })
    }

    fn line(drive: Value) -> Value {
        json!({ "line": { "name": "hall-1" }, "drives": [drive] })
    }

    fn why(body: &Value) -> String {
        parse_addition(body.to_string().as_bytes())
            .map(drop)
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn a_line_or_the_control_of_a_drive_is_wanted() {
        let mut body = line(
            json!({ "name": "p1", "station": 1, "model": "m", "full_scale_hz": null, "control": rules() }),
        );
        body["digest"] = "d".into();
        let (found, digest) = parse_addition(body.to_string().as_bytes()).unwrap();
        let WantedAddition::Line { name, drives } = found else {
            panic!("a line")
        };
        let control = drives[0].control.clone().unwrap();
        assert_eq!(
            (name.as_str(), drives.len(), digest.as_deref()),
            ("hall-1", 1, Some("d"))
        );
        assert_eq!(
            (
                control.limits_hz,
                control.has_reverse,
                control.lost_after.as_str()
            ),
            ((5.0, 50.5), true, "10s")
        );
        assert!(!control.accepts_unproven, "it is asked for, never assumed");
        let given = json!({ "drive": "p1", "control": rules() });
        assert!(
            matches!(parse_addition(given.to_string().as_bytes()), Ok((WantedAddition::Control { drive, .. }, None)) if drive == "p1")
        );
    }

    #[test]
    fn what_decides_over_a_motor_is_never_left_out_and_nothing_unknown_is_passed_over() {
        for key in rules().as_object().unwrap().keys() {
            let mut rules = rules();
            rules.as_object_mut().unwrap().remove(key);
            assert_eq!(
                why(&json!({ "drive": "p1", "control": rules })),
                format!("`control.{key}` is missing")
            );
        }
        let with = |key: &str, value: Value| {
            let mut rules = rules();
            rules[key] = value;
            why(&line(
                json!({ "name": "p1", "station": 1, "model": "m", "control": rules }),
            ))
        };
        for (key, value, part) in [
            (
                "on_shutdown",
                json!("halt"),
                "must be one of stop, coast, hold",
            ),
            (
                "max_frequency_hz",
                json!("50"),
                "a frequency from 0 to 1000 Hz",
            ),
            (
                "max_frequency_hz",
                json!(1e9),
                "a frequency from 0 to 1000 Hz",
            ),
            ("lost_after_s", json!(0), "from 1 to 86400"),
            ("directions", json!("reverse"), "\"forward\" or \"both\""),
            (
                "takes",
                json!(true),
                "`drives[0].control.takes` is not known here",
            ),
        ] {
            let found = with(key, value);
            assert!(
                found.contains(part) && found.contains("drives[0].control"),
                "{found}"
            );
        }
        for (body, part) in [
            (
                line(json!({ "name": "a\nb", "station": 1, "model": "m" })),
                "a text of one line",
            ),
            (
                line(json!({ "name": "a", "station": 248, "model": "m" })),
                "from 1 to 247",
            ),
            (
                json!({ "line": { "name": "a" }, "drives": [] }),
                "a list of 1 to 247",
            ),
            (json!([]), "the body must be an object"),
        ] {
            assert!(why(&body).contains(part), "{}", why(&body));
        }
    }
}
