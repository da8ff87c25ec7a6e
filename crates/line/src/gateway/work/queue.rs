//! What one drive wishes for the wire, and its commands that have not ended: the one in execution, those that wait for it,
//! and whether one of its exchanges is on the wire.

use super::durable::OpeningRows;
use super::reports::{DriveReports, Out};
use crate::domain::command::{Order, Outcome, Reason, Report};
use crate::domain::time::MonoTime;
use crate::drive::steps::StepPart;
use crate::gateway::execution::CommandExecution;
use crate::gateway::waiter::ReportWaiter;
use crate::guard::{Approved, DriveGuard};
use crate::wire::pdu::Request;
use std::collections::VecDeque;

/// The kinds of a drive's wishes, most urgent first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum WishRank {
    /// A stop that has never been sent.
    FirstStop,
    /// A stop without effect so far.
    RepeatedStop,
    /// The next step of a command that has begun, including read-back.
    Step,
    /// A read that shows whether a stop takes effect.
    Look,
    /// A trip record.
    Trip,
    /// The first step of a command.
    Start,
}

/// One wish.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveWish {
    /// How urgent it is.
    pub rank: WishRank,
    /// The earliest moment to send it.
    pub at: MonoTime,
    /// The request.
    pub request: Request,
}

/// The commands of one drive.
#[derive(Debug, Default)]
pub(super) struct OrderQueue {
    current: Option<CommandExecution>,
    waiting: VecDeque<CommandExecution>,
    /// The exchange on the wire, and whether the result still matters.
    flight: Option<WishRank>,
}

impl OrderQueue {
    /// The command in execution.
    pub const fn current(&self) -> Option<&CommandExecution> {
        self.current.as_ref()
    }

