//! Finds rows of the journal by table, name, time and number.

use super::reader::{ReadRow, TableRows};
use crate::domain::calendar::parse;
use crate::domain::time::WallTime;
use crate::journal::JournalTable;
use rusqlite::{Connection, Error};
use std::iter::Peekable;

/// Most rows that one search for the newest examines. A journal may hold millions.
const LOOKED_AT_MAX: usize = 200_000;
/// This many consecutive rows of a table that are too old end the search there. A few may be, if the clock was set.
const TOO_OLD_MAX: usize = 1000;

/// Since when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SearchStart {
    /// A moment.
    At(WallTime),
    /// Milliseconds before now.
    Ago(i64),
}

impl SearchStart {
    /// Parses a time or a duration.
    ///
    /// # Errors
    /// What is expected, as text.
    pub fn parse(text: &str) -> Result<Self, String> {
        let ago = || {
            let (number, unit) = text.split_at(text.find(|c: char| !c.is_ascii_digit())?);
            let unit: i64 = match unit {
                "s" => 1_000,
                "min" => 60_000,
                "h" => 3_600_000,
                "d" => 86_400_000,
                _ => return None,
            };
            number.parse::<i64>().ok()?.checked_mul(unit).map(Self::Ago)
        };
        let found = parse(text).map(Self::At).or_else(ago);
        found.ok_or_else(|| {
            "expected a time such as 2026-01-31T08:00, or a duration such as 30min, 12h or 7d"
                .to_owned()
        })
    }

    /// The moment, as of `now`.
    #[must_use]
    pub const fn moment(self, now: WallTime) -> WallTime {
        match self {
            Self::At(at) => at,
            Self::Ago(millis) => WallTime {
                unix_ms: now.unix_ms.saturating_sub(millis),
            },
        }
    }
}

/// The tables that a word names; `None` if it is unknown.
#[must_use]
pub fn tables(word: &str) -> Option<&'static [JournalTable]> {
    Some(match word {
        "trips" => &[JournalTable::Event],
        "audit" => &[JournalTable::Audit],
        "availability" => &[JournalTable::Availability],
        "all" => &JournalTable::ALL,
        _ => return None,
    })
}

/// Which rows are wanted.
#[derive(Clone, Debug)]
pub struct WantedRows {
    /// Of which tables.
    pub tables: &'static [JournalTable],
    /// About this drive or line; `None` for all.
    pub drive: Option<String>,
    /// Since this moment; `None` for all.
    pub since: Option<WallTime>,
}

impl WantedRows {
    /// Whether a row is wanted. A damaged one always is: what it was about is unknown.
    #[must_use]
    pub fn wants(&self, seen: &ReadRow) -> bool {
        let ReadRow::Sound(row) = seen else {
            return true;
        };
        let is_about = self
            .drive
            .as_ref()
            .is_none_or(|drive| row.name.as_ref() == Some(drive));
        is_about && !self.is_too_old(seen)
    }

    fn is_too_old(&self, seen: &ReadRow) -> bool {
        let ReadRow::Sound(row) = seen else {
            return false;
        };
        self.since
            .is_some_and(|since| row.at.unix_ms < since.unix_ms)
    }
}

/// The rows of several tables, merged by time. Each table stays in its own order, whatever the clock did.
#[derive(Debug)]
pub struct MergedRows<'c>(Vec<(JournalTable, Peekable<TableRows<'c>>)>);

impl<'c> MergedRows<'c> {
    /// All rows of these tables, oldest first.
    #[must_use]
    pub fn new(connection: &'c Connection, tables: &[JournalTable]) -> Self {
        Self(
            tables
                .iter()
                .map(|table| (*table, TableRows::after(connection, *table, 0).peekable()))
                .collect(),
        )
    }
}

