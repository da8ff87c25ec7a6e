//! What is reported of one drive: notes, journal rows, and the outcomes of commands, of which the newest is shown.

use crate::domain::command::Report;
use crate::domain::ids::DriveIndex;
use crate::gateway::event::LineEffect;
use crate::gateway::note::DriveNote;
use crate::gateway::outbox::EffectOutbox;
use crate::gateway::waiter::ReportWaiter;
use crate::journal::{JournalEntry, RowNumber};

/// Where effects go.
pub(super) type Out<'a> = &'a mut EffectOutbox;

/// The reports of one drive.
#[derive(Debug)]
pub(super) struct DriveReports {
    drive: DriveIndex,
    /// The latest report of the newest command.
    last: Option<Report>,
    /// Number of commands so far, which is the number of the newest.
    commands: u16,
    has_changed: bool,
}

impl DriveReports {
    pub const fn new(drive: DriveIndex) -> Self {
        Self {
            drive,
            last: None,
            commands: 0,
            has_changed: true,
        }
    }

    pub const fn drive(&self) -> DriveIndex {
        self.drive
    }

    /// The latest report of the newest command, and its number.
    pub const fn newest(&self) -> (Option<Report>, u16) {
        (self.last, self.commands)
    }

    /// Marks the view as changed.
    pub const fn mark_changed(&mut self) {
        self.has_changed = true;
    }

    /// Whether the view has changed since the last call.
    pub const fn take_changed(&mut self) -> bool {
        std::mem::replace(&mut self.has_changed, false)
    }

    pub fn note(&self, note: DriveNote, out: Out<'_>) {
        out.push_back(LineEffect::Note(self.drive, note));
    }

    /// Adds a journal row with `entry`. Returns its number; `None` without a journal.
    pub fn keep(&self, entry: JournalEntry, out: Out<'_>) -> Option<RowNumber> {
        out.keep(self.drive, entry)
    }

    pub const fn count(&mut self, waiter: &mut ReportWaiter) {
        self.commands = self.commands.wrapping_add(1);
        waiter.set_number(self.commands);
    }

    /// The newest command has ended after all with `report`.
    pub const fn ended_after_all(&mut self, report: Report) {
        self.last = Some(report);
        self.has_changed = true;
    }

    pub fn tell(
        &mut self,
        waiter: &mut ReportWaiter,
        report: Report,
        is_final: bool,
        out: Out<'_>,
    ) {
        if waiter.number() == Some(self.commands) {
            self.last = Some(report);
        }
        self.has_changed = true;
        out.tell(waiter, report, is_final);
    }

    /// Ends the wait of all `waiters` with `report`.
    pub fn tell_all(&mut self, waiters: &mut Vec<ReportWaiter>, report: Report, out: Out<'_>) {
        for mut waiter in std::mem::take(waiters) {
            self.tell(&mut waiter, report, true, out);
        }
    }
}
