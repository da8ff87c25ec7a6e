//! A document that a tool understands and prints as it came.

use super::read_tolerantly;
use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::Value;

/// A document as this version knows it, and with everything that the gateway sent.
#[derive(Clone, Debug)]
pub struct PassedOn<T> {
    /// What this version knows of it.
    pub known: T,
    sent: Value,
}

impl<'de, T: DeserializeOwned> Deserialize<'de> for PassedOn<T> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let sent = Value::deserialize(from)?;
        let known = read_tolerantly(sent.clone()).map_err(D::Error::custom)?;
        Ok(Self { known, sent })
    }
}

impl<T> Serialize for PassedOn<T> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        self.sent.serialize(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::north::api::LineHealthDocument;

    #[test]
    fn a_document_of_another_version_is_understood_and_passed_on_as_it_is() {
        let sent = r#"{"name":"hall-1","newer":[1]}"#;
        let line: PassedOn<LineHealthDocument> = serde_json::from_str(sent).unwrap();
        assert_eq!(line.known.name, "hall-1");
        assert_eq!(line.known.state, "?");
        assert_eq!(line.known.standby, None);
        assert_eq!(serde_json::to_string(&line).unwrap(), sent);
    }
}
