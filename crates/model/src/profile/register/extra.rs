//! Registers that the gateway's configuration adds to a model.

use super::tables::tables_are_served;
use super::{RegisterFile, RegisterSource, addresses_fit, codes_fit, distinct, tables_fit};
use crate::domain::problem::Problem;
use crate::profile::model::{Model, Register, RegisterRole};
use crate::toml_file::{LocatedValue, TableReader, TomlSection};
use std::borrow::Cow;

/// Reads a register that the gateway's configuration adds to a model. Its confidence is [`Confidence::Configured`].
pub fn extra_register(section: TomlSection<'_>, problems: &mut Vec<Problem>) -> RegisterFile {
    RegisterFile::of(
        &RegisterSource::Configuration,
        TableReader::new(section, problems),
    )
}

/// `model` with the usable registers of `extra`. Duplicate names, codes and addresses are reported, as are addresses and
/// codes that this model cannot have; after such a problem nothing is added.
///
/// A register that the model gained later must not prevent a start: if `extra` repeats the address of a register that
/// only shows or holds a value, that is a warning. The configuration's description wins, unless the gateway itself reads
/// that register: then the model's does.
pub fn with_extra(model: &Model, extra: &[RegisterFile], problems: &mut Vec<Problem>) -> Model {
    let (known, extra) = known_since(model, extra, problems);
    let model = &Model {
        registers: known,
        ..model.clone()
    };
    let extra = &*extra;
    let before = problems.len();
    distinct(&model.registers, extra, problems);
    tables_fit(extra, problems);
    tables_are_served(&model.functions.value, extra, problems);
    let alias_bit = model
        .quirks
        .stored_alias_bit
        .as_ref()
        .map(|fact| fact.value);
    addresses_fit(
        model.quirks.decimal_numbers.is_some(),
        alias_bit,
        extra,
        problems,
    );
    if let Some(rule) = &model.codes {
        codes_fit(rule, extra, problems);
    }
    let mut model = model.clone();
    if problems.len() == before {
        model
            .registers
            .extend(extra.iter().filter_map(RegisterFile::register));
        model.registers.sort_by_key(|register| register.address);
    }
    model
}

/// The registers of `model` that `extra` does not replace, and the registers of `extra` that the model does not replace.
fn known_since<'x>(
    model: &Model,
    extra: &'x [RegisterFile],
    problems: &mut Vec<Problem>,
) -> (Vec<Register>, Cow<'x, [RegisterFile]>) {
    let mut known = model.registers.clone();
    let mut added = Cow::Borrowed(extra);
    for register in extra {
        let Some(LocatedValue {
            value: address,
            location,
        }) = &register.place()
        else {
            continue;
        };
        let harmless = |own: &&Register| own.address == *address && is_harmless(model, own);
        let Some(own) = model.registers.iter().find(harmless) else {
            continue;
        };
        let what = format!(
            "{} now has its own register at {address}, `{}`",
            model.id, own.name
        );
        if own.role.is_some() {
            added.to_mut().retain(|it| it.address != register.address);
            let problem = location.problem(format!("has no effect: {what}"));
            problems.push(
                problem
                    .right(format!("leave it out and use the name `{}`", own.name))
                    .warning(),
            );
        } else {
            known.retain(|it| it.address != *address);
            let problem =
                location.problem(format!("{what}; the description here takes precedence"));
            problems.push(
                problem
                    .right(format!("leave it out and use the name `{}`", own.name))
                    .warning(),
            );
        }
    }
    (known, added)
}

