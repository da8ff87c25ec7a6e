//! The output of a line: effects in order, including journal rows, numbered without gaps.

use super::event::LineEffect;
use super::waiter::{OpenAttempt, ReportWaiter};
use crate::domain::command::{Owner, Report};
use crate::domain::counts::CommandCounts;
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::journal::{AttemptId, EntryToKeep, JournalEntry, RowNumber, TriedWrite, WriteAttempt};
use std::collections::VecDeque;

/// Effects of a line that the caller has not taken yet.
#[derive(Debug, Default)]
pub struct EffectOutbox {
    effects: VecDeque<LineEffect>,
    /// Whether there is a journal.
    keeps: bool,
    rows: u64,
    attempts: u64,
    /// The outcomes of attempts, per drive.
    commands: Vec<CommandCounts>,
    /// The moment of the event that is being handled.
    now: MonoTime,
}

impl EffectOutbox {
    /// Creates the outbox of a line with this many `drives`. It emits journal rows only if there is a journal (`keeps`).
    #[must_use]
    pub fn new(keeps: bool, drives: usize) -> Self {
        Self {
            keeps,
            commands: vec![CommandCounts::default(); drives],
            ..Self::default()
        }
    }

    /// The outcomes of attempts to command `drive` or to write to it.
    #[must_use]
    pub fn commands(&self, drive: DriveIndex) -> CommandCounts {
        self.commands.get(drive.get()).copied().unwrap_or_default()
    }

    /// Whether there is a journal.
    #[must_use]
    pub const fn keeps(&self) -> bool {
        self.keeps
    }

    /// Sets the moment of the following effects.
    pub const fn set_time(&mut self, now: MonoTime) {
        self.now = now;
    }

    /// The moment of the event that is being handled.
    pub const fn now(&self) -> MonoTime {
        self.now
    }

    /// Adds an effect.
    pub fn push_back(&mut self, effect: LineEffect) {
        self.effects.push_back(effect);
    }

    /// Takes the oldest effect.
    pub fn pop_front(&mut self) -> Option<LineEffect> {
        self.effects.pop_front()
    }

    /// Adds a journal row with `entry` about `drive`. Returns its number; `None` without a journal.
    pub fn keep(&mut self, drive: DriveIndex, entry: JournalEntry) -> Option<RowNumber> {
        if !self.keeps {
            return None;
        }
        self.rows += 1;
        let row = RowNumber(self.rows);
        self.effects.push_back(LineEffect::Keep(EntryToKeep {
            row,
            drive,
            at: self.now,
            entry,
        }));
        Some(row)
    }

    /// Records an attempt to write that ended at once with `report`.
    pub fn attempt_ended(
        &mut self,
        drive: DriveIndex,
        owner: Owner,
        tried: TriedWrite,
        report: Report,
    ) {
        self.attempt(drive, owner, tried, Some(report));
        self.count_end(drive, owner, report);
    }

    /// Records an accepted order; `waiter` gets its outcome.
    pub fn attempt_taken(
        &mut self,
        drive: DriveIndex,
        owner: Owner,
        tried: TriedWrite,
        waiter: &mut ReportWaiter,
    ) {
        let id = self.attempt(drive, owner, tried, None);
        waiter.set_attempt(OpenAttempt { id, owner });
    }

    /// Sends `waiter` an interim or final report of its command. The end of an attempt is recorded and counted even if
    /// no client waits for it any more.
    pub fn tell(&mut self, waiter: &mut ReportWaiter, report: Report, is_final: bool) {
        if is_final && let Some(OpenAttempt { id, owner }) = waiter.take_attempt() {
            self.keep(
                waiter.drive(),
                JournalEntry::Ended {
                    attempt: id,
                    report,
                },
            );
            self.count_end(waiter.drive(), owner, report);
        }
        self.effects.extend(waiter.answer(report, is_final));
    }

    fn attempt(
        &mut self,
        drive: DriveIndex,
        owner: Owner,
        tried: TriedWrite,
        report: Option<Report>,
    ) -> AttemptId {
        self.attempts += 1;
        let id = AttemptId(self.attempts);
        self.keep(
            drive,
            JournalEntry::Attempt(WriteAttempt {
                id,
                owner,
                tried,
                report,
            }),
        );
        id
    }

    fn count_end(&mut self, drive: DriveIndex, owner: Owner, report: Report) {
        if let Some(counts) = self.commands.get_mut(drive.get()) {
            counts.add(&owner, report.outcome);
        }
    }
}
