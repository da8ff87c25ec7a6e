//! The parameters of a drive.

use super::{ApiText, SeenWord};
use serde::{Deserialize, Serialize};

/// What the model of a drive knows of its parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ParameterListDocument {
    /// The name of the drive.
    pub drive: ApiText,
    /// The name of its line.
    pub line: ApiText,
    /// Its model.
    pub model: ApiText,
    /// Whether anything may be written to this drive at all.
    pub may_be_written: bool,
    /// The parameters.
    pub parameters: Vec<ListedParameterDocument>,
    /// What follows the last parameter that is written; `None` if the drive needs nothing.
    pub commit: Option<CommitDocument>,
    /// The registers of the model that are not parameters.
    pub left_out: Vec<LeftOutDocument>,
    /// The groups of the drive's parameters, where the model has a rule for them.
    pub groups: Vec<ParameterGroupDocument>,
}

/// A parameter that a model knows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ListedParameterDocument {
    /// The vendor's code, or else its name.
    #[serde(default)]
    pub code: ApiText,
    /// Its name.
    #[serde(default)]
    pub name: ApiText,
    /// What it is.
    #[serde(default)]
    pub title: ApiText,
    /// Its address on the wire.
    pub address: u16,
    /// Its unit of measure.
    #[serde(default)]
    pub unit: ApiText,
    /// What a tool may do with it.
    #[serde(default)]
    pub kind: ApiText,
    /// Why it is never written, if so.
    #[serde(default)]
    pub reason: Option<String>,
    /// Whether writing it wears a memory; it is taken to where another version does not tell.
    #[serde(default = "yes")]
    pub is_stored: bool,
}

const fn yes() -> bool {
    true
}

/// A word after which a drive takes over or stores its parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CommitDocument {
    /// `store` or `apply`.
    pub does: ApiText,
    /// Its register.
    pub what: Option<String>,
    /// Whether the gateway sends it; otherwise it is unproven.
    pub is_sent: bool,
}

/// A register that is not a parameter.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LeftOutDocument {
    /// The vendor's code, or else its name.
    pub code: ApiText,
    /// Its address on the wire.
    pub address: u16,
    /// Why it is none.
    pub reason: ApiText,
}

/// A group of parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ParameterGroupDocument {
    /// Its name.
    pub name: ApiText,
    /// The addresses that the model does not describe: the drive may or may not have them.
    pub unknown: Vec<u16>,
}

/// The present value of a parameter.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ParameterDocument {
    /// The vendor's code, or else its name.
    pub code: ApiText,
    /// Its address on the wire.
    pub address: u16,
    /// What was read.
    #[serde(flatten)]
    pub seen: SeenWord,
}
