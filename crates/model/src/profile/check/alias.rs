//! The rules for the RAM form of stored registers.

use crate::domain::address::DataTable;
use crate::domain::problem::Problem;
use crate::profile::file::{AliasFile, FactFile, ModelFile};
use crate::profile::model::{RamAlias, RegisterAccess, RegisterMemory, RegisterRole};
use crate::profile::register::RegisterFile;
use crate::toml_file::{KeyLocation, OptionalKey};

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    let fact = file
        .quirks
        .valid()
        .and_then(|quirks| quirks.value.ram_alias.as_ref());
    setpoints_are_written_in_ram(fact, &file.registers, problems);
    let Some(written) = fact.and_then(|fact| fact.value.as_ref()) else {
        return;
    };
    let Some(alias) = written.value.ready() else {
        return;
    };
    if tells_both_forms_apart(&written.value, alias, &written.location, problems) {
        forms_are_free(alias, &file.registers, &written.location, problems);
    }
    if let Some(twins) = file
        .quirks
        .valid()
        .and_then(|quirks| quirks.value.stored_alias_bit.as_ref())
    {
        let location = twins
            .value
            .as_ref()
            .map_or(&written.location, |bit| &bit.location);
        let problem = location.problem("with `ram_alias` the register itself is the stored form");
        problems.push(problem.right("one of `stored_alias_bit` and `ram_alias`"));
    }
}

/// A stored register takes setpoints only by its RAM form, if that is proven.
fn setpoints_are_written_in_ram(
    fact: Option<&FactFile<AliasFile>>,
    registers: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    let is_proven = |fact: &&FactFile<AliasFile>| {
        fact.origin
            .as_ref()
            .is_some_and(|(confidence, _)| confidence.is_proven())
    };
    let alias = fact
        .filter(is_proven)
        .and_then(|fact| fact.value.as_ref()?.value.ready());
    for register in registers.iter().filter(|it| {
        it.role
            .valid()
            .is_some_and(|it| it.value == RegisterRole::FrequencyCommand)
    }) {
        let Some(memory) = register
            .memory
            .valid()
            .filter(|memory| memory.value == RegisterMemory::Stored)
        else {
            continue;
        };
        let has_form = register
            .address
            .as_ref()
            .is_none_or(|address| has_form(alias, register, address.value));
        if !has_form {
            let problem = memory
                .location
                .problem("frequent commands wear out a stored register");
            problems.push(problem.right(
                "a register that is not stored, if the documents name one, or a proven `ram_alias` in `[quirks]`",
            ));
        }
    }
}

/// Whether the register, at `address`, has a RAM form.
fn has_form(alias: Option<RamAlias>, register: &RegisterFile, address: u16) -> bool {
    let is_whole = register
        .access
        .as_ref()
        .is_none_or(|access| access.value == RegisterAccess::ReadWrite)
        && register
            .table()
            .is_none_or(|table| table == DataTable::Holding)
        && !register.form.is_pair();
    is_whole && alias.is_some_and(|alias| alias.form_of(address).is_some())
}

fn tells_both_forms_apart(
    written: &AliasFile,
    alias: RamAlias,
    location: &KeyLocation,
    problems: &mut Vec<Problem>,
) -> bool {
    let before = problems.len();
    for (bits, key) in [(&written.from, "from"), (&written.to, "to")] {
        let Some(bits) = bits.as_ref().filter(|bits| bits.value & !alias.mask != 0) else {
            continue;
        };
        let what = format!(
            "0x{:04X} has bits outside the mask 0x{:04X}",
            bits.value, alias.mask
        );
        problems.push(
            bits.location
                .problem(what)
                .right(format!("the bits of `{key}` under the mask alone")),
        );
    }
    if alias.from == alias.to {
        let problem =
            location.problem("`from` and `to` are the same: both forms would have one address");
        problems.push(problem.right("the bits of a register, and those of its form in RAM"));
    }
    problems.len() == before
}

