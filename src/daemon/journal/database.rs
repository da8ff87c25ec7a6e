//! The journal's database: opened, written in groups, cut when it is full.

use super::days;
use super::events;
use super::reader;
use super::rescue::{self, RescuedTable};
use super::schema::{self, FileKind};
use crate::domain::ids::Name;
use crate::journal::audit::RowChange;
use crate::journal::policy::{self, TableShare};
use crate::journal::row::memory_crc;
use crate::journal::{JournalBook, JournalRow, JournalTable, RememberedDrive, StoredEvent};
use rusqlite::{CachedStatement, Connection, Error, ErrorCode, OpenFlags, Transaction, params};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

/// How long a write waits for another process, such as a person with SQLite's own shell.
const BUSY_WAIT: Duration = Duration::from_millis(100);
/// Most cuts after one write: a journal that is much too large shrinks gradually.
const CUTS_MAX: usize = 4;
/// Beyond this size the writer empties the log itself.
const LOG_BYTES_MAX: u64 = 16 * 1024 * 1024;
/// Pages that go back to the file system at once.
const PAGES_FREED: u32 = 256;

/// Why a database cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DatabaseFailure {
    /// Its contents can never be used.
    Damaged(String),
    /// The system refuses, perhaps only for now.
    Refused(String),
}

impl From<Error> for DatabaseFailure {
    fn from(error: Error) -> Self {
        match error.sqlite_error_code() {
            Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase) => {
                Self::Damaged(error.to_string())
            }
            _ => Self::Refused(error.to_string()),
        }
    }
}

/// An open database.
#[derive(Debug)]
pub struct JournalDatabase {
    pub(super) connection: Connection,
    /// Distinguishes the numbers of this file from those of another one.
    session: String,
    last_event: u64,
    last_availability: u64,
    /// Rows of the audit from before this start of the gateway.
    audit_base: u64,
    is_synced: bool,
    /// A write failed before this file was opened again: some of it may have been written.
    is_in_doubt: bool,
    most_bytes: u64,
}

/// Up to where a file is known to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileMark {
    session: String,
    last_event: u64,
    last_availability: u64,
}

/// What was recovered from a damaged database.
#[derive(Debug, Default)]
pub struct TakenOver {
    /// Rows of all tables.
    pub rows: usize,
    /// Those of them that are events that no broker has taken.
    pub waiting: usize,
    /// What is lost, as text.
    pub lost: Vec<String>,
}

/// What an opened database contained.
#[derive(Debug, Default)]
pub struct DatabaseState {
    /// What is remembered of each drive.
    pub memory: BTreeMap<Name, RememberedDrive>,
    /// Drives whose remembered state is damaged.
    pub damaged: Vec<String>,
    /// The configuration with which the gateway ran last.
    pub configuration: Option<String>,
}

impl JournalDatabase {
    /// Opens or creates the database at `path`, with at most `most_bytes`. A new one is called `session`.
    ///
    /// # Errors
    /// [`DatabaseFailure`].
    pub fn open(
        path: &Path,
        session: &str,
        most_bytes: u64,
    ) -> Result<(Self, DatabaseState), DatabaseFailure> {
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE
            | OpenFlags::SQLITE_OPEN_CREATE
            | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let mut connection = Connection::open_with_flags(path, flags)?;
        connection.busy_timeout(BUSY_WAIT)?;
        match schema::make(&mut connection, session)? {
            FileKind::New | FileKind::Found => {}
            FileKind::Foreign => {
                return Err(DatabaseFailure::Damaged(
                    "it is a database of another program".to_owned(),
                ));
            }
            FileKind::Newer(version) => {
                let what = format!(
                    "version {version} of its tables is newer than this program's, {}",
                    schema::VERSION
                );
                return Err(DatabaseFailure::Damaged(what));
            }
        }
        connection.pragma_update(None, "synchronous", "NORMAL")?;
        let highest = |sql: &str| connection.query_row(sql, [], |row| row.get::<_, Option<u64>>(0));
        let given = highest("SELECT max(seq) FROM sqlite_sequence WHERE name = 'event'")?;
        let there = highest("SELECT max(number) FROM event")?;
        let audit_base = highest("SELECT max(number) FROM audit")?.unwrap_or(0);
        let last_availability = highest("SELECT max(number) FROM availability")?.unwrap_or(0);
        let last_event = given.max(there).unwrap_or(0);
        let session = meta(&connection, "session")?.unwrap_or_else(|| session.to_owned());
        let found = read_state(&connection)?;
        let is_synced = false;
        let is_in_doubt = false;
        let database = Self {
            connection,
            session,
            last_event,
            last_availability,
            audit_base,
            is_synced,
            is_in_doubt,
            most_bytes,
        };
        Ok((database, found))
    }

