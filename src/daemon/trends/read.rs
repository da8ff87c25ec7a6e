//! Reads the kept rows of a drive while they are written.

use crate::daemon::journal::reader::connect;
use crate::north::page::history::{DriveHistory, Names};
use crate::north::page::kept::{TrendLevel, cells};
use rusqlite::Error;
use std::path::Path;

/// The rows of `drive` at `level` up to `until_s`, the newest `rows`, with the values called `wanted`.
///
/// # Errors
/// SQLite's.
pub fn history(
    file: &Path,
    drive: &str,
    level: TrendLevel,
    rows: usize,
    until_s: i64,
    wanted: Names,
) -> Result<DriveHistory, Error> {
    let mut history = DriveHistory::new(level, wanted);
    if !file.exists() {
        // Nothing was kept yet.
        return Ok(history);
    }
    let connection = connect(file)?;
    let mut shapes = connection
        .prepare("SELECT number, columns FROM shape WHERE drive = ? ORDER BY number DESC")?;
    let shapes = shapes.query_map([drive], |row| {
        Ok((row.get::<_, i64>(0)?, row.get::<_, String>(1)?))
    })?;
    let shapes = shapes.collect::<Result<Vec<_>, _>>()?;
    let first = "SELECT min(at) FROM (SELECT at FROM moment WHERE step = ? AND at <= ? ORDER BY at DESC LIMIT ?)";
    let first: Option<i64> =
        connection.query_row(first, (level.step_s, until_s, rows), |row| row.get(0))?;
    let Some(first) = first else {
        return Ok(history);
    };
    let mut select = connection
        .prepare("SELECT at, cells FROM cells WHERE step = ? AND at BETWEEN ? AND ? AND shape = ? ORDER BY at")?;
    for (number, columns) in shapes {
        let found = select.query_map((level.step_s, first, until_s, number), |row| {
            Ok((row.get::<_, i64>(0)?, row.get::<_, Vec<u8>>(1)?))
        })?;
        for row in found {
            let (at, bytes) = row?;
            if let Some(cells) = cells(&bytes) {
                history.add(at, &columns, &cells);
            }
        }
    }
    Ok(history)
}
