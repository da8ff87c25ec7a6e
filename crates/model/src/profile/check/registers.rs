//! The rules between registers, quirks and the code rule.

use crate::domain::problem::Problem;
use crate::domain::units::UnitOfMeasure;
use crate::profile::file::{ModelFile, QuirksFile};
use crate::profile::model::{FactPart, RegisterMemory, RegisterRole};
use crate::profile::register::{RegisterFile, addresses_fit, codes_fit, distinct};
use crate::toml_file::{LocatedValue, OptionalKey};

/// Roles whose values may be in percent of the drive's rated values.
const RATED: [RegisterRole; 5] = [
    RegisterRole::OutputCurrent,
    RegisterRole::OutputVoltage,
    RegisterRole::TripCurrent,
    RegisterRole::DcLinkVoltage,
    RegisterRole::TripDcLinkVoltage,
];

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    distinct(&[], &file.registers, problems);
    for role in [RegisterRole::RunCommand, RegisterRole::FrequencyCommand] {
        takes_commands(role, &file.registers, problems);
    }
    deafness_is_bearable(&file.registers, problems);
    energy_is_counted(&file.registers, problems);
    plausible_is_seen(&file.registers, problems);
    if let Some(rule) = file.codes.valid().and_then(|codes| codes.value.ready()) {
        codes_fit(&rule, &file.registers, problems);
    }
    let quirks = match &file.quirks {
        OptionalKey::Absent => &QuirksFile::default(),
        OptionalKey::Invalid => return,
        OptionalKey::Valid(quirks) => &quirks.value,
    };
    percent_is_of_something(quirks, &file.registers, problems);
    let alias_bit = quirks
        .stored_alias_bit
        .as_ref()
        .and_then(|fact| Some(fact.value.as_ref()?.value));
    addresses_fit(
        quirks.decimal_numbers.is_some(),
        alias_bit,
        &file.registers,
        problems,
    );
}

/// Registers of `role` are writable, not stored, and not back doors.
fn takes_commands(role: RegisterRole, registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    for register in registers
        .iter()
        .filter(|it| it.role.valid().is_some_and(|it| it.value == role))
    {
        if let Some(access) = register
            .access
            .as_ref()
            .filter(|access| !access.value.can_write())
        {
            let problem = access
                .location
                .problem("a command register must be writable");
            problems.push(problem.right("a register that the documents show being written"));
        }
        // Whether a setpoint has a form in RAM is checked with `ram_alias`.
        let is_run = role == RegisterRole::RunCommand;
        if let Some(memory) = register
            .memory
            .valid()
            .filter(|memory| is_run && memory.value == RegisterMemory::Stored)
        {
            let problem = memory
                .location
                .problem("frequent commands wear out a stored register");
            problems
                .push(problem.right("a register that is not stored, if the documents name one"));
        }
        if let OptionalKey::Valid(LocatedValue { location, .. }) = &register.back_door {
            let problem = location.problem("a command register cannot be a back door");
            problems.push(problem.right("leave it out"));
        }
    }
}

/// A drive may be deaf after a write of a parameter only: after an order it could not be stopped.
fn deafness_is_bearable(registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    for register in registers {
        let Some(deaf) = register.deaf_after.valid() else {
            continue;
        };
        if register
            .access
            .as_ref()
            .is_some_and(|access| !access.value.can_write())
        {
            let problem = deaf.location.problem("the register cannot be written");
            problems.push(problem.right("leave it out, or use access \"write\" or \"read-write\""));
        }
        if register.role.valid().is_some_and(|role| {
            matches!(
                role.value,
                RegisterRole::RunCommand | RegisterRole::FrequencyCommand
            )
        }) {
            let problem = deaf
                .location
                .problem("a drive that is deaf after each order cannot be stopped");
            problems
                .push(problem.right("leave it out; after a reset, the quirk `deaf_after_reset`"));
        }
    }
}