    /// Counts the audit from where an earlier file of this start of the gateway began.
    pub const fn count_audit_from(&mut self, base: u64) {
        self.audit_base = base;
    }

    /// Up to where it is known to be written.
    #[must_use]
    pub fn mark(&self) -> FileMark {
        let Self {
            last_event,
            last_availability,
            ..
        } = *self;
        FileMark {
            session: self.session.clone(),
            last_event,
            last_availability,
        }
    }

    /// Continues at `mark`, if that is of this file: a write after it failed and may or may not have been stored. The
    /// system may believe data written that never reached the disk: therefore the log is emptied first.
    ///
    /// # Errors
    /// SQLite's.
    pub fn resume(&mut self, mark: &FileMark) -> Result<(), Error> {
        if self.session != mark.session {
            return Ok(());
        }
        self.checkpoint()?;
        self.last_event = mark.last_event;
        self.last_availability = mark.last_availability;
        self.is_in_doubt = true;
        Ok(())
    }

    /// Rows of the audit from before this start of the gateway.
    #[must_use]
    pub const fn audit_base(&self) -> u64 {
        self.audit_base
    }

    /// Writes what waits in `book` and the numbers of events that were `taken`, in one transaction. With a trip in it,
    /// it is synced to the disk; otherwise it only outlives the process.
    ///
    /// # Errors
    /// SQLite's; as far as is known, nothing was written.
    pub fn write(&mut self, book: &JournalBook, taken: &BTreeSet<u64>) -> Result<(), Error> {
        if self.is_synced != book.has_trip() {
            let mode = if book.has_trip() { "FULL" } else { "NORMAL" };
            self.connection.pragma_update(None, "synchronous", mode)?;
            self.is_synced = book.has_trip();
        }
        let mut last_event = self.last_event;
        let mut last_availability = self.last_availability;
        let transaction = self.connection.transaction()?;
        if self.is_in_doubt {
            let known = [
                (JournalTable::Event, last_event),
                (JournalTable::Availability, last_availability),
                (JournalTable::Audit, self.audit_base + book.audit.kept()),
            ];
            for (table, last) in known {
                remove_behind(&transaction, table, last)?;
            }
        }
        for event in book.events() {
            last_event += 1;
            put(
                &transaction,
                JournalTable::Event,
                &events::row(event, last_event, &self.session),
            )?;
        }
        for row in book.availability() {
            last_availability += 1;
            put(
                &transaction,
                JournalTable::Availability,
                &JournalRow {
                    number: last_availability,
                    ..row.clone()
                },
            )?;
        }
        put_audit(&transaction, book, self.audit_base)?;
        put_drives(&transaction, book)?;
        events::mark(&transaction, taken, events::TAKEN)?;
        transaction.commit()?;
        self.last_event = last_event;
        self.last_availability = last_availability;
        self.is_in_doubt = false;
        Ok(())
    }

    /// Reads what the file holds of the days that `book` adds to for the first time.
    ///
    /// # Errors
    /// SQLite's.
    pub fn read_days(&self, book: &mut JournalBook) -> Result<(), Error> {
        for key in book.days.unread() {
            let before = days::usage_of_day(&self.connection, key.0.as_str(), key.1)?;
            book.days.read(&key, before);
        }
        Ok(())
    }

    /// Stores the digest of the configuration in force.
    ///
    /// # Errors
    /// SQLite's.
    pub fn set_configuration(&self, digest: &str) -> Result<(), Error> {
        self.connection
            .execute(
                "INSERT OR REPLACE INTO meta VALUES ('configuration', ?)",
                [digest],
            )
            .map(drop)
    }

    /// At most `most` events after `after` that were not taken, and whether there are more.
    ///
    /// # Errors
    /// SQLite's.
    pub fn events(&self, after: u64, most: usize) -> Result<(Vec<StoredEvent>, bool), Error> {
        events::waiting(&self.connection, after, most)
    }

