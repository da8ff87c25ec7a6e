//! A drive model, checked and ready to use. Only [`super::check`] creates one. It answers questions about its registers in
//! `registers` and about its control in `control`.

mod codes;
mod command;
mod commit;
mod control;
mod document;
mod form;
mod link;
mod order;
mod parameter;
mod read;
mod register;
mod registers;
mod run_word;
mod start;
mod status;
mod stop_bits;

pub use codes::{CodeRule, NUMBERS_MAX, ParameterGroup};
pub use command::{
    BasicFact, BlockWrite, ModelIdentity, ModelWatchdog, NeededFor, RefusedWrite, RunCommand,
    SecondSource, SetupItem, StopBits, WriteRules,
};
pub use commit::{CommitEffect, CommitWord, CommitWords};
pub use document::{DocumentKind, ModelDocument};
pub use form::{
    AddendWord, BasisRegister, FractionWhole, FullScale, NumberForm, ScaleBy, WordOrder,
};
pub use link::{FactorySetting, ModelBroadcast, ModelLink, ModelTiming};
pub use order::{DirectionWords, OrderKind, OrderPlaces, ResetStep, ResetWrite};
pub use parameter::ParameterKind;
pub use read::{ReadArea, ReadBoundary, ReadHoles, ReadLimits};
pub use register::{FactPart, PollClass, Register, RegisterAccess, RegisterMemory, RegisterRole};
pub use run_word::{
    BitMeaning, BitSense, OrderedWord, RunBit, RunField, RunForm, WordEffect, WordSenses, ZeroWord,
};
pub use start::{StartCondition, StartStep, StartWords};
pub use status::{
    Barrier, BarrierRead, ClearWords, CodeText, DriveQuirks, ExceptionKind, IndicatedState,
    MaskedText, MaskedWord, RamAlias, StateText, StatusFlag,
};

/// How sure a fact is. A control action rests on a fact only as far as its confidence allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Confidence {
    /// Stated in a manual of this very model.
    Manual,
    /// Stated in a second manual of this model, such as its distributor's.
    SecondSource,
    /// Stated for this model by a third party: an open program, a register map, a note from the field.
    ThirdParty,
    /// Stated for a sibling model only.
    Sibling,
    /// Follows from other facts by reasoning; not seen on a real drive.
    Inferred,
    /// No source: a conservative default. Allowed for timings only, never for registers or bits.
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
            Self::ThirdParty | Self::Sibling | Self::Inferred | Self::Default => false,
        }
    }

    /// The word used in model files.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Manual => "manual",
            Self::SecondSource => "second-source",
            Self::ThirdParty => "third-party",
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
    /// Documents that the facts cite.
    pub documents: Vec<ModelDocument>,
    /// Second sources of facts, in the order of the file.
    pub second_sources: Vec<SecondSource>,
    /// Line settings.
    pub link: ModelLink,
    /// Times on the line.
    pub timing: ModelTiming,
    /// Function codes that the drive serves.
    pub functions: Fact<Vec<u8>>,
    /// Limits of reads.
    pub read: ReadLimits,
    /// How writes behave.
    pub write: WriteRules,
    /// Exception codes with the vendor's texts, each at most once.
    pub exceptions: Vec<CodeText>,
    /// What the drive means by some of them.
    pub exception_kinds: Vec<(u8, ExceptionKind)>,
    /// Deviations from the standard behaviour.
    pub quirks: DriveQuirks,
    /// Exchanges after which no late reply can follow, best first.
    pub barriers: Vec<Barrier>,
    /// How run commands are given; `None` if the model cannot be commanded.
    pub run: Option<RunCommand>,
    /// The status flags, each at most once.
    pub status: Vec<StatusFlag>,
    /// Trip numbers with the vendor's texts, each at most once.
    pub trip_codes: Vec<CodeText>,
    /// Texts of warnings.
    pub warning_codes: Vec<CodeText>,
    /// How the drive takes over and stores what was written to its parameters, if it does not do so by itself.
    pub commit: CommitWords,
    /// The settings that the drive needs before it obeys the bus, in order.
    pub setup: Vec<SetupItem>,
    /// How the drive tells what it is, if it does.
    pub identity: Option<ModelIdentity>,
    /// The drive's own watchdog, if it is documented.
    pub watchdog: Option<ModelWatchdog>,
    /// How codes map to addresses, if there is a rule.
    pub codes: Option<CodeRule>,
    /// The registers, in order of address, each at most once.
    pub registers: Vec<Register>,
    /// Identifies the content of its file, together with what that takes over from others; independent of empty lines
    /// and comments. 0 for a model that is in no catalog.
    pub digest: u64,
}
