//! A frame in words, and what is known of the line that it went over.

use crate::domain::ids::{Name, Station};
use crate::domain::link::Framing;
use crate::domain::traffic::{TrafficKind, Why};
use crate::drive::description::Ratings;
use crate::profile::model::Model;
use std::sync::Arc;
use std::time::Duration;

/// What has to be known of a line to understand what goes over it.
#[derive(Clone, Debug)]
pub struct LineFacts {
    /// How frames are told apart.
    pub framing: Framing,
    /// Its drives.
    pub drives: Vec<KnownDrive>,
}

/// One drive of the line.
#[derive(Clone, Debug)]
pub struct KnownDrive {
    /// Its number on the line.
    pub station: Station,
    /// Its name.
    pub name: Name,
    /// What it is.
    pub model: Arc<Model>,
    /// Its rated values, where the model reports in per cent of them.
    pub ratings: Ratings,
}

/// One piece of traffic in words.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// What it was.
    pub kind: TrafficKind,
    /// Why we sent it; nothing for what was received.
    pub why: Option<Why>,
    /// The silence in front of it; nothing in front of the first one that is seen.
    pub gap: Option<Duration>,
    /// How long it took on the wire, as far as known.
    pub on_wire: Duration,
    /// The station in it; nothing if it is no frame.
    pub station: Option<Station>,
    /// The drive at that station.
    pub drive: Option<Name>,
    /// Its function, as it stands there: with the highest bit in an exception.
    pub function: Option<u8>,
    /// The code of an exception.
    pub exception: Option<u8>,
    /// What it says.
    pub text: String,
    /// The registers in it with their values.
    pub values: Vec<FrameValue>,
}

/// One register in a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameValue {
    /// Its address on the wire.
    pub address: u16,
    /// Its name in the model.
    pub name: Option<String>,
    /// Its value with the unit, or with what it means.
    pub text: String,
}

/// What a frame says.
#[derive(Debug, Default)]
pub(super) struct FrameText {
    pub(super) text: String,
    pub(super) exception: Option<u8>,
    pub(super) values: Vec<FrameValue>,
}

impl FrameText {
    pub(super) fn text(text: impl Into<String>) -> Self {
        Self { text: text.into(), ..Self::default() }
    }
}

/// A request that was sent, as long as its reply may be understood by it.
#[derive(Debug)]
pub(super) struct OpenRequest {
    pub(super) station: u8,
    pub(super) pdu: Vec<u8>,
    pub(super) why: Option<Why>,
}
