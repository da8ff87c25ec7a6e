//! The tables of the journal's database: creating them, and migrating older ones.

use rusqlite::{Connection, Error, TransactionBehavior};

/// The version of the tables, stored as `user_version`.
pub const VERSION: i64 = 2;
/// "VFDG": the database is a journal of ours.
const APPLICATION: i64 = 0x5646_4447;
/// Bytes of the write-ahead log that stay when it is emptied.
const LOG_BYTES_KEPT: u64 = 4 * 1024 * 1024;

/// Statements that migrate the tables from each version to the next, oldest first.
const STEPS: [&str; VERSION as usize] = [
    "
    CREATE TABLE event (
        number INTEGER PRIMARY KEY AUTOINCREMENT, at INTEGER NOT NULL, kind TEXT NOT NULL, name TEXT,
        body TEXT NOT NULL, crc INTEGER NOT NULL, taken INTEGER NOT NULL DEFAULT 0);
    CREATE INDEX event_waiting ON event (number) WHERE taken = 0;
    CREATE TABLE audit (
        number INTEGER PRIMARY KEY, at INTEGER NOT NULL, kind TEXT NOT NULL, name TEXT,
        body TEXT NOT NULL, crc INTEGER NOT NULL);
    CREATE TABLE availability (
        number INTEGER PRIMARY KEY, at INTEGER NOT NULL, kind TEXT NOT NULL, name TEXT,
        body TEXT NOT NULL, crc INTEGER NOT NULL);
    CREATE TABLE drive (name TEXT PRIMARY KEY, body TEXT NOT NULL, crc INTEGER NOT NULL) WITHOUT ROWID;
    CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
",
    "
    CREATE TABLE day (
        drive TEXT NOT NULL, day INTEGER NOT NULL, body TEXT NOT NULL, crc INTEGER NOT NULL,
        PRIMARY KEY (drive, day)) WITHOUT ROWID;
",
];

/// The kind of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// The file was empty and has its tables now.
    New,
    /// The file had its tables, which are in their newest version now.
    Found,
    /// The file is a database of another program.
    Foreign,
    /// The file's tables are from a later version of this program.
    Newer(i64),
}

/// Creates or migrates the tables of `connection`.
///
/// # Errors
/// SQLite's.
pub fn make(connection: &mut Connection, session: &str) -> Result<FileKind, Error> {
    let number = |name: &str| connection.pragma_query_value(None, name, |row| row.get::<_, i64>(0));
    let version = number("user_version")?;
    let application = number("application_id")?;
    let tables: i64 =
        connection.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get(0))?;
    let is_new = version == 0 && tables == 0;
    if !is_new && application != APPLICATION {
        return Ok(FileKind::Foreign);
    }
    if version > VERSION {
        return Ok(FileKind::Newer(version));
    }
    if is_new {
        // Only before the first table: later it would require rewriting the whole file.
        connection.pragma_update(None, "auto_vacuum", "INCREMENTAL")?;
    }
    connection.pragma_update_and_check(None, "journal_mode", "WAL", |_| Ok(()))?;
    connection.pragma_update_and_check(None, "journal_size_limit", LOG_BYTES_KEPT, |_| Ok(()))?;
    // Done by a thread of its own, so that no row waits for it.
    connection.pragma_update_and_check(None, "wal_autocheckpoint", 0, |_| Ok(()))?;
    if version < VERSION {
        let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        for step in STEPS.iter().skip(usize::try_from(version).unwrap_or(0)) {
            transaction.execute_batch(step)?;
        }
        transaction.execute(
            "INSERT OR IGNORE INTO meta VALUES ('session', ?)",
            [session],
        )?;
        transaction.pragma_update(None, "application_id", APPLICATION)?;
        transaction.pragma_update(None, "user_version", VERSION)?;
        transaction.commit()?;
    }
    Ok(if is_new {
        FileKind::New
    } else {
        FileKind::Found
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A journal as version 1 left it, with a trip that no broker has taken and a drive.
    fn of_version_1() -> Connection {
        let connection = Connection::open_in_memory().unwrap();
        connection.execute_batch(STEPS[0]).unwrap();
        connection
            .pragma_update(None, "application_id", APPLICATION)
            .unwrap();
        connection.pragma_update(None, "user_version", 1).unwrap();
        let rows =
            "INSERT INTO event (number, at, kind, body, crc) VALUES (7, 1, 'tripped', '{}', 2);
                    INSERT INTO drive VALUES ('pump-1', '{}', 3);
                    INSERT INTO meta VALUES ('session', 'first');";
        connection.execute_batch(rows).unwrap();
        connection
    }

    #[test]
    fn a_journal_of_an_earlier_version_keeps_its_rows_and_gets_what_is_new() {
        let mut connection = of_version_1();
        assert_eq!(make(&mut connection, "second").unwrap(), FileKind::Found);
        let number = |sql: &str| {
            connection
                .query_row(sql, [], |row| row.get::<_, i64>(0))
                .unwrap()
        };
        assert_eq!(number("SELECT number FROM event WHERE taken = 0"), 7);
        assert_eq!(number("SELECT crc FROM drive WHERE name = 'pump-1'"), 3);
        assert_eq!(
            number("SELECT value = 'first' FROM meta WHERE key = 'session'"),
            1,
            "numbers go on"
        );
        assert_eq!(number("SELECT count(*) FROM day"), 0);
        assert_eq!(
            number("SELECT user_version FROM pragma_user_version"),
            VERSION
        );
        assert_eq!(
            make(&mut connection, "third").unwrap(),
            FileKind::Found,
            "once is enough"
        );
    }
}
