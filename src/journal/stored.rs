//! An event that is kept, as it goes to the broker.

use crate::domain::ids::Name;

/// A trip, or its end, that is kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredEvent {
    /// Its number: rising for ever, never used twice.
    pub seq: u64,
    /// The drive that it is about.
    pub drive: Name,
    /// What is published, JSON.
    pub body: String,
}
