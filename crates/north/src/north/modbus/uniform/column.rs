//! One measurement of a drive, from the word of its register to the word of the uniform map.

use crate::domain::address::Address;
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::{DriveDescription, FreshnessLimits};
use crate::drive::rated::RatedConversion;
use crate::drive::view::DriveView;
use crate::profile::model::{Register, RegisterRole};

/// The unsigned word for a value that the drive does not have or that is not known.
pub const ABSENT: u16 = 0xFFFF;
/// The word for a signed value that the drive does not have or that is not known.
pub const ABSENT_SIGNED: u16 = 0x8000;

/// Where a measurement comes from.
#[derive(Clone, Debug)]
pub(super) struct MeasurementSource {
    register: Register,
    /// The register is in per cent of a rated value that is stated.
    rated: Option<RatedConversion>,
    freshness: FreshnessLimits,
}

/// A value that is fresh: `raw` steps of `1 / scale`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FreshValue {
    raw: i64,
    scale: i64,
}

impl MeasurementSource {
    /// The measurement with `role`, of the frequency setting as the drive holds it; `None` if the model does not have it,
    /// does not poll it, or has it in another unit (in per cent of a rated value that is not stated, for instance).
    pub(super) fn new(drive: &DriveDescription, role: RegisterRole) -> Option<Self> {
        let unit = unit_of(role);
        let register = match role {
            RegisterRole::FrequencySetting => drive.model.setting_register()?,
            _ => drive.model.register_for(role)?,
        };
        let rated =
            RatedConversion::of(register, &drive.ratings).filter(|rated| rated.unit == unit);
        if register.unit != unit && rated.is_none() {
            return None;
        }
        Some(Self {
            register: register.clone(),
            rated,
            freshness: drive.freshness(register)?,
        })
    }

    /// The drive's own register.
    pub(super) const fn address(&self) -> Address {
        self.register.address
    }

    /// The value, if it is known and not stale.
    pub(super) fn fresh(&self, view: &DriveView, now: MonoTime) -> Option<FreshValue> {
        let reading = view.snapshot.value(&self.register)?;
        if now >= self.freshness.ends_at_of(reading.at, &view.snapshot)? {
            return None;
        }
        let (raw, scale) = self.rated.map_or_else(
            || reading.value.fraction(),
            |rated| rated.fraction(reading.value),
        );
        Some(FreshValue { raw, scale })
    }
}

impl FreshValue {
    /// A frequency.
    pub(super) fn of(frequency: Hertz) -> Self {
        Self {
            raw: frequency.millihertz().into(),
            scale: 1000,
        }
    }

    /// Without its sign: a drive that shows a frequency in reverse as negative shows the direction elsewhere.
    pub(super) const fn magnitude(self) -> Self {
        Self {
            raw: self.raw.abs(),
            scale: self.scale,
        }
    }

    /// In steps of `1 / steps`, rounded half away from zero.
    pub(super) const fn in_steps(self, steps: i64) -> i64 {
        let twice = self.raw.saturating_mul(2 * steps);
        let half = if self.raw < 0 {
            -self.scale
        } else {
            self.scale
        };
        twice.saturating_add(half) / (2 * self.scale)
    }

    /// The value as an unsigned word of `1 / steps`; absent if it does not fit.
    pub(super) fn unsigned(self, steps: i64) -> u16 {
        unsigned(self.in_steps(steps))
    }

    /// The value as a signed word of `1 / steps`; absent if it does not fit.
    pub(super) fn signed(self, steps: i64) -> u16 {
        let word = i16::try_from(self.in_steps(steps))
            .ok()
            .filter(|word| *word != i16::MIN);
        word.map_or(ABSENT_SIGNED, i16::cast_unsigned)
    }

    /// Whether two values are at most a tenth of their unit apart.
    pub(super) fn is_near(self, other: Self) -> bool {
        let apart = i128::from(self.raw) * i128::from(other.scale)
            - i128::from(other.raw) * i128::from(self.scale);
        10 * apart.abs() <= i128::from(self.scale) * i128::from(other.scale)
    }
}

/// The unit of the words that show the measurement with `role`; none if it is no measurement.
pub(super) const fn unit_of(role: RegisterRole) -> UnitOfMeasure {
    match (role, role.measurement()) {
        (RegisterRole::OutputFrequency | RegisterRole::FrequencySetting, _) => UnitOfMeasure::Hertz,
        (_, Some((_, unit))) => unit,
        (_, None) => UnitOfMeasure::None,
    }
}

/// `value` as a word that does not read as absent, or absent.
pub(super) fn unsigned(value: i64) -> u16 {
    u16::try_from(value).unwrap_or(ABSENT)
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn fresh(raw: i64, scale: i64) -> FreshValue {
        FreshValue { raw, scale }
    }

    #[test]
    fn values_are_rescaled_exactly_and_rounded_half_away_from_zero() {
        for (raw, scale, steps, right) in [
            (6000, 100, 100, 6000),
            (425, 10, 100, 4250),
            (1234, 100, 10, 123),
            (1235, 100, 10, 124),
            (-1235, 100, 10, -124),
            (-1234, 100, 10, -123),
            (1, 3, 10, 3),
            (5, 3, 10, 17),
            (65_535, 1, 100, 6_553_500),
            (0, 7, 10, 0),
        ] {
            assert_eq!(
                fresh(raw, scale).in_steps(steps),
                right,
                "{raw}/{scale} in 1/{steps}"
            );
        }
    }

    #[test]
    fn what_does_not_fit_is_absent() {
        assert_eq!(fresh(65_534, 1).unsigned(1), 65_534);
        assert_eq!(fresh(65_535, 1).unsigned(1), ABSENT);
        assert_eq!(fresh(6554, 1).unsigned(10), ABSENT);
        assert_eq!(fresh(-1, 1).unsigned(10), ABSENT);
        assert_eq!(fresh(-1, 1).signed(10), (-10_i16).cast_unsigned());
        assert_eq!(fresh(-32_767, 1).signed(1), 0x8001);
        for beyond in [-32_768, 32_768, -40_000] {
            assert_eq!(fresh(beyond, 1).signed(1), ABSENT_SIGNED);
        }
    }

    #[test]
    fn a_tenth_is_near_and_more_is_not() {
        assert!(fresh(4250, 100).is_near(fresh(424, 10)));
        assert!(!fresh(4250, 100).is_near(fresh(42_399, 1000)));
        assert!(fresh(0, 100).is_near(fresh(0, 1)));
        assert!(
            fresh(i64::from(u16::MAX), i64::from(u32::MAX)).is_near(fresh(0, i64::from(u32::MAX)))
        );
    }
}
