//! The bodies of requests.

use crate::north::command_words::without_mark;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// The body in `json`; `None` unless it is an object with the keys of `T` and no others.
#[must_use]
pub fn read_exactly<T: DeserializeOwned>(json: &[u8]) -> Option<T> {
    let json = without_mark(json);
    // A list of the values in order would be taken for an object.
    let is_object = json.trim_ascii_start().first() == Some(&b'{');
    if is_object {
        serde_json::from_slice(json).ok()
    } else {
        None
    }
}

/// The registers to set for bus control.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AddressesBody {
    /// Their addresses.
    pub addresses: Vec<u16>,
}

/// What to set the drive's own watchdog to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WatchdogBody {
    /// Its time; `None` for off, which has to be written as null.
    #[serde(deserialize_with = "Option::deserialize")]
    pub time_ms: Option<u64>,
}

/// What to write to a parameter.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NumberBody {
    /// The word, or the number in two words.
    pub raw: u32,
}

/// An order of a trial.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialBody {
    /// Its word.
    pub order: String,
    /// The epoch of the drive as it was last shown; a start needs it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub epoch: Option<u64>,
}

/// The result of a trial.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FindingBody {
    /// The action.
    pub action: String,
    /// The result.
    pub result: String,
    /// Who saw it.
    pub by: String,
}

/// Who asks for something.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PersonBody {
    /// The person's name.
    pub by: String,
}

/// The lines to hand over.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandOverBody {
    /// The name of a line; without it, all lines on which the gateway sends.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        deserialize_with = "named"
    )]
    pub line: Option<String>,
}

/// A name, which is not null.
fn named<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    String::deserialize(from).map(Some)
}

/// A user and the password, to sign in. It has no `Debug`, so that no password gets into a log.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SignInBody {
    /// The user.
    pub user: String,
    /// The password.
    pub password: String,
}

/// Nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EmptyBody {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_has_exactly_its_keys() {
        let read = |text: &str| read_exactly::<PersonBody>(text.as_bytes()).map(|body| body.by);
        assert_eq!(read(r#"{"by": "anna"}"#).as_deref(), Some("anna"));
        assert_eq!(
            read("\u{FEFF} {\"by\": \"anna\"} ").as_deref(),
            Some("anna")
        );
        for wrong in [
            "",
            "{}",
            r#"["anna"]"#,
            r#""anna""#,
            r#"{"by": null}"#,
            r#"{"by": "anna", "at": 1}"#,
            r#"{"by": "anna", "by": "otto"}"#,
            r#"{"by": "anna"} x"#,
        ] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn off_is_written_out_and_no_line_is_left_out() {
        let time = |text: &str| read_exactly::<WatchdogBody>(text.as_bytes());
        assert_eq!(
            time(r#"{"time_ms": null}"#),
            Some(WatchdogBody { time_ms: None })
        );
        assert_eq!(time("{}"), None);
        let line = |text: &str| read_exactly::<HandOverBody>(text.as_bytes());
        assert_eq!(line("{}"), Some(HandOverBody { line: None }));
        assert_eq!(line(r#"{"line": null}"#), None);
        assert!(read_exactly::<EmptyBody>(b" {} ").is_some());
        assert!(read_exactly::<EmptyBody>(b"{\"a\": 1}").is_none());
    }
}
