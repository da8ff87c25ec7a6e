//! One register as a file states it: of a model file, or added to a model by the gateway's configuration.

use super::file::Origin;
use super::model::{Access, Confidence, Memory, Model, PollClass, Register, Role};
use super::reader::{Given, Needed, Place, Reader, Section, Written};
use super::scale::steps;
use super::values::Kind;
use super::words::{ACCESSES, MEMORIES, POLL_CLASSES, ROLES, UNITS};
use crate::domain::problem::Problem;
use crate::domain::units::UnitOfMeasure;
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// The largest scale, in raw steps per unit.
const MAX_SCALE: u32 = 1_000_000;

/// A register as written. What is wrong with it is already reported; what is sound of it is still compared
/// with the others.
#[derive(Clone, Debug, PartialEq)]
pub struct RegisterFile {
    pub(super) name: Needed<String>,
    pub(super) code: Given<String>,
    pub(super) address: Needed<u16>,
    pub(super) access: Needed<Access>,
    pub(super) role: Given<Role>,
    pub(super) unit: Needed<UnitOfMeasure>,
    pub(super) poll: Given<PollClass>,
    pub(super) back_door: Given<String>,
    title: Needed<String>,
    scale: Given<u32>,
    signed: Given<bool>,
    memory: Given<Memory>,
    range: Given<RangeInclusive<i32>>,
    meanings: Vec<(u16, String)>,
    origin: Option<Origin>,
}

impl RegisterFile {
    /// The register; nothing if any part of it cannot be used.
    #[must_use]
    pub fn register(&self) -> Option<Register> {
        let (confidence, source) = self.origin.clone()?;
        Some(Register {
            name: self.name.as_ref()?.value.clone(),
            title: self.title.as_ref()?.value.clone(),
            code: self.code.clone().optional()?,
            address: self.address.as_ref()?.value,
            scale: self.scale.or(1)?,
            signed: self.signed.or(false)?,
            unit: self.unit.as_ref()?.value,
            access: self.access.as_ref()?.value,
            role: self.role.clone().optional()?,
            poll: self.poll.clone().optional()?,
            memory: self.memory.clone().optional()?,
            range: self.range.clone().optional()?,
            meanings: self.meanings.clone(),
            back_door: self.back_door.clone().optional()?,
            confidence,
            source,
        })
    }

    /// The keys that a register has wherever it stands.
    fn read(reader: &mut Reader<'_, '_>) -> Self {
        let register = Self {
            name: reader.required("name", &Kind::parsed("snake_case: a to z, 0 to 9 and `_`, a letter first", name)),
            title: reader.required("title", &Kind::text()),
            code: reader.optional("code", &Kind::text()),
            address: reader.required("address", &Kind::address()),
            scale: reader.optional("scale", &Kind::number(1..=MAX_SCALE)),
            signed: reader.optional("signed", &Kind::flag()),
            unit: reader.required("unit", &Kind::one_of(&UNITS)),
            access: reader.required("access", &Kind::one_of(&ACCESSES)),
            poll: reader.optional("poll", &Kind::one_of(&POLL_CLASSES)),
            role: Given::LeftOut,
            memory: Given::LeftOut,
            range: Given::LeftOut,
            meanings: Vec::new(),
            back_door: Given::LeftOut,
            origin: None,
        };
        let unreadable = register.access.as_ref().is_some_and(|access| !access.value.can_read());
        if let Some(poll) = register.poll.usable().filter(|_| unreadable) {
            let problem = poll.place.problem("a register that cannot be read cannot be polled");
            reader.problems().push(problem.right("leave it out, or give it an access that reads"));
        }
        register
    }

    /// One `[[register]]` of a model file, whose confidence and source are read already.
    pub(super) fn of_model(mut reader: Reader<'_, '_>, origin: Option<Origin>) -> Self {
        let mut register = Self::read(&mut reader);
        register.role = reader.optional("role", &Kind::one_of(&ROLES));
        register.memory = reader.optional("memory", &Kind::one_of(&MEMORIES));
        register.range = register.read_range(&mut reader);
        register.meanings = meanings(&mut reader);
        register.back_door = reader.optional("back_door", &Kind::text());
        register.origin = origin;
        reader.finish();
        register
    }
}

