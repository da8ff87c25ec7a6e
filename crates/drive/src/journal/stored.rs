//! A stored trip event: its published body and its number.

use crate::domain::ids::Name;

/// A stored trip, or its clearing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredEvent {
    /// Its number; it only rises and is never reused.
    pub seq: u64,
    /// The drive.
    pub drive: Name,
    /// The published body: a JSON object.
    pub body: String,
}
