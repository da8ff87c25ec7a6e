//! One register of a model: its address, its meaning, and its use by the gateway.

use super::{Confidence, MaskedText, NumberForm};
use crate::domain::address::Address;
use crate::domain::units::UnitOfMeasure;
use std::ops::RangeInclusive;
use std::time::Duration;

macro_rules! roles {
    ($($(#[$about:meta])* $role:ident $(, measures $name:literal in $unit:ident)?;)*) => {
        /// What the gateway uses a register for.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum RegisterRole {
            $($(#[$about])* $role,)*
        }

        impl RegisterRole {
            /// The name and the unit of what is measured there, which are the same for every vendor; `None` if nothing is.
            #[must_use]
            pub const fn measurement(self) -> Option<(&'static str, UnitOfMeasure)> {
                match self {
                    $($(Self::$role => Some(($name, UnitOfMeasure::$unit)),)?)*
                    _ => None,
                }
            }
        }
    };
}

roles! {
    /// Run commands are written here.
    RunCommand;
    /// An order of its own is written here, or the direction of the next one.
    Order;
    /// The commanded frequency is written here.
    FrequencyCommand;
    /// The frequency setting as the drive holds it.
    FrequencySetting;
    /// Output frequency.
    OutputFrequency;
    /// Acceleration time.
    AccelerationTime;
    /// Deceleration time.
    DecelerationTime;
    /// Where the drive takes its frequency from.
    FrequencySource;
    /// Where the drive takes its run commands from.
    RunSource;
    /// The number of the active trip, 0 for none.
    TripCode;
    /// The active trips, one bit each; 0 for none.
    TripBits;
    /// Number of trips so far.
    TripCount;
    /// Cause of the newest trip, as the vendor numbers it.
    TripCause;
    /// Output frequency at the newest trip.
    TripFrequency;
    /// Output current at the newest trip.
    TripCurrent;
    /// DC link voltage at the newest trip.
    TripDcLinkVoltage;
    /// Output current.
    OutputCurrent, measures "current" in Ampere;
    /// Output voltage.
    OutputVoltage, measures "voltage" in Volt;
    /// DC link voltage.
    DcLinkVoltage, measures "dc_voltage" in Volt;
    /// Output power.
    OutputPower, measures "power" in Kilowatt;
    /// Torque.
    Torque, measures "torque" in Percent;
    /// Temperature of the drive.
    Temperature, measures "temperature" in Celsius;
    /// Run hours.
    RunHours, measures "run_hours" in Hour;
    /// The energy that the drive has counted.
    Energy, measures "energy" in KilowattHour;
    /// An older trip's number. Several registers may have this role; the newest trip is at the lowest address.
    TripHistory;
    /// The number of the active warning, 0 for none. A warning stops no motor.
    WarningCode;
    /// The active warnings, one bit each; 0 for none.
    WarningBits;
}

impl RegisterRole {
    /// Whether several registers of a model may have this role.
    #[must_use]
    pub const fn is_repeated(self) -> bool {
        matches!(self, Self::TripHistory | Self::Order)
    }

    /// Whether the register decides what the motor does or whom it obeys. Only the gateway's own commands write such a
    /// register; it is never written directly.
    #[must_use]
    pub const fn is_guarded(self) -> bool {
        matches!(
            self,
            Self::RunCommand
                | Self::Order
                | Self::FrequencyCommand
                | Self::FrequencySetting
                | Self::FrequencySource
                | Self::RunSource
        )
    }
}

/// A property of a register that its source may leave unstated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FactPart {
    /// The fact that the register is readable.
    Reading,
    /// The fact that the register is writable.
    Writing,
    /// Its scale.
    Scale,
    /// How negative numbers are encoded.
    Sign,
    /// Whether it is volatile.
    Memory,
    /// The meaning of its words.
    Meaning,
}

impl FactPart {
    /// The word used in model files.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Reading => "reading",
            Self::Writing => "writing",
            Self::Scale => "scale",
            Self::Sign => "sign",
            Self::Memory => "memory",
            Self::Meaning => "meaning",
        }
    }
}

/// The kind of memory behind a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RegisterMemory {
    /// Volatile: may be written any number of times.
    Ram,
    /// Non-volatile: endures a limited number of writes.
    Stored,
}

impl RegisterMemory {
    /// The word used in model files.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Ram => "ram",
            Self::Stored => "stored",
        }
    }
}

/// How often a register is polled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PollClass {
    /// At the drive's poll period: status and output frequency.
    Fast,
    /// Once a second, or at the drive's poll period where that is longer: the trip count.
    Second,
    /// At four times the poll period.
    Slow,
    /// Once a minute: settings that a person may change on a running drive.
    Minutely,
    /// Once an hour: values that do not change while the drive is powered.
    Hourly,
}