/// An energy counter is read again and again, in a unit of energy that is stated.
fn energy_is_counted(registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    for register in registers {
        let Some(role) = register
            .role
            .valid()
            .filter(|role| role.value == RegisterRole::Energy)
        else {
            continue;
        };
        let is_energy = |unit| {
            matches!(
                unit,
                UnitOfMeasure::KilowattHour | UnitOfMeasure::MegawattHour
            )
        };
        if let Some(unit) = register.unit.as_ref().filter(|unit| !is_energy(unit.value)) {
            problems.push(
                unit.location
                    .problem("an energy counter counts energy")
                    .right("unit = \"kWh\" or \"MWh\""),
            );
        }
        if matches!(register.poll, OptionalKey::Absent) {
            let problem = role
                .location
                .problem("an energy counter that is not polled counts nothing");
            problems.push(problem.right("poll = \"minutely\""));
        }
        let not_stated = register.not_stated.valid().map(|parts| parts.value.iter());
        if let Some(scale) = not_stated
            .into_iter()
            .flatten()
            .find(|part| part.value == FactPart::Scale)
        {
            let problem = scale
                .location
                .problem("the scale of an energy counter must be stated");
            problems.push(
                problem.right("leave the role out: energy is then summed up from the output power"),
            );
        }
    }
}

/// What proves that the drive is one of its model is one plain word that is read while the drive is there.
fn plausible_is_seen(registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    for register in registers {
        let Some(plausible) = register.plausible.valid() else {
            continue;
        };
        let is_polled = register
            .poll
            .valid()
            .is_some_and(|poll| poll.value.is_live());
        if !is_polled && !matches!(register.poll, OptionalKey::Invalid) {
            let problem = plausible
                .location
                .problem("it is not seen when the drive comes into sight");
            problems.push(
                problem.right("poll = \"slow\", \"second\" or \"fast\" there, or leave it out"),
            );
        }
        if register.form.is_pair()
            || register.form.full_scale.valid().is_some()
            || register.form.scale_by.valid().is_some()
        {
            let problem = plausible
                .location
                .problem("a range is plain numbers of one word");
            problems.push(problem.right("a register of one word with a scale of its own"));
        }
    }
}

/// Values in percent require the quirk `percent_of_rated`, and the quirk requires such values.
fn percent_is_of_something(
    quirks: &QuirksFile,
    registers: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    let is_rated = |register: &&RegisterFile| {
        register
            .role
            .valid()
            .is_some_and(|role| RATED.contains(&role.value))
    };
    let in_percent: Vec<_> = registers
        .iter()
        .filter(is_rated)
        .filter_map(|register| register.unit.as_ref())
        .filter(|unit| unit.value == UnitOfMeasure::Percent)
        .collect();
    match &quirks.percent_of_rated {
        None => problems.extend(in_percent.into_iter().map(|unit| {
            let problem = unit.location.problem("the reference of the percentage is not stated");
            problem.right("the unit that the documents state: \"A\", \"V\", or \"%\" with the quirk `percent_of_rated`")
        })),
        Some(quirk) if in_percent.is_empty() && registers.iter().all(is_known) => {
            problems.extend(quirk.value.as_ref().map(|quirk| {
                let problem = quirk.location.problem("no current or voltage with a role is in percent");
                problem.right("leave it out, or unit = \"%\" where the documents state it")
            }));
        }
        Some(_) => {}
    }
}

/// Whether unit and role are known.
fn is_known(register: &RegisterFile) -> bool {
    register.unit.is_some() && !matches!(register.role, OptionalKey::Invalid)
}

#[cfg(test)]
mod tests {
    use crate::profile::testing::{EVERYTHING, each_is_told, each_mistake_is_told, told_with};

    #[test]
    fn commands_are_written_to_registers_that_take_them() {
        each_is_told(&[
            (
                "access = \"write\"\nrole = \"run-command\"",
                "access = \"write\"\nback_door = \"it runs\"\nrole = \"run-command\"",
                "register[0].back_door: a command register cannot be a back door -> leave it out",
            ),
            (
                "access = \"write\"\nrole = \"run-command\"",
                "access = \"read\"\nrole = \"run-command\"",
                "write.block: there is no writable register at 0x2000 -> \
                 a range of writable registers only\n\
                 register[0].access: a command register must be writable -> \
                 a register that the documents show being written",
            ),
        ]);
    }