impl RegisterFile {
    /// `range` in the register's unit, as numbers before scaling.
    fn read_range(&self, reader: &mut Reader<'_, '_>) -> Given<RangeInclusive<i32>> {
        // No register reaches further, whatever its scale.
        let ends = Kind::decimal(f64::from(i16::MIN)..=f64::from(u16::MAX));
        let (list, place) = match reader.list("range", &ends) {
            Given::LeftOut => return Given::LeftOut,
            Given::Unusable => return Given::Unusable,
            Given::Usable(Written { value, place }) => (value, place),
        };
        let [least, most] = &list[..] else {
            let what = format!("has {} numbers", list.len());
            reader.problems().push(place.problem(what).right("two: the least and the greatest value"));
            return Given::Unusable;
        };
        let (Some(scale), Some(signed)) = (self.scale.or(1), self.signed.or(false)) else { return Given::Unusable };
        let mut raw = |end: &Written<f64>| {
            let problem = |wrong| end.place.problem(format!("{} is {wrong}", end.value));
            let told = |wrong| reader.problems().push(problem(wrong).right("a value that the register can hold"));
            steps(end.value, scale, signed).map_err(told).ok()
        };
        let (Some(low), Some(high)) = (raw(least), raw(most)) else { return Given::Unusable };
        if low > high {
            let problem = place.problem(format!("{} is above {}", least.value, most.value));
            reader.problems().push(problem.right("the least value first"));
            return Given::Unusable;
        }
        Given::Usable(Written { value: low..=high, place })
    }
}

/// The table `values`: what the words of a register mean, in order of the words.
fn meanings(reader: &mut Reader<'_, '_>) -> Vec<(u16, String)> {
    let Given::Usable(Written { value: section, place }) = reader.table("values") else { return Vec::new() };
    let inner = reader.open(section);
    let (is_empty, all) = (inner.is_empty(), inner.all(&Kind::text()));
    if is_empty {
        reader.problems().push(place.problem("is empty").right("the meaning of at least one word, or leave it out"));
    }
    let mut meanings = Vec::new();
    for (key, text) in all {
        // A leading zero or sign would let the same word stand twice.
        match key.parse::<u16>().ok().filter(|word| word.to_string() == key) {
            Some(word) => meanings.push((word, text.value)),
            None => {
                let problem = text.place.problem(format!("`{key}` is no word of a register"));
                reader.problems().push(problem.right("a decimal number from \"0\" to \"65535\""));
            }
        }
    }
    meanings.sort_by_key(|(word, _)| *word);
    meanings
}

/// The address of the register called `name`.
pub(super) fn address_of(name: &str, registers: &[RegisterFile]) -> Option<u16> {
    Some(named(name, registers)?.address.as_ref()?.value)
}

/// The register called `name`.
pub(super) fn named<'f>(name: &str, registers: &'f [RegisterFile]) -> Option<&'f RegisterFile> {
    registers.iter().find(|register| register.name.as_ref().is_some_and(|it| it.value == name))
}

/// Reads a register that the gateway's configuration adds to a model: `name`, `title`, `address`, `unit` and
/// `access`, and if need be `code`, `scale`, `signed` and `poll`. Its confidence is
/// [`Confidence::Configured`], and it has no role.
pub fn extra_register(section: Section<'_>, problems: &mut Vec<Problem>) -> RegisterFile {
    let mut reader = Reader::new(section, problems);
    let mut register = RegisterFile::read(&mut reader);
    register.origin = Some((Confidence::Configured, "configuration".to_owned()));
    reader.refuse("role", "a register of the configuration has no role", "leave it out");
    reader.finish();
    register
}

/// `model` with those registers of `extra` that can be used. Each that has the name, code or address of another
/// is reported, and then `model` comes back as it is.
pub fn with_extra(model: &Model, extra: &[RegisterFile], problems: &mut Vec<Problem>) -> Model {
    let before = problems.len();
    distinct(&model.registers, extra, problems);
    let mut model = model.clone();
    if problems.len() == before {
        model.registers.extend(extra.iter().filter_map(RegisterFile::register));
        model.registers.sort_by_key(|register| register.address);
    }
    model
}

/// Reports each register of `written` whose name, code, address or role belongs to one before it or to one of
/// `model`. Names and codes share one space, without regard to case, as [`Model::register_named`] does.
pub(super) fn distinct(model: &[Register], written: &[RegisterFile], problems: &mut Vec<Problem>) {
    let mut taken = Taken::default();
    for register in model {
        let owner = format!("`{}` of the model", register.name);
        taken.labels.insert(register.name.to_lowercase(), owner.clone());
        taken.labels.extend(register.code.as_ref().map(|code| (code.to_lowercase(), owner.clone())));
        taken.addresses.insert(register.address, owner);
    }
    for register in written {
        taken.add(register, problems);
    }
}

