//! Who waits for what becomes of a command, and in which words it is told.

use super::event::Effect;
use crate::domain::command::{CommandAnswer, Outcome, Reason, Report};
use crate::domain::ids::{AskerId, DriveIndex, Ticket};
use crate::domain::native::{NativeAnswer, NativeOutcome, Refusal};

/// One commander that waits for a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Waiter {
    /// Who commanded.
    pub asker: AskerId,
    /// The asker's number for it.
    pub ticket: Ticket,
    /// Which drive.
    pub drive: DriveIndex,
    /// Whether it was a write to the drive's own registers: that is answered once, in native words.
    pub is_native: bool,
}

impl Waiter {
    /// The answer with `report`; nothing if this waiter is told only how things end. A native writer is answered at
    /// the drive's acknowledgement, or at the end.
    pub fn answer(&self, report: Report, is_final: bool) -> Option<Effect> {
        if !self.is_native {
            let Self { asker, ticket, drive, .. } = *self;
            return Some(Effect::Command(CommandAnswer { asker, ticket, drive, report, is_final }));
        }
        let outcome = native_outcome(report);
        let ends = is_final || report.outcome == Outcome::Acknowledged;
        ends.then_some(Effect::Answer(NativeAnswer { asker: self.asker, ticket: self.ticket, outcome }))
    }

    /// Whether nothing more is to be told after `report`.
    pub fn is_done(&self, report: Report) -> bool {
        self.is_native && report.outcome == Outcome::Acknowledged
    }
}

fn native_outcome(report: Report) -> NativeOutcome {
    match report.outcome {
        Outcome::Acknowledged | Outcome::Confirmed => NativeOutcome::Written,
        Outcome::Refused => NativeOutcome::Refused(match report.reason {
            Reason::QueueFull => Refusal::QueueFull,
            Reason::LineDown => Refusal::LineDown,
            reason => Refusal::Guard(reason),
        }),
        Outcome::Failed => match (report.exception, report.held) {
            (Some(code), _) => NativeOutcome::DriveException(code),
            (None, Some(held)) => NativeOutcome::KeptOldValue(held),
            (None, None) => NativeOutcome::NoReply,
        },
        Outcome::Unknown => NativeOutcome::NoReply,
        Outcome::Expired => NativeOutcome::Expired,
        Outcome::Superseded => NativeOutcome::Superseded,
    }
}
