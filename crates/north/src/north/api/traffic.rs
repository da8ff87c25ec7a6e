//! The traffic of a line, event by event.

use super::ApiText;
use serde::{Deserialize, Serialize};

/// The line whose traffic follows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrafficLineDocument {
    /// Its name.
    pub line: ApiText,
    /// Its framing.
    pub framing: ApiText,
    /// Its port.
    pub port: ApiText,
    /// Speed and characters; `None` over Modbus TCP, which has neither.
    pub link: Option<String>,
    /// Speed in bit/s.
    pub baud: Option<u32>,
    /// Its drives.
    pub drives: Vec<TrafficDriveDocument>,
}

/// A drive on that line.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrafficDriveDocument {
    /// Its name.
    pub name: ApiText,
    /// Its station number.
    pub station: u8,
    /// Its model.
    pub model: ApiText,
}

/// A frame, or bytes that make none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameDocument {
    /// When it was sent or received, in RFC 3339 with microseconds.
    pub at: String,
    /// The kind of frame.
    pub kind: String,
    /// Why the gateway sent it.
    #[serde(default)]
    pub why: Option<String>,
    /// The bytes in hexadecimal.
    pub bytes: String,
    /// The silence before it; `None` before the first one.
    #[serde(default)]
    pub gap_ms: Option<f64>,
    /// How long it took on the wire.
    #[serde(default)]
    pub on_wire_ms: f64,
    /// Its station.
    #[serde(default)]
    pub station: Option<u8>,
    /// The drive at that station.
    #[serde(default)]
    pub drive: Option<String>,
    /// Its function code.
    #[serde(default)]
    pub function: Option<u8>,
    /// The code of an exception.
    #[serde(default)]
    pub exception: Option<u8>,
    /// Its content in words.
    #[serde(default)]
    pub text: String,
    /// The registers in it.
    #[serde(default)]
    pub values: Vec<FrameValueDocument>,
}

/// A register in a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FrameValueDocument {
    /// Its address on the wire.
    pub address: u16,
    /// Its name in the model.
    pub name: Option<String>,
    /// Its value with the unit, or with its meaning.
    pub text: ApiText,
}

/// Records that a client will not get, because it did not read them in time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LostRecords {
    /// How many.
    pub records: u64,
}

impl Default for LostRecords {
    /// Where another version does not say how many, it was one at least.
    fn default() -> Self {
        Self { records: 1 }
    }
}
