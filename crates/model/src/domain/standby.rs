//! Several gateways on one line: which of them sends, and what the next one does with running drives.

use super::ids::{Name, Station};
use std::time::Duration;

/// Highest rank.
pub const RANK_MAX: u8 = 7;

/// This gateway as one of several on the same lines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StandbyPair {
    /// The name of this one.
    pub half: Name,
    /// The name of the other one.
    pub partner: Name,
    /// How many steps later than rank 0 it takes a line over, 0 to [`RANK_MAX`]. No two gateways of a line should have
    /// the same.
    pub rank: u8,
    /// Silence of the line after which rank 0 takes it over. `None`: the shortest that is safe on the line.
    pub take_over_after: Option<Duration>,
}

/// What this gateway does on a line that has several.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LineRole {
    /// The gateway only listens: another one sends, or may send.
    Listening,
    /// The gateway sends.
    Active,
}

impl LineRole {
    /// Both roles.
    pub const ALL: [Self; 2] = [Self::Listening, Self::Active];

    /// The machine-readable word.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Listening => "listening",
            Self::Active => "active",
        }
    }
}

/// What happens to a drive that was seen ordered to run, when this gateway takes its line over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OnGatewayLost {
    /// The drive is stopped along its ramp.
    Stop,
    /// Its output is cut off.
    Coast,
    /// The drive keeps running, and nothing is sent.
    Hold,
    /// The drive keeps running for `lost_after`, so that its client can come back. Then it is as after a lost client.
    Adopt,
}

impl OnGatewayLost {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Stop, Self::Coast, Self::Hold, Self::Adopt];

    /// The word used in the configuration.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Coast => "coast",
            Self::Hold => "hold",
            Self::Adopt => "adopt",
        }
    }
}

/// A line that has several gateways, as this one sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StandbyReport {
    /// What this gateway does there.
    pub role: LineRole,
    /// How often it took the line over, since start.
    pub take_overs: u64,
    /// How often it gave the line up, for whatever reason.
    pub given_up: u64,
    /// How often another master was heard while this one was active.
    pub rivals: u64,
    /// Whether another gateway or master was heard within the time after which the line would be taken over.
    pub hears_other: bool,
    /// While this gateway is active: whether another one listens, which it asks now and then. `None` while that is not
    /// known.
    pub listener: Option<bool>,
    /// How often the line was not handed over, because no other gateway answered.
    pub kept: u64,
    /// What keeps the two from standing in for each other.
    pub trouble: StandbyTrouble,
}

/// What keeps the gateways of a line from standing in for each other, while it lasts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StandbyTrouble {
    /// The gateway hears no valid frame although it should.
    pub is_deaf: bool,
    /// The other gateway has other drives on the line, or the same with other limits or declared actions.
    pub files_differ: bool,
    /// A station that another gateway or master talks to, and that the own configuration lacks.
    pub unknown_station: Option<Station>,
}
