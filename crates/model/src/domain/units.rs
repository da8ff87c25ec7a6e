//! Units of measure as they are shown with a value.

use std::fmt;

/// The unit in which a register's value is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum UnitOfMeasure {
    /// Hertz.
    Hertz,
    /// Ampere.
    Ampere,
    /// Volt.
    Volt,
    /// Kilowatt.
    Kilowatt,
    /// Per cent.
    Percent,
    /// Degrees Celsius.
    Celsius,
    /// Seconds.
    Second,
    /// Hours.
    Hour,
    /// Revolutions per minute.
    Rpm,
    /// Kilowatt hours.
    KilowattHour,
    /// Megawatt hours.
    MegawattHour,
    /// Newton metres.
    NewtonMetre,
    /// Bar.
    Bar,
    /// Cubic metres per hour.
    CubicMetrePerHour,
    /// Litres per second.
    LitrePerSecond,
    /// Minutes.
    Minute,
    /// Days.
    Day,
    /// A plain number: a count, a code, an enumeration.
    None,
}

impl UnitOfMeasure {
    /// The symbol that follows a value; `-` for a plain number.
    #[must_use]
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Hertz => "Hz",
            Self::Ampere => "A",
            Self::Volt => "V",
            Self::Kilowatt => "kW",
            Self::Percent => "%",
            Self::Celsius => "degC",
            Self::Second => "s",
            Self::Hour => "h",
            Self::Rpm => "rpm",
            Self::KilowattHour => "kWh",
            Self::MegawattHour => "MWh",
            Self::NewtonMetre => "Nm",
            Self::Bar => "bar",
            Self::CubicMetrePerHour => "m3/h",
            Self::LitrePerSecond => "l/s",
            Self::Minute => "min",
            Self::Day => "days",
            Self::None => "-",
        }
    }
}

impl fmt::Display for UnitOfMeasure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.symbol())
    }
}