/// No form lies on another register, or a write of one would be a write of the other.
fn forms_are_free(
    alias: RamAlias,
    registers: &[RegisterFile],
    location: &KeyLocation,
    problems: &mut Vec<Problem>,
) {
    let mut is_used = false;
    for register in registers {
        let (Some(address), Some(DataTable::Holding)) = (&register.address, register.table())
        else {
            continue;
        };
        let is_stored = match register.memory {
            OptionalKey::Valid(ref memory) => memory.value == RegisterMemory::Stored,
            _ => !register
                .role
                .valid()
                .is_some_and(|role| role.value.is_guarded()),
        };
        let Some(form) = alias.form_of(address.value) else {
            continue;
        };
        if !is_stored || !has_form(Some(alias), register, address.value) {
            continue;
        }
        is_used = true;
        let covers = |other: &&RegisterFile| {
            let words = if other.form.is_pair() { 2 } else { 1 };
            let first = other.address.as_ref().map(|address| address.value);
            let is_there =
                first.is_some_and(|first| (first..first.saturating_add(words)).contains(&form));
            is_there && other.table() == Some(DataTable::Holding)
        };
        if let Some(other) = registers.iter().find(covers) {
            let name = other.name().unwrap_or("another one");
            let what =
                format!("its form in RAM by `ram_alias`, 0x{form:04X}, is the register `{name}`");
            problems.push(
                address
                    .location
                    .problem(what)
                    .right("another `mask` in `ram_alias`, or another address"),
            );
        }
    }
    if !is_used
        && registers
            .iter()
            .all(|it| it.address.is_some() && !matches!(it.memory, OptionalKey::Invalid))
    {
        let problem = location.problem("no register that is stored and readable has these bits");
        problems.push(problem.right("the bits of one of them as `from`, or leave it out"));
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::check;
    use crate::profile::testing::{RAM_FORM, each_is_told_of};

    const ALIAS: &str = "mask = 0xF000, from = 0xF000, to = 0x0000";

    #[test]
    fn a_form_in_ram_lies_where_nothing_else_is() {
        each_is_told_of(
            RAM_FORM,
            &[
                (
                    ALIAS,
                    "mask = 0x0F00, from = 0xF000, to = 0x0000",
                    "quirks.ram_alias.from: 0xF000 has bits outside the mask 0x0F00 -> the bits of `from` under the mask alone\n\
                     register[1].memory: frequent commands wear out a stored register -> a register that is not stored, if the \
                     documents name one, or a proven `ram_alias` in `[quirks]`",
                ),
                (
                    ALIAS,
                    "mask = 0xF000, from = 0xF000, to = 0xF000",
                    "quirks.ram_alias: `from` and `to` are the same: both forms would have one address -> \
                     the bits of a register, and those of its form in RAM",
                ),
                (
                    "address = 0x0020\n",
                    "address = 0x0002\n",
                    "register[1].address: its form in RAM by `ram_alias`, 0x0002, is the register `status` -> \
                     another `mask` in `ram_alias`, or another address",
                ),
                (
                    "ram_alias = {",
                    "stored_alias_bit = { value = 14, confidence = \"manual\", source = \"IM 8\" }\nram_alias = {",
                    "quirks.stored_alias_bit.value: with `ram_alias` the register itself is the stored form -> \
                     one of `stored_alias_bit` and `ram_alias`\n\
                     register[1].address: 0xF002 is the stored twin of another register: it has bit 14 -> 0xB002, the register itself\n\
                     register[4].address: 0xF100 is the stored twin of another register: it has bit 14 -> 0xB100, the register itself\n\
                     register[5].address: 0xF101 is the stored twin of another register: it has bit 14 -> 0xB101, the register itself\n\
                     register[6].address: 0xF102 is the stored twin of another register: it has bit 14 -> 0xB102, the register itself",
                ),
            ],
        );
    }

    #[test]
    fn a_setpoint_is_written_in_ram_by_a_proven_form_alone() {
        let right = "register[1].memory: frequent commands wear out a stored register -> a register that is not stored, if the \
                     documents name one, or a proven `ram_alias` in `[quirks]`";
        let fact = format!("ram_alias = {{ {ALIAS}, readable = false, confidence = \"manual\"");
        each_is_told_of(
            RAM_FORM,
            &[(&fact, &fact.replace("manual", "inferred"), right)],
        );
        check::model(RAM_FORM).unwrap();
    }

    #[test]
    fn a_rule_that_concerns_no_register_is_useless() {
        let in_ram = RAM_FORM.replace("memory = \"stored\"", "memory = \"ram\"");
        let found = check::model(&in_ram).unwrap_err();
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(
            (found[0].key.as_str(), found[0].what.as_str()),
            (
                "quirks.ram_alias",
                "no register that is stored and readable has these bits",
            )
        );
    }
}
