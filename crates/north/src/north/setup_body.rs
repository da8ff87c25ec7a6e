//! The body of an order at the gateway's own socket: which registers are to be set for bus control.

use super::api::{AddressesBody, NumberBody, WatchdogBody, read_exactly};
use crate::domain::command::GoOrder;
use std::time::Duration;

/// What a body looks like, for people.
pub const EXAMPLE: &str = r#"{"addresses": [529, 530]}"#;

/// The addresses that `body` names; `None` unless it is an object with only these.
#[must_use]
pub fn addresses(body: &[u8]) -> Option<Vec<u16>> {
    let AddressesBody { addresses } = read_exactly(body)?;
    let is_bounded = (1..=GoOrder::REGISTERS_MAX).contains(&addresses.len());
    is_bounded.then_some(addresses)
}

/// What the body of an order to set the drive's own watchdog looks like, for people.
pub const WATCHDOG_EXAMPLE: &str = r#"{"time_ms": 5000}"#;

/// The time that `body` names, or `Some(None)` for off; `None` unless it is an object with only that.
#[must_use]
pub fn watchdog_time(body: &[u8]) -> Option<Option<Duration>> {
    let WatchdogBody { time_ms } = read_exactly(body)?;
    if time_ms == Some(0) {
        return None;
    }
    Some(time_ms.map(Duration::from_millis))
}

/// What the body of an order to write one parameter looks like, for people.
pub const PARAMETER_EXAMPLE: &str = r#"{"raw": 100}"#;

/// The word, or the number in two words, that `body` names; `None` unless it is an object with only that.
#[must_use]
pub fn parameter_number(body: &[u8]) -> Option<u32> {
    read_exactly(body).map(|NumberBody { raw }| raw)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_names_one_word() {
        assert_eq!(parameter_number(PARAMETER_EXAMPLE.as_bytes()), Some(100));
        for wrong in [
            "",
            "100",
            r#"{"raw": -1}"#,
            r#"{"raw": 4294967296}"#,
            r#"{"raw": "1"}"#,
            r#"{"raw": 1, "to": 2}"#,
        ] {
            assert_eq!(parameter_number(wrong.as_bytes()), None, "{wrong}");
        }
    }

    #[test]
    fn a_body_names_one_time_or_none() {
        assert_eq!(
            watchdog_time(WATCHDOG_EXAMPLE.as_bytes()),
            Some(Some(Duration::from_secs(5)))
        );
        assert_eq!(watchdog_time(br#"{"time_ms": null}"#), Some(None));
        for wrong in [
            "",
            "5000",
            r#"{"time_ms": 0}"#,
            r#"{"time_ms": "5s"}"#,
            r#"{"time_ms": -1}"#,
            r#"{"time": 1}"#,
        ] {
            assert_eq!(watchdog_time(wrong.as_bytes()), None, "{wrong}");
        }
    }

    #[test]
    fn a_body_names_addresses_and_nothing_else() {
        assert_eq!(addresses(EXAMPLE.as_bytes()), Some(vec![529, 530]));
        let many = format!(
            r#"{{"addresses": [{}1]}}"#,
            "1,".repeat(GoOrder::REGISTERS_MAX)
        );
        for wrong in [
            "",
            "[529]",
            r#"{"addresses": []}"#,
            r#"{"addresses": [65536]}"#,
            r#"{"addresses": [-1]}"#,
            r#"{"addresses": ["529"]}"#,
            r#"{"addresses": 529}"#,
            r#"{"addresses": [529], "values": [3]}"#,
            &many,
        ] {
            assert_eq!(addresses(wrong.as_bytes()), None, "{wrong}");
        }
    }
}
