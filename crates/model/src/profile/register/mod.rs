//! One register as written in a file: in a model file, or added to a model by the gateway's configuration.

mod extra;
mod form;
mod rules;
mod tables;

use crate::domain::address::{Address, DataTable};
use crate::domain::problem::Problem;
pub use extra::{extra_register, with_extra};
pub(super) use form::{CONFIGURED, FormFile, RawSteps};
#[cfg(test)]
pub(super) use form::{FullScaleFile, PartFile, RatioFile, ScaleByFile};
pub(super) use rules::{addresses_fit, codes_fit, distinct, has_decimal_digits};
pub(super) use tables::{called, read_by, tables_fit, written_by};

use super::file::{FactReader, Origin};
use super::model::{
    CodeRule, Confidence, FactPart, PollClass, Register, RegisterAccess, RegisterMemory,
    RegisterRole,
};
use super::scale::steps;
use super::words::{ACCESSES, MEMORIES, PARTS, POLL_CLASSES, ROLES, TABLES};
use crate::domain::units::UnitOfMeasure;
use crate::toml_file::declare::{
    KeyForm, declare_table, list, listing, no_key, only, optional, required,
};
use crate::toml_file::values::ValueKind;
use crate::toml_file::words::UNITS;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader};
use std::ops::RangeInclusive;
use std::time::Duration;

/// The longest time that a drive may be deaf after a write: it cannot be stopped meanwhile.
const DEAF_MAX: Duration = Duration::from_secs(10);

declare_table! {
    /// One register. Leave out what is not documented. Rows are distinguished by `name`.
    RegisterFile is "[[register]]" with source: &RegisterSource<'_> {
        /// What it rests on.
        origin: Option<Origin> = source.origin();
        /// Its name, unique in the model; what topics, `read` and `write` call it.
        name: RequiredKey<String> = required(ValueKind::parsed(
            "snake_case: a to z, 0 to 9 and `_`, a letter first",
            name,
        ));
        /// A description.
        title: RequiredKey<String> = required(ValueKind::text());
        /// The vendor's code, as `F007`.
        code: OptionalKey<String> = optional(ValueKind::text()), without "none";
        /// The address as it is sent on the wire, counted from 0.
        address after code: RequiredKey<u16> = source.address(code),
            without "required unless `[codes]` gives that of `code`";
        /// The table of the Modbus data model that the address is in. `functions` of the model lists the ones that read and write
        /// it. A coil or a discrete input is 0 or 1.
        table: OptionalKey<DataTable> = optional(ValueKind::one_of(&TABLES)),
            or DataTable::Holding, without "`holding`";
        /// Raw steps in one unit: with 100 a raw 4250 is 42.50. Or a ratio: value = raw x per / steps.
        scale: OptionalKey<RawSteps> = form::steps(), or RawSteps::ONE, without "1";
        /// Whether the number is in two's complement.
        signed: OptionalKey<bool> = optional(ValueKind::flag()), or false;
        /// The unit of the value; `-` for none.
        unit: RequiredKey<UnitOfMeasure> = required(ValueKind::one_of(&UNITS));
        /// What the documents say can be done with it.
        access: RequiredKey<RegisterAccess> = required(ValueKind::one_of(&ACCESSES));
        /// How often it is read.
        poll: OptionalKey<PollClass> = optional(ValueKind::one_of(&POLL_CLASSES)),
            without "on request only";
        /// What the gateway uses it for. A role belongs to one register, except `trip-history`.
        role: OptionalKey<RegisterRole> = source.of_model(optional(ValueKind::one_of(&ROLES))),
            without "none";
        /// How its words form a value.
        form: FormFile = source.of_model(no_key(FormFile::keys));
        /// Where a written value is kept.
        memory: OptionalKey<RegisterMemory> = source.of_model(optional(ValueKind::one_of(&MEMORIES))),
            without "not known, treated as `stored`";
        /// The least and the greatest value that the drive takes, in the unit: `[0.1, 600.0]`.
        range after scale after signed: OptionalKey<RangeInclusive<i32>> =
            source.of_model(range(scale, signed)), without "not known";
        /// What it shows of every drive of this model, in the unit: `[150, 900]`. Until it was seen in this range after the drive
        /// came into sight, no reading of the drive is shown as good, and every order but a stop is refused (`implausible`): the
        /// addresses may be off by one, or the drive another one.
        plausible after scale after signed: OptionalKey<RangeInclusive<i32>> =
            source.of_model(range(scale, signed)), without "none";
        /// The meanings of its words, in decimal: `{ "0" = "panel", "2" = "bus" }`.
        meanings as "values": Vec<(u16, String)> = source.of_model(meanings()), without "none";
        /// Why no client may ever write it: it is another way to move the motor, or widens its limits.
        back_door: OptionalKey<String> = source.of_model(optional(ValueKind::text())), without "none";
        /// Whether it decides how the drive is reached: station, speed, format. `params restore` writes it last, and only on
        /// request.
        is_link as "link": OptionalKey<bool> = source.of_model(optional(ValueKind::flag())), or false;
        /// How long the drive hears nothing after this register was written. A stop is tried at once and sent again then.
        deaf_after: OptionalKey<Duration> =
            source.of_model(optional(ValueKind::duration(Duration::from_millis(1)..=DEAF_MAX))),
            without "none";
        /// The drive never answers a write of this register, as of one that restarts it. It is written once; its outcome is read
        /// when the time of `deaf_after` is over. Of all orders only `reset` may be written there.
        no_reply: OptionalKey<bool> = source.of_model(optional(ValueKind::flag())), or false;
        /// What of this row its source does not state, so that it is not proven. With `"sign"`, `signed` is required: below half
        /// of the range both readings agree.
        not_stated: OptionalKey<Vec<LocatedValue<FactPart>>> =
            source.of_model(list(ValueKind::one_of(&PARTS))), without "none";
    }
}

