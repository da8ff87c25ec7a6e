//! A drive model, checked and ready to use. Only [`super::check`] makes one.

use crate::domain::link::{Framing, Interface, LinkSettings, Parity};
use crate::domain::units::UnitOfMeasure;
use std::ops::RangeInclusive;
use std::time::Duration;

/// How sure a fact is. A control action rests on a fact only as far as its confidence allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Confidence {
    /// Stated in the manual of this very model.
    Manual,
    /// Stated in a second document for this model.
    SecondSource,
    /// Stated for a sibling model only.
    Sibling,
    /// Follows from other facts by reasoning; not seen on a real drive.
    Inferred,
    /// No source: a cautious choice of ours. Allowed for timings only, never for registers or bits.
    Default,
    /// Stated by the operator in the gateway's configuration, not by a model file.
    Configured,
}

impl Confidence {
    /// Whether a control action may rest on the fact without the operator's acceptance.
    #[must_use]
    pub const fn is_proven(self) -> bool {
        match self {
            Self::Manual | Self::SecondSource | Self::Configured => true,
            Self::Sibling | Self::Inferred | Self::Default => false,
        }
    }

    /// The word as it stands in model files.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Manual => "manual",
            Self::SecondSource => "second-source",
            Self::Sibling => "sibling",
            Self::Inferred => "inferred",
            Self::Default => "default",
            Self::Configured => "configured",
        }
    }
}

/// A value with where it comes from and how sure it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Fact<T> {
    /// The value.
    pub value: T,
    /// How sure it is.
    pub confidence: Confidence,
    /// Document and place.
    pub source: String,
}

/// A drive model.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Identifier used in configurations, `vendor-model`.
    pub id: String,
    /// The vendor's name.
    pub vendor: String,
    /// The product's name.
    pub title: String,
    /// Documents that the facts cite, as (short name, full title).
    pub documents: Vec<(String, String)>,
    /// What the model says of the line.
    pub link: Link,
    /// Times on the line.
    pub timing: Timing,
    /// Limits of reads.
    pub read: ReadLimits,
    /// How writes behave.
    pub write: WriteRules,
    /// Reads that prove, by a word count that differs from every missing reply, that no late reply follows.
    /// Each lies within what the model documents as readable.
    pub barrier_reads: Vec<BarrierRead>,
    /// How run commands are given; nothing if the model cannot be commanded.
    pub run: Option<RunCommand>,
    /// The registers, in order of address, none twice.
    pub registers: Vec<Register>,
}

impl Model {
    /// The register at `address`.
    #[must_use]
    pub fn register_at(&self, address: u16) -> Option<&Register> {
        self.registers.iter().find(|register| register.address == address)
    }

    /// The register with `role`.
    #[must_use]
    pub fn register_for(&self, role: Role) -> Option<&Register> {
        self.registers.iter().find(|register| register.role == Some(role))
    }

    /// The register called `name` or, by the vendor's code, `name` in any case.
    #[must_use]
    pub fn register_named(&self, name: &str) -> Option<&Register> {
        self.registers.iter().find(|register| {
            register.name == name || register.code.as_deref().is_some_and(|code| code.eq_ignore_ascii_case(name))
        })
    }

    /// How many words may be read from `address` in one frame before the model's limit or group boundary.
    #[must_use]
    pub fn words_in_one_read(&self, address: u16) -> u16 {
        self.read.words_from(address)
    }
}

/// What a model says of the line it hangs on.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// Factory settings.
    pub default: Fact<LinkSettings>,
    /// Speeds in bit/s that can be set.
    pub bauds: Fact<Vec<u32>>,
    /// Parities that can be set.
    pub parities: Fact<Vec<Parity>>,
    /// Stop bits that can be set.
    pub stop_bits: Fact<Vec<u8>>,
    /// Data bits that can be set.
    pub data_bits: Fact<Vec<u8>>,
    /// Framings that the drive understands.
    pub framings: Fact<Vec<Framing>>,
    /// Interfaces that the drive has.
    pub interfaces: Fact<Vec<Interface>>,
    /// Station numbers that can be set.
    pub stations: Fact<RangeInclusive<u8>>,
    /// Broadcast, if it is documented.
    pub broadcast: Option<Broadcast>,
}

