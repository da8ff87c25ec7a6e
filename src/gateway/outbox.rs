//! What a line says: effects in order, and among them what should be kept, numbered without holes.

use super::event::Effect;
use super::waiter::{OpenAttempt, Waiter};
use crate::domain::command::{Owner, Report};
use crate::domain::counts::CommandCounts;
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::journal::{Attempt, AttemptId, Entry, Keep, RowNumber, Tried};
use std::collections::VecDeque;

/// What a line has said and nobody has taken yet.
#[derive(Debug, Default)]
pub struct Outbox {
    effects: VecDeque<Effect>,
    /// There is a journal.
    keeps: bool,
    rows: u64,
    attempts: u64,
    /// What became of those of each drive.
    commands: Vec<CommandCounts>,
    /// The moment of the event that is being handled.
    now: MonoTime,
}

impl Outbox {
    /// One of a line of so many `drives` that says what should be kept only if somebody `keeps` it.
    #[must_use]
    pub fn new(keeps: bool, drives: usize) -> Self {
        Self { keeps, commands: vec![CommandCounts::default(); drives], ..Self::default() }
    }

    /// What became of attempts to command `drive` or to write to it.
    #[must_use]
    pub fn commands(&self, drive: DriveIndex) -> CommandCounts {
        self.commands.get(drive.get()).copied().unwrap_or_default()
    }

    /// Whether there is a journal.
    #[must_use]
    pub const fn keeps(&self) -> bool {
        self.keeps
    }

    /// What is said from now on happens at `now`.
    pub const fn set_time(&mut self, now: MonoTime) {
        self.now = now;
    }

    /// The moment of the event that is being handled.
    pub const fn now(&self) -> MonoTime {
        self.now
    }

    /// One more effect.
    pub fn push_back(&mut self, effect: Effect) {
        self.effects.push_back(effect);
    }

    /// The oldest effect.
    pub fn pop_front(&mut self) -> Option<Effect> {
        self.effects.pop_front()
    }

    /// Says that `entry` about `drive` should be kept. Returns the number of its row; nothing without a journal.
    pub fn keep(&mut self, drive: DriveIndex, entry: Entry) -> Option<RowNumber> {
        if !self.keeps {
            return None;
        }
        self.rows += 1;
        let row = RowNumber(self.rows);
        self.effects.push_back(Effect::Keep(Keep { row, drive, at: self.now, entry }));
        Some(row)
    }

    /// Somebody tried to write, and it ended at once with `report`.
    pub fn attempt_ended(&mut self, drive: DriveIndex, owner: Owner, tried: Tried, report: Report) {
        self.attempt(drive, owner, tried, Some(report));
        self.count_end(drive, owner, report);
    }

    /// Somebody ordered something, and it was taken: `waiter` is told of its end.
    pub fn attempt_taken(&mut self, drive: DriveIndex, owner: Owner, tried: Tried, waiter: &mut Waiter) {
        let id = self.attempt(drive, owner, tried, None);
        waiter.set_attempt(OpenAttempt { id, owner });
    }

    /// Tells `waiter` what became of its command, so far or for good. The end of an attempt is kept and counted also if
    /// nobody waits for it any more.
    pub fn tell(&mut self, waiter: &mut Waiter, report: Report, is_final: bool) {
        if is_final && let Some(OpenAttempt { id, owner }) = waiter.take_attempt() {
            self.keep(waiter.drive(), Entry::Ended { attempt: id, report });
            self.count_end(waiter.drive(), owner, report);
        }
        self.effects.extend(waiter.answer(report, is_final));
    }

    fn attempt(&mut self, drive: DriveIndex, owner: Owner, tried: Tried, report: Option<Report>) -> AttemptId {
        self.attempts += 1;
        let id = AttemptId(self.attempts);
        self.keep(drive, Entry::Attempt(Attempt { id, owner, tried, report }));
        id
    }

    fn count_end(&mut self, drive: DriveIndex, owner: Owner, report: Report) {
        if let Some(counts) = self.commands.get_mut(drive.get()) {
            counts.add(&owner, report.outcome);
        }
    }
}
