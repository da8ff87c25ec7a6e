//! A command in execution: its steps in turn, then a read-back of their effect, with one outcome for all.

mod awaiting;
mod read_back;
mod reset;
#[cfg(test)]
mod tests;

use super::waiter::ReportWaiter;
use crate::domain::command::{Order, Outcome, Owner, Reason, Report};
use crate::domain::ids::AskerId;
use crate::domain::time::MonoTime;
use crate::drive::steps::{CommandStep, StepPart, WriteStep};
use crate::guard::{Approved, VoidApproval};
use crate::profile::model::ExceptionKind;
use crate::wire::pdu::{Reply, Request};
use read_back::READS_MAX;
use std::time::Duration;

/// How long after its deadline an execution that has begun may continue: as long as a Modbus TCP client waits for its answer.
/// A station that must not be asked can delay it for longer, and an order must not be executed minutes later.
const HELD_UP_MAX: Duration = Duration::from_secs(5);
/// Maximum number of attempts for the stop that ends a reset. Every other write is sent once.
const STOPS_MAX: u8 = 4;

/// One approved command and its progress.
#[derive(Debug)]
pub struct CommandExecution {
    approved: Approved,
    waiter: ReportWaiter,
    stage: CommandStage,
    /// A frame of it was sent.
    has_begun: bool,
    /// Unanswered attempts of the current read, or of the stop that ends a reset.
    in_vain: u8,
    /// The next request is not sent before this moment.
    ready_at: MonoTime,
    /// Deadline for the drive to show the current condition; `None` before the first read.
    shown_until: Option<MonoTime>,
    repeats: ResetRepeats,
    /// The reset word was not answered: only the drive's trip state shows whether it took effect.
    is_in_doubt: bool,
    /// A write was sent that the drive never answers: only what is read afterwards shows whether it took effect.
    is_unanswered: bool,
}

/// The stage of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum CommandStage {
    /// The step at this index.
    Step(usize),
    /// All is written; the conditions of the step at this index are being read back.
    ReadBack(usize, usize),
    /// The step at this index was not answered: its conditions show whether it took effect. Nothing more is written.
    Resolve(usize, usize),
    /// Complete.
    Done,
}

/// Whether the stop that ends a reset is sent again, because the drive ignored it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ResetRepeats {
    No,
    /// The step at this index, after the current rest.
    AfterRest(usize),
    Done,
}

/// The result of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepResult {
    /// The execution continues, possibly with an interim report.
    Goes(Option<Report>),
    /// The execution is over.
    Ends(Report),
}

impl CommandExecution {
    /// Creates an execution for an approved command that has not begun.
    #[must_use]
    pub const fn new(approved: Approved, waiter: ReportWaiter) -> Self {
        Self {
            approved,
            waiter,
            stage: CommandStage::Step(0),
            has_begun: false,
            in_vain: 0,
            ready_at: MonoTime::ZERO,
            shown_until: None,
            repeats: ResetRepeats::No,
            is_in_doubt: false,
            is_unanswered: false,
        }
    }

    /// The waiting client.
    pub const fn waiter(&mut self) -> &mut ReportWaiter {
        &mut self.waiter
    }

    /// Whether `asker` is waiting for it.
    #[must_use]
    pub fn is_of(&self, asker: AskerId) -> bool {
        self.waiter.is_of(asker)
    }

    /// The owner who ordered it.
    #[must_use]
    pub const fn owner(&self) -> Owner {
        self.approved.owner()
    }

    /// The order.
    #[must_use]
    pub const fn order(&self) -> &Order {
        self.approved.order()
    }