/// Where a register is written.
pub enum RegisterSource<'s> {
    /// In the gateway's configuration.
    Configuration,
    /// In a model file.
    Model {
        /// The reader of its facts.
        facts: &'s FactReader<'s>,
        /// Gives the address of a register that states only its code.
        rule: Option<&'s CodeRule>,
    },
}

impl RegisterSource<'_> {
    /// The address, which a model file may leave to its rule for codes.
    fn address<'k>(&'k self, code: &'k OptionalKey<String>) -> KeyForm<'k, RequiredKey<u16>> {
        match self {
            Self::Configuration => required(ValueKind::address()),
            Self::Model { rule, .. } => address(code, *rule),
        }
    }

    fn origin(&self) -> KeyForm<'_, Option<Origin>> {
        match self {
            Self::Configuration => {
                no_key(|_| Some((Confidence::Configured, "configuration".to_owned())))
            }
            Self::Model { facts, .. } => facts.sources(),
        }
    }

    /// `form`, of a key that a configuration cannot have.
    fn of_model<'k, W: Default + 'k>(&self, form: KeyForm<'k, W>) -> KeyForm<'k, W> {
        only(matches!(self, Self::Model { .. }), form)
    }
}

impl RegisterFile {
    /// Its name.
    pub(in crate::profile) fn name(&self) -> Option<&str> {
        self.name.as_ref().map(|name| name.value.as_str())
    }

    /// Its address with its table; `None` if one of them is unusable.
    pub(in crate::profile) fn place(&self) -> Option<LocatedValue<Address>> {
        let LocatedValue { value, location } = self.address.as_ref()?;
        let address = Address::new(self.table()?, *value);
        Some(LocatedValue {
            value: address,
            location: location.clone(),
        })
    }

    /// Where its range is.
    pub(in crate::profile) fn range_location(&self) -> Option<&crate::toml_file::KeyLocation> {
        self.range.valid().map(|range| &range.location)
    }

    /// Its words that have a meaning.
    pub(in crate::profile) fn meaning_words(&self) -> impl Iterator<Item = u16> + '_ {
        self.meanings.iter().map(|(word, _)| *word)
    }

    /// The register; `None` if any part is unusable.
    #[must_use]
    pub fn register(&self) -> Option<Register> {
        self.register_among(&[])
    }

    /// The register, whose value may depend on others of `all`; `None` if any part is unusable.
    pub(super) fn register_among(&self, all: &[Self]) -> Option<Register> {
        let (confidence, source) = self.origin.clone()?;
        let scale = self.scale()?;
        Some(Register {
            name: self.name.as_ref()?.value.clone(),
            title: self.title.as_ref()?.value.clone(),
            code: self.code.clone().optional()?,
            address: self.place()?.value,
            scale: scale.steps,
            signed: self.signed()?,
            form: self.form.ready(self.table()?, scale, all)?,
            unit: self.unit.as_ref()?.value,
            access: self.access.as_ref()?.value,
            role: self.role.clone().optional()?,
            poll: self.poll.clone().optional()?,
            memory: self.memory.clone().optional()?,
            range: self.range.clone().optional()?,
            plausible: self.plausible.clone().optional()?,
            meanings: self.meanings.clone(),
            // Those of `[[run.state]]` are added by the model.
            states: Vec::new(),
            back_door: self.back_door.clone().optional()?,
            is_link: self.is_link()?,
            deaf_after: self.deaf_after.clone().optional()?,
            has_no_reply: self.no_reply()?,
            confidence,
            source,
            not_stated: match &self.not_stated {
                OptionalKey::Absent => Vec::new(),
                OptionalKey::Invalid => return None,
                OptionalKey::Valid(parts) => parts.value.iter().map(|part| part.value).collect(),
            },
        })
    }

    /// One `[[register]]` of `source`.
    pub(super) fn of(source: &RegisterSource<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let register = Self::keys(source, &mut reader);
        let unreadable = register
            .access
            .as_ref()
            .is_some_and(|access| !access.value.can_read());
        if unreadable && let Some(poll) = register.poll.valid() {
            let problem = poll
                .location
                .problem("polling requires a readable register");
            reader.problems().push(
                problem.right("leave it out, or \"read\" or \"read-write\" if the documents say that it can be read"),
            );
        }
        if matches!(source, RegisterSource::Configuration) {
            let what = "a register in the configuration has no role";
            reader.refuse("role", what, "leave it out");
        }
        reader.finish();
        register
    }
}

