//! A frame as a JSON document.

use super::{FrameValue, TrafficFrame};
use crate::domain::ids::Name;
use crate::north::api::{FrameDocument, FrameValueDocument};
use std::fmt::Write;
use std::time::Duration;

impl TrafficFrame {
    /// The frame with its `bytes`, sent or received `at`, RFC 3339 in UTC.
    #[must_use]
    pub fn document(&self, at: String, bytes: &[u8]) -> FrameDocument {
        FrameDocument {
            at,
            kind: self.kind.keyword().to_owned(),
            why: self.why.map(|why| why.keyword().to_owned()),
            bytes: hex(bytes),
            gap_ms: self.gap.map(millis),
            on_wire_ms: millis(self.on_wire),
            station: self.station.map(|station| station.0),
            drive: self.drive.as_ref().map(Name::to_string),
            function: self.function,
            exception: self.exception,
            text: self.text.clone(),
            values: self.values.iter().map(value).collect(),
        }
    }
}

fn value(value: &FrameValue) -> FrameValueDocument {
    FrameValueDocument {
        address: value.address.number(),
        name: value.name.clone(),
        text: value.text.clone().into(),
    }
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
