//! Trip events in the database: numbered, read until they are taken, recovered from a damaged file.

use super::reader::{self, ReadRow};
use crate::domain::ids::Name;
use crate::journal::{JournalRow, JournalTable, NewEvent, StoredEvent};
use rusqlite::{Connection, Error};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// Mark of an event that the broker has taken.
pub const TAKEN: u8 = 1;
/// Mark of an event that is damaged: it is shown as such and cannot be published.
const DAMAGED: u8 = 2;
/// Most events that are recovered from a damaged file.
const RESCUED_MAX: usize = 1024;

/// `event` with its number and the name of the file that assigned it, as it is published.
#[must_use]
pub fn row(event: &NewEvent, number: u64, session: &str) -> JournalRow {
    let mut body = event.body.clone();
    body.insert("seq".to_owned(), number.into());
    body.insert("session".to_owned(), session.into());
    let kind = event.kind.to_owned();
    let name = event.drive.as_str().to_owned();
    JournalRow {
        number,
        at: event.at,
        kind,
        name: Some(name),
        body: Value::Object(body).to_string(),
    }
}

/// Marks the events with these numbers.
///
/// # Errors
/// SQLite's.
pub fn mark(connection: &Connection, numbers: &BTreeSet<u64>, mark: u8) -> Result<(), Error> {
    for number in numbers {
        connection
            .prepare_cached("UPDATE event SET taken = ? WHERE number = ?")?
            .execute((mark, number))?;
    }
    Ok(())
}

/// At most `most` events after `after` that were not taken, and whether there are more. Damaged ones are marked and
/// skipped from then on.
///
/// # Errors
/// SQLite's.
pub fn waiting(
    connection: &Connection,
    after: u64,
    most: usize,
) -> Result<(Vec<StoredEvent>, bool), Error> {
    loop {
        let rows = unread(connection, after, most + 1)?;
        let damaged: BTreeSet<u64> = rows
            .iter()
            .filter(|seen| event_of(seen).is_none())
            .map(ReadRow::number)
            .collect();
        if damaged.is_empty() {
            let has_more = rows.len() > most;
            return Ok((
                rows.iter().take(most).filter_map(event_of).collect(),
                has_more,
            ));
        }
        tracing::error!(numbers = ?damaged, "ALARM: trip events in the journal are damaged and cannot be published");
        mark(connection, &damaged, DAMAGED)?;
        let still = unread(connection, after, most + 1)?;
        if still.iter().any(|seen| damaged.contains(&seen.number())) {
            // Otherwise it would be found again for ever.
            return Err(reader::out_of_order(JournalTable::Event));
        }
    }
}

fn unread(connection: &Connection, after: u64, most: usize) -> Result<Vec<ReadRow>, Error> {
    let mut select = connection.prepare_cached(
        "SELECT number, at, kind, name, body, crc FROM event WHERE taken = 0 AND number > ? ORDER BY number LIMIT ?",
    )?;
    let rows = select.query_map((after, most), |row| {
        reader::read_row(JournalTable::Event, row)
    })?;
    rows.collect()
}

fn event_of(seen: &ReadRow) -> Option<StoredEvent> {
    let ReadRow::Sound(row) = seen else {
        return None;
    };
    let drive = Name::new(row.name.as_deref()?)?;
    Some(StoredEvent {
        seq: row.number,
        drive,
        body: row.body.clone(),
    })
}

/// The sound events of the damaged file at `path` that were not taken, as far as they can be read, and the highest
/// number of all.
#[must_use]
pub fn rescued(path: &Path) -> (Vec<JournalRow>, u64) {
    let Ok(connection) = reader::salvage(path) else {
        return (Vec::new(), 0);
    };
    let mut rows: Vec<JournalRow> = Vec::new();
    while rows.len() < RESCUED_MAX {
        let after = rows.last().map_or(0, |row| row.number);
        let Ok(seen) = unread(&connection, after, 16) else {
            break;
        };
        let before = rows.len();
        let sound = seen.into_iter().filter_map(|seen| {
            if let ReadRow::Sound(row) = seen {
                Some(row)
            } else {
                None
            }
        });
        // A damaged index can loop.
        rows.extend(sound.filter(|row| row.number > after));
        if rows.len() == before {
            break;
        }
    }
    let highest = connection.query_row("SELECT max(number) FROM event", [], |row| {
        row.get::<_, Option<u64>>(0)
    });
    let newest = rows.last().map(|row| row.number);
    (rows, highest.ok().flatten().max(newest).unwrap_or(0))
}
