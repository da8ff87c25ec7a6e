//! The origin of rows: a line from its start to its end.

use crate::daemon::exchange::inbox::Inbox as LineInbox;
use crate::domain::ids::Name;
use crate::drive::description::DriveDescription;
use crate::journal::RowNumber;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A line from its start to its end.
#[derive(Debug)]
pub struct Origin {
    pub(super) id: u64,
    pub(super) line: Name,
    /// In order.
    pub(super) drives: Vec<DriveDescription>,
    pub(super) inbox: Arc<LineInbox>,
    /// The number up to which all its rows are kept.
    pub(super) kept: AtomicU64,
}

impl Origin {
    /// Whether the row `number` and all before it are kept.
    #[must_use]
    pub fn has_kept(&self, number: RowNumber) -> bool {
        self.kept.load(Ordering::SeqCst) >= number.0
    }
}
