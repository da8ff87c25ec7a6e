//! The exchange on the wire, and why it was sent.

use super::work::WishRank;
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::domain::traffic::{FramePurpose, HeardFrame};
use crate::drive::plan::PollGroup;
use crate::line::schedule::{ReadJob, WaiterId};
use crate::line::transaction::LineWire;
use crate::wire::pdu::Request;
use std::time::Duration;

/// The exchange on the wire.
#[derive(Debug)]
pub(super) struct OpenFlight {
    pub drive: DriveIndex,
    pub purpose: ExchangePurpose,
    /// A late reply could be mistaken for its reply.
    pub doubt: bool,
    /// The request, if its refusal could be a late one and is not believed; `None` once such a frame has arrived.
    pub doubts_refusal: Option<Request>,
    /// A reply that repeats it may be a mere echo.
    pub proves_nothing: bool,
    /// The drive was known to be silent: its silence says nothing about the line.
    pub was_silent: bool,
    pub sent_at: MonoTime,
    /// When the last character of the request has left.
    pub request_end: MonoTime,
    /// From this moment on a stop for another drive ends the wait, if nothing was received. `None`: too few replies are
    /// known.
    pub overdue_at: Option<MonoTime>,
    /// The moment `overdue_at` has passed.
    pub is_overdue: bool,
    /// An unexplained frame of the station preceded its reply: the apparent reply may be another such frame.
    pub is_spoilt: bool,
    /// The first frame that came instead of its reply, and how late; without that if it is of no configured station.
    pub wrong_reply: Option<(HeardFrame, Option<Duration>)>,
    /// Bytes before its reply that form no frame.
    pub noise: usize,
}

impl OpenFlight {
    /// When a stop for another drive may end it, if it still may; or when any stop may, because the reply may have arrived
    /// damaged.
    pub fn cut_at(&self, wire: &LineWire) -> Option<MonoTime> {
        if self.is_overdue {
            return None;
        }
        if let Some(damaged_from) = wire.damaged_from() {
            return Some(self.overdue_at.unwrap_or(damaged_from).max(damaged_from));
        }
        if wire.has_heard_after(self.request_end) {
            None
        } else {
            self.overdue_at
        }
    }
}

/// A request that is sent next.
pub(super) type PickedRequest = (DriveIndex, Request, ExchangePurpose);

/// Why an exchange was sent.
#[derive(Debug)]
pub(super) enum ExchangePurpose {
    /// A request of clients.
    Read(ReadJob),
    /// The drive's own work: stops, commands, read-backs.
    Work(WishRank),
    /// A poll.
    Poll,
    /// To rule out late replies.
    Barrier,
    /// To find out whether the line echoes.
    Probe,
    /// To find out whether the barrier at this index of the model is reliable.
    Trial(usize),
}

impl ExchangePurpose {
    /// The purpose as observers see it.
    pub const fn why(&self) -> FramePurpose {
        match self {
            Self::Read(_) => FramePurpose::Client,
            Self::Work(WishRank::FirstStop | WishRank::RepeatedStop) => FramePurpose::Stop,
            Self::Work(WishRank::Trip) => FramePurpose::Trip,
            Self::Work(WishRank::Look | WishRank::Step | WishRank::Start) => FramePurpose::Command,
            Self::Poll => FramePurpose::Poll,
            Self::Barrier => FramePurpose::Barrier,
            Self::Probe => FramePurpose::Probe,
            Self::Trial(_) => FramePurpose::Trial,
        }
    }

    /// The clients that wait for its end.
    pub fn waiters(self) -> Vec<WaiterId> {
        match self {
            Self::Read(job) => job.waiters,
            Self::Work(_) | Self::Poll | Self::Barrier | Self::Probe | Self::Trial(_) => Vec::new(),
        }
    }
}

/// Whether a wish of this `rank` is a stop.
pub(super) const fn is_stop(rank: WishRank) -> bool {
    matches!(rank, WishRank::FirstStop | WishRank::RepeatedStop)
}

/// The request that polls `group`.
pub(super) fn poll_request(group: PollGroup) -> Request {
    Request::Read {
        address: group.address,
        count: group.count,
    }
}