    /// Recovers the sound rows of a database that was moved aside, as far as they can be read; rows after `mark` are
    /// still to be written. Events that no broker has taken are published again. Returns what was recovered and what is
    /// lost.
    ///
    /// # Errors
    /// SQLite's, of this database.
    pub fn take_over(&mut self, old: &Path, mark: Option<&FileMark>) -> Result<TakenOver, Error> {
        let (mut waiting, highest) = events::rescued(old);
        waiting.retain(|row| mark.is_none_or(|mark| row.number <= mark.last_event));
        let mut taken_over = TakenOver {
            waiting: waiting.len(),
            ..TakenOver::default()
        };
        let transaction = self.connection.transaction()?;
        for table in JournalTable::ALL {
            let RescuedTable { mut rows, lost } = rescue::rescued(old, table);
            let last = mark.and_then(|mark| match table {
                JournalTable::Event => Some(mark.last_event),
                JournalTable::Availability => Some(mark.last_availability),
                // The book has the rows that may be missing, under the same numbers.
                JournalTable::Audit => None,
            });
            rows.retain(|row| last.is_none_or(|last| row.number <= last));
            for row in &rows {
                put(&transaction, table, row)?;
            }
            let numbers = rows.iter().map(|row| row.number);
            match table {
                JournalTable::Event => {
                    events::mark(&transaction, &numbers.clone().collect(), events::TAKEN)?;
                    self.last_event = self.last_event.max(numbers.max().unwrap_or(0));
                }
                JournalTable::Availability => {
                    self.last_availability = self.last_availability.max(numbers.max().unwrap_or(0))
                }
                JournalTable::Audit => {
                    self.audit_base = self.audit_base.max(numbers.max().unwrap_or(0))
                }
            }
            taken_over.rows += rows.len();
            taken_over.lost.extend(lost);
        }
        for row in &waiting {
            put(&transaction, JournalTable::Event, row)?;
        }
        days::take_over(&transaction, old)?;
        transaction.commit()?;
        self.last_event = self.last_event.max(highest);
        Ok(taken_over)
    }

    /// Deletes old rows if the journal is nearly full. Returns the size of its file in bytes.
    ///
    /// # Errors
    /// SQLite's.
    pub fn cut(&mut self) -> Result<u64, Error> {
        let number = |connection: &Connection, name: &str| {
            connection.pragma_query_value(None, name, |row| row.get::<_, u64>(0))
        };
        let page = number(&self.connection, "page_size")?;
        for _ in 0..CUTS_MAX {
            let pages = number(&self.connection, "page_count")?;
            let used = pages.saturating_sub(number(&self.connection, "freelist_count")?);
            if !policy::is_full(used * page, self.most_bytes) {
                if pages * page > self.most_bytes {
                    self.connection
                        .execute_batch(&format!("PRAGMA incremental_vacuum({PAGES_FREED})"))?;
                }
                break;
            }
            if days::cut(&self.connection, policy::most_days(self.most_bytes))? {
                continue;
            }
            let rows = |table: JournalTable| {
                let count = format!("SELECT max(number) - min(number) + 1 FROM {}", table.name());
                self.connection
                    .query_row(&count, [], |row| row.get::<_, Option<u64>>(0))
            };
            let mut shares = JournalTable::ALL.map(|table| TableShare { table, rows: 0 });
            for share in &mut shares {
                share.rows = rows(share.table)?.unwrap_or(0);
            }
            let Some(cut) = policy::cut(shares, self.most_bytes) else {
                break;
            };
            let table = cut.table.name();
            let sql =
                format!("DELETE FROM {table} WHERE number < (SELECT min(number) FROM {table}) + ?");
            self.connection.execute(&sql, [cut.rows])?;
        }
        Ok(number(&self.connection, "page_count")? * page)
    }

    /// Empties the write-ahead log if it has grown although another thread empties it: a reader never finishes, or
    /// writes never pause.
    ///
    /// # Errors
    /// SQLite's.
    pub fn empty_log(&self) -> Result<(), Error> {
        let log = self.connection.path().map(|path| format!("{path}-wal"));
        let bytes = log
            .and_then(|log| std::fs::metadata(log).ok())
            .map_or(0, |log| log.len());
        if bytes > LOG_BYTES_MAX {
            self.checkpoint()
        } else {
            Ok(())
        }
    }

    /// Empties the write-ahead log into the file, as far as readers allow.
    ///
    /// # Errors
    /// SQLite's.
    pub fn checkpoint(&self) -> Result<(), Error> {
        self.connection
            .query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(()))
    }
}

