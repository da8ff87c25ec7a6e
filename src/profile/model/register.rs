//! One register of a model: where it is, what it means, and what the gateway uses it for.

use super::Confidence;
use crate::domain::units::UnitOfMeasure;
use std::ops::RangeInclusive;

/// What the gateway uses a register for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// Run commands are written here.
    RunCommand,
    /// The commanded frequency is written here.
    FrequencyCommand,
    /// The frequency setting as the drive holds it.
    FrequencySetting,
    /// Output frequency.
    OutputFrequency,
    /// Acceleration time.
    AccelerationTime,
    /// Deceleration time.
    DecelerationTime,
    /// Where the drive takes its frequency from.
    FrequencySource,
    /// Where the drive takes its run commands from.
    RunSource,
    /// The number of the trip that holds now, 0 for none.
    TripCode,
    /// Number of trips so far.
    TripCount,
    /// Cause of the newest trip, as the vendor numbers it.
    TripCause,
    /// Output frequency at the newest trip.
    TripFrequency,
    /// Output current at the newest trip.
    TripCurrent,
    /// Voltage of the DC link at the newest trip.
    TripDcLinkVoltage,
    /// Output current.
    OutputCurrent,
    /// Output voltage.
    OutputVoltage,
    /// Voltage of the DC link.
    DcLinkVoltage,
    /// Output power.
    OutputPower,
    /// Torque.
    Torque,
    /// Temperature of the drive.
    Temperature,
    /// Run hours.
    RunHours,
    /// An older trip's number. The only role that several registers may have: the newest of them at the lowest address.
    TripHistory,
}

impl Role {
    /// Whether several registers of a model may have it.
    #[must_use]
    pub const fn is_repeated(self) -> bool {
        matches!(self, Self::TripHistory)
    }

    /// Whether the register decides what the motor does or whom it obeys, so that it is written by commands of the
    /// gateway's own and never as it is.
    #[must_use]
    pub const fn is_guarded(self) -> bool {
        matches!(
            self,
            Self::RunCommand
                | Self::FrequencyCommand
                | Self::FrequencySetting
                | Self::FrequencySource
                | Self::RunSource
        )
    }
}

/// Something about a register that its source may not state, although it states the register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FactPart {
    /// That it can be read.
    Reading,
    /// That it can be written.
    Writing,
    /// In what steps it counts.
    Scale,
    /// How negative numbers are written.
    Sign,
    /// Where it keeps what is written to it.
    Memory,
    /// What its words mean.
    Meaning,
}

impl FactPart {
    /// The word as it stands in model files.
    #[must_use]
    pub const fn word(self) -> &'static str {
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

/// Where a register keeps what is written to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Memory {
    /// It is lost with the power, and may be written as often as one likes.
    Ram,
    /// It is stored, in a memory that endures a limited number of writes.
    Stored,
}

impl Memory {
    /// The word as it stands in model files.
    #[must_use]
    pub const fn word(self) -> &'static str {
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
    /// Once a minute: what a person may change on a drive that runs.
    Minutely,
    /// Once an hour: what does not change while the drive has power.
    Hourly,
}

/// Who may do what with a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Access {
    /// Only read.
    Read,
    /// Only write; reading back is not documented.
    Write,
    /// Read and write.
    ReadWrite,
}

impl Access {
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

    /// As a table shows it.
    #[must_use]
    pub const fn word(self) -> &'static str {
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
    /// Name in our own vocabulary, snake_case, unique in the model.
    pub name: String,
    /// A description in words.
    pub title: String,
    /// The vendor's own code (`F007`), where it has one.
    pub code: Option<String>,
    /// Address as sent on the wire.
    pub address: u16,
    /// Raw steps per unit of measure: value = raw / scale. Never 0.
    pub scale: u32,
    /// Whether the raw word is in two's complement.
    pub signed: bool,
    /// Unit of the value.
    pub unit: UnitOfMeasure,
    /// Who may do what with it.
    pub access: Access,
    /// What the gateway uses it for.
    pub role: Option<Role>,
    /// How often it is polled; nothing: only when asked for.
    pub poll: Option<PollClass>,
    /// Where it keeps what is written to it; nothing: no document says so, and it is treated as stored.
    pub memory: Option<Memory>,
    /// The words that it takes, as numbers before scaling; nothing: no document says so.
    pub range: Option<RangeInclusive<i32>>,
    /// What its words mean, where they are codes.
    pub meanings: Vec<(u16, String)>,
    /// Why nobody may write it although the drive would let them: it is another way to move the motor or to widen its
    /// limits. Nothing where it is none.
    pub back_door: Option<String>,
    /// It decides how the drive is reached: its station, speed or character format, its protocol.
    pub is_link: bool,
    /// How sure the row is, but for what is `not_stated`.
    pub confidence: Confidence,
    /// Where the row comes from.
    pub source: String,
    /// What of the row that source does not state.
    pub not_stated: Vec<FactPart>,
}

impl Register {
    /// Whether documents of the model prove `part` of the row.
    #[must_use]
    pub fn proves(&self, part: FactPart) -> bool {
        self.confidence.is_proven() && !self.not_stated.contains(&part)
    }

    /// What `word` means, where the register holds codes and the model knows this one.
    #[must_use]
    pub fn meaning(&self, word: u16) -> Option<&str> {
        self.meanings.iter().find(|(code, _)| *code == word).map(|(_, text)| text.as_str())
    }

    /// Whether `word` lies within the range that the register takes, as far as that is known.
    #[must_use]
    pub fn takes(&self, word: u16) -> bool {
        let raw = if self.signed { i32::from(word.cast_signed()) } else { i32::from(word) };
        self.range.as_ref().is_none_or(|range| range.contains(&raw))
    }
}
