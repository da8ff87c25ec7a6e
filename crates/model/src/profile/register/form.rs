//! The keys of a register that say how its words form a value.

use super::{RegisterFile, find_register};
use crate::domain::address::{Address, DataTable};
use crate::profile::model::{
    AddendWord, BasisRegister, FractionWhole, FullScale, NumberForm, ScaleBy, WordOrder,
};
use crate::profile::words::WORD_ORDERS;
use crate::toml_file::declare::{KeyForm, declare_table, optional, required, table, tables};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TomlEntry};

/// The largest scale, in raw steps per unit.
const MAX_SCALE: u32 = 1_000_000;
/// The word for a full scale that the configuration of the drive states.
pub(in crate::profile) const CONFIGURED: &str = "configured";
/// Values of `direction`.
const DIRECTIONS: [(&str, ()); 1] = [("sign", ())];

/// Raw steps for a number of units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawSteps {
    pub steps: u32,
    pub per: u32,
}

impl RawSteps {
    /// One step is one unit.
    pub const ONE: Self = Self { steps: 1, per: 1 };
}

declare_table! {
    /// How the words of a register form a value.
    FormFile is "[[register]]" {
        /// 2 for a 32-bit value, which takes this address and the next. Both words are read in one frame. Only a setpoint may be
        /// written: both words in one frame of function 10 hex.
        words: OptionalKey<u8> = optional(ValueKind::number(1..=2)), or 1;
        /// The order of the two words.
        word_order: OptionalKey<WordOrder> = optional(ValueKind::one_of(&WORD_ORDERS)),
            without "required with `words = 2`";
        /// The bits that hold the number, neighbours; it is shifted down. Registers may share an address if their masks do not
        /// overlap and they are only read.
        mask: OptionalKey<u16> = optional(ValueKind::number(1..=u16::MAX)),
            or u16::MAX, without "the whole word";
        /// Beside `mask`: at most 3 bits with a power of ten: value = number x 10^exponent / scale.
        exponent_mask: OptionalKey<u16> = optional(ValueKind::number(1..=u16::MAX)), or 0, without "none";
        /// The value is a fraction: from + raw / steps x (of - from). In place of `scale`.
        full_scale: OptionalKey<FullScaleFile> = table(FullScaleFile::read), without "none";
        /// The steps per unit depend on another register. In place of `scale`.
        scale_by: OptionalKey<ScaleByFile> = table(ScaleByFile::read), without "none";
        /// Further words that are added, as MWh to kWh.
        plus: Vec<PartFile> = tables(PartFile::read), without "none";
        /// Of a signed output frequency, frequency command or frequency setting: the sign is the direction, and the magnitude is
        /// shown. With `not_stated = ["sign"]` only a number below 0 shows a direction.
        direction: OptionalKey<()> = optional(ValueKind::one_of(&DIRECTIONS)), without "none";
    }
}

declare_table! {
    /// `scale`, as a ratio.
    RatioFile is "register.scale" {
        /// Raw steps.
        steps: RequiredKey<u32> = required(raw_steps());
        /// The number of units that they are.
        per: RequiredKey<u32> = required(raw_steps());
    }
}

declare_table! {
    /// `full_scale`
    FullScaleFile is "register.full_scale" {
        /// The raw number that stands for the whole.
        steps: RequiredKey<u32> = required(raw_steps());
        /// The name of the readable register in the same unit that holds the whole, or `"configured"`: the drive's key
        /// `full_scale_hz`.
        of: RequiredKey<String> = required(ValueKind::text());
        /// The name of the register that holds the value of a raw 0.
        from: OptionalKey<String> = optional(ValueKind::text()), without "0";
        /// Beside `of = "configured"`: the drive's own parameter that holds the whole, as a person looks for it.
        parameter: OptionalKey<String> = optional(ValueKind::text()), without "none";
    }
}

declare_table! {
    /// `scale_by`
    ScaleByFile is "register.scale_by" {
        /// The name of that register.
        register: RequiredKey<String> = required(ValueKind::text());
        /// Steps per unit by its word in decimal: `{ "0" = 1, "1" = 10 }`. With another word there is no value.
        steps: Option<Vec<(u16, u32)>> = words_and_steps();
    }
}

declare_table! {
    /// An element of `plus`.
    PartFile is "register.plus" {
        /// The address of the word.
        address: RequiredKey<u16> = required(ValueKind::address());
        /// Its steps, as `scale`.
        scale: OptionalKey<RawSteps> = steps(), or RawSteps::ONE, without "1";
    }
}

/// A number of raw steps, or of the units that they are.
fn raw_steps() -> ValueKind<'static, u32> {
    ValueKind::number(1..=MAX_SCALE)
}

impl FormFile {
    /// Whether it has two words.
    pub(in crate::profile) fn is_pair(&self) -> bool {
        self.words.valid().is_some_and(|words| words.value == 2)
    }

    /// The bits that hold number and exponent.
    pub(in crate::profile) fn bits(&self) -> u16 {
        let mask = |given: &OptionalKey<u16>| given.valid().map(|it| it.value);
        mask(&self.mask).unwrap_or(u16::MAX) | mask(&self.exponent_mask).unwrap_or(0)
    }

