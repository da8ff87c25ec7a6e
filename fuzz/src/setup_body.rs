//! The body of an order at the gateway's own socket: addresses and nothing else.

use serde_json::{Value, json};
use vfd_model::domain::command::GoOrder;
use vfd_north::north::command_words::without_mark;
use vfd_north::north::setup_body::addresses;

pub fn run(bytes: &[u8]) {
    let Some(addresses) = addresses(bytes) else {
        return;
    };
    assert!(
        (1..=GoOrder::REGISTERS_MAX).contains(&addresses.len()),
        "{addresses:?}"
    );
    let said: Value = serde_json::from_slice(without_mark(bytes)).expect("what is taken is JSON");
    assert_eq!(said, json!({ "addresses": addresses }));
}
