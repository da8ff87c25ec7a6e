//! A frame as a JSON document.

use super::{FrameValue, TrafficFrame};
use serde_json::{Value, json};
use std::fmt::Write;
use std::time::Duration;

impl TrafficFrame {
    /// The frame with its `bytes`, sent or received `at`, RFC 3339 in UTC.
    #[must_use]
    pub fn json(&self, at: &str, bytes: &[u8]) -> Value {
        json!({
            "at": at,
            "kind": self.kind.keyword(),
            "why": self.why.map(|why| why.keyword()),
            "bytes": hex(bytes),
            "gap_ms": self.gap.map(millis),
            "on_wire_ms": millis(self.on_wire),
            "station": self.station.map(|station| station.0),
            "drive": self.drive.as_ref().map(|name| name.as_str()),
            "function": self.function,
            "exception": self.exception,
            "text": self.text,
            "values": self.values.iter().map(value).collect::<Vec<_>>(),
        })
    }
}

fn value(value: &FrameValue) -> Value {
    json!({ "address": value.address.number(), "name": value.name, "text": value.text })
}

fn hex(bytes: &[u8]) -> String {
    bytes
        .iter()
        .fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
            let _ = write!(text, "{byte:02X}");
            text
        })
}

/// Milliseconds with three decimals.
fn millis(span: Duration) -> f64 {
    (span.as_nanos() as f64 / 1e3).round() / 1e3
}
