//! The constant properties of a drive while the gateway runs: names, units, model, limits.

use super::plan::PollPace;
use super::snapshot::{DriveSnapshot, ValueReading};
use crate::domain::address::Address;
use crate::domain::control::{BusFunctions, ControlSettings};
use crate::domain::ids::{DriveIndex, Name, UnitId};
use crate::domain::time::MonoTime;
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
pub struct DriveRatings {
    /// Rated current in mA; `None` if not stated.
    pub current_ma: Option<u32>,
    /// Rated voltage in mV; `None` if not stated.
    pub voltage_mv: Option<u32>,
}

/// How the polled registers of a drive are published, by register name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointSettings {
    /// Smallest change that is published, in the register's unit; one step for registers not listed.
    pub dead_bands: Vec<(String, f64)>,
    /// After this time an unchanged value is published again; the general heartbeat applies to registers not listed.
    pub heartbeats: Vec<(String, Duration)>,
    /// Digits after the decimal point, at most those that the register has; all of them for registers not listed.
    pub decimals: Vec<(String, u8)>,
}

impl PointSettings {
    /// Digits after the decimal point with which `register` is published; `None` for all that it has.
    #[must_use]
    pub fn decimals_of(&self, register: &Register) -> Option<u8> {
        self.decimals
            .iter()
            .find(|(name, _)| *name == register.name)
            .map(|(_, digits)| *digits)
    }
}

/// How long a value is fresh.
#[derive(Clone, Debug, PartialEq)]
pub struct FreshnessLimits {
    own: Duration,
    /// Address and stale time of each register on which the value depends.
    bases: Vec<(Address, Duration)>,
}

impl FreshnessLimits {
    /// When the value of `register` grows stale; `None` if there is none.
    #[must_use]
    pub fn ends_at(&self, register: &Register, snapshot: &DriveSnapshot) -> Option<MonoTime> {
        self.ends_at_of(snapshot.read_at(register)?, snapshot)
    }

    /// When the value of a register that was read at `read_at` grows stale; `None` if there is none.
    #[must_use]
    pub fn ends_at_of(&self, read_at: MonoTime, snapshot: &DriveSnapshot) -> Option<MonoTime> {
        if snapshot.is_implausible {
            return None;
        }
        let mut ends_at = read_at + self.own;
        for (address, stale_after) in &self.bases {
            ends_at = ends_at.min(snapshot.reading(*address)?.at + *stale_after);
        }
        Some(ends_at)
    }
}

/// One drive as the configuration names it.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveDescription {
    /// Its line and its place there.
    pub place: DriveRef,
    /// Its name, unique over the gateway.
    pub name: Name,
    /// The name of its line.
    pub line: Name,
    /// Its model.
    pub model: Arc<Model>,
    /// Its native unit on Modbus TCP.
    pub unit: UnitId,
    /// Its uniform unit on Modbus TCP.
    pub uniform_unit: UnitId,
    /// The group in which the page shows it.
    pub group: Option<Name>,
    /// How often it is polled.
    pub pace: PollPace,
    /// Its rated values, where the model reports in per cent of them.
    pub ratings: DriveRatings,
    /// What may be commanded; `None` if the drive is read-only.
    pub control: Option<Arc<ControlSettings>>,
    /// How its polled registers are published.
    pub points: PointSettings,
}

impl DriveDescription {
    /// Which functions come over the bus.
    #[must_use]
    pub fn bus(&self) -> BusFunctions {
        self.control
            .as_ref()
            .map_or(BusFunctions::Both, |control| control.bus)
    }

    /// The age from which a reading of `register` is stale; `None` if the register is not polled.
    #[must_use]
    pub fn stale_after(&self, register: &Register) -> Option<Duration> {
        Some(self.pace.period(register.poll?) * STALE_PERIODS)
    }

    /// When the value of `register` grows stale: when its own words do, or those of a register on which it depends.
    /// `None` if it has no value, is not polled, or is of a drive that may be another one.
    #[must_use]
    pub fn stale_at(&self, register: &Register, snapshot: &DriveSnapshot) -> Option<MonoTime> {
        if snapshot.is_implausible {
            return None;
        }
        let mut ends_at = snapshot.read_at(register)? + self.stale_after(register)?;
        for address in register.form.bases() {
            ends_at = ends_at.min(snapshot.reading(address)?.at + self.basis_stale_after(address)?);
        }
        Some(ends_at)
    }

    fn basis_stale_after(&self, address: Address) -> Option<Duration> {
        self.stale_after(self.model.readable_at(address)?)
    }

    /// How long the value of `register` is fresh, for those who ask again and again; `None` if it is not polled.
    #[must_use]
    pub fn freshness(&self, register: &Register) -> Option<FreshnessLimits> {
        let basis = |address| Some((address, self.basis_stale_after(address)?));
        let bases = register.form.bases().map(basis).collect::<Option<_>>()?;
        Some(FreshnessLimits {
            own: self.stale_after(register)?,
            bases,
        })
    }

    /// The value of `register`, unless it is stale at `now`.
    #[must_use]
    pub fn fresh(
        &self,
        register: &Register,
        snapshot: &DriveSnapshot,
        now: MonoTime,
    ) -> Option<ValueReading> {
        let stale_at = self.stale_at(register, snapshot)?;
        if now < stale_at {
            snapshot.value(register)
        } else {
            None
        }
    }
}
