//! Passes attempts of one north side that reached no line to the journal.

use crate::daemon::exchange::north_journal::Journal;
use crate::domain::command::{Owner, Report};
use crate::drive::description::DriveRef;
use crate::journal::{AttemptId, TriedWrite, WriteAttempt};
use std::sync::atomic::{AtomicU64, Ordering};

/// Numbers attempts and hands them on.
#[derive(Debug, Default)]
pub struct AttemptKeeper {
    journal: Journal,
    last: AtomicU64,
}

impl AttemptKeeper {
    /// Hands them on to `journal`.
    #[must_use]
    pub fn new(journal: Journal) -> Self {
        Self {
            journal,
            last: AtomicU64::default(),
        }
    }

    /// Keeps what `owner` tried. `drive` is `None` if it was for all drives or for one that does not exist.
    pub fn keep(&self, drive: Option<DriveRef>, owner: Owner, tried: TriedWrite, report: Report) {
        let Some(journal) = &self.journal else { return };
        let id = AttemptId(self.last.fetch_add(1, Ordering::Relaxed) + 1);
        journal.keep(
            drive,
            WriteAttempt {
                id,
                owner,
                tried,
                report: Some(report),
            },
        );
    }
}
