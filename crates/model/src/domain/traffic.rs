//! What went over a line, for people and for tests that watch the wire.

use super::ids::Station;
use super::time::MonoTime;
use std::fmt;

/// One event on the wire of a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrafficRecord {
    /// What it was.
    pub kind: TrafficKind,
    /// Why we sent it; `None` for received data.
    pub why: Option<FramePurpose>,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// Begin: for our own frames when they were handed to the port, for anything else the latest possible begin.
    pub begin: MonoTime,
    /// End: for our own frames computed from their length, for anything else when the last byte was read.
    pub end: MonoTime,
}

impl TrafficRecord {
    /// The timestamp of the event: when one of our frames was handed to the port, when the last byte of anything else
    /// was read.
    #[must_use]
    pub const fn at(&self) -> MonoTime {
        if matches!(self.kind, TrafficKind::Request) {
            self.begin
        } else {
            self.end
        }
    }
}

/// What a piece of traffic was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TrafficKind {
    /// A frame that we sent.
    Request,
    /// A frame of ours, echoed by the line.
    Echo,
    /// The awaited reply.
    Reply,
    /// A frame of the awaited station that arrived too late or answers something else.
    Stray(Station),
    /// A sound frame of a station that was not addressed.
    Foreign(Station),
    /// A sound request of another master on this line.
    OtherMaster(Station),
    /// Bytes that belong to no frame.
    Noise,
}

/// Why a frame of ours was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FramePurpose {
    /// A client asked for registers of the drive by their addresses.
    Client,
    /// The poll plan.
    Poll,
    /// A stop.
    Stop,
    /// Another command, or a read of the effect of a command or a stop.
    Command,
    /// A trip: its record is read.
    Trip,
    /// Its answer proves that no late reply can follow.
    Barrier,
    /// A test of whether a barrier can be relied on.
    Trial,
    /// A test of whether the line echoes what is sent.
    Probe,
}

impl FramePurpose {
    /// The word used in documents.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
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
    /// The word used in documents.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
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

/// The beginning of a frame that was heard, for messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct HeardFrame {
    bytes: [u8; 16],
    len: usize,
}

impl HeardFrame {
    /// The first bytes of `frame`.
    #[must_use]
    pub fn of(frame: &[u8]) -> Self {
        let mut bytes = [0; 16];
        let len = frame.len();
        bytes
            .iter_mut()
            .zip(frame)
            .for_each(|(to, from)| *to = *from);
        Self { bytes, len }
    }
}

impl fmt::Display for HeardFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, byte) in self.bytes.iter().take(self.len).enumerate() {
            let space = if at > 0 { " " } else { "" };
            write!(f, "{space}{byte:02X}")?;
        }
        if self.len > self.bytes.len() {
            write!(f, " ... ({} bytes)", self.len)
        } else {
            Ok(())
        }
    }
}
