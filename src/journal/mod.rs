//! What is kept beyond the life of the process: what a line says that should be kept, what it is told of an earlier life,
//! and how that is written. Files and databases are the daemon's.
//!
//! `entry` and `remembered` are what lines say and hear. `book` holds what waits to be written: attempts in `audit`, each
//! one a `record`, equal ones counted together by `merge`; trips as `trip` words them; comings and goings. `row` is how
//! all of it stands in a table, with its CRC, `memory` how what is remembered of a drive does, and `policy` says what
//! gives way when there is no more room.

pub mod audit;
pub mod book;
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

pub use book::{Book, NewEvent};
pub use entry::{Attempt, AttemptId, Cause, Entry, Keep, RowNumber, Tried};
pub use remembered::{Remembered, RememberedLease, RememberedStop, TripBaseline};
pub use row::{Row, Table};
pub use stored::StoredEvent;
