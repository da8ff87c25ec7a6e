//! What outlives the process: the entries of lines, what lines learn of an earlier run, and how it is written. Files
//! and databases belong to the daemon.
//!
//! `entry` is what lines report, `remembered` what they get at start. `book` holds what is waiting to be written:
//! attempts in `audit`, each a `record`, equal ones counted together by `merge`; trips in the form of `trip`;
//! availability; what was used on each day in `days`. `row` is the form of a table row, with its CRC, `memory` that of the remembered state of a drive, and
//! `policy` decides what is deleted when the journal is full.

pub mod audit;
pub mod book;
pub mod days;
pub mod entry;
mod memory;
pub mod merge;
pub mod policy;
pub mod record;
pub mod remembered;
pub mod row;
pub mod stored;
pub mod trip;
pub mod words;

#[cfg(test)]
mod tests;

pub use crate::drive::usage::KeptUsage;
pub use book::{JournalBook, NewEvent};
pub use entry::{
    AttemptId, EntryToKeep, FailSafeCause, JournalEntry, RowNumber, TriedWrite, WriteAttempt,
};
pub use remembered::{RememberedDrive, RememberedLease, RememberedStop, TripBaseline};
pub use row::{JournalRow, JournalTable};
pub use stored::StoredEvent;
