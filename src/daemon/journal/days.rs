//! The table of what each drive has used on each day.

use super::reader;
use crate::drive::usage::UsageTotals;
use crate::journal::days::{DAYS_MAX, Day, from_row, to_row};
use rusqlite::{Connection, Error, OptionalExtension, Transaction, params};
use std::path::Path;

/// One day of one drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DayRow {
    /// The drive's name.
    pub drive: String,
    /// The day.
    pub day: Day,
    /// What it used.
    pub totals: UsageTotals,
}

/// What the file holds of `day`; nothing where that is damaged.
///
/// # Errors
/// SQLite's.
pub(super) fn of(connection: &Connection, name: &str, day: Day) -> Result<UsageTotals, Error> {
    let mut select = connection.prepare_cached("SELECT body, crc FROM day WHERE drive = ? AND day = ?")?;
    let found: Option<(String, u32)> =
        select.query_row(params![name, day.0], |row| Ok((row.get(0)?, row.get(1)?))).optional()?;
    Ok(found.and_then(|(body, crc)| from_row(name, day, &body, crc)).unwrap_or_default())
}

/// Stores `totals`, and deletes the oldest days of a drive that has too many.
///
/// # Errors
/// SQLite's.
pub(super) fn put(transaction: &Transaction<'_>, name: &str, day: Day, totals: &UsageTotals) -> Result<(), Error> {
    let (body, crc) = to_row(name, day, totals);
    let update = "UPDATE day SET body = ?, crc = ? WHERE drive = ? AND day = ?";
    if transaction.prepare_cached(update)?.execute(params![body, crc, name, day.0])? > 0 {
        return Ok(());
    }
    transaction.execute("INSERT INTO day VALUES (?, ?, ?, ?)", params![name, day.0, body, crc])?;
    // They are counted, so that a clock that was set ahead deletes no more than it adds.
    let cut = "DELETE FROM day WHERE drive = ?1 AND day <= \
               (SELECT day FROM day WHERE drive = ?1 ORDER BY day DESC LIMIT 1 OFFSET ?2)";
    transaction.execute(cut, params![name, DAYS_MAX]).map(drop)
}

/// Recovers the sound days of the damaged file at `old`, as far as they can be read.
///
/// # Errors
/// SQLite's, of the database that takes them over.
pub(super) fn take_over(transaction: &Transaction<'_>, old: &Path) -> Result<(), Error> {
    let mut rows = Vec::new();
    // What was read before an error is still sound, and an older file has no days.
    let _ = reader::salvage(old).and_then(|connection| each(&connection, None, |row| rows.push(row)));
    for DayRow { drive, day, totals } in &rows {
        put(transaction, drive, *day, totals)?;
    }
    Ok(())
}

/// Calls `take` with each sound day of `drive`, or of all drives, oldest first.
///
/// # Errors
/// SQLite's; a file of an earlier version has none.
pub fn each(connection: &Connection, drive: Option<&str>, mut take: impl FnMut(DayRow)) -> Result<(), Error> {
    let sql = "SELECT drive, day, body, crc FROM day WHERE ?1 IS NULL OR drive = ?1 ORDER BY day, drive";
    let mut select = connection.prepare(sql)?;
    let mut rows = select.query([drive])?;
    while let Some(row) = rows.next()? {
        let sound = || {
            let drive: String = row.get(0).ok()?;
            let day = Day(row.get(1).ok()?);
            let body: String = row.get(2).ok()?;
            let totals = from_row(&drive, day, &body, row.get(3).ok()?)?;
            Some(DayRow { drive, day, totals })
        };
        sound().into_iter().for_each(&mut take);
    }
    Ok(())
}
