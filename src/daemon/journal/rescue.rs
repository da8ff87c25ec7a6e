//! What is left of a damaged journal: whether a file was truncated, and which of its rows are sound.

use super::reader::{self, PAGE_BYTES_MIN, ReadRow, TableRows};
use crate::journal::{JournalRow, JournalTable};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// The header of a database, which contains its length.
const HEADER_BYTES: usize = 100;
/// Most rows of one table that are recovered from a damaged file, the newest that can be read; also the most that are
/// examined for that. This happens before the gateway serves, so it must not take long.
const RESCUED_MAX: usize = 10_000;
const LOOKED_AT_MAX: usize = 100_000;

/// What exists at the journal's path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FileStanding {
    /// No file: a new journal begins.
    New,
    /// An empty file: a journal that was created and never written, or one whose rows are lost.
    Empty,
    /// A file that may be a sound journal.
    Whole,
    /// A file that cannot be one, and why.
    Broken(String),
}

/// What exists at `path`, judged by its length.
///
/// # Errors
/// The system's.
pub fn standing(path: &Path) -> io::Result<FileStanding> {
    let log = std::fs::metadata(PathBuf::from(format!("{}-wal", path.display())))
        .map_or(0, |log| log.len());
    let broken = |what: &str| Ok(FileStanding::Broken(what.to_owned()));
    let found = match std::fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound && log == 0 => {
            return Ok(FileStanding::New);
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return broken("it is missing, but its log exists");
        }
        found => found?,
    };
    match found.len() {
        // Opening a pipe would block.
        _ if !found.is_file() => broken("it is not a regular file"),
        0 if log == 0 => Ok(FileStanding::Empty),
        0 => broken("it is empty, but its log is not"),
        bytes if bytes < PAGE_BYTES_MIN => broken(&format!("it was cut to {bytes} bytes")),
        // What is missing in the file may be in its log.
        _ if log > 0 => Ok(FileStanding::Whole),
        bytes => Ok(match bytes_of(path)? {
            Some(whole) if whole > bytes => {
                FileStanding::Broken(format!("it was cut to {bytes} of {whole} bytes"))
            }
            _ => FileStanding::Whole,
        }),
    }
}

/// The length of the database at `path` according to its header, if that is valid.
fn bytes_of(path: &Path) -> io::Result<Option<u64>> {
    let mut header = [0; HEADER_BYTES];
    File::open(path)?.read_exact(&mut header)?;
    let number = |at: usize| {
        header
            .get(at..at + 4)
            .and_then(|it| it.try_into().ok())
            .map(u32::from_be_bytes)
    };
    let page = match header.get(16..18) {
        Some([0, 1]) => 65_536,
        Some([high, low]) => u64::from(u16::from_be_bytes([*high, *low])),
        _ => return Ok(None),
    };
    // The number of pages is valid if it was written with the last change.
    let change = number(24);
    let pages = number(28);
    let valid_for = number(92);
    Ok(match pages {
        Some(pages) if change == valid_for => Some(u64::from(pages) * page),
        _ => None,
    })
}

/// What could be read of one table.
#[derive(Debug, Default)]
pub struct RescuedTable {
    /// The newest of the sound rows that can be read, in order.
    pub rows: Vec<JournalRow>,
    /// Where reading failed and why; `None` if all of it was read.
    pub lost: Option<String>,
}

/// The sound rows of `table` in the damaged file at `path`, up to the first place that cannot be read.
#[must_use]
pub fn rescued(path: &Path, table: JournalTable) -> RescuedTable {
    let connection = match reader::salvage(path) {
        Ok(connection) => connection,
        Err(error) => {
            return RescuedTable {
                rows: Vec::new(),
                lost: Some(format!("all of {}: {error}", table.name())),
            };
        }
    };
    let sql = format!("SELECT max(number) FROM {}", table.name());
    let newest = connection
        .query_row(&sql, [], |row| row.get::<_, Option<u64>>(0))
        .ok()
        .flatten();
    let after = newest.map_or(0, |newest| newest.saturating_sub(RESCUED_MAX as u64));
    let mut rows = VecDeque::new();
    let mut last = after;
    let mut lost = None;
    for seen in TableRows::after(&connection, table, after).take(LOOKED_AT_MAX) {
        match seen {
            Ok(ReadRow::Sound(row)) => {
                last = row.number;
                rows.push_back(row);
                if rows.len() > RESCUED_MAX {
                    rows.pop_front();
                }
            }
            Ok(ReadRow::Damaged(_)) => {}
            Err(error) => lost = Some(format!("{} after number {last}: {error}", table.name())),
        }
    }
    RescuedTable {
        rows: rows.into(),
        lost,
    }
}