/// A documented broadcast.
#[derive(Clone, Debug, PartialEq)]
pub struct Broadcast {
    /// The station number that addresses all.
    pub station: Fact<u8>,
    /// Functions that may be broadcast. None is answered.
    pub functions: Vec<u8>,
}

/// Times on the line.
#[derive(Clone, Debug, PartialEq)]
pub struct Timing {
    /// Silence before and after each frame, in characters.
    pub gap_chars: Fact<f64>,
    /// Longest wait for a reply after the end of the request, while nothing better is known.
    pub reply_timeout_cap: Fact<Duration>,
    /// Longest time the drive works on a request, where a document says so.
    pub processing_max: Option<Fact<Duration>>,
    /// How long after a time-out a reply to the timed-out request may still come.
    pub max_lateness: Fact<Duration>,
}

/// Limits of reads.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadLimits {
    /// Most words in one read.
    pub max_words: Fact<u16>,
    /// What a read must not cross.
    pub boundary: Option<Boundary>,
}

impl ReadLimits {
    /// How many words may be read from `address` in one frame.
    pub(super) fn words_from(&self, address: u16) -> u16 {
        let to_boundary = match self.boundary {
            Some(Boundary::HighByte) => 0x100 - (address & 0xFF),
            None => (u16::MAX - address).saturating_add(1),
        };
        self.max_words.value.min(to_boundary)
    }
}

/// What a read must not cross.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Boundary {
    /// A change of the address's high byte (a group of parameters).
    HighByte,
}

/// How writes behave.
#[derive(Clone, Debug, PartialEq)]
pub struct WriteRules {
    /// What a refused write looks like.
    pub refused: Fact<RefusedWrite>,
}

/// What a refused write looks like on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RefusedWrite {
    /// An exception reply.
    Exception,
    /// A normal reply that carries the value the drive kept.
    KeepsOldValue,
}

/// A read that may serve as a barrier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BarrierRead {
    /// First register.
    pub address: u16,
    /// Number of words.
    pub count: u16,
}

/// How run commands are given: one register whose values are an enumeration.
#[derive(Clone, Debug, PartialEq)]
pub struct RunCommand {
    /// Decelerate and stop.
    pub stop: Fact<u16>,
    /// Run forward.
    pub forward: Fact<u16>,
    /// Run reverse, where the model has it.
    pub reverse: Option<Fact<u16>>,
    /// Cut the output off so that the motor coasts, where the model has it.
    pub coast: Option<Fact<u16>>,
    /// Reset a trip.
    pub reset: Option<Fact<u16>>,
    /// The words that are written one after the other to reset a trip: `reset` among them, stops around it, and no
    /// order to run. Empty where the model has no reset.
    pub reset_sequence: Vec<u16>,
}

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
    /// What it is, in words.
    pub title: String,
    /// The vendor's own code (`F007`), where it has one.
    pub code: Option<String>,
    /// Address as sent on the wire.
    pub address: u16,
    /// Raw steps per unit of measure: value = raw / scale. Never 0.
    pub scale: u32,
    /// Whether the raw word is two's complement.
    pub signed: bool,
    /// Unit of the value.
    pub unit: UnitOfMeasure,
    /// Who may do what with it.
    pub access: Access,
    /// What the gateway uses it for.
    pub role: Option<Role>,
    /// How often it is polled; nothing: only when asked for.
    pub poll: Option<PollClass>,
    /// How sure the row is.
    pub confidence: Confidence,
    /// Where the row comes from.
    pub source: String,
}