/// Whether a register of `model` only shows or holds a value: it does not move the motor, and does not affect
/// communication or the source of commands.
fn is_harmless(model: &Model, own: &Register) -> bool {
    let is_status = model.status.iter().any(|flag| flag.address == own.address);
    let is_setup = model
        .setup
        .iter()
        .any(|item| item.address == Some(own.address));
    own.back_door.is_none()
        && !own.is_link
        && !own.role.is_some_and(RegisterRole::is_guarded)
        && !is_status
        && !is_setup
        && !model.sets_watchdog(own.address)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;
    use crate::profile::model::{Confidence, RegisterAccess};
    use crate::profile::testing::{EVERYTHING, MODEL, problem_lines};
    use crate::toml_file::document;

    fn extended(model: &str, text: &str) -> (Model, String) {
        let mut problems = Vec::new();
        let document = document(text, &mut problems).unwrap();
        let mut reader = TableReader::new(document.section(), &mut problems);
        let sections = reader.tables("register");
        let extra: Vec<_> = sections
            .into_iter()
            .map(|section| extra_register(section, &mut problems))
            .collect();
        let model = with_extra(&check::model(model).unwrap(), &extra, &mut problems);
        (model, problem_lines(&problems, text))
    }

    #[test]
    fn registers_of_the_configuration_join_in_order_of_address() {
        let (model, problems) = extended(
            MODEL,
            "[[register]]\nname = 'output_current'\ntitle = 'Current'\naddress = 0x0100\nunit = 'A'\nscale = 10\n\
             access = 'read'\npoll = 'slow'\n",
        );
        assert_eq!(problems, "");
        let addresses: Vec<_> = model
            .registers
            .iter()
            .map(|register| register.address)
            .collect();
        assert_eq!(addresses, [0x0100, 0x0101]);
        let register = model.register_named("output_current").unwrap();
        assert_eq!(
            (register.scale, register.signed, register.access),
            (10, false, RegisterAccess::Read)
        );
        assert_eq!(
            (register.confidence, register.source.as_str()),
            (Confidence::Configured, "configuration")
        );
        assert_eq!((register.role, register.code.as_deref()), (None, None));
    }

    #[test]
    fn registers_of_the_configuration_take_nothing_from_the_model() {
        let (model, problems) = extended(
            MODEL,
            "[[register]]\nname = 'd001'\ntitle = 'a'\naddress = 0x0101\nunit = '-'\naccess = 'read'\n\
             role = 'trip-count'\nsource = 'IM 1'\n\
             [[register]]\nname = 'output_frequency'\ntitle = 'b'\ncode = 'D001'\naddress = 5\nunit = '-'\n\
             access = 'write'\npoll = 'fast'\n",
        );
        let expected = "\
7:1 register[0].role: a register in the configuration has no role
    right: leave it out
8:1 register[0].source: unknown key `source`
    right: one of name, title, code, address, table, scale, signed, unit, access, poll
16:8 register[1].poll: polling requires a readable register
    right: leave it out, or \"read\" or \"read-write\" if the documents say that it can be read
4:11 register[0].address: has no effect: acme-1 now has its own register at 0x0101, `output_frequency`
    right: leave it out and use the name `output_frequency`
10:8 register[1].name: the name `output_frequency` is taken by `output_frequency` of the model
    right: one that no other register of the model uses
12:8 register[1].code: the code `D001` is taken by `output_frequency` of the model
    right: one that no other register of the model uses
";
        assert_eq!(problems, expected);
        assert_eq!(model.registers.len(), 1);
    }

    #[test]
    fn registers_of_the_configuration_keep_to_how_the_model_counts() {
        let text = "[[register]]\nname = 'a'\ntitle = 'A'\naddress = 0x310A\nunit = '-'\naccess = 'read'\n\
                    [[register]]\nname = 'b'\ntitle = 'B'\naddress = 0xB102\nunit = '-'\naccess = 'read'\n\
                    [[register]]\nname = 'c'\ntitle = 'C'\ncode = 'P.05'\naddress = 0x3105\nunit = '-'\n\
                    access = 'read'\n";
        let (model, problems) = extended(EVERYTHING, text);
        let expected = "\
4:11 register[0].address: 0x310A is not an address: this drive uses decimal digits
    right: 0 to 9 in each of the last two places
10:11 register[1].address: 0xB102 is the stored twin of another register: it has bit 15
    right: 0x3102, the register itself
16:8 register[2].code: `P.05` is 0x0105 by `codes`, not 0x3105
    right: the code that belongs to the address, or leave it out
";
        assert_eq!(problems, expected);
        assert_eq!(model, check::model(EVERYTHING).unwrap());
    }

    #[test]
    fn registers_of_the_configuration_may_be_in_any_table_that_the_model_serves() {
        let coils = include_str!("../../../../../tests/golden/models/coils.toml");
        let register = |name: &str, table: &str, more: &str| {
            format!(
                "[[register]]\nname = '{name}'\ntitle = 'A'\naddress = 3\ntable = '{table}'\nunit = '-'\n{more}\n"
            )
        };
        let text = register("a", "discrete", "access = 'read'")
            + &register("b", "input", "access = 'read'");
        let (model, problems) = extended(coils, &text);
        assert_eq!(problems, "");
        let places: Vec<_> = ["a", "b"]
            .map(|name| model.register_named(name).unwrap().address.to_string())
            .to_vec();
        assert_eq!(places, ["discrete 0x0003", "input 0x0003"]);
        let text =
            register("a", "coil", "access = 'read'") + &register("b", "input", "access = 'write'");
        let (_, problems) = extended(coils, &text);
        let expected = "\
4:11 register[0].address: address coil 0x0003 is taken by `fault_reset` of the model
    right: one that no other register of the model uses
14:10 register[1].access: an input register cannot be written
    right: \"read\", or another `table`
";
        assert_eq!(problems, expected);
        let (_, problems) = extended(MODEL, &register("a", "coil", "access = 'read-write'"));
        let expected = "\
5:9 register[0].table: a coil needs function 01 hex, which the model does not serve
    right: a `table` or an `access` that the drive serves
5:9 register[0].table: a coil needs function 05 or 0F hex, which the model does not serve
    right: a `table` or an `access` that the drive serves
";
        assert_eq!(problems, expected);
    }

    #[test]
    fn only_a_model_says_what_its_words_mean() {
        for key in [
            "memory = 'ram'",
            "range = [0, 1]",
            "values = { 0 = 'off' }",
            "back_door = 'x'",
        ] {
            let text = format!(
                "[[register]]\nname = 'a'\ntitle = 'A'\naddress = 5\nunit = '-'\naccess = 'read'\n{key}\n"
            );
            let (_, problems) = extended(MODEL, &text);
            assert!(
                problems.starts_with("7:1 register[0].") && problems.contains(": unknown key `"),
                "{problems}"
            );
        }
    }
}
