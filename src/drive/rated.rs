//! Values that a drive reports in per cent of its rated ones, in units of their own.

use super::description::Ratings;
use crate::domain::units::UnitOfMeasure;
use crate::profile::model::{Register, Role};

/// How the words of a register in per cent become amperes or volts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rated {
    /// The rated value in thousandths of the unit.
    rated_milli: u32,
    /// Raw steps per per cent.
    scale: u32,
    /// The unit.
    pub unit: UnitOfMeasure,
}

impl Rated {
    /// Nothing if the register is not in per cent of a rated value, or that value is not stated.
    #[must_use]
    pub fn of(register: &Register, ratings: &Ratings) -> Option<Self> {
        let (rated_milli, unit) = match (register.role?, register.unit) {
            (Role::OutputCurrent | Role::TripCurrent, UnitOfMeasure::Percent) => {
                (ratings.current_ma?, UnitOfMeasure::Ampere)
            }
            (Role::OutputVoltage, UnitOfMeasure::Percent) => (ratings.voltage_mv?, UnitOfMeasure::Volt),
            _ => return None,
        };
        Some(Self { rated_milli, scale: register.scale, unit })
    }

    /// The value of `word` as a fraction: numerator and denominator, in the unit.
    #[must_use]
    pub fn fraction(self, word: u16) -> (i64, i64) {
        (i64::from(word) * i64::from(self.rated_milli), i64::from(self.scale) * 100 * 1000)
    }

    /// The value of `word` in the unit, to the nearest hundredth.
    #[must_use]
    pub fn hundredths(self, word: u16) -> i64 {
        let (numerator, denominator) = self.fraction(word);
        (200 * numerator + denominator) / (2 * denominator)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::testing::model;

    fn register(role: Role, unit: UnitOfMeasure) -> Register {
        Register { role: Some(role), unit, scale: 100, ..model().registers[0].clone() }
    }

    #[test]
    fn per_cent_of_the_rated_value() {
        let ratings = Ratings { current_ma: Some(10_000), voltage_mv: Some(400_000) };
        let current = Rated::of(&register(Role::OutputCurrent, UnitOfMeasure::Percent), &ratings).unwrap();
        // The worked example of the vendor whose drives report so: 0x1A8A is 67.94 %, 6.79 A on a 10 A drive.
        assert_eq!((current.hundredths(0x1A8A), current.unit), (679, UnitOfMeasure::Ampere));
        let voltage = Rated::of(&register(Role::OutputVoltage, UnitOfMeasure::Percent), &ratings).unwrap();
        assert_eq!((voltage.hundredths(0x24FD), voltage.unit), (37_876, UnitOfMeasure::Volt));
    }

    #[test]
    fn what_is_not_stated_is_not_guessed() {
        let percent = |role| register(role, UnitOfMeasure::Percent);
        assert_eq!(Rated::of(&percent(Role::OutputCurrent), &Ratings::default()), None);
        let ratings = Ratings { current_ma: Some(1), voltage_mv: Some(1) };
        assert_eq!(Rated::of(&percent(Role::DcLinkVoltage), &ratings), None, "of what is not documented");
        assert_eq!(Rated::of(&register(Role::OutputCurrent, UnitOfMeasure::Ampere), &ratings), None);
    }
}
