//! Converts values that a drive reports in per cent of its rated values into physical units.

use super::description::DriveRatings;
use crate::domain::units::UnitOfMeasure;
use crate::profile::model::{Register, RegisterRole};
use crate::profile::scale::{Decimal, ScaledValue};

/// The conversion of a register in per cent into amperes or volts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RatedConversion {
    /// The rated value in thousandths of the unit.
    rated_milli: u32,
    /// The unit.
    pub unit: UnitOfMeasure,
}

impl RatedConversion {
    /// `None` if the register is not in per cent of a rated value, or that value is not stated.
    #[must_use]
    pub fn of(register: &Register, ratings: &DriveRatings) -> Option<Self> {
        let (rated_milli, unit) = match (register.role?, register.unit) {
            (RegisterRole::OutputCurrent | RegisterRole::TripCurrent, UnitOfMeasure::Percent) => {
                (ratings.current_ma?, UnitOfMeasure::Ampere)
            }
            (RegisterRole::OutputVoltage, UnitOfMeasure::Percent) => {
                (ratings.voltage_mv?, UnitOfMeasure::Volt)
            }
            _ => return None,
        };
        Some(Self { rated_milli, unit })
    }

    /// `percent` as a fraction: numerator and denominator, in the unit.
    #[must_use]
    pub fn fraction(self, percent: ScaledValue) -> (i64, i64) {
        let (raw, scale) = percent.fraction();
        (
            raw.saturating_mul(self.rated_milli.into()),
            scale * 100 * 1000,
        )
    }

    /// `percent` in the unit, with `digits` digits after the decimal point.
    #[must_use]
    pub fn to_digits(self, percent: ScaledValue, digits: u8) -> Decimal {
        let (numerator, denominator) = self.fraction(percent);
        Decimal::nearest(numerator, denominator, digits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vendors::testing::model;

    fn register(role: RegisterRole, unit: UnitOfMeasure) -> Register {
        Register {
            role: Some(role),
            unit,
            scale: 100,
            ..model().registers[0].clone()
        }
    }

    #[test]
    fn per_cent_of_the_rated_value() {
        let ratings = DriveRatings {
            current_ma: Some(10_000),
            voltage_mv: Some(400_000),
        };
        let of = |role, word| ScaledValue::from_word(word, &register(role, UnitOfMeasure::Percent));
        let current = RatedConversion::of(
            &register(RegisterRole::OutputCurrent, UnitOfMeasure::Percent),
            &ratings,
        )
        .unwrap();
        // The worked example of the vendor whose drives report so: 0x1A8A is 67.94 %, 6.79 A on a 10 A drive.
        assert_eq!(
            (
                current
                    .to_digits(of(RegisterRole::OutputCurrent, 0x1A8A), 2)
                    .to_string(),
                current.unit
            ),
            ("6.79".into(), UnitOfMeasure::Ampere)
        );
        let voltage = RatedConversion::of(
            &register(RegisterRole::OutputVoltage, UnitOfMeasure::Percent),
            &ratings,
        )
        .unwrap();
        assert_eq!(
            (
                voltage
                    .to_digits(of(RegisterRole::OutputVoltage, 0x24FD), 2)
                    .to_string(),
                voltage.unit
            ),
            ("378.76".into(), UnitOfMeasure::Volt)
        );
        assert_eq!(
            current
                .to_digits(of(RegisterRole::OutputCurrent, 1), 1)
                .to_string(),
            "0.1",
            "what flows is not shown as nothing"
        );
    }

    #[test]
    fn what_is_not_stated_is_not_guessed() {
        let percent = |role| register(role, UnitOfMeasure::Percent);
        assert_eq!(
            RatedConversion::of(
                &percent(RegisterRole::OutputCurrent),
                &DriveRatings::default()
            ),
            None
        );
        let ratings = DriveRatings {
            current_ma: Some(1),
            voltage_mv: Some(1),
        };
        assert_eq!(
            RatedConversion::of(&percent(RegisterRole::DcLinkVoltage), &ratings),
            None,
            "of what is not documented"
        );
        assert_eq!(
            RatedConversion::of(
                &register(RegisterRole::OutputCurrent, UnitOfMeasure::Ampere),
                &ratings
            ),
            None
        );
    }
}
