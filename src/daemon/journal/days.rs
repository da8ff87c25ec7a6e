//! The table of what each drive has used on each day.

use super::listing::with_title;
use super::reader;
use crate::domain::calendar::day;
use crate::drive::usage::{EnergySource, UsagePart, UsageTotals};
use crate::journal::days::{DAYS_MAX, DayNumber, DayUsage, from_row, to_row};
use crate::north::api::DayDocument;
use crate::north::titles::{PartTitle, PlantTitles};
use rusqlite::{Connection, Error, OptionalExtension, Transaction, params};
use std::path::Path;

/// One day of one drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DayRow {
    /// The drive's name.
    pub drive: String,
    /// The day.
    pub day: DayNumber,
    /// What it used.
    pub usage: DayUsage,
}

/// The columns of CSV in a plant with `titles`, with the line break.
#[must_use]
pub fn columns(titles: &PlantTitles) -> String {
    let columns = "day,drive,energy_kwh,energy_from,running_hours,starts,trips";
    with_title(columns, titles, Some("title"))
}

impl DayRow {
    /// The row as a document.
    #[must_use]
    pub fn document(&self) -> DayDocument {
        let DayUsage {
            totals,
            energy_from,
        } = self.usage;
        DayDocument {
            day: day(self.day.begin()).into(),
            drive: self.drive.clone().into(),
            energy_kwh: energy_from.map(|_| totals.value(UsagePart::Energy).value()),
            energy_from: energy_from.map(|from| from.keyword().to_owned()),
            running_hours: totals.value(UsagePart::RunningHours).value(),
            starts: totals.starts,
            trips: totals.trips,
        }
    }

    /// The row as a line of CSV, with its line break. A name needs no quotes.
    #[must_use]
    pub fn in_csv(&self, titles: &PlantTitles) -> String {
        let DayUsage {
            totals,
            energy_from,
        } = self.usage;
        let energy = energy_from
            .map(|_| totals.value(UsagePart::Energy).to_string())
            .unwrap_or_default();
        let from = energy_from.map_or("", EnergySource::keyword);
        let UsageTotals { starts, trips, .. } = totals;
        let hours = totals.value(UsagePart::RunningHours);
        let line = format!(
            "{},{},{energy},{from},{hours},{starts},{trips}",
            day(self.day.begin()),
            self.drive
        );
        let title = titles.drives.get(&self.drive);
        with_title(&line, titles, title.map(PartTitle::as_str))
    }
}

/// What the file holds of `day`; nothing where that is damaged.
///
/// # Errors
/// SQLite's.
pub(super) fn usage_of_day(
    connection: &Connection,
    name: &str,
    day: DayNumber,
) -> Result<UsageTotals, Error> {
    let mut select =
        connection.prepare_cached("SELECT body, crc FROM day WHERE drive = ? AND day = ?")?;
    let found: Option<(String, u32)> = select
        .query_row(params![name, day.0], |row| Ok((row.get(0)?, row.get(1)?)))
        .optional()?;
    Ok(found
        .and_then(|(body, crc)| from_row(name, day, &body, crc))
        .unwrap_or_default()
        .totals)
}

/// Stores `usage`, and deletes the oldest days of a drive that has too many.
///
/// # Errors
/// SQLite's.
pub(super) fn put(
    transaction: &Transaction<'_>,
    name: &str,
    day: DayNumber,
    usage: &DayUsage,
) -> Result<(), Error> {
    let (body, crc) = to_row(name, day, usage);
    let update = "UPDATE day SET body = ?, crc = ? WHERE drive = ? AND day = ?";
    if transaction
        .prepare_cached(update)?
        .execute(params![body, crc, name, day.0])?
        > 0
    {
        return Ok(());
    }
    transaction.execute(
        "INSERT INTO day VALUES (?, ?, ?, ?)",
        params![name, day.0, body, crc],
    )?;
    // They are counted, so that a clock that was set ahead deletes no more than it adds.
    let cut = "DELETE FROM day WHERE drive = ?1 AND day <= \
               (SELECT day FROM day WHERE drive = ?1 ORDER BY day DESC LIMIT 1 OFFSET ?2)";
    transaction.execute(cut, params![name, DAYS_MAX]).map(drop)
}

/// Deletes the oldest days of all drives if there are more than `most` rows. Returns whether there were.
///
/// # Errors
/// SQLite's.
pub(super) fn cut(connection: &Connection, most: u64) -> Result<bool, Error> {
    if connection.query_row("SELECT count(*) FROM day", [], |row| row.get::<_, u64>(0))? <= most {
        return Ok(false);
    }
    let cut =
        "DELETE FROM day WHERE day <= (SELECT day FROM day ORDER BY day DESC LIMIT 1 OFFSET ?)";
    Ok(connection.execute(cut, [most])? > 0)
}

/// Recovers the sound days of the damaged file at `old`, as far as they can be read.
///
/// # Errors
/// SQLite's, of the database that takes them over.
pub(super) fn take_over(transaction: &Transaction<'_>, old: &Path) -> Result<(), Error> {
    let mut rows = Vec::new();
    // What was read before an error is still sound, and an older file has no days.
    let _ = reader::salvage(old)
        .and_then(|connection| each_day(&connection, None, |row| rows.push(row)));
    for DayRow { drive, day, usage } in &rows {
        put(transaction, drive, *day, usage)?;
    }
    Ok(())
}