/// A range in the unit of a register with this scale and sign, as numbers before scaling.
fn range<'k>(
    scale: &OptionalKey<RawSteps>,
    signed: &OptionalKey<bool>,
) -> KeyForm<'k, OptionalKey<RangeInclusive<i32>>> {
    // No register exceeds this range, whatever its scale.
    let ends = ValueKind::decimal(f64::from(i16::MIN)..=f64::from(u16::MAX));
    let raw = scale.or(RawSteps::ONE).zip(signed.or(false));
    listing(KeyForm::of(ends, move |reader, key, ends| {
        let (list, location) = match reader.list(key, ends) {
            OptionalKey::Absent => return OptionalKey::Absent,
            OptionalKey::Invalid => return OptionalKey::Invalid,
            OptionalKey::Valid(LocatedValue { value, location }) => (value, location),
        };
        let [least, most] = &list[..] else {
            let what = match list.len() {
                1 => "has 1 number".to_owned(),
                many => format!("has {many} numbers"),
            };
            reader.problems().push(
                location
                    .problem(what)
                    .right("two: the least and the greatest value"),
            );
            return OptionalKey::Invalid;
        };
        let Some((scale, signed)) = raw else {
            return OptionalKey::Invalid;
        };
        let mut raw = |end: &LocatedValue<f64>| {
            let problem = |wrong| end.location.problem(format!("{} is {wrong}", end.value));
            let report = |wrong| {
                reader
                    .problems()
                    .push(problem(wrong).right("a value that the register can hold"))
            };
            steps(end.value, scale.steps, signed).map_err(report).ok()
        };
        let (Some(low), Some(high)) = (raw(least), raw(most)) else {
            return OptionalKey::Invalid;
        };
        if low > high {
            let problem = location.problem(format!("{} is above {}", least.value, most.value));
            reader
                .problems()
                .push(problem.right("the least value first"));
            return OptionalKey::Invalid;
        }
        OptionalKey::Valid(LocatedValue {
            value: low..=high,
            location,
        })
    }))
}

/// The address, or the one that `rule` gives to `code`.
fn address<'k>(
    code: &'k OptionalKey<String>,
    rule: Option<&'k CodeRule>,
) -> KeyForm<'k, RequiredKey<u16>> {
    KeyForm::of(ValueKind::address(), move |reader, key, kind| {
        match reader.optional(key, kind) {
            OptionalKey::Valid(address) => return Some(address),
            OptionalKey::Invalid => return None,
            OptionalKey::Absent => {}
        }
        if let Some(code) = code.valid()
            && let Some(address) = rule.and_then(|rule| rule.address(&code.value))
        {
            return Some(LocatedValue {
                value: address,
                location: code.location.clone(),
            });
        }
        let missing = reader.location().missing(key);
        let problem = missing.problem(format!("`{key}` is missing"));
        reader.problems().push(problem.right(kind.right()));
        None
    })
}

/// A table with the meanings of words, in their order.
pub(super) fn meanings() -> KeyForm<'static, Vec<(u16, String)>> {
    let text = ValueKind::text();
    let right = format!("a table, each {}", text.right());
    let form = KeyForm::of(text, |reader, key, text| {
        let OptionalKey::Valid(section) = reader.table(key) else {
            return Vec::new();
        };
        let inner = reader.open(section.value);
        let is_empty = inner.is_empty();
        let all = inner.all(text);
        if is_empty {
            let problem = section.location.problem("is empty");
            reader
                .problems()
                .push(problem.right("the meaning of at least one word, or leave it out"));
        }
        words_of(all, reader.problems())
            .into_iter()
            .map(|(word, text)| (word, text.value))
            .collect()
    });
    form.right(right)
}

