//! A frame in words, and what is known of its line.

use crate::domain::address::Address;
use crate::domain::ids::{Name, Station};
use crate::domain::link::Framing;
use crate::domain::traffic::{FramePurpose, TrafficKind};
use crate::drive::description::DriveRatings;
use crate::profile::model::Model;
use std::sync::Arc;
use std::time::Duration;

/// What has to be known of a line to decode its traffic.
#[derive(Clone, Debug)]
pub struct LineFacts {
    /// The framing.
    pub framing: Framing,
    /// Its drives.
    pub drives: Vec<KnownDrive>,
}

/// One drive of the line.
#[derive(Clone, Debug)]
pub struct KnownDrive {
    /// Its station number on the line.
    pub station: Station,
    /// Its name.
    pub name: Name,
    /// Its model.
    pub model: Arc<Model>,
    /// Its rated values, if the model reports in per cent of them.
    pub ratings: DriveRatings,
}

/// One piece of traffic in words.
#[derive(Clone, Debug, PartialEq)]
pub struct TrafficFrame {
    /// Its kind.
    pub kind: TrafficKind,
    /// Why we sent it; `None` for what was received.
    pub why: Option<FramePurpose>,
    /// The silence before it; `None` before the first one that is seen.
    pub gap: Option<Duration>,
    /// How long it took on the wire, as far as known.
    pub on_wire: Duration,
    /// Its station; `None` if it is no frame.
    pub station: Option<Station>,
    /// The drive at that station.
    pub drive: Option<Name>,
    /// Its function code, as sent: with the highest bit in an exception.
    pub function: Option<u8>,
    /// The code of an exception.
    pub exception: Option<u8>,
    /// Its content in words.
    pub text: String,
    /// The registers in it with their values.
    pub values: Vec<FrameValue>,
}

/// One register in a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameValue {
    /// Its address on the wire.
    pub address: Address,
    /// Its name in the model.
    pub name: Option<String>,
    /// Its value with the unit, or with its meaning.
    pub text: String,
}

/// The content of a frame.
#[derive(Debug, Default)]
pub(super) struct FrameText {
    pub(super) text: String,
    pub(super) exception: Option<u8>,
    pub(super) values: Vec<FrameValue>,
}

impl FrameText {
    pub(super) fn text(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            ..Self::default()
        }
    }
}

/// A sent request, for as long as it can explain its reply.
#[derive(Debug)]
pub(super) struct OpenRequest {
    pub(super) station: u8,
    pub(super) pdu: Vec<u8>,
    pub(super) why: Option<FramePurpose>,
}
