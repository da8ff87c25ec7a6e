//! Reads the journal while a gateway writes it: rows in order, damaged ones shown as such.

use crate::domain::ids::Name;
use crate::domain::time::WallTime;
use crate::journal::{JournalRow, JournalTable};
use rusqlite::{Connection, Error, OpenFlags};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Rows that are read at once. No transaction is open in between, so a reader that pauses holds up nothing.
const PAGE: usize = 250;
/// SQLite's cache for one reader, in KiB.
const CACHE_KIB: i64 = 512;
/// The smallest page of a database. SQLite takes a shorter file for an empty database.
pub const PAGE_BYTES_MIN: u64 = 512;
/// How long a read waits for the writer.
const BUSY_WAIT: Duration = Duration::from_secs(2);

/// A row as it was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ReadRow {
    /// An intact row.
    Sound(JournalRow),
    /// A damaged row, of which only the number is known.
    Damaged(u64),
}

impl ReadRow {
    /// Its number.
    #[must_use]
    pub const fn number(&self) -> u64 {
        match self {
            Self::Sound(row) => row.number,
            Self::Damaged(number) => *number,
        }
    }
}

/// The columns number, at, kind, name, body, crc of a row of `table`.
///
/// # Errors
/// The row has no number.
pub fn read_row(table: JournalTable, row: &rusqlite::Row<'_>) -> Result<ReadRow, Error> {
    let number: u64 = row.get(0)?;
    let read = || {
        let unix_ms = row.get(1).ok()?;
        let kind = row.get(2).ok()?;
        let name = row.get(3).ok()?;
        let body = row.get(4).ok()?;
        JournalRow {
            number,
            at: WallTime { unix_ms },
            kind,
            name,
            body,
        }
        .checked(table, row.get(5).ok()?)
    };
    Ok(read().map_or(ReadRow::Damaged(number), ReadRow::Sound))
}

/// Opens the database at `path` for reading.
///
/// # Errors
/// SQLite's.
pub fn connect(path: &Path) -> Result<Connection, Error> {
    is_long_enough(path)?;
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY
        | OpenFlags::SQLITE_OPEN_URI
        | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let open = |target: &Path| {
        let connection = Connection::open_with_flags(target, flags)?;
        connection.busy_timeout(BUSY_WAIT)?;
        // Negative: in KiB, not in pages.
        connection.pragma_update(None, "cache_size", -CACHE_KIB)?;
        connection.query_row("SELECT count(*) FROM sqlite_schema", [], |_| Ok(()))?;
        Ok(connection)
    };
    let log = PathBuf::from(format!("{}-wal", path.display()));
    open(path).or_else(|error| {
        // Without a gateway there is no log, and in a directory without write access SQLite could not create one.
        if log.exists() {
            Err(error)
        } else {
            open(Path::new(&format!("file:{}?immutable=1", escaped(path))))
        }
    })
}

/// Opens the damaged database at `path`, to read what is left of it.
///
/// # Errors
/// SQLite's.
pub fn salvage(path: &Path) -> Result<Connection, Error> {
    is_long_enough(path)?;
    let connection = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
    // SQLite reads a truncated file only with this pragma, which is intended for repairs.
    connection.pragma_update(None, "writable_schema", true)?;
    Ok(connection)
}

/// SQLite takes a file shorter than a page for an empty database, and removes its log.
fn is_long_enough(path: &Path) -> Result<(), Error> {
    if std::fs::metadata(path).is_ok_and(|it| it.len() < PAGE_BYTES_MIN) {
        let what = "it is shorter than any database".to_owned();
        return Err(Error::SqliteFailure(
            rusqlite::ffi::Error::new(rusqlite::ffi::SQLITE_CORRUPT),
            Some(what),
        ));
    }
    Ok(())
}

fn escaped(path: &Path) -> String {
    path.display()
        .to_string()
        .replace('%', "%25")
        .replace('?', "%3f")
        .replace('#', "%23")
}

