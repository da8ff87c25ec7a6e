//! What does not change about a drive while the gateway runs: names, units, model, limits.

use super::plan::Pace;
use crate::domain::control::ControlSettings;
use crate::domain::ids::{DriveIndex, Name, UnitId};
use crate::profile::model::{Model, Register};
use std::sync::Arc;
use std::time::Duration;

/// How many planned periods a value may age before it is stale.
pub const STALE_PERIODS: u32 = 3;

/// A drive's place in the gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DriveRef {
    /// Its line, in the order of the configuration, from 0.
    pub line: u16,
    /// Its place on the line.
    pub drive: DriveIndex,
}

/// Rated values of one drive, from its nameplate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ratings {
    /// Rated current in mA; nothing: not stated.
    pub current_ma: Option<u32>,
    /// Rated voltage in mV; nothing: not stated.
    pub voltage_mv: Option<u32>,
}

/// How the polled registers of a drive are published, each by its name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points {
    /// Smallest change that is published, in the register's unit; of one that is not here: a step.
    pub dead_bands: Vec<(String, f64)>,
    /// After this time a value that has not changed is published again; of one that is not here: after the heartbeat of
    /// all topics.
    pub heartbeats: Vec<(String, Duration)>,
    /// Digits behind the decimal point, none that the register has not; of one that is not here: all that it has.
    pub decimals: Vec<(String, u8)>,
}

impl Points {
    /// Digits behind the decimal point with which `register` is published; nothing: all that it has.
    #[must_use]
    pub fn decimals_of(&self, register: &Register) -> Option<u8> {
        self.decimals.iter().find(|(name, _)| *name == register.name).map(|(_, digits)| *digits)
    }
}

/// One drive as the configuration names it.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveDescription {
    /// Where it hangs.
    pub place: DriveRef,
    /// Its name, unique over the gateway.
    pub name: Name,
    /// The name of its line.
    pub line: Name,
    /// What it is.
    pub model: Arc<Model>,
    /// Its native unit on Modbus TCP.
    pub unit: UnitId,
    /// Its uniform unit on Modbus TCP.
    pub uniform_unit: UnitId,
    /// How often it is polled.
    pub pace: Pace,
    /// Its rated values, where the model reports in per cent of them.
    pub ratings: Ratings,
    /// What may be commanded; nothing: the drive is read-only.
    pub control: Option<Arc<ControlSettings>>,
    /// How its polled registers are published.
    pub points: Points,
}

impl DriveDescription {
    /// The age from which a reading of `register` is stale; nothing if the register is not polled.
    #[must_use]
    pub fn stale_after(&self, register: &Register) -> Option<Duration> {
        Some(self.pace.period(register.poll?) * STALE_PERIODS)
    }
}
