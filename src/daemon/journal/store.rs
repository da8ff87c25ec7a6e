//! The database while it can be used. A damaged one is moved aside; one that the system refuses is retried.

use super::aside::move_aside;
use super::database::{
    DatabaseFailure, DatabaseState, FileMark, JournalDatabase, TakenOver, rescued,
};
use super::files::{FileLoss, OpenFiles, remove_log};
use super::rescue::{FileStanding, standing};
use super::status::{JournalState, JournalStatus};
use crate::daemon::host::clock;
use crate::domain::time::MonoTime;
use crate::journal::{JournalBook, JournalRow, row};
use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// First wait before a retry; it doubles.
const FIRST_WAIT: Duration = Duration::from_millis(200);
/// The longest of them.
const LONGEST_WAIT: Duration = Duration::from_secs(10);

/// The database, or when it is retried.
#[derive(Debug)]
pub struct JournalStore {
    path: PathBuf,
    max_bytes: u64,
    status: Arc<JournalStatus>,
    database: Option<JournalDatabase>,
    /// The files of the one that was opened last.
    files: Option<OpenFiles>,
    /// The audit is numbered after the rows that the first database of this start held.
    audit_base: Option<u64>,
    /// Up to where the file was written when it failed.
    mark: Option<FileMark>,
    retry_at: MonoTime,
    wait: Duration,
    /// Rows about the journal itself, for the next group.
    notes: Vec<JournalRow>,
    /// A new file has replaced the one that was there.
    has_begun_anew: bool,
}

impl JournalStore {
    /// Opens the database at `path`. Returns what it contained as well.
    #[must_use]
    pub fn open(path: &Path, max_bytes: u64, status: &Arc<JournalStatus>) -> (Self, DatabaseState) {
        let mut store = Self {
            path: path.to_owned(),
            max_bytes,
            status: Arc::clone(status),
            database: None,
            files: None,
            audit_base: None,
            mark: None,
            retry_at: MonoTime::ZERO,
            wait: FIRST_WAIT,
            notes: Vec::new(),
            has_begun_anew: false,
        };
        let found = store.connect();
        // What an earlier run has left is read even if nothing can be written.
        let found = found.unwrap_or_else(|| DatabaseState {
            memory: rescued(path),
            ..DatabaseState::default()
        });
        (store, found)
    }

    /// Opens it; a damaged one is moved aside first. `None` if the system refuses.
    fn connect(&mut self) -> Option<DatabaseState> {
        let broken = match self.open_once() {
            Ok(found) => return Some(found),
            Err(DatabaseFailure::Refused(reason)) if self.is_unreadable() => {
                DatabaseFailure::Damaged(reason)
            }
            Err(broken) => broken,
        };
        match broken {
            DatabaseFailure::Refused(reason) => self.failed(reason),
            DatabaseFailure::Damaged(reason) => match self.begin_anew(&reason) {
                Ok(aside) => match self.open_once() {
                    Ok(found) => {
                        return Some(DatabaseState {
                            memory: rescued(&aside),
                            ..found
                        });
                    }
                    Err(DatabaseFailure::Refused(reason) | DatabaseFailure::Damaged(reason)) => {
                        self.failed(reason)
                    }
                },
                Err(error) => self.failed(format!("{reason}; it cannot be moved aside: {error}")),
            },
        }
        None
    }

    fn open_once(&mut self) -> Result<DatabaseState, DatabaseFailure> {
        match standing(&self.path).map_err(|error| DatabaseFailure::Refused(error.to_string()))? {
            FileStanding::New | FileStanding::Whole => {}
            FileStanding::Broken(what) => return Err(DatabaseFailure::Damaged(what)),
            // Noted once, however often it cannot be opened.
            FileStanding::Empty if !self.notes.is_empty() => {}
            FileStanding::Empty => {
                let now = clock::wall();
                let file = self.path.display().to_string();
                let reason = "its file was empty: rows that an earlier one may have held are lost";
                tracing::warn!(
                    file,
                    "journal file is empty; starting a new journal; earlier rows, if any, are lost"
                );
                self.notes.push(row::begun_anew(now, reason, None));
            }
        }
        let session = clock::wall().unix_ms.to_string();
        let (mut database, found) = JournalDatabase::open(&self.path, &session, self.max_bytes)?;
        let base = *self.audit_base.get_or_insert(database.audit_base());
        database.count_audit_from(base);
        if let Some(mark) = &self.mark {
            database.resume(mark)?;
        }
        self.files = Some(OpenFiles::at(&self.path));
        self.database = Some(database);
        Ok(found)
    }

