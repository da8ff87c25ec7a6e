//! The state of the journal, for health and metrics.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Whether rows are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum JournalState {
    /// Rows are written to the database.
    #[default]
    Ok,
    /// Rows cannot be written at present. The newest are kept in memory and written later.
    Failed,
    /// No database could be opened since the start: the newest are in memory only.
    Memory,
}

impl JournalState {
    /// The word that is shown.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Failed => "failed",
            Self::Memory => "memory",
        }
    }
}

/// The state and the counts of the journal.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JournalReport {
    /// Whether rows are kept.
    pub state: JournalState,
    /// Why not.
    pub reason: Option<String>,
    /// Where a damaged journal was moved to since the start, if one was.
    pub moved_aside: Option<String>,
    /// What happened to its file while it was open, if it was deleted or replaced.
    pub replaced: Option<String>,
    /// Rows written since the start.
    pub rows: u64,
    /// Attempts, events and other rows that could not be kept, since the start.
    pub lost: u64,
    /// Of these: attempts to write.
    pub attempts_lost: u64,
    /// Rows that wait to be written.
    pub waiting: u64,
    /// Groups of rows written since the start.
    pub commits: u64,
    /// Attempts to write that failed since the start.
    pub failures: u64,
    /// Bytes of the file.
    pub size_bytes: u64,
    /// How long the last group took.
    pub commit_time: Duration,
    /// How long the slowest one took.
    pub commit_time_max: Duration,
}

/// The report that the writer changes and others read.
#[derive(Debug, Default)]
pub struct JournalStatus(Mutex<JournalReport>);

impl JournalStatus {
    /// The present report.
    #[must_use]
    pub fn report(&self) -> JournalReport {
        self.lock().clone()
    }

    /// Whether rows are kept.
    #[must_use]
    pub fn is_ok(&self) -> bool {
        self.lock().state == JournalState::Ok
    }

    /// Changes it.
    pub fn change(&self, change: impl FnOnce(&mut JournalReport)) {
        change(&mut self.lock());
    }

    fn lock(&self) -> MutexGuard<'_, JournalReport> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
