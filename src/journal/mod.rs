//! What is kept beyond the life of the process, as types: what a line says that should be kept, and what it is told of
//! an earlier life. Files and databases are the daemon's.

pub mod entry;
pub mod remembered;
pub mod stored;

pub use entry::{Attempt, AttemptId, Cause, Entry, Keep, RowNumber, Tried};
pub use remembered::{Remembered, RememberedLease, RememberedStop, TripBaseline};
pub use stored::StoredEvent;
