//! What is probably wrong with a line, judging by the pattern of received data, and what to do about it.

use super::ids::Station;
use super::traffic::HeardFrame;

/// One suspicion. `Display` gives a text for people.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum LineSuspicion {
    /// Nothing is received from any drive.
    #[error(
        "nothing received from any drive: check the power, the wiring (A and B swapped?), speed, parity and the \
         station numbers"
    )]
    NothingHeard,
    /// A Modbus TCP server takes requests and sends nothing.
    #[error(
        "nothing received from the Modbus TCP server: check that it is one and not a device server \
         in raw mode, the units of the drives, and whether it serves only one client"
    )]
    ServerSilent,
    /// Bytes arrive but never a frame, and fewer bytes than the expected replies have.
    #[error(
        "too few bytes and never a frame: the drives are probably set to a higher speed than the line"
    )]
    DrivesAreFaster,
    /// Bytes arrive but never a frame, and more bytes than the expected replies have.
    #[error(
        "too many bytes and never a frame: the drives are probably set to a lower speed than the line"
    )]
    DrivesAreSlower,
    /// Replies of the right length arrive, but their checksum is always wrong.
    #[error(
        "replies have the right length but are always damaged: check parity, data bits and stop bits, then the \
         termination and the shield"
    )]
    AlwaysDamaged,
    /// One drive is silent while others answer.
    #[error("station {} has never answered while others do: check its station number, speed, parity and power", .0.0)]
    OneSilent(Station),
    /// A drive behind a Modbus TCP server is silent while others answer.
    #[error("unit {} has never answered while others do: check its unit number at the server, and its power", .0.0)]
    OneUnitSilent(Station),
    /// A server sends bytes that are no Modbus TCP frames.
    #[error(
        "the server sends bytes that are no Modbus TCP frames: check that it is a Modbus TCP server and not a device server \
         in raw mode"
    )]
    NotModbusTcp,
    /// Sound frames that do not answer the requests, one for each.
    #[error(
        "station {} answers each request with a valid frame of the wrong form: {reply} to \
         {request}; check that the model is the right one, and what is in between (wrong_replies)", .station.0
    )]
    WrongReplies {
        /// Who answers so.
        station: Station,
        /// A request.
        request: HeardFrame,
        /// What came instead of its reply.
        reply: HeardFrame,
    },
    /// More replies than requests.
    #[error(
        "more answers from station {} than requests to it: two drives probably have this number; its trips are ignored \
         until this is resolved (duplicate_station)", .0.0
    )]
    DuplicateStation(Station),
    /// Replies arrive later than the declared maximum lateness.
    #[error(
        "station {} answers later than its `max_lateness` allows: raise that, or find what delays the replies \
         (late_beyond_limit)", .0.0
    )]
    LateBeyondLimit(Station),
    /// Another master sends requests on this line.
    #[error(
        "another master sends requests on this line: a serial line can have only one; disconnect the other one"
    )]
    OtherMaster,
    /// The adapter echoes what is sent.
    #[error(
        "the adapter echoes what is sent: switch its echo off, or set `echo = \"strip\"` for the line"
    )]
    Echo,
    /// A device sends without a pause.
    #[error(
        "something on the line never stops sending: disconnect drives one by one until it is silent"
    )]
    Jam,
}

impl LineSuspicion {
    /// The station that it concerns, if it is one.
    #[must_use]
    pub const fn station(self) -> Option<Station> {
        match self {
            Self::WrongReplies { station, .. }
            | Self::OneSilent(station)
            | Self::OneUnitSilent(station)
            | Self::DuplicateStation(station)
            | Self::LateBeyondLimit(station) => Some(station),
            _ => None,
        }
    }

    /// The machine-readable name.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::NothingHeard => "nothing_heard",
            Self::ServerSilent => "server_silent",
            Self::DrivesAreFaster => "drives_are_faster",
            Self::DrivesAreSlower => "drives_are_slower",
            Self::AlwaysDamaged => "always_damaged",
            Self::OneSilent(_) => "one_silent",
            Self::OneUnitSilent(_) => "one_unit_silent",
            Self::NotModbusTcp => "not_modbus_tcp",
            Self::WrongReplies { .. } => "wrong_replies",
            Self::DuplicateStation(_) => "duplicate_station",
            Self::LateBeyondLimit(_) => "late_beyond_limit",
            Self::OtherMaster => "other_master",
            Self::Echo => "echo",
            Self::Jam => "jam",
        }
    }
}
