//! The writer's side of the database: minutes are merged into the rows of each level.

use crate::north::page::kept::{LEVELS, TrendMinute, merged, stored};
use rusqlite::{Connection, Error, OptionalExtension, Transaction};
use std::path::Path;
use std::time::Duration;

/// "VFDT": the database holds trends of ours.
const APPLICATION: i64 = 0x5646_4454;
/// How long a write waits for readers.
const BUSY_WAIT: Duration = Duration::from_secs(5);
/// Bytes of the write-ahead log that stay.
const LOG_BYTES_KEPT: i64 = 1024 * 1024;

/// A row is found by its level and its time, so that what is written together is in one place on the disk. `moment` has the
/// times of a level once, because the oldest is looked for each minute.
const TABLES: &str = "
    CREATE TABLE IF NOT EXISTS shape (number INTEGER PRIMARY KEY, drive TEXT NOT NULL, columns TEXT NOT NULL,
        UNIQUE (drive, columns));
    CREATE TABLE IF NOT EXISTS cells (step INTEGER NOT NULL, at INTEGER NOT NULL, shape INTEGER NOT NULL,
        cells BLOB NOT NULL, PRIMARY KEY (step, at, shape)) WITHOUT ROWID;
    CREATE TABLE IF NOT EXISTS moment (step INTEGER NOT NULL, at INTEGER NOT NULL, PRIMARY KEY (step, at)) WITHOUT ROWID;
";

/// The open database.
#[derive(Debug)]
pub struct TrendStore(Connection);

impl TrendStore {
    /// Opens or creates it.
    ///
    /// # Errors
    /// SQLite's; a database of another program is reported as none.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let connection = Connection::open(path)?;
        connection.busy_timeout(BUSY_WAIT)?;
        let tables: i64 =
            connection.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get(0))?;
        let application: i64 =
            connection.pragma_query_value(None, "application_id", |row| row.get(0))?;
        if tables > 0 && application != APPLICATION {
            let foreign = rusqlite::ffi::Error::new(rusqlite::ffi::SQLITE_NOTADB);
            return Err(Error::SqliteFailure(
                foreign,
                Some("it is a database of another program".to_owned()),
            ));
        }
        connection.pragma_update_and_check(None, "journal_mode", "WAL", |_| Ok(()))?;
        connection
            .pragma_update_and_check(None, "journal_size_limit", LOG_BYTES_KEPT, |_| Ok(()))?;
        connection.pragma_update(None, "synchronous", "NORMAL")?;
        connection.pragma_update(None, "application_id", APPLICATION)?;
        connection.execute_batch(TABLES)?;
        // Of drives that were removed or have another model.
        connection.execute(
            "DELETE FROM shape WHERE number NOT IN (SELECT shape FROM cells)",
            [],
        )?;
        Ok(Self(connection))
    }

    /// Merges `minutes` into their rows, in one transaction.
    ///
    /// # Errors
    /// SQLite's; nothing was written then.
    pub fn write(&mut self, minutes: &[TrendMinute]) -> Result<(), Error> {
        let transaction = self.0.transaction()?;
        for minute in minutes {
            let shape = shape(&transaction, minute)?;
            for level in LEVELS {
                let at = minute.at_s.div_euclid(level.step_s) * level.step_s;
                merge(&transaction, (level.step_s, at, shape), minute)?;
            }
        }
        for level in LEVELS {
            cut(&transaction, level.step_s, level.rows)?;
        }
        transaction.commit()
    }
}

fn shape(
    transaction: &Transaction<'_>,
    TrendMinute { drive, columns, .. }: &TrendMinute,
) -> Result<i64, Error> {
    let key = (drive.as_str(), columns);
    let find = "SELECT number FROM shape WHERE drive = ? AND columns = ?";
    if let Some(number) = transaction
        .prepare_cached(find)?
        .query_row(key, |row| row.get(0))
        .optional()?
    {
        return Ok(number);
    }
    transaction.execute("INSERT INTO shape (drive, columns) VALUES (?, ?)", key)?;
    Ok(transaction.last_insert_rowid())
}

fn merge(
    transaction: &Transaction<'_>,
    key: (i64, i64, i64),
    minute: &TrendMinute,
) -> Result<(), Error> {
    let find = "SELECT cells FROM cells WHERE step = ? AND at = ? AND shape = ?";
    let known: Option<Vec<u8>> = transaction
        .prepare_cached(find)?
        .query_row(key, |row| row.get(0))
        .optional()?;
    let cells = known.map_or_else(
        || stored(&minute.cells),
        |known| merged(&known, &minute.cells),
    );
    let (step, at, shape) = key;
    transaction
        .prepare_cached("INSERT OR REPLACE INTO cells VALUES (?, ?, ?, ?)")?
        .execute((step, at, shape, cells))?;
    transaction
        .prepare_cached("INSERT OR IGNORE INTO moment VALUES (?, ?)")?
        .execute((step, at))?;
    Ok(())
}

/// Deletes the oldest rows. They are counted, so that a clock that was set ahead deletes no more than it adds.
fn cut(transaction: &Transaction<'_>, step: i64, rows: usize) -> Result<(), Error> {
    let oldest = "SELECT at FROM moment WHERE step = ? ORDER BY at DESC LIMIT 1 OFFSET ?";
    let last: Option<i64> = transaction
        .prepare_cached(oldest)?
        .query_row((step, rows), |row| row.get(0))
        .optional()?;
    if let Some(last) = last {
        transaction
            .prepare_cached("DELETE FROM cells WHERE step = ? AND at <= ?")?
            .execute((step, last))?;
        transaction
            .prepare_cached("DELETE FROM moment WHERE step = ? AND at <= ?")?
            .execute((step, last))?;
    }
    Ok(())
}
