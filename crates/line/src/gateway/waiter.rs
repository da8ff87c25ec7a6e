//! Clients that wait for the outcome of a command, and the form of their answers.

use super::event::LineEffect;
use crate::domain::command::{CommandAnswer, Outcome, Owner, Reason, Report};
use crate::domain::ids::{AskerId, DriveIndex, Ticket};
use crate::domain::native::{NativeAnswer, NativeOutcome, NativeRefusal};
use crate::journal::AttemptId;

/// A client that waits for a report.
#[derive(Debug, PartialEq, Eq)]
pub struct ReportWaiter {
    asker: AskerId,
    ticket: Ticket,
    drive: DriveIndex,
    is_native: bool,
    /// A native writer was answered.
    is_answered: bool,
    /// The number of its command among those of the drive; `None` if it has none yet.
    number: Option<u16>,
    /// The attempt whose end is still to be recorded and counted.
    attempt: Option<OpenAttempt>,
}

/// An attempt that has not ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OpenAttempt {
    /// Its number.
    pub id: AttemptId,
    /// Its owner.
    pub owner: Owner,
}

impl ReportWaiter {
    /// A client that gave a command.
    #[must_use]
    pub const fn of_command(asker: AskerId, ticket: Ticket, drive: DriveIndex) -> Self {
        Self {
            asker,
            ticket,
            drive,
            is_native: false,
            is_answered: false,
            number: None,
            attempt: None,
        }
    }

    /// A client that wrote to the drive's own registers.
    #[must_use]
    pub const fn of_write(asker: AskerId, ticket: Ticket, drive: DriveIndex) -> Self {
        Self {
            is_native: true,
            ..Self::of_command(asker, ticket, drive)
        }
    }

    /// No client waits: only the end of the attempt is recorded and counted.
    #[must_use]
    pub const fn of_nobody(drive: DriveIndex) -> Self {
        Self {
            is_answered: true,
            ..Self::of_write(AskerId::LOCAL, Ticket(0), drive)
        }
    }

    /// The answer with `report`, if this waiter still expects one. A native writer is answered once: at the drive's
    /// acknowledgement, or at the end.
    pub fn answer(&mut self, report: Report, is_final: bool) -> Option<LineEffect> {
        let Self {
            asker,
            ticket,
            drive,
            ..
        } = *self;
        if !self.is_native {
            return Some(LineEffect::Command(CommandAnswer {
                asker,
                ticket,
                drive,
                report,
                is_final,
            }));
        }
        let is_due = is_final || report.outcome == Outcome::Acknowledged;
        if self.is_answered || !is_due {
            return None;
        }
        self.is_answered = true;
        Some(LineEffect::Answer(NativeAnswer {
            asker,
            ticket,
            outcome: native_outcome(report),
        }))
    }

    /// Whether `asker` is the waiting client.
    #[must_use]
    pub fn is_of(&self, asker: AskerId) -> bool {
        self.asker == asker
    }

    /// The number of its command among those of the drive.
    #[must_use]
    pub const fn number(&self) -> Option<u16> {
        self.number
    }

    /// Sets the number of its command.
    pub const fn set_number(&mut self, number: u16) {
        self.number = Some(number);
    }

    /// The drive that it commands.
    #[must_use]
    pub const fn drive(&self) -> DriveIndex {
        self.drive
    }

    /// Sets the attempt whose end is to be recorded and counted.
    pub const fn set_attempt(&mut self, attempt: OpenAttempt) {
        self.attempt = Some(attempt);
    }

    /// Takes the attempt whose end is still to be recorded and counted.
    pub const fn take_attempt(&mut self) -> Option<OpenAttempt> {
        self.attempt.take()
    }

    /// Whether nothing more is due: to the waiting client, the journal or the counts.
    #[must_use]
    pub const fn is_done(&self) -> bool {
        self.is_answered && self.attempt.is_none()
    }
}

fn native_outcome(report: Report) -> NativeOutcome {
    match report.outcome {
        Outcome::Acknowledged | Outcome::Confirmed => NativeOutcome::Written,
        Outcome::Refused => NativeOutcome::Refused(match report.reason {
            Reason::QueueFull => NativeRefusal::QueueFull,
            Reason::LineDown => NativeRefusal::LineDown,
            Reason::Standby => NativeRefusal::Standby,
            reason => NativeRefusal::Guard(reason),
        }),
        Outcome::Failed => match (report.exception, report.held) {
            (Some(code), _) => NativeOutcome::DriveException {
                code,
                reason: report.reason,
            },
            (None, Some(held)) => NativeOutcome::KeptOldValue(held),
            (None, None) => NativeOutcome::NoReply,
        },
        Outcome::Unknown => NativeOutcome::NoReply,
        Outcome::Expired => NativeOutcome::Expired,
        Outcome::Superseded => NativeOutcome::Superseded,
    }
}
