//! What a line is made of, ready to use.

use crate::domain::control::ControlSettings;
use crate::domain::ids::Station;
use crate::line::budget;
use crate::line::timing::Timing;
use crate::profile::model::Model;
use std::sync::Arc;
use std::time::Duration;

/// One line and its drives.
#[derive(Clone, Debug)]
pub struct LineSetup {
    /// Times on the wire.
    pub timing: Timing,
    /// The drives, in the order of the configuration.
    pub drives: Vec<DriveSetup>,
    /// Whether the traffic is told.
    pub tells_traffic: bool,
    /// Where the epochs of its drives begin: another number at each start of the gateway.
    pub first_epoch: u64,
}

impl LineSetup {
    /// Longest time from the acceptance of a stop for one drive to its first bit.
    #[must_use]
    pub fn worst_stop(&self) -> Duration {
        let drives = self.drives.iter().map(|drive| (drive.reply_timeout, drive.model.read.max_words.value));
        budget::worst_stop(&self.timing, drives)
    }
}

/// One drive of a line.
#[derive(Clone, Debug)]
pub struct DriveSetup {
    /// Number on the line.
    pub station: Station,
    /// What it is.
    pub model: Arc<Model>,
    /// Period of its fast polls.
    pub poll: Duration,
    /// Longest wait for a reply.
    pub reply_timeout: Duration,
    /// How long after a time-out a reply may still come.
    pub max_lateness: Duration,
    /// What may be commanded; nothing: it is read-only from everywhere.
    pub control: Option<Arc<ControlSettings>>,
}