/// Calls `take` with each sound day of `drive`, or of all drives, oldest first.
///
/// # Errors
/// SQLite's.
pub fn each_day(
    connection: &Connection,
    drive: Option<&str>,
    mut take: impl FnMut(DayRow),
) -> Result<(), Error> {
    let has_table = "SELECT count(*) FROM sqlite_schema WHERE name = 'day'";
    if connection.query_row(has_table, [], |row| row.get::<_, u64>(0))? == 0 {
        // The file is of an earlier version.
        return Ok(());
    }
    let sql =
        "SELECT drive, day, body, crc FROM day WHERE ?1 IS NULL OR drive = ?1 ORDER BY day, drive";
    let mut select = connection.prepare(sql)?;
    let mut rows = select.query([drive])?;
    while let Some(row) = rows.next()? {
        let sound = || {
            let drive: String = row.get(0).ok()?;
            let day = DayNumber(row.get(1).ok()?);
            let body: String = row.get(2).ok()?;
            let usage = from_row(&drive, day, &body, row.get(3).ok()?)?;
            Some(DayRow { drive, day, usage })
        };
        sound().into_iter().for_each(&mut take);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::schema;
    use super::*;
    use crate::daemon::testing::Dir;

    fn made(path: &Path) -> Connection {
        let mut connection = Connection::open(path).unwrap();
        schema::make(&mut connection, "test").unwrap();
        connection
    }

    fn usage(starts: u32) -> DayUsage {
        let totals = UsageTotals {
            starts,
            ..UsageTotals::default()
        };
        DayUsage {
            totals,
            energy_from: Some(EnergySource::Power),
        }
    }

    fn all(connection: &Connection, drive: Option<&str>) -> Vec<(String, i32, u32)> {
        let mut rows = Vec::new();
        each_day(connection, drive, |row| {
            rows.push((row.drive, row.day.0, row.usage.totals.starts))
        })
        .unwrap();
        rows
    }

    fn write(connection: &mut Connection, name: &str, days: impl Iterator<Item = i32>) {
        let transaction = connection.transaction().unwrap();
        days.for_each(|day| put(&transaction, name, DayNumber(day), &usage(1)).unwrap());
        transaction.commit().unwrap();
    }

    #[test]
    fn a_day_has_one_row_and_each_drive_its_own() {
        let directory = Dir::new();
        let mut connection = made(&directory.join("journal.db"));
        write(&mut connection, "pump-1", [5, 4, 5].into_iter());
        write(&mut connection, "fan-2", [5].into_iter());
        let row = |name: &str, day| (name.to_owned(), day, 1);
        assert_eq!(
            all(&connection, None),
            [row("pump-1", 4), row("fan-2", 5), row("pump-1", 5)]
        );
        assert_eq!(all(&connection, Some("fan-2")), [row("fan-2", 5)]);
        assert_eq!(
            usage_of_day(&connection, "pump-1", DayNumber(4))
                .unwrap()
                .starts,
            1
        );
        assert_eq!(
            usage_of_day(&connection, "pump-1", DayNumber(9)).unwrap(),
            UsageTotals::default()
        );
    }

    #[test]
    fn the_days_of_a_drive_are_bounded_and_a_clock_that_was_ahead_deletes_no_more_than_it_added() {
        let directory = Dir::new();
        let mut connection = made(&directory.join("journal.db"));
        let most = i32::try_from(DAYS_MAX).unwrap();
        write(&mut connection, "pump-1", 0..most + 10);
        write(
            &mut connection,
            "pump-1",
            [1_000_000, 1_000_001].into_iter(),
        );
        write(&mut connection, "fan-2", [0].into_iter());
        let days = all(&connection, Some("pump-1"));
        assert_eq!((days.len(), days[0].1), (DAYS_MAX as usize, 12));
        assert_eq!(all(&connection, Some("fan-2")).len(), 1);
    }

    #[test]
    fn in_a_full_journal_the_oldest_days_of_all_drives_give_way() {
        let directory = Dir::new();
        let mut connection = made(&directory.join("journal.db"));
        for name in ["pump-1", "fan-2", "mill-3"] {
            write(&mut connection, name, 0..100);
        }
        assert!(!cut(&connection, 300).unwrap());
        assert!(cut(&connection, 30).unwrap());
        let days = all(&connection, None);
        assert_eq!((days.len(), days[0].1), (30, 90));
        assert!(!cut(&connection, 30).unwrap(), "once is enough");
        assert!(cut(&connection, 0).unwrap() && all(&connection, None).is_empty());
    }

    #[test]
    fn sound_days_of_a_damaged_file_are_taken_over() {
        let directory = Dir::new();
        let old = directory.join("old.db");
        let mut connection = made(&old);
        write(&mut connection, "pump-1", 0..3);
        connection
            .execute(
                "UPDATE day SET body = replace(body, '1', '2') WHERE day = 1",
                [],
            )
            .unwrap();
        drop(connection);
        let mut connection = made(&directory.join("new.db"));
        let transaction = connection.transaction().unwrap();
        take_over(&transaction, &old).unwrap();
        take_over(&transaction, &directory.join("none.db")).unwrap();
        transaction.commit().unwrap();
        let days: Vec<_> = all(&connection, None)
            .into_iter()
            .map(|(_, day, _)| day)
            .collect();
        assert_eq!(days, [0, 2], "the flipped one is lost");
    }

    #[test]
    fn a_file_of_an_earlier_version_has_no_days() {
        let connection = Connection::open_in_memory().unwrap();
        assert_eq!(all(&connection, None), []);
    }
}