/// The row `number` of `table`; `None` if it was deleted.
///
/// # Errors
/// SQLite's.
pub fn row(
    connection: &Connection,
    table: JournalTable,
    number: u64,
) -> Result<Option<ReadRow>, Error> {
    let sql = format!(
        "SELECT number, at, kind, name, body, crc FROM {} WHERE number = ?",
        table.name()
    );
    let mut select = connection.prepare_cached(&sql)?;
    match select.query_row([number], |row| read_row(table, row)) {
        Err(Error::QueryReturnedNoRows) => Ok(None),
        found => found.map(Some),
    }
}

/// The rows of one table, in ascending or descending order of their numbers.
#[derive(Debug)]
pub struct TableRows<'c> {
    connection: &'c Connection,
    table: JournalTable,
    is_backward: bool,
    last: u64,
    page: VecDeque<ReadRow>,
    has_failed: bool,
    failure: Option<Error>,
}

impl<'c> TableRows<'c> {
    /// The rows after number `after`, oldest first.
    #[must_use]
    pub const fn after(connection: &'c Connection, table: JournalTable, after: u64) -> Self {
        Self {
            connection,
            table,
            is_backward: false,
            last: after,
            page: VecDeque::new(),
            has_failed: false,
            failure: None,
        }
    }

    /// All rows, the newest first.
    #[must_use]
    pub const fn newest_first(connection: &'c Connection, table: JournalTable) -> Self {
        // SQLite's greatest number.
        let last = i64::MAX.unsigned_abs();
        Self {
            connection,
            table,
            is_backward: true,
            last,
            page: VecDeque::new(),
            has_failed: false,
            failure: None,
        }
    }

    fn read(&mut self) -> Result<(), Error> {
        let (behind, order) = if self.is_backward {
            ("<", "DESC")
        } else {
            (">", "ASC")
        };
        let sql = format!(
            "SELECT number, at, kind, name, body, crc FROM {} WHERE number {behind} ? ORDER BY number {order} LIMIT ?",
            self.table.name()
        );
        let mut select = self.connection.prepare_cached(&sql)?;
        let rows = select.query_map((self.last, PAGE), |row| read_row(self.table, row))?;
        for row in rows {
            let row = row?;
            // A damaged index can loop.
            if (row.number() > self.last) == self.is_backward || row.number() == self.last {
                return Err(out_of_order(self.table));
            }
            self.last = row.number();
            self.page.push_back(row);
        }
        Ok(())
    }
}

impl Iterator for TableRows<'_> {
    type Item = Result<ReadRow, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.page.is_empty() && !self.has_failed {
            let read = self.read();
            self.has_failed = read.is_err();
            // What was read before the error is sound.
            self.failure = read.err();
        }
        self.page
            .pop_front()
            .map(Ok)
            .or_else(|| self.failure.take().map(Err))
    }
}

/// The error for a table whose numbers are not ascending.
#[must_use]
pub fn out_of_order(table: JournalTable) -> Error {
    let what = format!(
        "the rows of {} are out of order: the file is damaged",
        table.name()
    );
    Error::SqliteFailure(
        rusqlite::ffi::Error::new(rusqlite::ffi::SQLITE_CORRUPT),
        Some(what),
    )
}

/// Problems that a check of the whole file finds, as SQLite words them; empty if it is sound.
///
/// # Errors
/// SQLite's: it could not be checked.
pub fn check(path: &Path) -> Result<Vec<String>, Error> {
    let connection = connect(path)?;
    let mut check = connection.prepare("PRAGMA quick_check(10)")?;
    let found: Vec<String> = check
        .query_map([], |row| row.get(0))?
        .collect::<Result<_, _>>()?;
    Ok(found.into_iter().filter(|line| line != "ok").collect())
}

/// The drives that are remembered although no row mentions them any more.
///
/// # Errors
/// SQLite's.
pub fn unused_drives(path: &Path) -> Result<Vec<Name>, Error> {
    let connection = connect(path)?;
    let tables = JournalTable::ALL
        .map(|table| format!("SELECT name FROM {} WHERE name IS NOT NULL", table.name()));
    let mut select = connection.prepare(&format!(
        "SELECT name FROM drive WHERE name NOT IN ({})",
        tables.join(" UNION ")
    ))?;
    let names = select
        .query_map([], |row| row.get::<_, String>(0))?
        .collect::<Result<Vec<_>, _>>()?;
    Ok(names.iter().filter_map(|name| Name::new(name)).collect())
}
