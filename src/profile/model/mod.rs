//! A drive model, checked and ready to use. Only [`super::check`] creates one.

mod alias;
mod codes;
mod command;
mod commit;
mod document;
mod evidence;
mod form;
mod full_scale;
mod groups;
mod link;
mod order;
mod parameter;
mod read;
mod register;
mod run_word;
mod start;
mod status;
mod stop_bits;
mod watchdog;

pub use alias::RamAlias;
pub use codes::CodeRule;
pub use command::{
    BasicFact, BlockWrite, ModelIdentity, ModelWatchdog, NeededFor, RefusedWrite, RunCommand,
    SetupItem, StopBits, WriteRules,
};
pub use commit::{CommitEffect, CommitWord, CommitWords};
pub use document::{DocumentKind, ModelDocument};
pub use evidence::SecondSource;
pub use form::{
    AddendWord, BasisRegister, FractionWhole, FullScale, NumberForm, ScaleBy, WordOrder,
};
pub use groups::{NUMBERS_MAX, ParameterGroup};
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
    MaskedText, MaskedWord, StateText, StatusFlag,
};

use crate::domain::address::Address;
use crate::domain::link::Framing;
use std::time::Duration;

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

impl Model {
    /// The register at `address`.
    #[must_use]
    pub fn register_at(&self, address: impl Into<Address>) -> Option<&Register> {
        let address = address.into();
        self.registers
            .iter()
            .find(|register| register.address == address)
    }

    /// The register that is written at `address`.
    #[must_use]
    pub fn writable_at(&self, address: impl Into<Address>) -> Option<&Register> {
        let address = address.into();
        self.registers
            .iter()
            .find(|register| register.address == address && register.access.can_write())
    }

    /// A register that is read at `address`: one that begins there, or has its second word there.
    #[must_use]
    pub fn readable_at(&self, address: impl Into<Address>) -> Option<&Register> {
        let address = address.into();
        let covers = |it: &&Register| {
            address
                .offset_from(it.address)
                .is_some_and(|offset| offset < it.form.words())
        };
        self.registers
            .iter()
            .filter(|register| register.access.can_read())
            .find(covers)
    }

    /// What a read of the word at `address` shows: more than one register if it has fields.
    pub fn fields_at(&self, address: Address) -> impl Iterator<Item = &Register> {
        self.registers
            .iter()
            .filter(move |register| register.address == address && register.access.can_read())
    }

    /// How often the word at `address` is polled, if a read of `count` words from `first` on covers all words that it
    /// belongs to; `None` if it is not polled, or is one half of a pair.
    #[must_use]
    pub fn polled_at(&self, address: Address, first: Address, count: u16) -> Option<PollClass> {
        let is_read = |it: Address| it.offset_from(first).is_some_and(|offset| offset < count);
        let class = |register: &Register| {
            let words = register.form.words();
            let is_own = address
                .offset_from(register.address)
                .is_some_and(|offset| offset < words);
            let is_whole = register.address.onwards().take(words.into()).all(is_read);
            let is_part = register
                .form
                .plus
                .iter()
                .any(|part| part.address == address);
            if (is_own && is_whole) || is_part {
                register.poll
            } else {
                None
            }
        };
        self.registers.iter().filter_map(class).min()
    }

    /// The drive's own parameter that holds that full scale, if the model names it.
    #[must_use]
    pub fn full_scale_parameter(&self) -> Option<&str> {
        let scales = self
            .registers
            .iter()
            .filter_map(|register| register.form.full_scale.as_ref());
        scales
            .into_iter()
            .find_map(|scale| scale.parameter.as_deref())
    }

    /// The register whose stored twin is at `address`, on a model that has such twins.
    #[must_use]
    pub fn stored_twin(&self, address: impl Into<Address>) -> Option<&Register> {
        let address = address.into();
        let bit = 1_u16.checked_shl(u32::from(self.quirks.stored_alias_bit.as_ref()?.value))?;
        let number = address.number();
        (number & bit != 0).then(|| self.register_at(address.at(number & !bit)))?
    }

    /// Whether the register at `address` is non-volatile. If undocumented, only the registers that the gateway commands
    /// through count as volatile: no drive is commanded through a memory that wears out.
    #[must_use]
    pub fn is_stored(&self, address: impl Into<Address>) -> bool {
        let address = address.into();
        let second = || self.second_word_at(address);
        let register = self
            .writable_at(address)
            .or_else(|| self.register_at(address))
            .or_else(second);
        let Some(register) = register else {
            return self.in_ram_at(address).is_none();
        };
        match register.memory {
            Some(memory) => memory == RegisterMemory::Stored,
            None => !register.role.is_some_and(RegisterRole::is_guarded),
        }
    }

    /// Whether a register holds the word at `address`, alone or as the second of two.
    #[must_use]
    pub fn has_word_at(&self, address: Address) -> bool {
        let holds = |it: &Register| {
            address
                .offset_from(it.address)
                .is_some_and(|offset| offset < it.form.words())
        };
        self.registers.iter().any(holds)
    }

    /// The register of two words that can be written and whose second word is at `address`.
    #[must_use]
    pub fn second_word_at(&self, address: Address) -> Option<&Register> {
        let is_second =
            |it: &&Register| it.form.pair.is_some() && it.address.checked_add(1) == Some(address);
        self.registers
            .iter()
            .filter(|register| register.access.can_write())
            .find(is_second)
    }

