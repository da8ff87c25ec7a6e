//! What of a drive's document has changed since it was last sent.
//!
//! Most readings bring the number that was there before: all that changes then is how old it is, and that is sent as
//! one number for the whole drive.

use serde_json::{Map, Value};

/// Keys that say how old something is.
const AGES: [&str; 2] = ["age_ms", "oldest_ms"];
/// What a changed value leaves out, because it never changes.
const CONSTANT: [&str; 4] = ["label", "unit", "poll", "role"];

/// What of `new` is not in `old`, with the name of the drive: keys, and of `values` those that have another number, text or
/// quality. `None` if nothing is new but ages. Both are documents of the same drive.
#[must_use]
pub fn changes(old: &Value, new: &Value) -> Option<Value> {
    let (old, new) = (old.as_object()?, new.as_object()?);
    let mut found = Map::new();
    for (key, value) in new.iter().filter(|(key, _)| !AGES.contains(&key.as_str())) {
        match (key.as_str(), old.get(key)) {
            (_, Some(known)) if known == value => {}
            ("values", Some(known)) => {
                let changed = changed_values(known, value);
                if !changed.is_empty() {
                    found.insert(key.clone(), changed.into());
                }
            }
            _ => {
                found.insert(key.clone(), value.clone());
            }
        }
    }
    if found.is_empty() {
        return None;
    }
    found.insert(
        "name".to_owned(),
        new.get("name").cloned().unwrap_or_default(),
    );
    Some(Value::Object(found))
}

/// Values of one drive are always the same ones, in the same order.
fn changed_values(old: &Value, new: &Value) -> Vec<Value> {
    let rows = |values: &Value| values.as_array().cloned().unwrap_or_default();
    let changed = rows(old)
        .into_iter()
        .zip(rows(new))
        .filter(|(old, new)| !is_same(old, new));
    changed.map(|(_, new)| without_constants(new)).collect()
}

fn is_same(old: &Value, new: &Value) -> bool {
    let (Some(old), Some(new)) = (old.as_object(), new.as_object()) else {
        return false;
    };
    new.iter()
        .all(|(key, value)| AGES.contains(&key.as_str()) || old.get(key) == Some(value))
}

fn without_constants(mut value: Value) -> Value {
    if let Some(row) = value.as_object_mut() {
        row.retain(|key, _| !CONSTANT.contains(&key.as_str()));
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn drive(hertz: f64, age_ms: u64, state: &str) -> Value {
        json!({
            "name": "pump-1", "run_state": state, "oldest_ms": age_ms, "trip": { "active": false },
            "values": [
                { "name": "output_frequency", "label": "Output", "unit": "Hz", "value": hertz, "quality": "good", "age_ms": age_ms },
                { "name": "current", "label": "Current", "unit": "A", "value": 1.5, "quality": "good", "age_ms": age_ms },
            ],
        })
    }

    #[test]
    fn a_reading_of_the_same_numbers_changes_nothing_but_ages() {
        assert_eq!(
            changes(&drive(10.0, 100, "forward"), &drive(10.0, 700, "forward")),
            None
        );
    }

    #[test]
    fn only_what_is_new_is_sent_under_the_name_of_the_drive() {
        let found = changes(&drive(10.0, 100, "forward"), &drive(11.0, 700, "stopping")).unwrap();
        let right = json!({
            "name": "pump-1", "run_state": "stopping",
            "values": [{ "name": "output_frequency", "value": 11.0, "quality": "good", "age_ms": 700 }],
        });
        assert_eq!(found, right);
    }
}
