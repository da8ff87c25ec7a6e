//! One register as written in a file: in a model file, or added to a model by the gateway's configuration.

mod extra;
mod form;
mod rules;
mod tables;

use crate::domain::address::{Address, DataTable};
use crate::domain::problem::Problem;
pub use extra::{extra_register, with_extra};
pub(super) use form::{CONFIGURED, FormFile, RawSteps};
pub(super) use rules::{addresses_fit, codes_fit, distinct, has_decimal_digits};
pub(super) use tables::{called, read_by, tables_fit, written_by};

use super::file::Origin;
use super::model::{
    CodeRule, FactPart, PollClass, Register, RegisterAccess, RegisterMemory, RegisterRole,
};
use super::scale::steps;
use super::words::{ACCESSES, MEMORIES, PARTS, POLL_CLASSES, ROLES, TABLES};
use crate::domain::units::UnitOfMeasure;
use crate::toml_file::values::ValueKind;
use crate::toml_file::words::UNITS;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader};
use std::ops::RangeInclusive;
use std::time::Duration;

/// The longest time that a drive may be deaf after a write: it cannot be stopped meanwhile.
const DEAF_MAX: Duration = Duration::from_secs(10);

/// A register as written. Its invalid parts are already reported; its valid parts still take part in the
/// cross-checks.
#[derive(Clone, Debug, PartialEq)]
pub struct RegisterFile {
    pub(super) name: RequiredKey<String>,
    pub(super) code: OptionalKey<String>,
    pub(super) address: RequiredKey<u16>,
    pub(super) table: OptionalKey<DataTable>,
    pub(super) access: RequiredKey<RegisterAccess>,
    pub(super) role: OptionalKey<RegisterRole>,
    pub(super) unit: RequiredKey<UnitOfMeasure>,
    pub(super) poll: OptionalKey<PollClass>,
    pub(super) back_door: OptionalKey<String>,
    is_link: OptionalKey<bool>,
    pub(super) deaf_after: OptionalKey<Duration>,
    pub(super) no_reply: OptionalKey<bool>,
    title: RequiredKey<String>,
    pub(super) scale: OptionalKey<RawSteps>,
    pub(super) signed: OptionalKey<bool>,
    pub(super) form: FormFile,
    pub(in crate::profile) memory: OptionalKey<RegisterMemory>,
    range: OptionalKey<RangeInclusive<i32>>,
    pub(super) plausible: OptionalKey<RangeInclusive<i32>>,
    meanings: Vec<(u16, String)>,
    origin: Option<Origin>,
    pub(super) not_stated: OptionalKey<Vec<LocatedValue<FactPart>>>,
}

impl RegisterFile {
    /// Its name.
    pub(in crate::profile) fn name(&self) -> Option<&str> {
        self.name.as_ref().map(|name| name.value.as_str())
    }

    /// Its address with its table; `None` if one of them is unusable.
    pub(in crate::profile) fn place(&self) -> Option<LocatedValue<Address>> {
        let LocatedValue { value, location } = self.address.as_ref()?;
        let address = Address::new(self.table.or(DataTable::Holding)?, *value);
        Some(LocatedValue {
            value: address,
            location: location.clone(),
        })
    }

    /// Its table, if that is usable.
    pub(in crate::profile) fn in_table(&self) -> Option<DataTable> {
        self.table.or(DataTable::Holding)
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
        let scale = self.scale.or(RawSteps::ONE)?;
        Some(Register {
            name: self.name.as_ref()?.value.clone(),
            title: self.title.as_ref()?.value.clone(),
            code: self.code.clone().optional()?,
            address: self.place()?.value,
            scale: scale.steps,
            signed: self.signed.or(false)?,
            form: self.form.ready(self.in_table()?, scale, all)?,
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
            is_link: self.is_link.or(false)?,
            deaf_after: self.deaf_after.clone().optional()?,
            has_no_reply: self.no_reply.or(false)?,
            confidence,
            source,
            not_stated: match &self.not_stated {
                OptionalKey::Absent => Vec::new(),
                OptionalKey::Invalid => return None,
                OptionalKey::Valid(parts) => parts.value.iter().map(|part| part.value).collect(),
            },
        })
    }

