//! Units of measure as they stand beside a value.

use std::fmt;

/// The unit in which a register's value is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Deserialize)]
pub enum UnitOfMeasure {
    /// Hertz.
    #[serde(rename = "Hz")]
    Hertz,
    /// Ampere.
    #[serde(rename = "A")]
    Ampere,
    /// Volt.
    #[serde(rename = "V")]
    Volt,
    /// Kilowatt.
    #[serde(rename = "kW")]
    Kilowatt,
    /// Per cent.
    #[serde(rename = "%")]
    Percent,
    /// Degrees Celsius.
    #[serde(rename = "degC")]
    Celsius,
    /// Seconds.
    #[serde(rename = "s")]
    Second,
    /// Hours.
    #[serde(rename = "h")]
    Hour,
    /// Revolutions per minute.
    #[serde(rename = "rpm")]
    Rpm,
    /// A plain number: a count, a code, an enumeration.
    #[serde(rename = "-")]
    None,
}

impl UnitOfMeasure {
    /// The unit as it stands behind a value; `-` for a plain number.
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
            Self::None => "-",
        }
    }
}

impl fmt::Display for UnitOfMeasure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.symbol())
    }
}
