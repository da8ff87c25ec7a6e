//! The outcome of an order for a drive.

use super::ApiText;
use serde::{Deserialize, Serialize};

/// The outcome of an order, also of one that was refused before it reached the drive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct OrderOutcomeDocument {
    /// The name of the drive.
    pub drive: ApiText,
    /// The word for the outcome.
    pub outcome: ApiText,
    /// The word for the reason; `none` if there is none.
    pub reason: ApiText,
    /// The reason for people.
    pub message: ApiText,
    /// The word that the drive holds instead.
    pub held: Option<u16>,
    /// The exception that the drive answered with.
    pub exception: Option<u8>,
    /// What was written.
    pub changes: Vec<ChangeDocument>,
    /// The names of all drives, if there is none of this name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drives: Option<Vec<String>>,
}

/// A register that was written.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ChangeDocument {
    /// What it is.
    pub what: ApiText,
    /// Its address.
    pub address: Option<u16>,
    /// What it held, if that was read.
    pub old: Option<u32>,
    /// What was written.
    pub new: Option<u32>,
}
