//! The end of control: the gateway shuts down, or the drive leaves the configuration or its line is restarted. Until then,
//! only stops are accepted.

use crate::domain::command::{Reason, Report};

/// Why a drive is commanded no longer, if it is not.
#[derive(Debug, Default)]
pub(super) struct Closing {
    is_ending: bool,
    is_leaving: bool,
}

impl Closing {
    /// The gateway shuts down.
    pub const fn end(&mut self) {
        self.is_ending = true;
    }

    /// The drive is about to leave the configuration, or stays after all.
    pub const fn leaves(&mut self, is_leaving: bool) {
        self.is_leaving = is_leaving;
    }

    /// Whether the drive may be commanded.
    pub fn may_command(&self) -> Result<(), Report> {
        if self.is_ending {
            return Err(Report::refused(Reason::ShuttingDown));
        }
        if self.is_leaving {
            Err(Report::refused(Reason::Removed))
        } else {
            Ok(())
        }
    }
}
