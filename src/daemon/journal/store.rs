//! The database as long as it can be used, and what is done when it cannot: moved aside if it is damaged, tried again if
//! the system refuses.

use super::aside::move_aside;
use super::database::{Broken, Database, Found, Mark, rescued};
use super::status::{JournalState, Status};
use crate::daemon::clock;
use crate::domain::time::MonoTime;
use crate::journal::{Book, Row, row};
use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Waits before another try, doubling.
const FIRST_WAIT: Duration = Duration::from_millis(200);
/// The longest of them.
const LONGEST_WAIT: Duration = Duration::from_secs(10);

/// The database, or when it is tried again.
#[derive(Debug)]
pub struct Store {
    path: PathBuf,
    max_bytes: u64,
    status: Arc<Status>,
    database: Option<Database>,
    /// The audit is numbered behind what the first database of this life held.
    audit_base: Option<u64>,
    /// Up to where the file was written when it failed.
    mark: Option<Mark>,
    retry_at: MonoTime,
    wait: Duration,
    /// What the journal itself has to say, for the next group.
    notes: Vec<Row>,
    /// Another file took the place of the one that was there.
    has_begun_anew: bool,
}

impl Store {
    /// Opens the database at `path`, and says what was found in it.
    #[must_use]
    pub fn open(path: &Path, max_bytes: u64, status: &Arc<Status>) -> (Self, Found) {
        let mut store = Self {
            path: path.to_owned(),
            max_bytes,
            status: Arc::clone(status),
            database: None,
            audit_base: None,
            mark: None,
            retry_at: MonoTime::ZERO,
            wait: FIRST_WAIT,
            notes: Vec::new(),
            has_begun_anew: false,
        };
        let found = store.connect();
        (store, found.unwrap_or_default())
    }

    /// Opens it; a damaged one is moved aside first. Nothing: the system refuses.
    fn connect(&mut self) -> Option<Found> {
        let broken = match self.open_once() {
            Ok(found) => return Some(found),
            Err(Broken::Refused(reason)) if self.is_unreadable() => Broken::Damaged(reason),
            Err(broken) => broken,
        };
        match broken {
            Broken::Refused(reason) => self.failed(reason),
            Broken::Damaged(reason) => match self.begin_anew(&reason) {
                Ok(aside) => match self.open_once() {
                    Ok(found) => return Some(Found { memory: rescued(&aside), ..found }),
                    Err(Broken::Refused(reason) | Broken::Damaged(reason)) => self.failed(reason),
                },
                Err(error) => self.failed(format!("{reason}; it cannot be moved aside: {error}")),
            },
        }
        None
    }

    fn open_once(&mut self) -> Result<Found, Broken> {
        let session = clock::wall().unix_ms.to_string();
        let (mut database, found) = Database::open(&self.path, &session, self.max_bytes)?;
        let base = *self.audit_base.get_or_insert(database.audit_base());
        database.count_audit_from(base);
        if let Some(mark) = &self.mark {
            database.resume(mark)?;
        }
        self.database = Some(database);
        Ok(found)
    }

    /// Something stands there that this process may never read.
    fn is_unreadable(&self) -> bool {
        let denied = |error: &io::Error| error.kind() == io::ErrorKind::PermissionDenied;
        self.path.is_dir() || std::fs::File::open(&self.path).is_err_and(|error| denied(&error))
    }

    /// Moves the damaged file aside. What it has of events that nobody took goes into the next one.
    fn begin_anew(&mut self, reason: &str) -> io::Result<PathBuf> {
        self.leave();
        let now = clock::wall();
        let aside = move_aside(&self.path, now)?;
        let lies_at = aside.display().to_string();
        tracing::error!(reason, lies_at, "ALARM: the journal cannot be used; it was moved aside and a new one begins");
        self.notes.push(row::begun_anew(now, reason, &lies_at));
        self.status.change(|report| report.moved_aside = Some(lies_at));
        self.has_begun_anew = true;
        let mark = self.mark.take();
        let opened = self.open_once();
        match (opened, &mut self.database) {
            (Ok(_), Some(database)) => match database.take_over(&aside, mark.as_ref()) {
                Ok(0) => {}
                Ok(events) => tracing::warn!(events, "trip events that nobody had taken were rescued"),
                Err(error) => tracing::error!(%error, "trip events could not be rescued"),
            },
            // It is tried again, and says then why.
            _ => self.database = None,
        }
        Ok(aside)
    }

    /// Closes the database, and notes up to where it was written.
    fn leave(&mut self) {
        if let Some(database) = self.database.take() {
            self.mark = Some(database.mark());
        }
    }

    fn failed(&mut self, reason: String) {
        self.leave();
        let had_one = self.audit_base.is_some();
        let state = if had_one { JournalState::Failed } else { JournalState::Memory };
        let before = self.status.report();
        if before.state != state || before.reason.as_ref() != Some(&reason) {
            tracing::error!(reason, "ALARM: the journal cannot be written; control goes on");
        }
        self.retry_at = clock::now() + self.wait;
        self.wait = (self.wait * 2).min(LONGEST_WAIT);
        self.status.change(|report| {
            (report.state, report.reason) = (state, Some(reason));
            report.failures += 1;
        });
    }

    /// When it is tried again; nothing: it works.
    #[must_use]
    pub fn retry_at(&self) -> Option<MonoTime> {
        let is_broken = self.database.is_none() || !self.status.is_ok();
        is_broken.then_some(self.retry_at)
    }

    /// Whether it has something to write of its own.
    #[must_use]
    pub const fn has_news(&self) -> bool {
        self.has_begun_anew || !self.notes.is_empty()
    }

    /// Writes what waits. False: it cannot, and is not tried before [`retry_at`](Self::retry_at).
    pub fn write(&mut self, book: &mut Book, taken: &BTreeSet<u64>) -> bool {
        if self.retry_at().is_some_and(|at| clock::now() < at) {
            return false;
        }
        // Once more if it proves damaged: the next one is new.
        for _ in 0..2 {
            if self.database.is_none() && self.connect().is_none() {
                return false;
            }
            if std::mem::take(&mut self.has_begun_anew) {
                book.touch_all();
            }
            self.notes.drain(..).for_each(|note| book.note(note));
            let Some(database) = self.database.as_mut() else { return false };
            match database.write(book, taken) {
                Ok(()) => {
                    self.works();
                    return true;
                }
                Err(error) => match Broken::from(error) {
                    Broken::Refused(reason) => {
                        self.failed(reason);
                        return false;
                    }
                    Broken::Damaged(reason) => self.give_up(&reason),
                },
            }
        }
        false
    }

    /// The file is damaged: another one takes its place.
    pub fn give_up(&mut self, reason: &str) {
        if let Err(error) = self.begin_anew(reason) {
            self.failed(format!("{reason}; it cannot be moved aside: {error}"));
        }
    }

    fn works(&mut self) {
        self.wait = FIRST_WAIT;
        if !self.status.is_ok() {
            tracing::warn!("the journal can be written again");
            self.status.change(|report| (report.state, report.reason) = (JournalState::Ok, None));
        }
    }

    /// The database, if it can be used.
    pub const fn database(&mut self) -> Option<&mut Database> {
        self.database.as_mut()
    }

    /// A read or a cut failed for this reason.
    pub fn troubled(&mut self, error: rusqlite::Error) {
        match Broken::from(error) {
            Broken::Refused(reason) => self.failed(reason),
            Broken::Damaged(reason) => self.give_up(&reason),
        }
    }
}