    /// All commands, the oldest first.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &CommandExecution> {
        self.current.iter().chain(&self.waiting)
    }

    /// Number of commands that wait for the one in execution.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Whether the exchange of a command is on the wire.
    pub const fn is_on_the_wire(&self) -> bool {
        matches!(self.flight, Some(WishRank::Step | WishRank::Start))
    }

    /// Its wish for the wire.
    pub fn wants(&self, opening: &OpeningRows) -> Option<DriveWish> {
        let execution = self.current.as_ref().or(self.waiting.front())?;
        let rank = if execution.is_new() {
            WishRank::Start
        } else {
            WishRank::Step
        };
        let (at, request) = execution.request()?;
        Some(DriveWish {
            rank,
            at: at.max(opening.opens_at(execution)),
            request,
        })
    }

    /// When a command expires that has not begun.
    pub fn next_wake(&self) -> Option<MonoTime> {
        let current = self
            .current
            .as_ref()
            .filter(|execution| !execution.has_begun() && self.flight.is_none());
        current
            .into_iter()
            .chain(&self.waiting)
            .map(CommandExecution::start_before)
            .min()
    }

    /// Adds an execution, in place of those that it covers.
    pub fn push(&mut self, execution: CommandExecution, reports: &mut DriveReports, out: Out<'_>) {
        while let Some(at) = self
            .waiting
            .iter()
            .position(|old| old.is_replaced_by(&execution))
        {
            if let Some(mut old) = self.waiting.remove(at) {
                let report = Report::new(Outcome::Superseded, Reason::Newer);
                reports.tell(old.waiter(), report, true, out);
            }
        }
        self.waiting.push_back(execution);
    }

    /// Adds an order of the gateway itself, which goes first.
    pub fn push_front(&mut self, approved: Approved, reports: &DriveReports) {
        let waiter = ReportWaiter::of_nobody(reports.drive());
        self.waiting
            .push_front(CommandExecution::new(approved, waiter));
    }

    /// The execution whose next request is to be sent.
    pub fn next_to_send(&mut self) -> Option<&mut CommandExecution> {
        if self.current.is_none() {
            self.current = self.waiting.pop_front();
        }
        self.current.as_mut()
    }

    /// The wish of `rank` is sent.
    pub const fn was_sent(&mut self, rank: WishRank) {
        self.flight = Some(rank);
    }

    /// The exchange on the wire is over. Returns whether its result still matters.
    pub fn exchange_ended(&mut self) -> bool {
        self.flight.take().is_some()
    }

    /// Stops waiting for the exchange on the wire; the drive may still execute it. Returns what it writes.
    pub fn leave_flight(&mut self) -> Vec<StepPart> {
        if !self.is_on_the_wire() {
            return Vec::new();
        }
        self.flight = None;
        self.current
            .iter()
            .flat_map(|execution| execution.present_writes())
            .map(|it| it.part)
            .collect()
    }

    /// Puts the execution back that waits for its next step.
    pub fn goes_on(&mut self, execution: CommandExecution) {
        self.current = Some(execution);
    }

    pub const fn take_current(&mut self) -> Option<CommandExecution> {
        self.current.take()
    }

    pub fn take_all(&mut self) -> impl Iterator<Item = CommandExecution> + use<> {
        self.current
            .take()
            .into_iter()
            .chain(std::mem::take(&mut self.waiting))
    }

    /// Takes the executions that match, and stops waiting for their exchange on the wire.
    pub fn take_if(
        &mut self,
        goes: impl Fn(&CommandExecution) -> bool,
    ) -> VecDeque<CommandExecution> {
        let current = self.current.take_if(|execution| goes(execution));
        let (mut gone, kept) = std::mem::take(&mut self.waiting)
            .into_iter()
            .partition::<VecDeque<_>, _>(goes);
        self.waiting = kept;
        if let Some(current) = current {
            if self.is_on_the_wire() {
                self.flight = None;
            }
            gone.push_front(current);
        }
        gone
    }

    /// Whether the deadline of the current one has passed before it began.
    pub fn is_current_expired(&self, now: MonoTime) -> bool {
        self.flight.is_none()
            && self
                .current
                .as_ref()
                .is_some_and(|execution| !execution.has_begun() && now >= execution.start_before())
    }

    /// Takes one that waits and whose deadline has passed.
    pub fn take_expired(&mut self, now: MonoTime) -> Option<CommandExecution> {
        let at = self
            .waiting
            .iter()
            .position(|execution| now >= execution.start_before())?;
        self.waiting.remove(at)
    }

    /// The order of `execution` has failed: what is left of it is no longer part of the intent.
    pub fn left_undone(&self, execution: &CommandExecution, guard: &mut DriveGuard) {
        for part in execution.parts_left() {
            match part {
                StepPart::Run(direction) => {
                    let still_ordered = self.last_left(|_, part| match part {
                        StepPart::Run(direction) => Some(direction),
                        _ => None,
                    });
                    guard.run_failed(direction, still_ordered);
                }
                StepPart::Setpoint(value) | StepPart::SignedSetpoint(value, _) => {
                    let still_ordered = self
                        .last_left(|execution, part| Some((execution.owner(), part.setpoint()?)));
                    guard.setpoint_failed(value, still_ordered);
                }
                StepPart::Start
                | StepPart::Direction(_)
                | StepPart::TakesStartBack
                | StepPart::Register
                | StepPart::Commit
                | StepPart::Reset { .. }
                | StepPart::Release
                | StepPart::TakesBack => {}
            }
        }
    }

    /// The newest value that `of` finds in the orders still to be sent.
    fn last_left<T>(&self, of: impl Fn(&CommandExecution, StepPart) -> Option<T>) -> Option<T> {
        self.iter().rev().find_map(|execution| {
            execution
                .parts_left()
                .filter_map(|part| of(execution, part))
                .last()
        })
    }
}

/// Whether `execution` is an order to run, or to another frequency.
pub(super) fn moves(execution: &CommandExecution) -> bool {
    matches!(execution.order(), Order::Go(go) if go.run().is_some() || go.frequency().is_some())
}