    /// How long the drive hears nothing after a write of the register at `address`, or of another form of it.
    #[must_use]
    pub fn deaf_after(&self, address: Address) -> Option<Duration> {
        let register = self
            .writable_at(address)
            .or_else(|| self.stored_twin(address));
        register.or_else(|| self.in_ram_at(address))?.deaf_after
    }

    /// The registers whose writes the drive never answers.
    pub fn silent_writes(&self) -> impl Iterator<Item = Address> + '_ {
        self.registers
            .iter()
            .filter(|register| register.has_no_reply)
            .map(|register| register.address)
    }

    /// The longest time for which the drive hears nothing after a write.
    #[must_use]
    pub fn longest_deafness(&self) -> Duration {
        self.registers
            .iter()
            .filter_map(|register| register.deaf_after)
            .max()
            .unwrap_or_default()
    }

    /// The register with `role`; the first one if there are several.
    #[must_use]
    pub fn register_for(&self, role: RegisterRole) -> Option<&Register> {
        self.registers
            .iter()
            .find(|register| register.role == Some(role))
    }

    /// The register called `name`: its name or the vendor's code, ignoring case.
    #[must_use]
    pub fn register_named(&self, name: &str) -> Option<&Register> {
        self.registers.iter().find(|register| {
            let is_called = |label: &str| label.eq_ignore_ascii_case(name);
            is_called(&register.name) || register.code.as_deref().is_some_and(is_called)
        })
    }

    /// The register that shows the setpoint as the drive holds it: a dedicated one, else the frequency command if it
    /// is readable.
    #[must_use]
    pub fn setting_register(&self) -> Option<&Register> {
        let readable = |role| {
            self.register_for(role)
                .filter(|register| register.access.can_read())
        };
        readable(RegisterRole::FrequencySetting)
            .or_else(|| readable(RegisterRole::FrequencyCommand))
    }

    /// The location of `flag`.
    #[must_use]
    pub fn status_flag(&self, flag: IndicatedState) -> Option<&StatusFlag> {
        self.status.iter().find(|it| it.flag == flag)
    }

    /// The most reliable register that indicates a trip: a status word, else the present trip's number or bits, else the
    /// trip count.
    #[must_use]
    pub fn trip_register(&self) -> Option<&Register> {
        let flagged = self
            .status_flag(IndicatedState::Tripped)
            .and_then(|flag| self.readable_at(flag.address));
        let code = || {
            self.register_for(RegisterRole::TripCode)
                .or_else(|| self.register_for(RegisterRole::TripBits))
        };
        flagged
            .or_else(code)
            .or_else(|| self.register_for(RegisterRole::TripCount))
    }

    /// Whether the drive serves `function`.
    #[must_use]
    pub fn serves(&self, function: u8) -> bool {
        self.functions.value.contains(&function)
    }

    /// The vendor's text for trip `code`.
    #[must_use]
    pub fn trip_text(&self, code: u16) -> Option<&CodeText> {
        self.trip_codes.iter().find(|it| it.code == code)
    }

    /// The register that shows the active trips as bits, if the model has one.
    #[must_use]
    pub fn trip_bits(&self) -> Option<&Register> {
        self.register_for(RegisterRole::TripBits)
    }

    /// The register that shows the active warnings, if the model has one.
    #[must_use]
    pub fn warning_register(&self) -> Option<&Register> {
        self.register_for(RegisterRole::WarningCode)
            .or_else(|| self.register_for(RegisterRole::WarningBits))
    }

    /// The vendor's text for warning `code`; of bits, the number of the bit + 1.
    #[must_use]
    pub fn warning_text(&self, code: u16) -> Option<&CodeText> {
        self.warning_codes.iter().find(|it| it.code == code)
    }

    /// The vendor's text for exception `code`.
    #[must_use]
    pub fn exception_text(&self, code: u8) -> Option<&CodeText> {
        self.exceptions.iter().find(|it| it.code == u16::from(code))
    }

    /// What the drive means by exception `code`, if the model says more than its text.
    #[must_use]
    pub fn exception_kind(&self, code: u8) -> Option<ExceptionKind> {
        self.exception_kinds
            .iter()
            .find(|(of, _)| *of == code)
            .map(|(_, kind)| *kind)
    }

    /// How many words may be read from `address` in one frame before the model's limit or group boundary.
    #[must_use]
    pub fn words_in_one_read(&self, address: impl Into<Address>) -> u16 {
        self.read.words_at(address.into())
    }

    /// Whether `address` belongs to no register and a read may cover it all the same.
    #[must_use]
    pub fn is_readable_hole(&self, address: Address) -> bool {
        self.read.reads_holes()
            && self.readable_at(address).is_none()
            && self.writable_at(address).is_none()
    }

    /// The address after `address`, in the drive's numbering.
    #[must_use]
    pub fn next_address(&self, address: Address) -> Address {
        let is_decimal = self.quirks.decimal_numbers.is_some();
        let number = address.number();
        address.at(match (is_decimal, number & 0xF, number & 0xF0) {
            (true, 9.., 0x90..) => (number & 0xFF00).wrapping_add(0x100),
            (true, 9.., _) => (number & 0xFFF0).wrapping_add(0x10),
            _ => number.wrapping_add(1),
        })
    }

    /// The model for a line with `framing`: ASCII frames carry fewer words.
    #[must_use]
    pub fn on(&self, framing: Framing) -> Self {
        let mut model = self.clone();
        if let (Framing::Ascii, Some(words)) = (framing, &self.read.max_words_ascii) {
            model.read.max_words = words.clone();
            for area in &mut model.read.areas {
                area.max_words.value = area.max_words.value.min(words.value);
            }
        }
        model
    }
}
