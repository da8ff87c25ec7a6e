//! Native requests: a client asks for a vendor's registers by their addresses.

use super::address::Address;
use super::command::{Origin, Outcome, Reason, Report};
use super::ids::{AskerId, DriveIndex, Ticket};
use super::time::MonoTime;
use std::sync::Arc;

/// Maximum number of frames that one request may need on the line.
pub const FRAMES_MAX: usize = 16;

/// A request for a drive's own registers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NativeAsk {
    /// Read `count` (1 to 125) holding registers from `address` on; the range ends at 0xFFFF at the latest.
    Read {
        /// First register.
        address: Address,
        /// Number of words.
        count: u16,
    },
    /// Write `values` (1 to 123) to holding registers from `address` on.
    Write {
        /// First register.
        address: Address,
        /// The words, in order.
        values: Vec<u16>,
    },
    /// Return this word: the loop test, function 08.
    Loop {
        /// The word.
        data: u16,
    },
}

/// One native request of one asker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NativeRequest {
    /// Who asks.
    pub asker: AskerId,
    /// The asker's number for this request.
    pub ticket: Ticket,
    /// Which drive of the line.
    pub drive: DriveIndex,
    /// The client and its rights, which the guard checks for writes.
    pub origin: Origin,
    /// What to do.
    pub ask: NativeAsk,
    /// When the asker stops waiting. The request ends by then, with [`NativeOutcome::Expired`] if need be.
    pub deadline: MonoTime,
}

impl NativeRequest {
    /// Whether it writes to the drive.
    #[must_use]
    pub const fn writes(&self) -> bool {
        matches!(self.ask, NativeAsk::Write { .. })
    }
}

/// The answer to one native request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NativeAnswer {
    /// Who asked.
    pub asker: AskerId,
    /// The asker's number for the request.
    pub ticket: Ticket,
    /// How the request ended.
    pub outcome: NativeOutcome,
}

/// How a native request ended. Each request has exactly one outcome.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NativeOutcome {
    /// The words that the drive sent. Shared, because one exchange may serve many askers.
    Words(Arc<[u16]>),
    /// The drive acknowledged the write, or returned the word of the loop test.
    Written,
    /// The drive refused the write: its reply carries the value that it kept.
    KeptOldValue(u16),
    /// The drive answered with an exception of its own.
    DriveException {
        /// The code of the exception.
        code: u8,
        /// What the drive means by it, as far as its model says.
        reason: Reason,
    },
    /// Nothing was sent.
    Refused(NativeRefusal),
    /// The drive did not answer, or only with damaged frames.
    NoReply,
    /// The asker's deadline passed before the drive was asked.
    Expired,
    /// The write was replaced by a newer command before it was sent, or cancelled by a stop.
    Superseded,
}

impl NativeOutcome {
    /// The report for a read that returned no words, as for a command with the same outcome.
    #[must_use]
    pub const fn read_failure(&self) -> Report {
        match self {
            Self::DriveException { code, reason } => Report {
                exception: Some(*code),
                ..Report::new(Outcome::Failed, *reason)
            },
            Self::Refused(refusal) => Report::refused(match refusal {
                NativeRefusal::NoSuchUnit => Reason::UnknownDrive,
                NativeRefusal::Guard(reason) => *reason,
                NativeRefusal::TooManyFrames => Reason::TooManyFrames,
                NativeRefusal::QueueFull => Reason::QueueFull,
                NativeRefusal::LineDown => Reason::LineDown,
                NativeRefusal::Standby => Reason::Standby,
            }),
            Self::Expired => Report::new(Outcome::Expired, Reason::TooLate),
            Self::Superseded => Report::new(Outcome::Superseded, Reason::Newer),
            Self::Words(_) | Self::Written | Self::KeptOldValue(_) | Self::NoReply => {
                Report::new(Outcome::Failed, Reason::NoReply)
            }
        }
    }
}

/// Why a request was refused before anything was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum NativeRefusal {
    /// No drive has this unit.
    #[error("no drive has this unit")]
    NoSuchUnit,
    /// The guard refused the write.
    #[error("{}", .0.text())]
    Guard(Reason),
    /// The request would need more than [`FRAMES_MAX`] frames.
    #[error("the request would need more than 16 frames on the line")]
    TooManyFrames,
    /// Too many requests are waiting: of this asker, or on this line.
    #[error("too many requests are waiting")]
    QueueFull,
    /// The line's port is not open.
    #[error("the line is down")]
    LineDown,
    /// Another gateway of the line is active.
    #[error("another gateway is active on the line")]
    Standby,
}
