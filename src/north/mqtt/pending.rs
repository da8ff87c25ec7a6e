//! What was handed to the lines and is not answered.

use super::results::Reply;
use crate::domain::command::{Order, Owner};
use crate::domain::ids::Ticket;
use crate::domain::time::MonoTime;
use serde_json::Value;

/// Most commands without an answer over all drives, stops aside.
pub(super) const COMMANDS_MAX: usize = 64;
/// Most stops of one drive without an answer: a stop for a drive that is away stays pending for minutes, and repeats
/// of it must not take the room of others.
const STOPS_MAX: usize = 4;
/// Most reads without an answer over all drives.
pub(super) const READS_MAX: usize = 64;

/// One command or read that is not answered.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pending {
    pub(super) ticket: Ticket,
    /// Place of the drive in the session's list.
    pub(super) drive: usize,
    /// Who asked.
    pub(super) by: Owner,
    pub(super) id: Value,
    pub(super) what: What,
    pub(super) reply: Option<Reply>,
    /// What its results say besides.
    pub(super) remark: Option<String>,
    /// When it is given up: long after the line must have answered.
    pub(super) forget_at: MonoTime,
}

/// What was asked.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum What {
    Order(Order),
    /// The register with this place in the drive's model.
    Read(usize),
}

/// All that is not answered, oldest first.
#[derive(Debug, Default)]
pub(super) struct Unanswered {
    all: Vec<Pending>,
}

impl Unanswered {
    /// Stops have room of their own.
    pub(super) fn has_room_for_command(&self) -> bool {
        self.all.iter().filter(|it| matches!(&it.what, What::Order(order) if !order.is_stop())).count() < COMMANDS_MAX
    }

    pub(super) fn has_room_for_read(&self) -> bool {
        self.all.iter().filter(|it| matches!(it.what, What::Read(_))).count() < READS_MAX
    }

    /// Takes the oldest stop of `drive` if there is no room for one more.
    pub(super) fn take_surplus_stop(&mut self, drive: usize) -> Option<Pending> {
        let is_its_stop =
            |it: &&Pending| it.drive == drive && matches!(&it.what, What::Order(order) if order.is_stop());
        let oldest = self.all.iter().find(is_its_stop)?.ticket;
        let is_full = self.all.iter().filter(is_its_stop).count() >= STOPS_MAX;
        if is_full { self.take(oldest) } else { None }
    }

    pub(super) fn add(&mut self, pending: Pending) {
        self.all.push(pending);
    }

    pub(super) fn get(&self, ticket: Ticket) -> Option<&Pending> {
        self.all.iter().find(|it| it.ticket == ticket)
    }

    pub(super) fn take(&mut self, ticket: Ticket) -> Option<Pending> {
        let place = self.all.iter().position(|it| it.ticket == ticket)?;
        Some(self.all.remove(place))
    }

    /// Takes one of a drive that has no place any more by `moved`.
    pub(super) fn take_gone(&mut self, moved: &[Option<usize>]) -> Option<Pending> {
        let place = self.all.iter().position(|it| moved.get(it.drive).copied().flatten().is_none())?;
        Some(self.all.remove(place))
    }

    /// Drives stand in other places now.
    pub(super) fn move_drives(&mut self, moved: &[Option<usize>]) {
        for pending in &mut self.all {
            pending.drive = moved.get(pending.drive).copied().flatten().unwrap_or(pending.drive);
        }
    }

    /// Takes one that is given up by `at`.
    pub(super) fn take_overdue(&mut self, at: MonoTime) -> Option<Pending> {
        let place = self.all.iter().position(|it| it.forget_at <= at)?;
        Some(self.all.remove(place))
    }

    pub(super) fn wake(&self) -> Option<MonoTime> {
        self.all.iter().map(|it| it.forget_at).min()
    }
}
