//! Approved work for the line. Private fields, no copies: one approval is one list of frames, sent once.

use crate::domain::address::Address;
use crate::domain::command::{Direction, Order, Owner};
use crate::domain::control::FailSafe;
use crate::domain::fail_safe::FailSafeCause;
use crate::domain::time::MonoTime;
use crate::drive::steps::{self, CommandStep, WriteFunctions, WriteStep};
use crate::profile::model::Model;
use crate::wire::pdu::Request;

/// A command approved for the line, as a bounded list of steps.
#[derive(Debug)]
pub struct Approved {
    order: Order,
    owner: Owner,
    /// The drive's stop count at approval. Any later stop voids the approval.
    stops: u64,
    start_before: MonoTime,
    steps: Vec<CommandStep>,
    functions: WriteFunctions,
    /// The registers whose writes the drive never answers.
    silent: Vec<Address>,
    /// The drive has acknowledged it before and not shown it: only its read-back is an answer.
    is_answered_late: bool,
}

/// Why an approved step may not be sent any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VoidApproval {
    /// A stop came after the approval.
    Stopped,
    /// Its first write missed the deadline.
    TooLate,
}

impl Approved {
    /// Approves `order` of `owner` for a drive of `model`, as long as the guard's count of stops is `stops`.
    pub(super) fn new(
        model: &Model,
        owner: Owner,
        order: Order,
        steps: Vec<CommandStep>,
        start_before: MonoTime,
        stops: u64,
    ) -> Self {
        Self {
            order,
            owner,
            stops,
            start_before,
            steps,
            functions: WriteFunctions::of(model),
            silent: model.silent_writes().collect(),
            is_answered_late: false,
        }
    }

    /// The order.
    #[must_use]
    pub const fn order(&self) -> &Order {
        &self.order
    }

    /// The owner who ordered it.
    #[must_use]
    pub const fn owner(&self) -> Owner {
        self.owner
    }

    /// The deadline of its first write.
    #[must_use]
    pub const fn start_before(&self) -> MonoTime {
        self.start_before
    }

    /// The steps, in order.
    #[must_use]
    pub fn steps(&self) -> &[CommandStep] {
        &self.steps
    }

    pub(super) const fn answered_when_shown(mut self, is_answered_late: bool) -> Self {
        self.is_answered_late = is_answered_late;
        self
    }

    /// Whether the drive's acknowledgement is no answer to it, but what the drive shows afterwards.
    #[must_use]
    pub const fn is_answered_late(&self) -> bool {
        self.is_answered_late
    }

    /// Whether the drive never answers `write`.
    #[must_use]
    pub fn is_silent(&self, write: &WriteStep) -> bool {
        self.silent.contains(&write.address)
    }

    /// Checks that its next frame may still be sent at `now`: no stop has arrived since (`stops` is the guard's current
    /// count), and if nothing has been written yet, the deadline has not passed.
    ///
    /// # Errors
    /// [`VoidApproval`]
    pub fn may_go(&self, has_begun: bool, now: MonoTime, stops: u64) -> Result<(), VoidApproval> {
        if stops != self.stops {
            return Err(VoidApproval::Stopped);
        }
        if !has_begun && now >= self.start_before {
            return Err(VoidApproval::TooLate);
        }
        Ok(())
    }

    /// The request of the step at `index`; `None` for a rest or a pause.
    #[must_use]
    pub fn request(&self, index: usize) -> Option<Request> {
        match self.steps.get(index)? {
            CommandStep::Write(writes) => match &writes[..] {
                [] => None,
                [WriteStep { address, value, .. }] => {
                    Some(self.functions.request(*address, *value))
                }
                [first, ..] => {
                    let values = writes.iter().map(|write| write.value).collect();
                    Some(Request::WriteMultiple {
                        address: first.address,
                        values,
                    })
                }
            },
            CommandStep::Check { address, .. } | CommandStep::Require { address, .. } => {
                Some(Request::Read {
                    address: *address,
                    count: 1,
                })
            }
            CommandStep::Skip(skip) => Some(Request::Read {
                address: skip.condition.address,
                count: 1,
            }),
            CommandStep::Await(wait) => Some(Request::Read {
                address: wait.condition.address,
                count: 1,
            }),
            CommandStep::Rest(_) | CommandStep::Pause(_) => None,
        }
    }
}

/// A stop or a cut-off approved for the line, repeatedly until it is effective.
#[derive(Debug, PartialEq, Eq)]
pub struct StopOrder {
    value: u16,
    coast: bool,
    /// Its requests in all forms that the model declares for it, the first one first. Never empty.
    forms: Vec<Request>,
}

impl StopOrder {
    /// The stop of a drive of `model` that was last ordered to run in direction `after`, or its cut-off; `None` if the model
    /// has none.
    pub(super) fn of(model: &Model, coast: bool, after: Option<Direction>) -> Option<Self> {
        let (address, value) = steps::of_stop(model, coast, after).ok()?;
        let in_block = steps::takes_in_a_block(model, address);
        let forms = WriteFunctions::of(model).forms(address, value, in_block);
        Some(Self {
            value,
            coast,
            forms,
        })
    }

    /// Its request, in the first form.
    #[must_use]
    pub fn request(&self) -> Request {
        self.request_in(0)
    }

    /// Number of forms that the model declares for it. If the drive refuses one, the next is tried.
    #[must_use]
    pub fn forms(&self) -> usize {
        self.forms.len()
    }

    /// Its request in the form with this number; numbers wrap around.
    #[must_use]
    pub fn request_in(&self, form: usize) -> Request {
        self.forms[form % self.forms.len()].clone()
    }

    /// The word that it writes.
    #[must_use]
    pub const fn word(&self) -> u16 {
        self.value
    }

    /// Whether the output is cut off instead of ramped down.
    #[must_use]
    pub const fn is_coast(&self) -> bool {
        self.coast
    }
}

/// The action after a client is lost, or when the gateway shuts down.
#[derive(Debug, PartialEq, Eq)]
pub struct LossAction {
    /// The owner of control.
    pub owner: Option<Owner>,
    /// The declared action.
    pub action: FailSafe,
    /// Why it runs.
    pub cause: FailSafeCause,
    /// Its frame; `None` for hold.
    pub order: Option<StopOrder>,
}
