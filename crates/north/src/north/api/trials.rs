//! Trials of what a model leaves unproven.

use super::ApiText;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Everything about the trials at a drive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrialDocument {
    /// The name of the drive.
    pub drive: ApiText,
    /// The name of its line.
    pub line: ApiText,
    /// Its model.
    pub model: ApiText,
    /// The digest of its model file.
    pub model_digest: Option<String>,
    /// The version of the program.
    pub version: Option<String>,
    /// The word by which the drive identifies itself.
    pub identity: Option<u16>,
    /// Why that word could not be read.
    pub not_identified: Option<String>,
    /// The version of the drive's firmware, if the drive tells.
    pub firmware: Option<u16>,
    /// Why earlier results no longer count.
    pub void: Option<String>,
    /// Why the file of earlier results cannot be used.
    pub damaged: Option<String>,
    /// Whether the drive has a control section.
    pub controlled: bool,
    /// Whether it is open to trials.
    pub qualify: bool,
    /// The actions to try.
    pub actions: Vec<TrialActionDocument>,
    /// What the drive does.
    pub state: TrialStateDocument,
    /// The frames of each order.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orders: Option<BTreeMap<String, Vec<TrialFrame>>>,
    /// The setpoint of a trial.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub setpoint_hz: Option<f64>,
    /// How long the commander may be silent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lost_after_ms: Option<u64>,
    /// What the drive gets after that.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub on_commander_lost: Option<String>,
    /// Whether its directions allow reverse.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub may_reverse: Option<bool>,
    /// Whether its directions allow forward.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub may_go_forward: Option<bool>,
    /// Whether it may be released to its panel or terminals.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub may_release: Option<bool>,
}

/// An action to try.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrialActionDocument {
    /// Its word.
    pub action: ApiText,
    /// The facts on which it rests.
    pub rests_on: Vec<String>,
    /// Whether the configuration accepts it by name.
    pub listed: bool,
    /// Whether it is accepted at present.
    pub in_force: bool,
    /// Whether the model file proves it.
    pub proven: bool,
    /// What was found before.
    pub result: Option<String>,
    /// By whom.
    pub by: Option<String>,
    /// When, in RFC 3339.
    pub at: Option<String>,
    /// Whether that counts.
    pub counts: bool,
}

/// A frame that an order sends.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrialFrame {
    /// The words that it writes.
    pub words: Vec<TrialWord>,
    /// Its bytes in hexadecimal.
    pub frame: ApiText,
}

/// A word that a frame writes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrialWord {
    /// The register.
    pub register: ApiText,
    /// The word.
    pub word: u16,
}

/// What a drive does, as it was last polled.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrialStateDocument {
    /// Whether it answers.
    pub presence: ApiText,
    /// Its run state.
    pub run_state: Option<String>,
    /// Its output frequency.
    pub output_hz: Option<f64>,
    /// How long ago that was read.
    pub age_ms: Option<u64>,
    /// Whether it is tripped, if that is known.
    pub tripped: Option<bool>,
    /// Whether it obeys its panel or terminals, if that is known.
    pub local: Option<bool>,
    /// Whether a stop is pending.
    pub stop_pending: bool,
    /// Its epoch, to be named by a start; `None` if it is read-only.
    pub epoch: Option<u64>,
}
