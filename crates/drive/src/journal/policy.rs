//! What is deleted when the journal has reached its size: audit before availability, availability before trips, oldest
//! rows first. What was used on each day gives way before all of them if it takes more than its part.

use super::row::JournalTable;

/// Assumed size of a row in bytes.
const ROW_BYTES: u64 = 512;
/// Each table keeps this fraction (1/n) of the size for its newest rows as long as another one can be cut.
const LEAST_PART: u64 = 16;
/// Minimum number of rows deleted at once, so that a full journal is not cut at every row.
const CUT_MIN: u64 = 64;

/// Assumed size of what a drive used on one day, in bytes.
const DAY_BYTES: u64 = 160;
/// What drives have used may take this fraction (1/n) of the size.
const DAYS_PART: u64 = 4;

/// How many days, of all drives together, may stay in a full journal of at most `most` bytes.
#[must_use]
pub const fn most_days(most: u64) -> u64 {
    most / DAYS_PART / DAY_BYTES
}

/// The number of rows of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableShare {
    /// The table.
    pub table: JournalTable,
    /// Its rows.
    pub rows: u64,
}

/// The oldest rows of one table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableCut {
    /// The table.
    pub table: JournalTable,
    /// Number of rows.
    pub rows: u64,
}

/// Whether a journal with `used` bytes in rows is so close to `most` that rows have to be deleted.
#[must_use]
pub const fn is_full(used: u64, most: u64) -> bool {
    used > most / 8 * 7
}

/// What to delete next from tables with these rows, in a journal of at most `most` bytes. `None` if all are empty.
#[must_use]
pub fn cut(shares: [TableShare; 3], most: u64) -> Option<TableCut> {
    let least = most / LEAST_PART / ROW_BYTES;
    let in_order = || {
        JournalTable::ALL
            .into_iter()
            .filter_map(|table| shares.into_iter().find(|share| share.table == table))
    };
    let above = in_order()
        .find(|share| share.rows > least)
        .map(|share| (share, least));
    let (share, floor) = above.or_else(|| {
        in_order()
            .find(|share| share.rows > 0)
            .map(|share| (share, 0))
    })?;
    let rows = (share.rows / 16).max(CUT_MIN).min(share.rows - floor);
    Some(TableCut {
        table: share.table,
        rows,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const MB: u64 = 1_000_000;

    fn shares(audit: u64, availability: u64, event: u64) -> [TableShare; 3] {
        let rows = [
            (JournalTable::Event, event),
            (JournalTable::Audit, audit),
            (JournalTable::Availability, availability),
        ];
        rows.map(|(table, rows)| TableShare { table, rows })
    }

    #[test]
    fn trips_are_kept_longest_and_nothing_is_pushed_out_whole() {
        let least = MB / 16 / 512;
        let table = [
            (
                shares(100_000, 100_000, 100_000),
                Some((JournalTable::Audit, 6250)),
            ),
            (
                shares(least + 1, 100_000, 100_000),
                Some((JournalTable::Audit, 1)),
            ),
            (
                shares(least, 100_000, 100_000),
                Some((JournalTable::Availability, 6250)),
            ),
            (
                shares(least, least, 100_000),
                Some((JournalTable::Event, 6250)),
            ),
            (
                shares(least, least, least + 70),
                Some((JournalTable::Event, 64)),
            ),
            (shares(least, least, least), Some((JournalTable::Audit, 64))),
            (shares(0, 3, 100), Some((JournalTable::Availability, 3))),
            (shares(0, 0, 100), Some((JournalTable::Event, 64))),
            (shares(0, 3, 0), Some((JournalTable::Availability, 3))),
            (shares(0, 0, 0), None),
        ];
        for (shares, cut) in table {
            let right = cut.map(|(table, rows)| TableCut { table, rows });
            assert_eq!(super::cut(shares, MB), right, "{shares:?}");
        }
    }

    #[test]
    fn it_always_comes_to_an_end() {
        let mut now = shares(3_000, 70, 5_000);
        let mut cuts = 0;
        while let Some(cut) = super::cut(now, 1000 * MB) {
            let share = now
                .iter_mut()
                .find(|share| share.table == cut.table)
                .unwrap();
            assert!(cut.rows > 0 && cut.rows <= share.rows);
            share.rows -= cut.rows;
            cuts += 1;
        }
        assert!(cuts < 1000 && now.iter().all(|share| share.rows == 0));
    }
}
