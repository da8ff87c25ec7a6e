//! The body of an order at the gateway's own socket: which registers are to be set for bus control.

use crate::domain::command::Go;
use serde_json::Value;

/// What a body looks like, for people.
pub const EXAMPLE: &str = r#"{"addresses": [529, 530]}"#;

/// The addresses that `body` names; nothing unless it is an object with them and nothing else.
#[must_use]
pub fn addresses(body: &[u8]) -> Option<Vec<u16>> {
    let Value::Object(object) = serde_json::from_slice(body).ok()? else { return None };
    let list = object.get("addresses").filter(|_| object.len() == 1)?.as_array()?;
    let is_bounded = (1..=Go::REGISTERS_MAX).contains(&list.len());
    let address = |value: &Value| u16::try_from(value.as_u64()?).ok();
    is_bounded.then(|| list.iter().map(address).collect())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_names_addresses_and_nothing_else() {
        assert_eq!(addresses(EXAMPLE.as_bytes()), Some(vec![529, 530]));
        let many = format!(r#"{{"addresses": [{}1]}}"#, "1,".repeat(Go::REGISTERS_MAX));
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