    /// The form of a register in `table` with `scale` among `all`; `None` if any part is unusable.
    pub(super) fn ready(
        &self,
        table: DataTable,
        scale: RawSteps,
        all: &[RegisterFile],
    ) -> Option<NumberForm> {
        let full_scale = self.full_scale.clone().optional()?;
        let scale_by = self.scale_by.clone().optional()?;
        let order = self.word_order.clone().optional()?;
        Some(NumberForm {
            pair: if self.words()? == 2 {
                Some(order?)
            } else {
                None
            },
            mask: self.mask()?,
            exponent_mask: self.exponent_mask()?,
            per: scale.per,
            full_scale: full_scale
                .map(|it| it.ready(all))
                .map_or(Some(None), |it| it.map(Some))?,
            scale_by: scale_by
                .map(|it| it.ready(all))
                .map_or(Some(None), |it| it.map(Some))?,
            plus: self
                .plus
                .iter()
                .map(|part| part.ready(table))
                .collect::<Option<_>>()?,
            sign_is_direction: self.direction.clone().optional()?.is_some(),
        })
    }
}

impl FullScaleFile {
    fn ready(&self, all: &[RegisterFile]) -> Option<FullScale> {
        let of = &self.of.as_ref()?.value;
        let from = self.from.clone().optional()?;
        Some(FullScale {
            steps: self.steps.as_ref()?.value,
            of: if of == CONFIGURED {
                FractionWhole::Configured
            } else {
                FractionWhole::Register(basis(of, all)?)
            },
            from: from
                .map(|name| basis(&name, all))
                .map_or(Some(None), |it| it.map(Some))?,
            parameter: self.parameter.clone().optional()?,
        })
    }
}

impl ScaleByFile {
    fn ready(&self, all: &[RegisterFile]) -> Option<ScaleBy> {
        let BasisRegister { address, mask, .. } = basis(&self.register.as_ref()?.value, all)?;
        Some(ScaleBy {
            address,
            mask,
            steps: self.steps.clone()?,
        })
    }
}

impl PartFile {
    /// The word in the `table` of its register.
    fn ready(&self, table: DataTable) -> Option<AddendWord> {
        let scale = self.scale()?;
        Some(AddendWord {
            address: Address::new(table, self.address.as_ref()?.value),
            scale: scale.steps,
            per: scale.per,
        })
    }
}

/// The register called `name` as the basis of another one.
fn basis(name: &str, all: &[RegisterFile]) -> Option<BasisRegister> {
    let register = find_register(name, all)?;
    let scale = register.scale()?;
    Some(BasisRegister {
        address: register.place()?.value,
        mask: register.form.mask()?,
        signed: register.signed()?,
        scale: scale.steps,
        per: scale.per,
    })
}

/// A whole number of steps per unit, or a table with `steps` and `per`.
pub(super) fn steps() -> KeyForm<'static, OptionalKey<RawSteps>> {
    let kind = raw_steps();
    let [notation, right] = [kind.notation(), kind.right()].map(|it| format!("{it}, or a table"));
    let form = KeyForm::of(kind, |reader, key, kind| {
        let LocatedValue { value, location } = match reader.value_or_table(key, kind) {
            OptionalKey::Absent => return OptionalKey::Absent,
            OptionalKey::Invalid => return OptionalKey::Invalid,
            OptionalKey::Valid(entry) => entry,
        };
        let (steps, per) = match value {
            TomlEntry::Value(steps) => (steps.value, 1),
            TomlEntry::Table(section) => {
                let RatioFile { steps, per } = RatioFile::read(reader.open(section));
                let (Some(steps), Some(per)) = (steps, per) else {
                    return OptionalKey::Invalid;
                };
                (steps.value, per.value)
            }
        };
        OptionalKey::Valid(LocatedValue {
            value: RawSteps { steps, per },
            location,
        })
    });
    form.listed_as(notation).right(right)
}

/// The table `steps`: raw steps per unit by the word of the other register.
fn words_and_steps() -> KeyForm<'static, Option<Vec<(u16, u32)>>> {
    let kind = raw_steps();
    let right = format!("a table, each {}", kind.right());
    let form = KeyForm::of(kind, |reader, key, kind| {
        let section = reader.required_table(key)?;
        let location = section.location.clone();
        let entries = reader.open(section).all(kind);
        if entries.is_empty() {
            let problem = location.problem("is empty");
            reader
                .problems()
                .push(problem.right("the steps per unit of at least one word"));
            return None;
        }
        let mut steps = Vec::new();
        for (key, value) in entries {
            let word = key.parse::<u16>().ok();
            let Some(word) = word.filter(|word| word.to_string() == key) else {
                let what = format!("`{key}` is not a register word");
                let problem = value.location.problem(what);
                reader
                    .problems()
                    .push(problem.right("a decimal number from \"0\" to \"65535\""));
                return None;
            };
            steps.push((word, value.value));
        }
        steps.sort_unstable();
        Some(steps)
    });
    form.right(right).needed()
}
