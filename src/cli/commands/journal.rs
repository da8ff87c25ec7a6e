//! `journal`: shows what the gateway has recorded, also while it runs.

use crate::cli::tools::data_dir::DataDirArgs;
use crate::cli::tools::{CommandFailure, print};
use crate::daemon::host::clock;
use crate::daemon::journal::file_in;
use crate::daemon::journal::listing::{columns, in_csv, in_json, in_words};
use crate::daemon::journal::reader::{ReadRow, connect, salvage};
use crate::daemon::journal::rescue::{FileStanding, standing};
use crate::daemon::journal::search::{MergedRows, SearchStart, WantedRows};
use crate::journal::JournalTable;
use crate::north::titles::PlantTitles;
use rusqlite::ErrorCode;
use std::collections::VecDeque;
use std::fmt;
use std::path::Path;

/// Rows that are shown if neither a number nor a start is given.
const LAST_USUAL: usize = 100;
/// Most rows that `--last` accepts: they are held in memory.
const LAST_MAX: u64 = 1_000_000;

/// Arguments of `journal`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// What is shown
    #[arg(value_enum, default_value_t = ShownRows::All)]
    which: ShownRows,
    #[command(flatten)]
    place: DataDirArgs,
    /// Only rows about this drive
    #[arg(long, value_name = "NAME")]
    drive: Option<String>,
    /// Only rows since a time in UTC, such as 2026-01-31 or 2026-01-31T08:00, or for a duration, such as 30min, 12h or 7d
    #[arg(long, value_name = "WHEN", value_parser = SearchStart::parse)]
    since: Option<SearchStart>,
    /// At most this many rows, the newest; default: 100 without --since
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=LAST_MAX))]
    last: Option<u64>,
    /// Print one JSON object per row
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Print CSV
    #[arg(long)]
    csv: bool,
}

/// Which rows are shown.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum ShownRows {
    /// Trips, and when they cleared
    Trips,
    /// Commands and refusals, and what the gateway did on its own
    Audit,
    /// Drives, lines and the gateway going online and offline
    Availability,
    /// All of them
    All,
}

/// Prints the rows, oldest first.
pub fn journal(args: &Args) -> Result<(), CommandFailure> {
    let (directory, titles) = args.place.read()?;
    let path = file_in(&directory);
    if !path.exists() {
        return Err(CommandFailure::failed(format!(
            "{}: there is no journal",
            path.display()
        )));
    }
    let failed =
        |error: rusqlite::Error| CommandFailure::failed(format!("{}: {error}", path.display()));
    let mut lost: Vec<_> = damage(&path)?.into_iter().collect();
    let connection = match connect(&path) {
        Ok(connection) if lost.is_empty() => connection,
        Err(error) if lost.is_empty() && !is_damaged(&error) => return Err(failed(error)),
        tried => {
            lost.extend(tried.err().map(|error| error.to_string()));
            salvage(&path).map_err(failed)?
        }
    };
    if args.csv {
        print(&columns(&titles))?;
    }
    let last = args
        .last
        .map(|last| last as usize)
        .or(args.since.is_none().then_some(LAST_USUAL));
    let mut newest = VecDeque::new();
    let wanted = args.wanted();
    for found in MergedRows::new(&connection, wanted.tables) {
        let found = match found {
            Ok(found) => found,
            Err(error) => {
                // The other tables are still read: their intact rows are shown.
                lost.push(error.to_string());
                continue;
            }
        };
        if !wanted.wants(&found.1) {
            continue;
        }
        match last {
            None => print(&args.shown(&found, &titles))?,
            Some(last) => {
                newest.push_back(found);
                if newest.len() > last {
                    newest.pop_front();
                }
            }
        }
    }
    newest
        .iter()
        .try_for_each(|found| print(&args.shown(found, &titles)))?;
    if lost.is_empty() {
        return Ok(());
    }
    Err(CommandFailure::failed(format!(
        "{}: the journal is damaged: {}; showing what could be read",
        path.display(),
        lost.join("; ")
    )))
}

/// What is known to be damaged before anything is read.
fn damage(path: &Path) -> Result<Option<String>, CommandFailure> {
    let failed =
        |what: &dyn fmt::Display| CommandFailure::failed(format!("{}: {what}", path.display()));
    match standing(path).map_err(|error| failed(&error))? {
        FileStanding::New | FileStanding::Whole => Ok(None),
        FileStanding::Empty => Err(failed(&"the journal is empty")),
        FileStanding::Broken(what) => Ok(Some(what)),
    }
}

fn is_damaged(error: &rusqlite::Error) -> bool {
    matches!(
        error.sqlite_error_code(),
        Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase)
    )
}

impl Args {
    fn wanted(&self) -> WantedRows {
        let tables: &[JournalTable] = match self.which {
            ShownRows::Trips => &[JournalTable::Event],
            ShownRows::Audit => &[JournalTable::Audit],
            ShownRows::Availability => &[JournalTable::Availability],
            ShownRows::All => &JournalTable::ALL,
        };
        let since = self.since.map(|since| since.moment(clock::wall()));
        WantedRows {
            tables,
            drive: self.drive.clone(),
            since,
        }
    }

    fn shown(&self, (table, seen): &(JournalTable, ReadRow), titles: &PlantTitles) -> String {
        if self.json {
            in_json(*table, seen, titles, false).to_string() + "\n"
        } else if self.csv {
            in_csv(*table, seen, titles)
        } else {
            in_words(*table, seen, titles)
        }
    }
}