    /// Whether the path holds something that this process may never read.
    fn is_unreadable(&self) -> bool {
        let denied = |error: &io::Error| error.kind() == io::ErrorKind::PermissionDenied;
        self.path.is_dir() || std::fs::File::open(&self.path).is_err_and(|error| denied(&error))
    }

    /// Moves the damaged file aside. Its events that no broker has taken are copied into the new one.
    fn begin_anew(&mut self, reason: &str) -> io::Result<PathBuf> {
        self.leave();
        let now = clock::wall();
        let aside = move_aside(&self.path, now)?;
        let lies_at = aside.display().to_string();
        tracing::error!(
            reason,
            moved_to = lies_at,
            "ALARM: journal is unusable; moved it aside and started a new one"
        );
        self.status
            .change(|report| report.moved_aside = Some(lies_at.clone()));
        self.has_begun_anew = true;
        let mark = self.mark.take();
        let is_first = self.audit_base.is_none();
        let opened = self.open_once();
        let mut text = reason.to_owned();
        match (opened, &mut self.database) {
            (Ok(_), Some(database)) => match database.take_over(&aside, mark.as_ref()) {
                Ok(TakenOver {
                    rows,
                    waiting,
                    lost,
                }) => {
                    if is_first {
                        self.audit_base = Some(database.audit_base());
                    } else {
                        // The audit of this run continues under its own numbers.
                        database.count_audit_from(self.audit_base.unwrap_or_default());
                    }
                    text += &format!("; {rows} rows recovered");
                    text += &lost
                        .iter()
                        .map(|lost| format!("; lost: {lost}"))
                        .collect::<String>();
                    let lost = lost.join("; ");
                    tracing::warn!(
                        rows,
                        unpublished_events = waiting,
                        lost,
                        "recovered rows of the damaged journal"
                    );
                }
                Err(error) => tracing::error!(%error, "cannot recover rows of the damaged journal"),
            },
            // It is retried, and the reason is logged then.
            _ => self.database = None,
        }
        self.notes.push(row::begun_anew(now, &text, Some(&lies_at)));
        Ok(aside)
    }

    /// Replaces the database if the files at its path are no longer those that are open. A process is not
    /// notified when a file that it has open is deleted or replaced, and would go on writing into a file without a name.
    pub fn reopen_if_replaced(&mut self) {
        let (Some(files), Some(_)) = (&mut self.files, &self.database) else {
            return;
        };
        let Some(loss) = files.loss(&self.path) else {
            return;
        };
        let what = match loss {
            FileLoss::Deleted => match self.restore() {
                Ok(()) => "its file was deleted while the gateway ran; all rows were written into a new one".to_owned(),
                Err(why) => {
                    format!("its file was deleted while the gateway ran; a new one begins without its rows: {why}")
                }
            },
            FileLoss::Replaced => {
                if let Some(database) = &self.database {
                    database.keep_off();
                }
                let is_left = self.files.as_ref().is_some_and(|files| files.has_log(&self.path));
                self.leave();
                if is_left && let Err(error) = remove_log(&self.path) {
                    tracing::error!(%error, "cannot remove the log of the journal that was replaced");
                }
                "its file was replaced while the gateway ran; the one that is there now is continued".to_owned()
            }
            FileLoss::Log => {
                let kept = self.database.as_ref().map_or(Ok(()), JournalDatabase::checkpoint);
                self.leave();
                match kept {
                    Ok(()) => "its log was deleted while the gateway ran; all rows are in its file".to_owned(),
                    Err(error) => format!("its log was deleted while the gateway ran; newest rows are lost: {error}"),
                }
            }
        };
        let file = self.path.display().to_string();
        tracing::error!(file, "ALARM: the journal is not what was opened: {what}");
        self.status
            .change(|report| report.replaced = Some(what.clone()));
        self.notes.push(row::begun_anew(clock::wall(), &what, None));
        self.has_begun_anew = true;
        if self.connect().is_some()
            && let Some(database) = &mut self.database
        {
            // No row of this run takes the number of one that the file holds.
            let base = self
                .audit_base
                .unwrap_or_default()
                .max(database.audit_base());
            self.audit_base = Some(base);
            database.count_audit_from(base);
        }
    }

