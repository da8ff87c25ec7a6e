//! The words that every file uses for enumerations: one table each, for reading and for showing.

use crate::domain::link::{EchoPolicy, Framing, Interface, Parity};
use crate::domain::units::UnitOfMeasure;

/// Parities.
pub const PARITIES: [(&str, Parity); 3] = [
    ("none", Parity::None),
    ("even", Parity::Even),
    ("odd", Parity::Odd),
];

/// Framings.
pub const FRAMINGS: [(&str, Framing); 2] = [("rtu", Framing::Rtu), ("ascii", Framing::Ascii)];

/// Framings, with the one that follows from a port, which no file names.
pub const SHOWN_FRAMINGS: [(&str, Framing); 3] =
    [FRAMINGS[0], FRAMINGS[1], ("modbus-tcp", Framing::Mbap)];

/// What to do about an echo.
pub const ECHO_POLICIES: [(&str, EchoPolicy); 2] =
    [("refuse", EchoPolicy::Refuse), ("strip", EchoPolicy::Strip)];

/// Interfaces.
pub const INTERFACES: [(&str, Interface); 2] =
    [("rs485", Interface::Rs485), ("rs232", Interface::Rs232)];

/// Units of measure.
pub const UNITS: [(&str, UnitOfMeasure); 18] = [
    (UnitOfMeasure::Hertz.symbol(), UnitOfMeasure::Hertz),
    (UnitOfMeasure::Ampere.symbol(), UnitOfMeasure::Ampere),
    (UnitOfMeasure::Volt.symbol(), UnitOfMeasure::Volt),
    (UnitOfMeasure::Kilowatt.symbol(), UnitOfMeasure::Kilowatt),
    (UnitOfMeasure::Percent.symbol(), UnitOfMeasure::Percent),
    (UnitOfMeasure::Celsius.symbol(), UnitOfMeasure::Celsius),
    (UnitOfMeasure::Second.symbol(), UnitOfMeasure::Second),
    (UnitOfMeasure::Hour.symbol(), UnitOfMeasure::Hour),
    (UnitOfMeasure::Rpm.symbol(), UnitOfMeasure::Rpm),
    (
        UnitOfMeasure::KilowattHour.symbol(),
        UnitOfMeasure::KilowattHour,
    ),
    (
        UnitOfMeasure::MegawattHour.symbol(),
        UnitOfMeasure::MegawattHour,
    ),
    (
        UnitOfMeasure::NewtonMetre.symbol(),
        UnitOfMeasure::NewtonMetre,
    ),
    (UnitOfMeasure::Bar.symbol(), UnitOfMeasure::Bar),
    (
        UnitOfMeasure::CubicMetrePerHour.symbol(),
        UnitOfMeasure::CubicMetrePerHour,
    ),
    (
        UnitOfMeasure::LitrePerSecond.symbol(),
        UnitOfMeasure::LitrePerSecond,
    ),
    (UnitOfMeasure::Minute.symbol(), UnitOfMeasure::Minute),
    (UnitOfMeasure::Day.symbol(), UnitOfMeasure::Day),
    (UnitOfMeasure::None.symbol(), UnitOfMeasure::None),
];

/// The word for `value` in `words`; `?` where it has none.
#[must_use]
pub fn word_for<T: PartialEq>(words: &[(&'static str, T)], value: &T) -> &'static str {
    words
        .iter()
        .find(|(_, it)| it == value)
        .map_or("?", |(word, _)| word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_has_its_word() {
        assert_eq!(word_for(&PARITIES, &Parity::Odd), "odd");
        assert_eq!(word_for(&UNITS, &UnitOfMeasure::None), "-");
    }
}
