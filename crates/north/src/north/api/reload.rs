//! Answers to requests that concern the gateway as a whole: a reload, and the hand-over of lines.

use super::ApiText;
use serde::{Deserialize, Serialize};

/// A reload that was carried out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ReloadDocument {
    /// True.
    pub reloaded: bool,
    /// What is different.
    pub changes: Vec<ConfigurationChange>,
    /// What is doubtful in the new configuration.
    pub warnings: Vec<ConfigurationWarning>,
}

/// A difference between two configurations.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ConfigurationChange {
    /// The kind of part.
    pub part: ApiText,
    /// The name of the part, if there are several.
    pub name: Option<String>,
    /// What happened to it.
    pub change: ApiText,
}

/// Something doubtful in a configuration.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ConfigurationWarning {
    /// Where.
    pub key: ApiText,
    /// What.
    pub what: ApiText,
    /// What would be right, if that is known.
    pub right: Option<String>,
}

/// A reload that was refused.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RefusedReload {
    /// False.
    pub reloaded: bool,
    /// The word for the reason.
    pub reason: ApiText,
    /// The drives that stand in the way.
    pub drives: Vec<String>,
    /// The reason for people.
    pub message: Option<String>,
}

/// The end of a hand-over.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct HandOverDocument {
    /// Whether any line was handed over.
    pub yielded: bool,
    /// The lines.
    pub lines: Vec<LineHandOver>,
}

/// The end of the hand-over of one line.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LineHandOver {
    /// The name of the line.
    pub line: ApiText,
    /// The word for the end.
    pub outcome: ApiText,
    /// The end for people.
    pub message: ApiText,
}
