//! Why a command did not succeed.

use super::log;
use crate::daemon::lines::tool_line::NoLine;
use crate::daemon::scan::ScanError;
use std::fmt::Display;
use std::process::ExitCode;

/// Exit code for a command that failed.
const FAILED: u8 = 1;
/// Exit code for wrong usage or a wrong configuration, as clap has it.
pub(crate) const WRONG_USAGE: u8 = 2;

/// Why a command did not succeed. The message is already for people.
#[derive(Debug)]
pub struct CommandFailure {
    pub(crate) message: String,
    pub(crate) code: u8,
}

impl Display for CommandFailure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.message)
    }
}

impl CommandFailure {
    /// Something failed while the command ran.
    #[must_use]
    pub fn failed(message: impl Display) -> Self {
        Self {
            message: message.to_string(),
            code: FAILED,
        }
    }

    /// The arguments or a file that was given are wrong.
    #[must_use]
    pub fn wrong(message: impl Display) -> Self {
        Self {
            message: message.to_string(),
            code: WRONG_USAGE,
        }
    }

    /// Prints it to stderr, and returns the exit code.
    #[must_use]
    pub fn report(&self) -> ExitCode {
        log::complain(format!("{}\n", self.message).as_bytes());
        ExitCode::from(self.code)
    }
}

impl From<NoLine> for CommandFailure {
    fn from(error: NoLine) -> Self {
        Self::failed(error)
    }
}

impl From<ScanError> for CommandFailure {
    fn from(error: ScanError) -> Self {
        Self::failed(error)
    }
}
