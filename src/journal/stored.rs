//! A trip event as it is kept: what is published of it, once, and its number.

use crate::domain::ids::Name;

/// A trip, or its clearing, that is kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredEvent {
    /// Its number; it rises for ever and is never used twice.
    pub seq: u64,
    /// The drive.
    pub drive: Name,
    /// What is published of it: a JSON object.
    pub body: String,
}
