//! What went over a line, for people and for tests that watch the wire.

use super::ids::Station;
use super::time::MonoTime;

/// One event on the wire of a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrafficRecord {
    /// When: for a frame of ours the moment it was handed to the port, else when its last byte was read.
    pub at: MonoTime,
    /// What it was.
    pub kind: TrafficKind,
    /// The bytes.
    pub bytes: Vec<u8>,
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