impl PollClass {
    /// All classes, in the order of their declaration.
    pub const ALL: [Self; 5] = [
        Self::Fast,
        Self::Second,
        Self::Slow,
        Self::Minutely,
        Self::Hourly,
    ];

    /// Whether it is read every few seconds. A value that is polled less often is no measurement: its age says nothing about
    /// the drive.
    #[must_use]
    pub const fn is_live(self) -> bool {
        matches!(self, Self::Fast | Self::Second | Self::Slow)
    }
}

/// The documented access to a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RegisterAccess {
    /// Read only.
    Read,
    /// Write only; reading is not documented.
    Write,
    /// Read and write.
    ReadWrite,
}

impl RegisterAccess {
    /// Whether reading is documented.
    #[must_use]
    pub const fn can_read(self) -> bool {
        matches!(self, Self::Read | Self::ReadWrite)
    }

    /// Whether writing is documented.
    #[must_use]
    pub const fn can_write(self) -> bool {
        matches!(self, Self::Write | Self::ReadWrite)
    }

    /// The word for tables.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Write => "write",
            Self::ReadWrite => "read, write",
        }
    }
}

/// One register of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Register {
    /// Name, snake_case, unique in the model.
    pub name: String,
    /// A description in words.
    pub title: String,
    /// The vendor's code (`F007`), if it has one.
    pub code: Option<String>,
    /// Address as sent on the wire.
    pub address: Address,
    /// Raw steps per unit of measure: value = raw / scale, unless `form` says more. Never 0.
    pub scale: u32,
    /// Whether the number is in two's complement.
    pub signed: bool,
    /// How its words form the number, and the number the value.
    pub form: NumberForm,
    /// Unit of the value.
    pub unit: UnitOfMeasure,
    /// Documented access.
    pub access: RegisterAccess,
    /// Its use by the gateway.
    pub role: Option<RegisterRole>,
    /// How often it is polled. `None`: only on request.
    pub poll: Option<PollClass>,
    /// Kind of memory. `None`: undocumented, treated as stored.
    pub memory: Option<RegisterMemory>,
    /// The valid words, as numbers before scaling. `None`: undocumented.
    pub range: Option<RangeInclusive<i32>>,
    /// What it shows of every drive of the model, as numbers before scaling. `None`: nothing is concluded from it.
    pub plausible: Option<RangeInclusive<i32>>,
    /// Meanings of its words, if they are codes.
    pub meanings: Vec<(u16, String)>,
    /// Texts for states that some of its bits show.
    pub states: Vec<MaskedText>,
    /// Why no client may write it although the drive would accept the write: it is another way to move the motor or to
    /// widen its limits. `None` if it is no such back door.
    pub back_door: Option<String>,
    /// Whether it affects communication: station, speed, character format or protocol.
    pub is_link: bool,
    /// How long the drive hears nothing after a write of it.
    pub deaf_after: Option<Duration>,
    /// The drive never answers a write of it.
    pub has_no_reply: bool,
    /// Confidence of the row, except for the parts in `not_stated`.
    pub confidence: Confidence,
    /// Document and place.
    pub source: String,
    /// The properties that the source does not state.
    pub not_stated: Vec<FactPart>,
}

impl Register {
    /// Whether the model's documents prove `part`.
    #[must_use]
    pub fn proves(&self, part: FactPart) -> bool {
        self.confidence.is_proven() && !self.not_stated.contains(&part)
    }

    /// The meaning of `word`, or of its field; `None` if the model does not know it.
    #[must_use]
    pub fn meaning(&self, word: u16) -> Option<&str> {
        let code = self.code_in(word);
        let own = self
            .meanings
            .iter()
            .find(|(of, _)| *of == code)
            .map(|(_, text)| text);
        let state = || {
            self.states
                .iter()
                .find(|state| word & state.mask == state.value)
                .map(|state| &state.text)
        };
        own.or_else(state).map(String::as_str)
    }

    /// Whether `word` lies within the register's range, if a range is known.
    #[must_use]
    pub fn takes(&self, word: u16) -> bool {
        self.takes_number(self.number_in(word))
    }

    /// Whether the value in `words` lies within the register's range, if a range is known.
    #[must_use]
    pub fn takes_both(&self, words: [u16; 2]) -> bool {
        let number = self.number(|address| address.word_in(self.address, &words));
        number.is_some_and(|number| self.takes_number(number))
    }

    fn takes_number(&self, raw: i64) -> bool {
        self.range.as_ref().is_none_or(|range| {
            (i64::from(*range.start())..=i64::from(*range.end())).contains(&raw)
        })
    }
}