/// Removes the rows of `table` behind the number `last`.
fn remove_behind(
    transaction: &Transaction<'_>,
    table: JournalTable,
    last: u64,
) -> Result<(), Error> {
    let sql = format!("DELETE FROM {} WHERE number > ?", table.name());
    transaction.execute(&sql, [last]).map(drop)
}

/// Writes the changes of the audit, whose numbers count from `base`.
fn put_audit(transaction: &Transaction<'_>, book: &JournalBook, base: u64) -> Result<(), Error> {
    for (number, change) in book.audit.waiting() {
        match change {
            RowChange::Put(record) => put(transaction, JournalTable::Audit, &record.row(base))?,
            RowChange::Remove => {
                let mut remove =
                    transaction.prepare_cached("DELETE FROM audit WHERE number = ?")?;
                remove.execute([base + number])?;
            }
        }
    }
    Ok(())
}

/// Writes what is remembered of drives and of their days, and forgets those that are gone.
fn put_drives(transaction: &Transaction<'_>, book: &JournalBook) -> Result<(), Error> {
    for (name, memory) in book.memory() {
        let name = name.as_str();
        let body = memory.to_json();
        let mut put =
            transaction.prepare_cached("INSERT OR REPLACE INTO drive VALUES (?, ?, ?)")?;
        put.execute(params![name, body, memory_crc(name, &body)])?;
    }
    for (name, day, usage) in book.days.waiting() {
        days::put(transaction, name.as_str(), day, &usage)?;
    }
    for name in book.forgotten() {
        transaction.execute("DELETE FROM drive WHERE name = ?", [name.as_str()])?;
        transaction.execute("DELETE FROM day WHERE drive = ?", [name.as_str()])?;
    }
    Ok(())
}

fn put(transaction: &Transaction<'_>, table: JournalTable, row: &JournalRow) -> Result<(), Error> {
    let mut put: CachedStatement<'_> = transaction.prepare_cached(match table {
        JournalTable::Event => "INSERT OR REPLACE INTO event (number, at, kind, name, body, crc) VALUES (?, ?, ?, ?, ?, ?)",
        JournalTable::Audit => "INSERT OR REPLACE INTO audit VALUES (?, ?, ?, ?, ?, ?)",
        JournalTable::Availability => "INSERT OR REPLACE INTO availability VALUES (?, ?, ?, ?, ?, ?)",
    })?;
    put.execute(params![
        row.number,
        row.at.unix_ms,
        row.kind,
        row.name,
        row.body,
        row.crc(table)
    ])
    .map(drop)
}

fn meta(connection: &Connection, key: &str) -> Result<Option<String>, Error> {
    match connection.query_row("SELECT value FROM meta WHERE key = ?", [key], |row| {
        row.get(0)
    }) {
        Ok(value) => Ok(Some(value)),
        Err(Error::QueryReturnedNoRows) => Ok(None),
        Err(error) => Err(error),
    }
}

fn read_state(connection: &Connection) -> Result<DatabaseState, Error> {
    let mut found = DatabaseState {
        configuration: meta(connection, "configuration")?,
        ..DatabaseState::default()
    };
    remembered(connection, &mut found)?;
    Ok(found)
}

/// The remembered state of drives in the damaged file at `path`, as far as it can be read and is sound.
#[must_use]
pub fn rescued(path: &Path) -> BTreeMap<Name, RememberedDrive> {
    let mut found = DatabaseState::default();
    // What was read before an error is still sound.
    let connection = reader::connect(path).or_else(|_| reader::salvage(path));
    let _ = connection.and_then(|connection| remembered(&connection, &mut found));
    found.memory
}

fn remembered(connection: &Connection, found: &mut DatabaseState) -> Result<(), Error> {
    let mut select = connection.prepare("SELECT name, body, crc FROM drive")?;
    let mut rows = select.query([])?;
    while let Some(row) = rows.next()? {
        let name: Option<String> = row.get(0).ok();
        let sound = || {
            let name = name.as_deref()?;
            let body = row.get::<_, String>(1).ok()?;
            if row.get::<_, u32>(2).ok()? != memory_crc(name, &body) {
                return None;
            }
            Some((Name::new(name)?, RememberedDrive::from_json(&body)?))
        };
        match sound() {
            Some((name, memory)) => drop(found.memory.insert(name, memory)),
            None => found.damaged.push(name.unwrap_or_else(|| "?".to_owned())),
        }
    }
    Ok(())
}
