//! Kept trends on the disk: a database of its own beside the journal, so that samples never delay a trip.
//!
//! The page's task hands over finished minutes and never waits. One thread merges them into the rows of each level and
//! deletes the oldest rows, so that the file stays bounded. What cannot be written is lost, and the log says so once.

mod read;
mod store;
#[cfg(test)]
mod tests;

pub use read::history;

use crate::daemon::host::clock;
use crate::daemon::host::file_identity::FileIdentity;
use crate::daemon::journal::move_aside;
use crate::north::page::kept::TrendMinute;
use rusqlite::{Error, ErrorCode};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use store::TrendStore;

/// The file in the data directory.
pub const FILE_NAME: &str = "trends.db";
/// Minutes of all drives that wait for the disk.
const WAITING_MAX: usize = 8;

/// The kept trends of a running gateway.
#[derive(Debug)]
pub struct KeptTrends {
    file: PathBuf,
    minutes: SyncSender<Vec<TrendMinute>>,
}

impl KeptTrends {
    /// Starts the thread that writes into `directory`, which no other process uses.
    ///
    /// # Errors
    /// The system's refusal to start a thread.
    pub fn start(directory: &Path) -> io::Result<Arc<Self>> {
        let file = directory.join(FILE_NAME);
        let (minutes, waiting) = sync_channel(WAITING_MAX);
        let writer = TrendWriter {
            file: file.clone(),
            store: None,
            opened: None,
            is_failure_logged: false,
        };
        std::thread::Builder::new()
            .name("trends".to_owned())
            .spawn(move || writer.run(&waiting))?;
        Ok(Arc::new(Self { file, minutes }))
    }

    /// Keeps these minutes.
    pub fn keep(&self, minutes: Vec<TrendMinute>) {
        if minutes.is_empty() {
            return;
        }
        if let Err(TrySendError::Full(_)) = self.minutes.try_send(minutes) {
            tracing::warn!(file = %self.file.display(), "disk does not keep up; a minute of the trends is lost");
        }
    }

    /// The path of its file.
    #[must_use]
    pub fn file(&self) -> &Path {
        &self.file
    }
}

/// The thread's part.
struct TrendWriter {
    file: PathBuf,
    /// `None` until it could be opened.
    store: Option<TrendStore>,
    /// The file that is open.
    opened: Option<FileIdentity>,
    /// The log says that nothing is kept.
    is_failure_logged: bool,
}

impl TrendWriter {
    fn run(mut self, waiting: &Receiver<Vec<TrendMinute>>) {
        while let Ok(minutes) = waiting.recv() {
            match self.write(&minutes) {
                Ok(()) if self.is_failure_logged => {
                    self.is_failure_logged = false;
                    tracing::info!(file = %self.file.display(), "trends are kept again");
                }
                Ok(()) => {}
                Err(error) => self.fail(&error),
            }
        }
    }

    fn write(&mut self, minutes: &[TrendMinute]) -> Result<(), Error> {
        // A process does not notice when a file that it has open is deleted or replaced.
        if self.store.is_some() && FileIdentity::at(&self.file) != self.opened {
            self.store = None;
            tracing::error!(file = %self.file.display(), "trends were deleted or replaced; continuing with what is there");
        }
        let store = match self.store.take() {
            Some(store) => store,
            None => TrendStore::open(&self.file)?,
        };
        self.opened = FileIdentity::at(&self.file);
        self.store.insert(store).write(minutes)
    }

    fn fail(&mut self, error: &Error) {
        self.store = None;
        let file = self.file.display();
        if is_damaged(error) {
            match move_aside(&self.file, clock::wall()) {
                Ok(aside) => {
                    tracing::error!(%error, aside = %aside.display(), "trends were damaged; starting new ones")
                }
                Err(aside) => {
                    tracing::error!(%error, %aside, %file, "trends are damaged and cannot be moved aside")
                }
            }
        } else if !self.is_failure_logged {
            tracing::warn!(%error, %file, "trends cannot be kept; trying again every minute");
        }
        self.is_failure_logged = true;
    }
}

fn is_damaged(error: &Error) -> bool {
    matches!(
        error.sqlite_error_code(),
        Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase)
    )
}