impl Iterator for MergedRows<'_> {
    type Item = Result<(JournalTable, ReadRow), rusqlite::Error>;

    fn next(&mut self) -> Option<Self::Item> {
        let moment = |rows: &mut Peekable<TableRows<'_>>| match rows.peek()? {
            Ok(ReadRow::Sound(row)) => Some(row.at.unix_ms),
            // At once: no moment is known, and an error ends everything.
            Ok(ReadRow::Damaged(_)) | Err(_) => Some(i64::MIN),
        };
        let moments = self
            .0
            .iter_mut()
            .enumerate()
            .filter_map(|(place, (_, rows))| Some((moment(rows)?, place)));
        let (_, place) = moments.min()?;
        let (table, rows) = self.0.get_mut(place)?;
        rows.next().map(|seen| seen.map(|seen| (*table, seen)))
    }
}

/// What a search for the newest has found.
#[derive(Debug)]
pub struct SearchResult {
    /// Tables and numbers of the rows, oldest first. The rows themselves may be many and long.
    pub rows: Vec<(JournalTable, u64)>,
    /// False if older rows may have been left out because the search took too long.
    pub is_complete: bool,
}

/// The newest `most` rows that are wanted. It starts at the newest, so it is cheap in a long journal.
///
/// # Errors
/// SQLite's.
pub fn newest(
    connection: &Connection,
    wanted: &WantedRows,
    most: usize,
) -> Result<SearchResult, Error> {
    let mut tables: Vec<_> = wanted
        .tables
        .iter()
        .map(|table| BackwardRows::new(connection, *table))
        .collect();
    let mut rows = Vec::new();
    let mut looked_at = 0;
    while rows.len() < most && looked_at < LOOKED_AT_MAX {
        let moments = tables
            .iter_mut()
            .enumerate()
            .filter_map(|(place, table)| Some((table.moment()?, place)));
        let Some((_, place)) = moments.max() else {
            break;
        };
        let Some(table) = tables.get_mut(place) else {
            break;
        };
        let Some(seen) = table.rows.next().transpose()? else {
            continue;
        };
        looked_at += 1;
        table.too_old = if wanted.is_too_old(&seen) {
            table.too_old + 1
        } else {
            0
        };
        if wanted.wants(&seen) {
            rows.push((table.table, seen.number()));
        }
        if table.too_old >= TOO_OLD_MAX {
            tables.remove(place);
        }
    }
    rows.reverse();
    Ok(SearchResult {
        rows,
        is_complete: looked_at < LOOKED_AT_MAX,
    })
}

/// The rows of one table, newest first.
struct BackwardRows<'c> {
    table: JournalTable,
    rows: Peekable<TableRows<'c>>,
    /// Consecutive rows that were too old.
    too_old: usize,
}

impl<'c> BackwardRows<'c> {
    fn new(connection: &'c Connection, table: JournalTable) -> Self {
        Self {
            table,
            rows: TableRows::newest_first(connection, table).peekable(),
            too_old: 0,
        }
    }

