//! Refusals that concern no order.

use super::ApiText;
use serde::{Deserialize, Serialize};

/// Why a request is refused.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ErrorDocument {
    /// For people; `None` in an answer of another kind.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// There is no line of that name.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct UnknownLineDocument {
    /// For people.
    pub error: ApiText,
    /// The names of all lines.
    pub lines: Vec<String>,
}
