//! Parts of a drive and of a line that several documents have.

use super::ApiText;
use serde::{Deserialize, Serialize};

/// What was last seen of a drive that is out of sight.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LastSeenDocument {
    /// Its run state.
    pub run_state: ApiText,
    /// Its output frequency, if it was seen.
    pub output_hz: Option<f64>,
    /// When, in RFC 3339.
    pub at: Option<String>,
}

/// A declared action that fell due.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FailSafeDocument {
    /// What was declared.
    pub action: ApiText,
    /// Why it is due.
    pub cause: ApiText,
    /// The stage that it has reached.
    pub stage: ApiText,
    /// When it fell due, in RFC 3339.
    pub at: ApiText,
}

/// The role of the gateway on a line that it shares with another one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct StandbyDocument {
    /// What this gateway does there.
    pub role: ApiText,
    /// The name of this gateway.
    pub half: Option<String>,
    /// The name of the other one.
    pub partner: Option<String>,
    /// How often it took the line over, since its start.
    pub take_overs: u64,
    /// How often it gave the line up, since its start.
    pub given_up: u64,
    /// How often another master was heard while this one was active.
    pub rivals: u64,
    /// Whether another master is heard.
    pub hears_other: bool,
    /// Whether another gateway would take over; `None` while that is not known.
    pub listener: Option<bool>,
    /// The gateway hears no valid frame although it should.
    pub deaf: bool,
    /// The other gateway has other drives, limits or declared actions there.
    pub files_differ: bool,
    /// A station of the other gateway that is not configured here.
    pub unknown_station: Option<u8>,
}

/// What a drive has used; `None` for each sum that it does not have.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct UsageDocument {
    /// Energy in kilowatt-hours.
    pub energy_kwh: Option<f64>,
    /// Where the energy comes from.
    pub energy_from: Option<String>,
    /// Hours in which the motor ran.
    pub running_hours: Option<f64>,
    /// Starts.
    pub starts: Option<u64>,
    /// Trips.
    pub trips: Option<u64>,
}

/// What a drive used on one day.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DayDocument {
    /// The day, in RFC 3339.
    pub day: ApiText,
    /// The name of the drive.
    pub drive: ApiText,
    /// Energy in kilowatt-hours, if it is known.
    pub energy_kwh: Option<f64>,
    /// Where the energy comes from.
    pub energy_from: Option<String>,
    /// Hours in which the motor ran.
    pub running_hours: f64,
    /// Starts.
    pub starts: u32,
    /// Trips.
    pub trips: u32,
}

/// The days of a drive, oldest first.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DaysDocument {
    /// The days.
    pub days: Vec<DayDocument>,
}

/// The sums of a drive were set back to 0.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct UsageResetDocument {
    /// The name of the drive.
    pub drive: ApiText,
    /// The sums before.
    pub before: UsageDocument,
}
