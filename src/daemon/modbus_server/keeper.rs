//! Attempts of all clients that no line saw, on their way to the journal.

use crate::daemon::north_journal::Journal;
use crate::domain::command::{Owner, Report};
use crate::drive::description::DriveRef;
use crate::journal::{Attempt, AttemptId, Tried};
use std::cell::Cell;

/// Numbers attempts and hands them on.
#[derive(Debug, Default)]
pub(super) struct Keeper {
    journal: Journal,
    last: Cell<u64>,
}

impl Keeper {
    pub(super) fn new(journal: Journal) -> Self {
        Self { journal, last: Cell::default() }
    }

    pub(super) fn keep(&self, drive: Option<DriveRef>, owner: Owner, tried: Tried, report: Report) {
        let Some(journal) = &self.journal else { return };
        self.last.set(self.last.get() + 1);
        journal.keep(drive, Attempt { id: AttemptId(self.last.get()), owner, tried, report: Some(report) });
    }
}
