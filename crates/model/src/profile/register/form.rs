//! The keys of a register that say how its words form a value.

use super::{RegisterFile, find_register};
use crate::domain::address::{Address, DataTable};
use crate::profile::model::{
    AddendWord, BasisRegister, FractionWhole, FullScale, NumberForm, ScaleBy, WordOrder,
};
use crate::profile::words::WORD_ORDERS;
use crate::toml_file::values::ValueKind;
use crate::toml_file::{
    KeyLocation, LocatedValue, OptionalKey, RequiredKey, TableReader, TomlEntry, TomlSection,
};

/// The largest scale, in raw steps per unit.
const MAX_SCALE: u32 = 1_000_000;
/// The word for a full scale that the configuration of the drive states.
pub(in crate::profile) const CONFIGURED: &str = "configured";
/// Values of `direction`.
const DIRECTIONS: [(&str, ()); 1] = [("sign", ())];

/// Raw steps for a number of units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::profile) struct RawSteps {
    pub steps: u32,
    pub per: u32,
}

impl RawSteps {
    /// One step is one unit.
    pub const ONE: Self = Self { steps: 1, per: 1 };
}

/// These keys as written.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::profile) struct FormFile {
    pub words: GivenKey<u8>,
    pub word_order: GivenKey<WordOrder>,
    pub mask: GivenKey<u16>,
    pub exponent_mask: GivenKey<u16>,
    pub full_scale: GivenKey<FullScaleFile>,
    pub scale_by: GivenKey<ScaleByFile>,
    pub plus: Vec<PartFile>,
    pub direction: GivenKey<()>,
}

/// An optional key that is absent by default.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::profile) struct GivenKey<T>(pub OptionalKey<T>);

impl<T> Default for GivenKey<T> {
    fn default() -> Self {
        Self(OptionalKey::Absent)
    }
}

impl<T> GivenKey<T> {
    pub(in crate::profile) const fn valid(&self) -> Option<&LocatedValue<T>> {
        self.0.valid()
    }
}

/// `full_scale`
#[derive(Clone, Debug, PartialEq)]
pub(in crate::profile) struct FullScaleFile {
    steps: RequiredKey<u32>,
    pub of: RequiredKey<String>,
    pub from: OptionalKey<String>,
    pub parameter: OptionalKey<String>,
}

/// `scale_by`
#[derive(Clone, Debug, PartialEq)]
pub(in crate::profile) struct ScaleByFile {
    pub register: RequiredKey<String>,
    steps: Option<Vec<(u16, u32)>>,
}

/// An element of `plus`.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::profile) struct PartFile {
    pub address: RequiredKey<u16>,
    scale: OptionalKey<RawSteps>,
}

impl FormFile {
    pub(super) fn read(reader: &mut TableReader<'_, '_>) -> Self {
        let field = ValueKind::number(1..=u16::MAX);
        Self {
            words: GivenKey(reader.optional("words", &ValueKind::number(1..=2_u8))),
            word_order: GivenKey(reader.optional("word_order", &ValueKind::one_of(&WORD_ORDERS))),
            mask: GivenKey(reader.optional("mask", &field)),
            exponent_mask: GivenKey(reader.optional("exponent_mask", &field)),
            full_scale: GivenKey(reader.inner("full_scale", full_scale)),
            scale_by: GivenKey(reader.inner("scale_by", scale_by)),
            plus: reader
                .tables("plus")
                .into_iter()
                .map(|section| part(reader.open(section)))
                .collect(),
            direction: GivenKey(reader.optional("direction", &ValueKind::one_of(&DIRECTIONS))),
        }
    }

    /// Whether it has two words.
    pub(in crate::profile) fn is_pair(&self) -> bool {
        self.words.valid().is_some_and(|words| words.value == 2)
    }

    /// The bits that hold number and exponent.
    pub(in crate::profile) fn bits(&self) -> u16 {
        let mask = |given: &GivenKey<u16>| given.valid().map(|it| it.value);
        mask(&self.mask).unwrap_or(u16::MAX) | mask(&self.exponent_mask).unwrap_or(0)
    }