    /// The keys common to all registers; `rule` gives the address of a register that states only its code.
    fn read(reader: &mut TableReader<'_, '_>, rule: Option<&CodeRule>) -> Self {
        let name = reader.required(
            "name",
            &ValueKind::parsed("snake_case: a to z, 0 to 9 and `_`, a letter first", name),
        );
        let title = reader.required("title", &ValueKind::text());
        let code = reader.optional("code", &ValueKind::text());
        let register = Self {
            address: read_address(reader, &code, rule),
            table: reader.optional("table", &ValueKind::one_of(&TABLES)),
            name,
            title,
            code,
            scale: form::steps(reader, "scale"),
            signed: reader.optional("signed", &ValueKind::flag()),
            unit: reader.required("unit", &ValueKind::one_of(&UNITS)),
            access: reader.required("access", &ValueKind::one_of(&ACCESSES)),
            poll: reader.optional("poll", &ValueKind::one_of(&POLL_CLASSES)),
            form: FormFile::default(),
            role: OptionalKey::Absent,
            memory: OptionalKey::Absent,
            range: OptionalKey::Absent,
            plausible: OptionalKey::Absent,
            meanings: Vec::new(),
            back_door: OptionalKey::Absent,
            is_link: OptionalKey::Absent,
            deaf_after: OptionalKey::Absent,
            no_reply: OptionalKey::Absent,
            origin: None,
            not_stated: OptionalKey::Absent,
        };
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
        register
    }

    /// One `[[register]]` of a model file whose confidence and source have already been read.
    pub(super) fn of_model(
        mut reader: TableReader<'_, '_>,
        origin: Option<Origin>,
        rule: Option<&CodeRule>,
    ) -> Self {
        let mut register = Self::read(&mut reader, rule);
        register.role = reader.optional("role", &ValueKind::one_of(&ROLES));
        register.form = FormFile::read(&mut reader);
        register.memory = reader.optional("memory", &ValueKind::one_of(&MEMORIES));
        register.range = register.read_range(&mut reader, "range");
        register.plausible = register.read_range(&mut reader, "plausible");
        register.meanings = meanings(&mut reader, "values");
        register.back_door = reader.optional("back_door", &ValueKind::text());
        register.is_link = reader.optional("link", &ValueKind::flag());
        register.deaf_after = reader.optional(
            "deaf_after",
            &ValueKind::duration(Duration::from_millis(1)..=DEAF_MAX),
        );
        register.no_reply = reader.optional("no_reply", &ValueKind::flag());
        register.not_stated = reader.list("not_stated", &ValueKind::one_of(&PARTS));
        register.origin = origin;
        reader.finish();
        register
    }
}

impl RegisterFile {
    /// The range `key` in the register's unit, as numbers before scaling.
    fn read_range(
        &self,
        reader: &mut TableReader<'_, '_>,
        key: &'static str,
    ) -> OptionalKey<RangeInclusive<i32>> {
        // No register exceeds this range, whatever its scale.
        let ends = ValueKind::decimal(f64::from(i16::MIN)..=f64::from(u16::MAX));
        let (list, location) = match reader.list(key, &ends) {
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
        let (Some(scale), Some(signed)) = (self.scale.or(RawSteps::ONE), self.signed.or(false))
        else {
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
    }
}

/// `address`, or the address of `code`.
fn read_address(
    reader: &mut TableReader<'_, '_>,
    code: &OptionalKey<String>,
    rule: Option<&CodeRule>,
) -> RequiredKey<u16> {
    let kind = ValueKind::address();
    match (reader.optional("address", &kind), code.valid()) {
        (OptionalKey::Valid(address), _) => Some(address),
        (OptionalKey::Invalid, _) => None,
        (OptionalKey::Absent, code) => {
            let by_code = |code: &LocatedValue<String>| {
                Some(LocatedValue {
                    value: rule?.address(&code.value)?,
                    location: code.location.clone(),
                })
            };
            code.and_then(by_code).or_else(|| {
                let problem = reader
                    .location()
                    .missing("address")
                    .problem("`address` is missing");
                reader.problems().push(problem.right(kind.right()));
                None
            })
        }
    }
}

/// The table `values`: the meanings of a register's words, in order of the words.
pub(super) fn meanings(reader: &mut TableReader<'_, '_>, key: &'static str) -> Vec<(u16, String)> {
    let OptionalKey::Valid(LocatedValue {
        value: section,
        location,
    }) = reader.table(key)
    else {
        return Vec::new();
    };
    let inner = reader.open(section);
    let is_empty = inner.is_empty();
    let all = inner.all(&ValueKind::text());
    if is_empty {
        reader.problems().push(
            location
                .problem("is empty")
                .right("the meaning of at least one word, or leave it out"),
        );
    }
    words_of(all, reader.problems())
        .into_iter()
        .map(|(word, text)| (word, text.value))
        .collect()
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
