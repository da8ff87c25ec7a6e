//! The origin of rows: a line from its start to its end.

use crate::daemon::exchange::inbox::LineInbox;
use crate::domain::ids::Name;
use crate::drive::description::DriveDescription;
use crate::journal::RowNumber;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A line from its start to its end.
#[derive(Debug)]
pub struct RowOrigin {
    /// Its number among those who write to the journal.
    pub id: u64,
    /// The name of the line.
    pub line: Name,
    /// Its drives, in order.
    pub drives: Vec<DriveDescription>,
    /// The line's inbox, which is notified of what is kept.
    pub inbox: Arc<LineInbox>,
    /// The number up to which all its rows are kept.
    kept: AtomicU64,
}

impl RowOrigin {
    /// A line without rows.
    #[must_use]
    pub const fn new(
        id: u64,
        line: Name,
        drives: Vec<DriveDescription>,
        inbox: Arc<LineInbox>,
    ) -> Self {
        Self {
            id,
            line,
            drives,
            inbox,
            kept: AtomicU64::new(0),
        }
    }

    /// Notes that the row `number` and all before it are kept.
    pub fn note_kept(&self, number: RowNumber) {
        self.kept.store(number.0, Ordering::SeqCst);
    }

    /// Whether the row `number` and all before it are kept.
    #[must_use]
    pub fn has_kept(&self, number: RowNumber) -> bool {
        self.kept.load(Ordering::SeqCst) >= number.0
    }
}