    /// The form of a register in `table` with `scale` among `all`; `None` if any part is unusable.
    pub(super) fn ready(
        &self,
        table: DataTable,
        scale: RawSteps,
        all: &[RegisterFile],
    ) -> Option<NumberForm> {
        let full_scale = self.full_scale.0.clone().optional()?;
        let scale_by = self.scale_by.0.clone().optional()?;
        let order = self.word_order.0.clone().optional()?;
        Some(NumberForm {
            pair: if self.words.0.or(1)? == 2 {
                Some(order?)
            } else {
                None
            },
            mask: self.mask.0.or(u16::MAX)?,
            exponent_mask: self.exponent_mask.0.or(0)?,
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
            sign_is_direction: self.direction.0.clone().optional()?.is_some(),
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
        let scale = self.scale.or(RawSteps::ONE)?;
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
    let scale = register.scale.or(RawSteps::ONE)?;
    Some(BasisRegister {
        address: register.place()?.value,
        mask: register.form.mask.0.or(u16::MAX)?,
        signed: register.signed.or(false)?,
        scale: scale.steps,
        per: scale.per,
    })
}

/// The optional key `key`: a whole number of steps per unit, or a table with `steps` and `per`.
pub(super) fn steps(reader: &mut TableReader<'_, '_>, key: &'static str) -> OptionalKey<RawSteps> {
    match reader.value_or_table(key, &ValueKind::number(1..=MAX_SCALE)) {
        OptionalKey::Absent => OptionalKey::Absent,
        OptionalKey::Invalid => OptionalKey::Invalid,
        OptionalKey::Valid(LocatedValue {
            value: TomlEntry::Value(steps),
            location,
        }) => OptionalKey::Valid(LocatedValue {
            value: RawSteps {
                steps: steps.value,
                per: 1,
            },
            location,
        }),
        OptionalKey::Valid(LocatedValue {
            value: TomlEntry::Table(section),
            location,
        }) => {
            let mut inner = reader.open(section);
            let steps = inner.required("steps", &ValueKind::number(1..=MAX_SCALE));
            let per = inner.required("per", &ValueKind::number(1..=MAX_SCALE));
            inner.finish();
            let (Some(steps), Some(per)) = (steps, per) else {
                return OptionalKey::Invalid;
            };
            OptionalKey::Valid(LocatedValue {
                value: RawSteps {
                    steps: steps.value,
                    per: per.value,
                },
                location,
            })
        }
    }
}

fn full_scale(mut reader: TableReader<'_, '_>) -> FullScaleFile {
    let file = FullScaleFile {
        steps: reader.required("steps", &ValueKind::number(1..=MAX_SCALE)),
        of: reader.required("of", &ValueKind::text()),
        from: reader.optional("from", &ValueKind::text()),
        parameter: reader.optional("parameter", &ValueKind::text()),
    };
    reader.finish();
    file
}

fn scale_by(mut reader: TableReader<'_, '_>) -> ScaleByFile {
    let register = reader.required("register", &ValueKind::text());
    let steps = reader
        .required_table("steps")
        .and_then(|section| words_and_steps(&mut reader, section));
    reader.finish();
    ScaleByFile { register, steps }
}

/// The table `steps`: raw steps per unit by the word of the other register.
fn words_and_steps<'a>(
    reader: &mut TableReader<'a, '_>,
    section: TomlSection<'a>,
) -> Option<Vec<(u16, u32)>> {
    let location: KeyLocation = section.location.clone();
    let entries = reader.open(section).all(&ValueKind::number(1..=MAX_SCALE));
    if entries.is_empty() {
        reader.problems().push(
            location
                .problem("is empty")
                .right("the steps per unit of at least one word"),
        );
        return None;
    }
    let mut steps = Vec::new();
    for (key, value) in entries {
        let Some(word) = key
            .parse::<u16>()
            .ok()
            .filter(|word| word.to_string() == key)
        else {
            let problem = value
                .location
                .problem(format!("`{key}` is not a register word"));
            reader
                .problems()
                .push(problem.right("a decimal number from \"0\" to \"65535\""));
            return None;
        };
        steps.push((word, value.value));
    }
    steps.sort_unstable();
    Some(steps)
}

fn part(mut reader: TableReader<'_, '_>) -> PartFile {
    let address = reader.required("address", &ValueKind::address());
    let scale = steps(&mut reader, "scale");
    reader.finish();
    PartFile { address, scale }
}
