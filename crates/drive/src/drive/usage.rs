//! What a drive has used: energy, running time, starts and trips, as sums that only rise.
//!
//! Everything is measured between two readings, on the monotonic clock, and only while readings follow each other: what
//! happened while the drive or the gateway was away is not known, except what the drive's own energy counter tells.

mod meter;
#[cfg(test)]
mod tests;

pub use meter::UsageMeter;

use crate::domain::units::UnitOfMeasure;
use crate::profile::model::{IndicatedState, Model, Register, RegisterRole};
use crate::profile::scale::Decimal;
use std::ops::AddAssign;
use std::time::Duration;

/// Millijoules of a kilowatt hour.
const MJ_PER_KWH: i64 = 3_600_000_000;
const MS_PER_HOUR: u64 = 3_600_000;

/// Sums of one drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UsageTotals {
    /// Energy in millijoules.
    pub energy_mj: u64,
    /// The time in which the motor ran, or was ordered to.
    pub running: Duration,
    /// How often it began to run.
    pub starts: u32,
    /// How often the drive tripped.
    pub trips: u32,
}

impl UsageTotals {
    /// `part` with two decimals where it is no plain number. Only full steps are shown.
    #[must_use]
    pub fn value(&self, part: UsagePart) -> Decimal {
        let digits = if part.unit() == UnitOfMeasure::None {
            0
        } else {
            2
        };
        let steps = self.steps(part, 10_u64.pow(digits.into()));
        Decimal::new(i64::try_from(steps).unwrap_or(i64::MAX), digits)
    }

    /// `part` in whole steps, this many per unit of measure.
    #[must_use]
    pub fn steps(&self, part: UsagePart, per_unit: u64) -> u64 {
        let steps = |number: u128, of_one: u64| {
            u64::try_from(number * u128::from(per_unit) / u128::from(of_one)).unwrap_or(u64::MAX)
        };
        match part {
            UsagePart::Energy => steps(self.energy_mj.into(), MJ_PER_KWH.unsigned_abs()),
            UsagePart::RunningHours => steps(self.running.as_millis(), MS_PER_HOUR),
            UsagePart::Starts => steps(self.starts.into(), 1),
            UsagePart::Trips => steps(self.trips.into(), 1),
        }
    }

    /// What has been added since `earlier`; nothing where a sum has fallen, because it was reset.
    #[must_use]
    pub const fn since(&self, earlier: &Self) -> Self {
        Self {
            energy_mj: self.energy_mj.saturating_sub(earlier.energy_mj),
            running: self.running.saturating_sub(earlier.running),
            starts: self.starts.saturating_sub(earlier.starts),
            trips: self.trips.saturating_sub(earlier.trips),
        }
    }
}

impl AddAssign for UsageTotals {
    fn add_assign(&mut self, more: Self) {
        self.energy_mj = self.energy_mj.saturating_add(more.energy_mj);
        self.running = self.running.saturating_add(more.running);
        self.starts = self.starts.saturating_add(more.starts);
        self.trips = self.trips.saturating_add(more.trips);
    }
}

/// Where the energy comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EnergySource {
    /// The drive's own counter, and readings of its output power between two steps of that.
    Counter,
    /// Summed up from readings of its output power.
    Power,
}

impl EnergySource {
    /// Where the energy of drives of `model` comes from; `None` if it is not known.
    #[must_use]
    pub fn of(model: &Model) -> Option<Self> {
        if counter(model).is_some() {
            Some(Self::Counter)
        } else {
            power(model).map(|_| Self::Power)
        }
    }

    /// The word used in documents.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Counter => "counter",
            Self::Power => "power",
        }
    }

    /// The source with this word; `None` if there is none.
    #[must_use]
    pub fn from_word(word: &str) -> Option<Self> {
        [Self::Counter, Self::Power]
            .into_iter()
            .find(|source| source.keyword() == word)
    }
}

/// One of the sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum UsagePart {
    /// Energy in kilowatt hours.
    Energy,
    /// The time in which the motor ran, in hours.
    RunningHours,
    /// How often it began to run.
    Starts,
    /// How often the drive tripped.
    Trips,
}

impl UsagePart {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Energy, Self::RunningHours, Self::Starts, Self::Trips];

    /// The word used in topics.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Energy => "energy",
            Self::RunningHours => "running_hours",
            Self::Starts => "starts",
            Self::Trips => "trips",
        }
    }

    /// Its unit of measure.
    #[must_use]
    pub const fn unit(self) -> UnitOfMeasure {
        match self {
            Self::Energy => UnitOfMeasure::KilowattHour,
            Self::RunningHours => UnitOfMeasure::Hour,
            Self::Starts | Self::Trips => UnitOfMeasure::None,
        }
    }
}

/// Which of the sums a drive has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UsageParts {
    /// Where the energy comes from; `None` if it is not known.
    pub energy: Option<EnergySource>,
    /// Whether it is read whether the motor runs.
    has_run_state: bool,
    /// Whether its trips are read.
    has_trips: bool,
}

impl UsageParts {
    /// The sums that drives of `model` allow.
    #[must_use]
    pub fn of(model: &Model) -> Self {
        let has_flag = model.status_flag(IndicatedState::Running).is_some();
        let has_output = model
            .register_for(RegisterRole::OutputFrequency)
            .is_some_and(|it| it.poll.is_some());
        let has_trips = model.trip_register().is_some();
        Self {
            energy: EnergySource::of(model),
            has_run_state: has_flag || has_output,
            has_trips,
        }
    }

    /// Whether `part` is one of them.
    #[must_use]
    pub const fn has(self, part: UsagePart) -> bool {
        match part {
            UsagePart::Energy => self.energy.is_some(),
            UsagePart::RunningHours | UsagePart::Starts => self.has_run_state,
            UsagePart::Trips => self.has_trips,
        }
    }
}

/// What a drive has used, as it is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UsageView {
    /// Which sums it has.
    pub parts: UsageParts,
    /// The sums.
    pub totals: UsageTotals,
}

impl UsageView {
    /// `part` with two decimals where it is no plain number; `None` if the drive does not have it.
    #[must_use]
    pub fn value(&self, part: UsagePart) -> Option<Decimal> {
        self.parts.has(part).then(|| self.totals.value(part))
    }

    /// `part` in whole steps, this many per unit of measure; `None` if the drive does not have it.
    #[must_use]
    pub fn steps(&self, part: UsagePart, per_unit: u64) -> Option<u64> {
        self.parts
            .has(part)
            .then(|| self.totals.steps(part, per_unit))
    }
}

/// What outlives the process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct KeptUsage {
    /// The sums.
    pub totals: UsageTotals,
    /// The last reading of the drive's own energy counter, in millijoules.
    pub counter_mj: Option<u64>,
    /// What of the energy was added since the last step of that counter, in millijoules.
    pub between_mj: u64,
    /// Where the energy comes from; `None` if none is known.
    pub energy_from: Option<EnergySource>,
}

/// The energy counter of drives of `model`.
fn counter(model: &Model) -> Option<&Register> {
    model
        .register_for(RegisterRole::Energy)
        .filter(|it| it.poll.is_some())
}

/// The register of the output power of drives of `model`, in kilowatts.
fn power(model: &Model) -> Option<&Register> {
    let register = model.register_for(RegisterRole::OutputPower)?;
    (register.poll.is_some() && register.unit == UnitOfMeasure::Kilowatt).then_some(register)
}
