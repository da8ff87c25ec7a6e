//! Looks for drives on an unused line. It only reads. `plan` says what is tried, `survey` tries it, `judge` says which
//! models a drive may be, `asker` sends the requests on a port.

pub mod asker;
pub mod judge;
pub mod plan;
pub mod survey;

use crate::daemon::lines::tool_line::NoLine;

/// What may help if no drive answers.
pub const ADVICE: &str = "nothing answers. Is the drive switched on, set to RS-485 and to a station among those that \
                          were asked? Are A and B swapped? Try --all-settings, or --stations 1-247";

/// Why a scan ended early, for people.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct ScanError(pub String);

impl ScanError {
    /// The line cannot be used, or another master uses it.
    pub fn new(what: impl Into<String>) -> Self {
        Self(what.into())
    }
}

impl From<NoLine> for ScanError {
    fn from(error: NoLine) -> Self {
        Self(error.to_string())
    }
}