    /// Puts what the open database holds, whose file was deleted, back at its path.
    fn restore(&mut self) -> Result<(), String> {
        let copy = PathBuf::from(format!("{}.restored", self.path.display()));
        // Of an earlier attempt.
        let _ = std::fs::remove_file(&copy);
        let copied = self.database.as_ref().map_or(Ok(()), |database| {
            database.keep_off();
            database.copy_to(&copy)
        });
        self.leave();
        copied.map_err(|error| error.to_string())?;
        remove_log(&self.path)
            .and_then(|()| std::fs::rename(copy, &self.path))
            .map_err(|error| error.to_string())
    }

    /// Closes the database, and stores up to where it was written.
    fn leave(&mut self) {
        if let Some(database) = self.database.take() {
            self.mark = Some(database.mark());
        }
    }

    fn failed(&mut self, reason: String) {
        self.leave();
        let had_one = self.audit_base.is_some();
        let state = if had_one {
            JournalState::Failed
        } else {
            JournalState::Memory
        };
        let before = self.status.report();
        if before.state != state || before.reason.as_ref() != Some(&reason) {
            tracing::error!(reason, "ALARM: cannot write the journal; control continues");
        }
        self.retry_at = clock::now() + self.wait;
        self.wait = (self.wait * 2).min(LONGEST_WAIT);
        self.status.change(|report| {
            report.state = state;
            report.reason = Some(reason);
            report.failures += 1;
        });
    }

    /// When it is retried; `None` if it works.
    #[must_use]
    pub fn retry_at(&self) -> Option<MonoTime> {
        let is_broken = self.database.is_none() || !self.status.is_ok();
        is_broken.then_some(self.retry_at)
    }

    /// Whether it has rows of its own to write.
    #[must_use]
    pub const fn has_news(&self) -> bool {
        self.has_begun_anew || !self.notes.is_empty()
    }

    /// Writes what waits. Returns false if it cannot; it is not retried before [`retry_at`](Self::retry_at).
    pub fn write(&mut self, book: &mut JournalBook, taken: &BTreeSet<u64>) -> bool {
        if self.retry_at().is_some_and(|at| clock::now() < at) {
            return false;
        }
        // Twice: if the first proves damaged, the second is new.
        for _ in 0..2 {
            if self.database.is_none() && self.connect().is_none() {
                return false;
            }
            if std::mem::take(&mut self.has_begun_anew) {
                book.touch_all();
            }
            self.notes.drain(..).for_each(|note| book.note(note));
            let Some(database) = self.database.as_mut() else {
                return false;
            };
            match database
                .read_days(book)
                .and_then(|()| database.write(book, taken))
            {
                Ok(()) => {
                    self.works();
                    return true;
                }
                Err(error) => match DatabaseFailure::from(error) {
                    DatabaseFailure::Refused(reason) => {
                        self.failed(reason);
                        return false;
                    }
                    DatabaseFailure::Damaged(reason) => self.give_up(&reason),
                },
            }
        }
        false
    }

    /// Replaces a damaged file with a new one.
    pub fn give_up(&mut self, reason: &str) {
        if let Err(error) = self.begin_anew(reason) {
            self.failed(format!("{reason}; it cannot be moved aside: {error}"));
        }
    }

    fn works(&mut self) {
        self.wait = FIRST_WAIT;
        if !self.status.is_ok() {
            tracing::warn!("journal is writable again");
            self.status
                .change(|report| (report.state, report.reason) = (JournalState::Ok, None));
        }
    }

    /// Whether a database is open.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.database.is_some()
    }

    /// The database, if it can be used.
    pub const fn database(&mut self) -> Option<&mut JournalDatabase> {
        self.database.as_mut()
    }

    /// Handles the failure of a read or a cut.
    pub fn troubled(&mut self, error: rusqlite::Error) {
        match DatabaseFailure::from(error) {
            DatabaseFailure::Refused(reason) => self.failed(reason),
            DatabaseFailure::Damaged(reason) => self.give_up(&reason),
        }
    }
}
