//! What went over a line, for people and for tests that watch the wire.

use super::ids::Station;
use super::time::MonoTime;

/// One event on the wire of a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrafficRecord {
    /// What it was.
    pub kind: TrafficKind,
    /// Why we sent it; nothing for what was received.
    pub why: Option<Why>,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// When it began: a frame of ours when it was handed to the port, anything else at this moment at the latest.
    pub begin: MonoTime,
    /// When it was over: a frame of ours as its length tells, anything else when its last byte was read.
    pub end: MonoTime,
}

impl TrafficRecord {
    /// The moment that stands for it: when a frame of ours was handed to the port, when the last byte of anything else was
    /// read.
    #[must_use]
    pub const fn at(&self) -> MonoTime {
        if matches!(self.kind, TrafficKind::Request) { self.begin } else { self.end }
    }
}

/// What a piece of traffic was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TrafficKind {
    /// A frame that we sent.
    Request,
    /// What we sent, as the line sent it back.
    Echo,
    /// The frame we waited for.
    Reply,
    /// A frame of the station we waited for that came too late, or that answers something else.
    Stray(Station),
    /// A sound frame of a station we did not ask.
    Foreign(Station),
    /// A sound request of somebody else who asks drives on this line.
    OtherMaster(Station),
    /// Bytes that make no frame.
    Noise,
}

/// Why a frame of ours was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Why {
    /// Somebody asked for registers of the drive by their addresses.
    Client,
    /// The poll plan.
    Poll,
    /// A stop.
    Stop,
    /// Another command, or a look at what a command or a stop has done.
    Command,
    /// A trip: its record is read.
    Trip,
    /// Its answer proves that no late reply can follow.
    Barrier,
    /// To see whether a barrier can be relied on.
    Trial,
    /// To see whether the line sends back what is sent.
    Probe,
}

impl Why {
    /// The word as it stands in documents.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Client => "client",
            Self::Poll => "poll",
            Self::Stop => "stop",
            Self::Command => "command",
            Self::Trip => "trip",
            Self::Barrier => "barrier",
            Self::Trial => "trial",
            Self::Probe => "probe",
        }
    }
}

impl TrafficKind {
    /// The word as it stands in documents.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Request => "request",
            Self::Echo => "echo",
            Self::Reply => "reply",
            Self::Stray(_) => "stray",
            Self::Foreign(_) => "foreign",
            Self::OtherMaster(_) => "other_master",
            Self::Noise => "noise",
        }
    }
}