    #[test]
    fn a_drive_is_deaf_after_parameters_only() {
        each_mistake_is_told(&[
            (
                "access = \"write\"\nrole = \"run-command\"",
                "access = \"write\"\ndeaf_after = \"1s\"\nrole = \"run-command\"",
                "register[0].deaf_after: a drive that is deaf after each order cannot be stopped -> \
                 leave it out; after a reset, the quirk `deaf_after_reset`",
            ),
            (
                "access = \"read\"\npoll = \"fast\"",
                "access = \"read\"\ndeaf_after = \"1s\"\npoll = \"fast\"",
                "register[2].deaf_after: the register cannot be written -> \
                 leave it out, or use access \"write\" or \"read-write\"",
            ),
            (
                "deaf_after = \"1s\"",
                "deaf_after = \"11s\"",
                "register[7].deaf_after: 11s is out of range -> a time from \"1ms\" to \"10s\"",
            ),
        ]);
    }

    #[test]
    fn what_must_be_plausible_is_seen_at_first_contact() {
        each_is_told(&[(
            "range = [0.0, 25.5]",
            "range = [0.0, 25.5]\nplausible = [1.0, 2.0]",
            "register[11].plausible: it is not seen when the drive comes into sight -> \
             poll = \"slow\", \"second\" or \"fast\" there, or leave it out",
        )]);
    }

    #[test]
    fn only_older_trips_may_have_a_role_together() {
        each_is_told(&[(
            "role = \"output-current\"",
            "role = \"output-frequency\"",
            "quirks.percent_of_rated: no current or voltage with a role is in percent -> \
             leave it out, or unit = \"%\" where the documents state it\n\
             register[8].role: this role is taken by register[7].role -> \
             one that no other register of the model uses",
        )]);
    }

    #[test]
    fn per_cent_is_of_something() {
        each_is_told(&[
            (
                "percent_of_rated = { confidence = \"manual\", source = \"IM 4\" }\n",
                "",
                "register[8].unit: the reference of the percentage is not stated -> the unit that the documents state: \"A\", \"V\", or \"%\" with the quirk `percent_of_rated`",
            ),
            (
                "unit = \"%\"\naccess = \"read\"\nrole = \"output-current\"",
                "unit = \"A\"\naccess = \"read\"\nrole = \"output-current\"",
                "quirks.percent_of_rated: no current or voltage with a role is in percent -> \
                 leave it out, or unit = \"%\" where the documents state it",
            ),
        ]);
    }

    #[test]
    fn addresses_are_those_that_the_drive_has() {
        each_is_told(&[
            (
                "address = 0x2103",
                "address = 0x210A",
                "register[6].address: 0x210A is not an address: this drive uses decimal digits -> \
                 0 to 9 in each of the last two places",
            ),
            (
                "address = 0x2103",
                "address = 0x21A0",
                "register[6].address: 0x21A0 is not an address: this drive uses decimal digits -> \
                 0 to 9 in each of the last two places",
            ),
            (
                "address = 0x2103",
                "address = 0xA103",
                "register[6].address: 0xA103 is the stored twin of another register: it has bit 15 -> \
                 0x2103, the register itself",
            ),
        ]);
    }

    #[test]
    fn codes_keep_to_their_rule() {
        each_is_told(&[(
            "code = \"U.09\"",
            "code = \"U.08\"",
            "register[9].code: `U.08` is 0x3008 by `codes`, not 0x3009 -> \
             the code that belongs to the address, or leave it out",
        )]);
        let rule = "groups = { P = 0x01, U = 0x30 }\nseparator = \".\"";
        each_is_told(&[
            (
                rule,
                "",
                "codes: has no rule -> either `groups` or `form`, \"hexadecimal\" or \"linear\"",
            ),
            (
                "separator = \".\"",
                "form = \"hexadecimal\"",
                "codes: has two rules -> either `groups` or `form`, \"hexadecimal\" or \"linear\"",
            ),
            (
                rule,
                "groups = {}",
                "codes.groups: is empty -> at least one group with its high byte",
            ),
            (
                "separator = \".\"",
                "separator = \".\"\noffset = -1",
                "codes.offset: `offset` applies to `form = \"linear\"` only -> leave it out",
            ),
            (
                rule,
                "form = \"hexadecimal\"\nseparator = \".\"",
                "codes.separator: `separator` applies to `groups` only -> leave it out",
            ),
        ]);
        let found = told_with(EVERYTHING, "groups = { P = 0x01", "groups = { P = 256");
        assert!(
            found.contains("codes.groups.P: 256 is out of range\n"),
            "{found}"
        );
    }
}