/// Who has which name or code (in lower case), address and role.
#[derive(Default)]
struct Taken {
    labels: BTreeMap<String, String>,
    addresses: BTreeMap<u16, String>,
    roles: BTreeMap<Role, String>,
}

impl Taken {
    fn add(&mut self, register: &RegisterFile, problems: &mut Vec<Problem>) {
        if let Some(name) = &register.name {
            let called = format!("the name `{}`", name.value);
            claim(&mut self.labels, name.value.to_lowercase(), &called, &name.place, problems);
        }
        if let Some(code) = register.code.usable() {
            let called = format!("the code `{}`", code.value);
            claim(&mut self.labels, code.value.to_lowercase(), &called, &code.place, problems);
        }
        if let Some(address) = &register.address {
            let called = format!("address 0x{:04X}", address.value);
            claim(&mut self.addresses, address.value, &called, &address.place, problems);
        }
        if let Some(role) = register.role.usable().filter(|role| !role.value.is_repeated()) {
            claim(&mut self.roles, role.value, "this role", &role.place, problems);
        }
    }
}

fn claim<T: Ord>(taken: &mut BTreeMap<T, String>, value: T, called: &str, place: &Place, problems: &mut Vec<Problem>) {
    match taken.get(&value) {
        Some(owner) => {
            let problem = place.problem(format!("{called} is taken by {owner}"));
            problems.push(problem.right("one that no other register of the model has"));
        }
        None => {
            taken.insert(value, place.key.clone());
        }
    }
}

fn name(text: &str) -> Option<String> {
    let fits = text.starts_with(|c: char| c.is_ascii_lowercase())
        && text.len() <= 64
        && text.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_');
    fits.then(|| text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;
    use crate::profile::reader::document;
    use crate::profile::testing::{MODEL, told};

    fn extended(text: &str) -> (Model, String) {
        let mut problems = Vec::new();
        let document = document(text, &mut problems).unwrap();
        let mut reader = Reader::new(document.section(), &mut problems);
        let sections = reader.tables("register");
        let extra: Vec<_> = sections.into_iter().map(|section| extra_register(section, &mut problems)).collect();
        let model = with_extra(&check::model(MODEL).unwrap(), &extra, &mut problems);
        (model, told(&problems, text))
    }

    #[test]
    fn registers_of_the_configuration_join_in_order_of_address() {
        let (model, problems) = extended(
            "[[register]]\nname = 'output_current'\ntitle = 'Current'\naddress = 0x0100\nunit = 'A'\nscale = 10\n\
             access = 'read'\npoll = 'slow'\n",
        );
        assert_eq!(problems, "");
        let addresses: Vec<_> = model.registers.iter().map(|register| register.address).collect();
        assert_eq!(addresses, [0x0100, 0x0101]);
        let register = model.register_named("output_current").unwrap();
        assert_eq!((register.scale, register.signed, register.access), (10, false, Access::Read));
        assert_eq!((register.confidence, register.source.as_str()), (Confidence::Configured, "configuration"));
        assert_eq!((register.role, register.code.as_deref()), (None, None));
    }

    #[test]
    fn registers_of_the_configuration_take_nothing_from_the_model() {
        let (model, problems) = extended(
            "[[register]]\nname = 'd001'\ntitle = 'a'\naddress = 0x0101\nunit = '-'\naccess = 'read'\n\
             role = 'trip-count'\nsource = 'IM 1'\n\
             [[register]]\nname = 'output_frequency'\ntitle = 'b'\ncode = 'D001'\naddress = 5\nunit = '-'\n\
             access = 'write'\npoll = 'fast'\n",
        );
        let expected = "\
7:1 register[0].role: a register of the configuration has no role
    right: leave it out
8:1 register[0].source: there is no key `source` here
    right: one of name, title, code, address, scale, signed, unit, access, poll
16:8 register[1].poll: a register that cannot be read cannot be polled
    right: leave it out, or give it an access that reads
2:8 register[0].name: the name `d001` is taken by `output_frequency` of the model
    right: one that no other register of the model has
4:11 register[0].address: address 0x0101 is taken by `output_frequency` of the model
    right: one that no other register of the model has
10:8 register[1].name: the name `output_frequency` is taken by `output_frequency` of the model
    right: one that no other register of the model has
12:8 register[1].code: the code `D001` is taken by `output_frequency` of the model
    right: one that no other register of the model has
";
        assert_eq!(problems, expected);
        assert_eq!(model.registers.len(), 1);
    }
}
