//! The files of an open database, which may be deleted or replaced.

use super::database::JournalDatabase;
use crate::daemon::host::file_identity::FileIdentity;
use rusqlite::Error;
use rusqlite::config::DbConfig;
use std::io;
use std::path::{Path, PathBuf};

/// The files that are open: the database and its log, once that is there.
#[derive(Debug)]
pub struct OpenFiles {
    file: Option<FileIdentity>,
    log: Option<FileIdentity>,
}

/// What happened to the open files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileLoss {
    /// There is no file at the path of the database.
    Deleted,
    /// Another file is at the path of the database.
    Replaced,
    /// The log is gone or another one.
    Log,
}

impl OpenFiles {
    /// The files of the database that was just opened at `path`.
    #[must_use]
    pub fn at(path: &Path) -> Self {
        Self {
            file: FileIdentity::at(path),
            log: FileIdentity::at(&log_of(path)),
        }
    }

    /// What happened to them since; `None`: they are the same.
    pub fn loss(&mut self, path: &Path) -> Option<FileLoss> {
        let file = FileIdentity::at(path);
        if file != self.file {
            return Some(if file.is_none() {
                FileLoss::Deleted
            } else {
                FileLoss::Replaced
            });
        }
        let log = FileIdentity::at(&log_of(path));
        if self.log.is_none() {
            self.log = log;
        }
        (log != self.log).then_some(FileLoss::Log)
    }

    /// Whether the log at `path` is still the one that was opened.
    #[must_use]
    pub fn has_log(&self, path: &Path) -> bool {
        self.log.is_some() && FileIdentity::at(&log_of(path)) == self.log
    }
}

impl JournalDatabase {
    /// Writes all that the journal holds into a new file at `path`, whatever happened to its own file.
    ///
    /// # Errors
    /// SQLite's.
    pub fn copy_to(&self, path: &Path) -> Result<(), Error> {
        self.connection
            .execute("VACUUM INTO ?", [path.to_string_lossy()])
            .map(drop)
    }

    /// Has its end leave alone what is at its path, which is of another database by then.
    pub fn keep_off(&self) {
        let kept_off = self
            .connection
            .set_db_config(DbConfig::SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, true);
        if let Err(error) = kept_off {
            tracing::debug!(%error, "cannot keep off the log of another journal");
        }
    }
}

/// Removes the log of a file that is not at `path` any more: it would be taken for one of the next file.
///
/// # Errors
/// The system's.
pub fn remove_log(path: &Path) -> io::Result<()> {
    let index = PathBuf::from(format!("{}-shm", path.display()));
    for left in [log_of(path), index] {
        match std::fs::remove_file(left) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    Ok(())
}

/// The path of the write-ahead log of the database at `path`.
fn log_of(path: &Path) -> PathBuf {
    PathBuf::from(format!("{}-wal", path.display()))
}