/// The entries of a table whose keys are words in decimal, in their order. Other keys are reported and omitted.
pub(super) fn words_of<T>(
    entries: Vec<(String, LocatedValue<T>)>,
    problems: &mut Vec<Problem>,
) -> Vec<(u16, LocatedValue<T>)> {
    let mut words = Vec::new();
    for (key, value) in entries {
        // A leading zero or sign would allow the same word twice.
        match key
            .parse::<u16>()
            .ok()
            .filter(|word| word.to_string() == key)
        {
            Some(word) => words.push((word, value)),
            None => {
                let problem = value
                    .location
                    .problem(format!("`{key}` is not a register word"));
                problems.push(problem.right("a decimal number from \"0\" to \"65535\""));
            }
        }
    }
    words.sort_by_key(|(word, _)| *word);
    words
}

/// The address of the register called `name`.
pub(super) fn address_of(name: &str, registers: &[RegisterFile]) -> Option<Address> {
    find_register(name, registers)?
        .place()
        .map(|place| place.value)
}

/// The register called `name`.
pub(super) fn find_register<'f>(
    name: &str,
    registers: &'f [RegisterFile],
) -> Option<&'f RegisterFile> {
    registers
        .iter()
        .find(|register| register.name.as_ref().is_some_and(|it| it.value == name))
}

fn name(text: &str) -> Option<String> {
    let fits = text.starts_with(|c: char| c.is_ascii_lowercase())
        && text.len() <= 64
        && text
            .bytes()
            .all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_');
    fits.then(|| text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;
    use crate::profile::testing::{EVERYTHING, each_is_told};

    #[test]
    fn ranges_and_meanings_become_raw_numbers() {
        let model = check::model(EVERYTHING).unwrap();
        let register = |name: &str| model.register_named(name).unwrap();
        assert_eq!(register("loss_time").range, Some(0..=255));
        assert_eq!(register("torque_command").range, Some(-3000..=3000));
        assert_eq!(
            (register("status").range.clone(), register("status").memory),
            (None, None)
        );
        assert_eq!(register("run_source").memory, Some(RegisterMemory::Stored));
        let words: Vec<_> = register("run_source")
            .meanings
            .iter()
            .map(|(word, _)| *word)
            .collect();
        assert_eq!(
            (words, register("run_source").meaning(10)),
            (vec![0, 1, 2, 10], Some("bus and keypad"))
        );
    }

    #[test]
    fn the_ends_of_a_range_are_steps_of_the_register() {
        let range = "range = [0.0, 25.5]";
        each_is_told(&[
            (
                range,
                "range = [0.0, 25.55]",
                "register[11].range[1]: 25.55 is finer than the register's steps of 1/10 -> \
                 a value that the register can hold",
            ),
            (
                range,
                "range = [-1, 6554]",
                "register[11].range[0]: -1 is outside 0.0 to 6553.5 -> a value that the register can hold\n\
                 register[11].range[1]: 6554 is outside 0.0 to 6553.5 -> a value that the register can hold",
            ),
            (
                range,
                "range = [1, 0.5]",
                "register[11].range: 1 is above 0.5 -> the least value first",
            ),
            (
                range,
                "range = [1]",
                "register[11].range: has 1 number -> two: the least and the greatest value",
            ),
            (
                range,
                "range = [0, 65536]",
                "register[11].range[1]: 65536 is out of range -> a number from -32768 to 65535",
            ),
        ]);
    }

    #[test]
    fn meanings_stand_beside_their_words() {
        let values = "values = { \"0\" = \"decelerate\", \"1\" = \"coast\", \"2\" = \"go on\" }";
        let no_word = "is not a register word -> a decimal number from \"0\" to \"65535\"";
        for wrong in ["01", "+1", "0x1", "65536", "one"] {
            let expected = format!("register[12].values.{wrong}: `{wrong}` {no_word}");
            each_is_told(&[(
                values,
                &format!("values = {{ \"{wrong}\" = \"coast\" }}"),
                &expected,
            )]);
        }
        each_is_told(&[
            (
                values,
                "values = {}",
                "register[12].values: is empty -> the meaning of at least one word, or leave it out",
            ),
            (
                values,
                "values = { \"0\" = 1 }",
                "register[12].values.0: must be text, not a whole number -> text, not empty",
            ),
            (
                values,
                "values = [\"coast\"]",
                "register[12].values: must be a table, not a list -> a table: `{ ... }`",
            ),
        ]);
    }
}