    /// The time by which the next row is merged with those of other tables.
    fn moment(&mut self) -> Option<i64> {
        Some(match self.rows.peek()? {
            Ok(ReadRow::Sound(row)) => row.at.unix_ms,
            // At once: no moment is known, and an error ends everything.
            Ok(ReadRow::Damaged(_)) | Err(_) => i64::MAX,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::journal::schema;
    use crate::journal::JournalRow;
    use serde_json::json;

    /// A journal with these rows: table, number, moment, name.
    fn journal(
        rows: impl IntoIterator<Item = (JournalTable, u64, i64, &'static str)>,
    ) -> Connection {
        let mut connection = Connection::open_in_memory().unwrap();
        schema::make(&mut connection, "test").unwrap();
        for (table, number, unix_ms, name) in rows {
            let row = JournalRow {
                number,
                ..JournalRow::new(WallTime { unix_ms }, "test", Some(name), &json!({}))
            };
            let sql = format!(
                "INSERT INTO {} (number, at, kind, name, body, crc) VALUES (?, ?, ?, ?, ?, ?)",
                table.name()
            );
            connection
                .execute(
                    &sql,
                    (number, unix_ms, &row.kind, name, &row.body, row.crc(table)),
                )
                .unwrap();
        }
        connection
    }

    fn wanted(tables: &'static [JournalTable]) -> WantedRows {
        WantedRows {
            tables,
            drive: None,
            since: None,
        }
    }

    /// Tables and numbers of the newest.
    fn numbers(
        connection: &Connection,
        wanted: &WantedRows,
        most: usize,
    ) -> Vec<(JournalTable, u64)> {
        let SearchResult { rows, is_complete } = newest(connection, wanted, most).unwrap();
        assert!(is_complete);
        rows
    }

    #[test]
    fn the_newest_of_all_tables_are_found_in_their_order() {
        let connection = journal([
            (JournalTable::Audit, 1, 10, "a"),
            (JournalTable::Event, 1, 20, "b"),
            (JournalTable::Audit, 2, 30, "a"),
            (JournalTable::Event, 2, 40, "a"),
            (JournalTable::Audit, 3, 50, "b"),
        ]);
        let all = wanted(&JournalTable::ALL);
        assert_eq!(
            numbers(&connection, &all, 3),
            [
                (JournalTable::Audit, 2),
                (JournalTable::Event, 2),
                (JournalTable::Audit, 3)
            ]
        );
        assert_eq!(numbers(&connection, &all, 100).len(), 5);
        assert_eq!(
            numbers(&connection, &wanted(&[JournalTable::Event]), 1),
            [(JournalTable::Event, 2)]
        );
        let of_b = WantedRows {
            drive: Some("b".to_owned()),
            ..all.clone()
        };
        assert_eq!(
            numbers(&connection, &of_b, 100),
            [(JournalTable::Event, 1), (JournalTable::Audit, 3)]
        );
        let late = WantedRows {
            since: Some(WallTime { unix_ms: 40 }),
            ..all.clone()
        };
        assert_eq!(
            numbers(&connection, &late, 100),
            [(JournalTable::Event, 2), (JournalTable::Audit, 3)]
        );
        connection
            .execute("UPDATE audit SET name = 'x' WHERE number = 1", [])
            .unwrap();
        assert_eq!(
            numbers(&connection, &late, 100)[0],
            (JournalTable::Audit, 1),
            "a damaged one may be about anything"
        );
    }

    #[test]
    fn a_clock_that_was_set_back_for_a_while_hides_nothing() {
        let early = (1..=5).map(|number| (JournalTable::Audit, number, 1000, "a"));
        let set_back = (6..=10).map(|number| (JournalTable::Audit, number, 1, "a"));
        let connection = journal(early.chain(set_back));
        let late = WantedRows {
            since: Some(WallTime { unix_ms: 500 }),
            ..wanted(&[JournalTable::Audit])
        };
        assert_eq!(
            numbers(&connection, &late, 100),
            [1, 2, 3, 4, 5].map(|number| (JournalTable::Audit, number))
        );
    }

    #[test]
    fn a_search_in_a_long_journal_ends_soon() {
        let most = TOO_OLD_MAX as u64;
        let connection = journal(
            (1..=most + 1).map(|number| (JournalTable::Audit, number, i64::from(number == 1), "a")),
        );
        let late = WantedRows {
            since: Some(WallTime { unix_ms: 1 }),
            ..wanted(&[JournalTable::Audit])
        };
        assert_eq!(
            numbers(&connection, &late, 100),
            [] as [(JournalTable, u64); 0],
            "behind so many old ones nobody looks"
        );
    }

    #[test]
    fn moments_and_times_are_distinguished() {
        assert!(matches!(
            SearchStart::parse("2026-01-31T08:00"),
            Ok(SearchStart::At(_))
        ));
        assert!(matches!(
            SearchStart::parse("7d"),
            Ok(SearchStart::Ago(604_800_000))
        ));
        for wrong in [
            "",
            "7",
            "d",
            "7 d",
            "7w",
            "99999999999999999999d",
            "9223372036854775807d",
        ] {
            assert!(SearchStart::parse(wrong).is_err(), "{wrong}");
        }
    }
}