    /// The writes that were not sent, or that the drive refused: everything from the current step on.
    pub fn parts_left(&self) -> impl Iterator<Item = StepPart> + '_ {
        let from = match self.stage {
            CommandStage::Step(index) => index,
            CommandStage::Resolve(index, _) => index + 1,
            CommandStage::ReadBack(..) | CommandStage::Done => self.approved.steps().len(),
        };
        self.approved
            .steps()
            .iter()
            .skip(from)
            .flat_map(writes_of)
            .map(|write| write.part)
    }

    /// Whether `newer` covers everything in this order, and nothing of this one has been sent: the newer one replaces
    /// it.
    #[must_use]
    pub fn is_replaced_by(&self, newer: &Self) -> bool {
        let (Order::Go(old), Order::Go(new)) = (self.order(), newer.order()) else {
            return false;
        };
        self.stage == CommandStage::Step(0)
            && !self.has_begun
            && old.registers().is_empty()
            && self.owner() == newer.owner()
            && (old.frequency().is_none() || new.frequency().is_some())
            && (old.run().is_none() || new.run().is_some())
    }

    /// The next request, and the earliest moment to send it.
    #[must_use]
    pub fn request(&self) -> Option<(MonoTime, Request)> {
        let request = match self.stage {
            CommandStage::Step(index) => self.approved.request(index)?,
            CommandStage::ReadBack(index, shown) | CommandStage::Resolve(index, shown) => {
                let condition = self.condition(index, shown)?;
                Request::Read {
                    address: condition.address,
                    count: condition.words(),
                }
            }
            CommandStage::Done => return None,
        };
        Some((self.ready_at, request))
    }

    /// The end of the rest or pause, if that is the next step, and whether the drive ignores requests until then.
    #[must_use]
    pub fn rest_at(&self, now: MonoTime) -> Option<(MonoTime, bool)> {
        let CommandStage::Step(index) = self.stage else {
            return None;
        };
        match self.approved.steps().get(index)? {
            CommandStep::Rest(rest) => Some((now + *rest, true)),
            CommandStep::Pause(pause) => Some((now + *pause, false)),
            CommandStep::Check { .. }
            | CommandStep::Require { .. }
            | CommandStep::Await(_)
            | CommandStep::Skip(_)
            | CommandStep::Write(_) => None,
        }
    }

    /// Starts a rest or pause that ends at `until`; then the execution continues.
    pub fn rest(&mut self, until: MonoTime) -> StepResult {
        let CommandStage::Step(index) = self.stage else {
            return StepResult::Goes(None);
        };
        self.ready_at = until;
        if let ResetRepeats::AfterRest(write) = self.repeats {
            self.repeats = ResetRepeats::Done;
            self.stage = CommandStage::Step(write);
            return StepResult::Goes(None);
        }
        self.go_on_from(index, until)
    }

    /// Whether the next request may be sent: reads after a write always may, and so may the end of a reset. An execution that
    /// has begun and was delayed for too long starts nothing more.
    ///
    /// # Errors
    /// [`VoidApproval`]
    pub fn may_go(&self, now: MonoTime, stops: u64) -> Result<(), VoidApproval> {
        match self.stage {
            CommandStage::Step(_)
                if self.has_begun && self.is_held_up(now) && !self.takes_back() =>
            {
                Err(VoidApproval::TooLate)
            }
            CommandStage::Step(_) => self.approved.may_go(self.has_begun, now, stops),
            CommandStage::ReadBack(..) | CommandStage::Resolve(..) | CommandStage::Done => Ok(()),
        }
    }

    /// Whether it was delayed for too long at `now`; what it waits for itself is no delay.
    fn is_held_up(&self, now: MonoTime) -> bool {
        now >= self.start_before() + HELD_UP_MAX + self.waits()
    }

    /// The deadline of its first write.
    #[must_use]
    pub const fn start_before(&self) -> MonoTime {
        self.approved.start_before()
    }

    /// Whether any of it was sent.
    #[must_use]
    pub const fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// Whether its first step is still pending.
    #[must_use]
    pub fn is_new(&self) -> bool {
        self.stage == CommandStage::Step(0)
    }

    /// The next request is sent.
    pub fn was_sent(&mut self) {
        self.has_begun |= !self.present_writes().is_empty();
    }

    /// Whether the next request reads what the drive is.
    #[must_use]
    pub fn reads_identity(&self) -> bool {
        let CommandStage::Step(index) = self.stage else {
            return false;
        };
        matches!(
            self.approved.steps().get(index),
            Some(CommandStep::Require {
                reason: Reason::OtherDrive,
                ..
            })
        )
    }

    /// The writes in the next request; empty if it is a read.
    #[must_use]
    pub fn present_writes(&self) -> &[WriteStep] {
        match self.stage {
            CommandStage::Step(index) => self.approved.steps().get(index).map_or(&[], writes_of),
            CommandStage::ReadBack(..) | CommandStage::Resolve(..) | CommandStage::Done => &[],
        }
    }

    /// The drive answered at `now`.
    pub fn answered(&mut self, reply: &Reply, now: MonoTime) -> StepResult {
        match (self.stage, reply) {
            (CommandStage::Step(index), reply) => self.step_answered(index, reply, now),
            (
                CommandStage::ReadBack(index, shown) | CommandStage::Resolve(index, shown),
                Reply::Words(words),
            ) => {
                if words.is_empty() {
                    self.unanswered()
                } else {
                    self.shown(index, shown, words, now)
                }
            }
            (CommandStage::ReadBack(..) | CommandStage::Resolve(..) | CommandStage::Done, _) => {
                self.unanswered()
            }
        }
    }

    /// The drive replied with an exception of this kind. A read is tried again while it is busy, a write never.
    pub fn excepted(&mut self, code: u8, kind: Option<ExceptionKind>) -> StepResult {
        let reads = self.present_writes().is_empty();
        if reads && kind == Some(ExceptionKind::Busy) && self.in_vain + 1 < READS_MAX {
            return self.read_again();
        }
        if !matches!(self.stage, CommandStage::Step(_)) {
            return self.give_up_reading();
        }
        let reason = if self.commits() {
            Reason::NotCommitted
        } else {
            reason_of(kind)
        };
        let failed = Report::new(Outcome::Failed, reason);
        StepResult::Ends(Report {
            exception: Some(code),
            register: self.required_register(),
            ..failed
        })
    }

    /// The drive did not answer, or its reply was damaged. A write is not repeated: if the model can show its effect,
    /// that is read.
    pub fn unanswered(&mut self) -> StepResult {
        let (CommandStage::Step(index), Some(write)) = (self.stage, self.present_writes().first())
        else {
            return self.read_again();
        };
        let part = write.part;
        // Reads may come before the first write.
        let is_later = self
            .approved
            .steps()
            .iter()
            .take(index)
            .any(|step| !writes_of(step).is_empty());
        match part {
            StepPart::TakesBack | StepPart::TakesStartBack => self.end_of_reset_unanswered(),
            // No register shows whether it was taken.
            StepPart::Commit => {
                StepResult::Ends(Report::new(Outcome::Unknown, Reason::NotCommitted))
            }
            // The run word was not sent, and is not.
            StepPart::Direction(_) | StepPart::Start => {
                StepResult::Ends(Report::new(Outcome::Failed, Reason::NoReply))
            }
            StepPart::Reset { resets: false, .. } if is_later => self.end_of_reset_unanswered(),
            StepPart::Reset { ends, .. } if is_later => {
                self.is_in_doubt = true;
                match self.rest_step() {
                    Some(rest) => self.rest_before_the_end(rest),
                    None if !ends => self.stage = CommandStage::Step(index + 1),
                    None => return self.resolve(index),
                }
                StepResult::Goes(Some(Report::new(Outcome::Unknown, Reason::NoReply)))
            }
            _ => self.resolve(index),
        }
    }

    fn step_answered(&mut self, index: usize, reply: &Reply, now: MonoTime) -> StepResult {
        match (self.approved.steps().get(index), reply) {
            (
                Some(CommandStep::Check {
                    least,
                    most,
                    reason,
                    ..
                }),
                Reply::Words(words),
            ) => match words.first() {
                Some(word) if (least..=most).contains(&word) => self.go_on_from(index, now),
                _ => StepResult::Ends(Report::refused(*reason)),
            },
            (
                Some(CommandStep::Require {
                    address,
                    mask,
                    values,
                    reason,
                }),
                Reply::Words(words),
            ) => match words.first() {
                Some(word) if values.contains(&(word & mask)) => self.go_on_from(index, now),
                word => StepResult::Ends(Report {
                    held: word.copied(),
                    register: Some(*address),
                    ..Report::refused(*reason)
                }),
            },
            (Some(CommandStep::Await(_)), Reply::Words(words)) => {
                self.awaited(index, words.first().copied(), now)
            }
            (Some(CommandStep::Skip(skip)), Reply::Words(words)) => {
                let is_met = words
                    .first()
                    .is_some_and(|word| skip.condition.is_met(*word));
                self.go_on_from(if is_met { index + skip.count } else { index }, now)
            }
            (
                Some(
                    CommandStep::Check { .. }
                    | CommandStep::Require { .. }
                    | CommandStep::Await(_)
                    | CommandStep::Skip(_),
                ),
                _,
            ) => self.unanswered(),
            (Some(CommandStep::Write(writes)), Reply::Holds { value })
                if writes.iter().any(|it| it.value != *value) =>
            {
                let reason = if self.commits() {
                    Reason::NotCommitted
                } else {
                    Reason::KeptOldValue
                };
                let kept = Report::new(Outcome::Failed, reason);
                StepResult::Ends(Report {
                    held: Some(*value),
                    ..kept
                })
            }
            (Some(CommandStep::Write(_)), _) => {
                // A drive that answered after its rest needs no other.
                let rested = self.repeats == ResetRepeats::Done;
                self.go_on_from(if rested { index + 1 } else { index }, now)
            }
            (Some(CommandStep::Rest(_) | CommandStep::Pause(_)) | None, _) => self.end(),
        }
    }

    fn go_on_from(&mut self, index: usize, now: MonoTime) -> StepResult {
        self.in_vain = 0;
        self.shown_until = None;
        if index + 1 < self.approved.steps().len() {
            self.ready_at = self.not_before(index + 1, now);
            self.stage = CommandStage::Step(index + 1);
            return StepResult::Goes(None);
        }
        match self.next_shown(0) {
            Some(first) => {
                self.look_at(CommandStage::ReadBack(first, 0));
                let is_acknowledged =
                    !(self.is_in_doubt || self.is_unanswered || self.approved.is_answered_late());
                StepResult::Goes(
                    is_acknowledged.then_some(Report::new(Outcome::Acknowledged, Reason::None)),
                )
            }
            None => self.end(),
        }
    }

    /// All steps are done: confirmed if the drive has shown the effect of all of them, else only acknowledged.
    fn end(&mut self) -> StepResult {
        let has_read_back = matches!(
            self.stage,
            CommandStage::ReadBack(..) | CommandStage::Resolve(..)
        );
        self.stage = CommandStage::Done;
        let mut writes = self.approved.steps().iter().flat_map(writes_of);
        let is_seen =
            |write: &WriteStep| matches!(write.part, StepPart::Reset { is_seen: true, .. });
        if self.is_in_doubt && !(has_read_back && writes.clone().any(is_seen)) {
            return StepResult::Ends(Report::new(Outcome::Unknown, Reason::NoReply));
        }
        // What comes before another write shows in the effect of that.
        let comes_before = |part| {
            matches!(
                part,
                StepPart::Start | StepPart::Direction(_) | StepPart::Reset { ends: false, .. }
            )
        };
        let shows = |write: &WriteStep| {
            !write.shown.is_empty() || comes_before(write.part) || write.part == StepPart::Commit
        };
        let is_proven = has_read_back
            && writes
                .clone()
                .filter(|write| self.approved.is_silent(write))
                .all(shows);
        if self.is_unanswered && !is_proven {
            return StepResult::Ends(Report::new(Outcome::Unknown, Reason::NoReply));
        }
        let outcome = if has_read_back && writes.all(shows) {
            Outcome::Confirmed
        } else {
            Outcome::Acknowledged
        };
        StepResult::Ends(Report::new(outcome, Reason::None))
    }

    /// Whether the next request takes over or stores what was written.
    fn commits(&self) -> bool {
        self.present_writes()
            .iter()
            .any(|write| write.part == StepPart::Commit)
    }

    /// Whether every write so far was answered.
    #[must_use]
    pub const fn is_sure(&self) -> bool {
        !self.is_in_doubt
    }
}

/// The reason for the end of a command by an exception of this kind.
pub const fn reason_of(kind: Option<ExceptionKind>) -> Reason {
    match kind {
        Some(ExceptionKind::Busy) => Reason::DriveBusy,
        Some(ExceptionKind::Locked) => Reason::DriveLocked,
        Some(ExceptionKind::InTrip) => Reason::DriveInTrip,
        Some(ExceptionKind::DamagedFrame) | None => Reason::DriveException,
    }
}

fn writes_of(step: &CommandStep) -> &[WriteStep] {
    match step {
        CommandStep::Write(writes) => writes,
        CommandStep::Check { .. }
        | CommandStep::Require { .. }
        | CommandStep::Await(_)
        | CommandStep::Skip(_)
        | CommandStep::Pause(_)
        | CommandStep::Rest(_) => &[],
    }
}
