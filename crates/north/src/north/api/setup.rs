//! Which drive answers, and how it is set for control over the bus.

use super::ApiText;
use serde::{Deserialize, Serialize};

/// The setup report of a drive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SetupDocument {
    /// The name of the drive.
    pub drive: ApiText,
    /// The name of its line.
    pub line: ApiText,
    /// Its model.
    pub model: ApiText,
    /// Whether everything was answered and is right.
    pub right: bool,
    /// Which drive it is; `None` if the model has no register that tells.
    pub identity: Option<IdentityDocument>,
    /// What it needs to obey the bus.
    pub items: Vec<SetupItemDocument>,
    /// Its own watchdog; `None` if the model has none.
    pub watchdog: Option<SetupWatchdogDocument>,
    /// Whether it obeys every command from the bus whatever its settings say.
    pub takes_priority: bool,
}

/// Which drive answers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct IdentityDocument {
    /// The register that tells.
    pub what: Option<String>,
    /// The bits of it that count.
    pub mask: Option<u16>,
    /// The words that a drive of the model shows.
    pub wanted: Vec<u16>,
    /// Whether it is right.
    pub result: ApiText,
    /// The model that it shows instead.
    pub other: Option<String>,
    /// What was read.
    #[serde(flatten)]
    pub seen: SeenWord,
}

/// A setting that a drive needs to obey the bus.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SetupItemDocument {
    /// The vendor's word for it.
    pub what: ApiText,
    /// What it is for.
    pub text: ApiText,
    /// Its address; `None` if it can only be checked at the drive.
    pub address: Option<u16>,
    /// The words that are right; the first is what `enable` writes.
    pub wanted: Vec<WordDocument>,
    /// Whether it is right.
    pub result: ApiText,
    /// What was read.
    #[serde(flatten)]
    pub seen: SeenWord,
}

/// The drive's own watchdog.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SetupWatchdogDocument {
    /// The register of its time.
    pub what: Option<String>,
    /// Whether it is on.
    pub state: ApiText,
    /// What the drive does when it expires.
    pub action: Option<WordDocument>,
    /// How its setting is judged.
    pub judged: Option<String>,
    /// Whether the setting outlasts the drive's power; `None` from a version that does not tell.
    pub is_stored: Option<bool>,
    /// What was read.
    #[serde(flatten)]
    pub seen: SeenWord,
}

/// What was read from a register, or why nothing was.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SeenWord {
    /// What was read.
    pub found: Option<WordDocument>,
    /// The word for why not.
    pub reason: Option<String>,
    /// Why not, for people.
    pub message: Option<String>,
    /// The exception that the drive answered with.
    pub exception: Option<u8>,
}

/// A word, or a number in two words, with its meaning.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WordDocument {
    /// The number.
    pub raw: u32,
    /// Its meaning, if it is more than a number.
    #[serde(default)]
    pub text: Option<String>,
}
