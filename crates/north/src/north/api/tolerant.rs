//! How a tool reads a document of a gateway that is a version older or newer.

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

/// Whether a document may be as it is.
type IsValid<'t> = &'t mut dyn FnMut(&Value) -> bool;

/// Reads what `sent` has of a `T`. A value that is not of its type is left out like a missing one, so that it hides
/// nothing else of the document.
///
/// # Errors
/// What remains without such values is no `T` either.
pub fn read_tolerantly<T: DeserializeOwned>(sent: Value) -> Result<T, serde_json::Error> {
    match T::deserialize(&sent) {
        Ok(read) => Ok(read),
        Err(error) => match valid_part(sent, &mut |part| T::deserialize(part).is_ok()) {
            Some(part) => T::deserialize(part),
            None => Err(error),
        },
    }
}

/// The largest part of `sent` that `is_valid`; `None` if there is none.
fn valid_part(sent: Value, is_valid: IsValid<'_>) -> Option<Value> {
    if is_valid(&sent) {
        return Some(sent);
    }
    match sent {
        Value::Object(keys) => {
            let mut part = Map::new();
            for (key, value) in keys {
                let kept = valid_part(value, &mut |value| {
                    let mut with = part.clone();
                    with.insert(key.clone(), value.clone());
                    is_valid(&Value::Object(with))
                });
                if let Some(value) = kept {
                    part.insert(key, value);
                }
            }
            Some(Value::Object(part)).filter(|part| is_valid(part))
        }
        Value::Array(elements) => {
            let mut part = Vec::new();
            for element in elements {
                let kept = valid_part(element, &mut |element| {
                    let mut with = part.clone();
                    with.push(element.clone());
                    is_valid(&Value::Array(with))
                });
                part.extend(kept);
            }
            Some(Value::Array(part)).filter(|part| is_valid(part))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::north::api::HealthDocument;
    use serde_json::json;

    #[test]
    fn a_value_of_another_type_hides_nothing_else() {
        let sent = json!({
            "gateway": "plant",
            "uptime_seconds": "long",
            "journal": { "rows": [], "state": "keeps" },
            "lines": [{ "name": "hall-1", "reason": 7, "state": "down" }, "hall-2"],
            "drives": [
                { "name": "fan", "unit": 900, "refused": null },
                { "name": "pump", "may_still_run": true },
            ],
        });
        let health: HealthDocument = read_tolerantly(sent).unwrap();
        assert_eq!((&*health.gateway, health.uptime_seconds), ("plant", 0));
        assert_eq!(health.journal.unwrap().state, "keeps");
        assert_eq!(health.lines.len(), 1);
        assert_eq!(
            (&*health.lines[0].state, &health.lines[0].reason),
            ("down", &None)
        );
        let drives: Vec<_> = health
            .drives
            .iter()
            .map(|it| (&*it.name, it.may_still_run))
            .collect();
        assert_eq!(drives, [("fan", false), ("pump", true)]);
    }

    #[test]
    fn what_is_no_document_is_refused() {
        assert!(read_tolerantly::<HealthDocument>(json!("down")).is_err());
    }
}
