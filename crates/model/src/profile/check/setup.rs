//! The rules for set-up and watchdog.

use super::keys::{once, readable};
use crate::domain::link::Interface;
use crate::domain::problem::Problem;
use crate::profile::file::{ModelFile, SetupFile, WatchdogFile};
use crate::profile::register::RegisterFile;
use crate::toml_file::words::{INTERFACES, word_for};
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey};

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    let interfaces = file
        .link
        .as_ref()
        .and_then(|link| Some(&link.interfaces.value.as_ref()?.value[..]));
    let registers = file.setup.iter().filter_map(|setup| setup.register.valid());
    once(
        registers,
        |name| format!("the register `{name}`"),
        "a register that is set only once",
        problems,
    );
    for setup in &file.setup {
        setting_can_be_made(setup, &file.registers, problems);
        interface_is_there(setup, interfaces, problems);
    }
    if let OptionalKey::Valid(LocatedValue {
        value: watchdog,
        location,
    }) = &file.watchdog
    {
        reaction_words_are_stated(watchdog, location, &file.registers, problems);
        for name in watchdog.register.iter().chain(watchdog.action.valid()) {
            readable(name, &file.registers, problems);
        }
    }
}

/// If a register holds the watchdog's reaction, the file states which of its words keep the motor running and which stop
/// it: otherwise any word would be taken for one that stops.
fn reaction_words_are_stated(
    watchdog: &WatchdogFile,
    location: &KeyLocation,
    registers: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    let right = "the words of that register that keep the motor running; `[]` if the documents say that there are none";
    let is_digit = |digit: u16| [1, 10, 100, 1000].contains(&digit);
    match (&watchdog.action, &watchdog.keeps_running) {
        (OptionalKey::Valid(_), OptionalKey::Absent) => {
            let problem = location
                .missing("keeps_running")
                .problem("`action` requires `keeps_running`");
            problems.push(problem.right(right));
        }
        (OptionalKey::Absent, OptionalKey::Valid(words)) => {
            let problem = words.location.problem("`keeps_running` requires `action`");
            problems
                .push(problem.right("add the register that holds one of them, or leave it out"));
        }
        (OptionalKey::Valid(_), OptionalKey::Valid(words)) => {
            let both = |stops: &LocatedValue<Vec<LocatedValue<u16>>>| {
                words
                    .value
                    .iter()
                    .find(|word| stops.value.iter().any(|it| it.value == word.value))
                    .cloned()
            };
            if let Some(word) = watchdog.stops.valid().and_then(both) {
                let problem = word
                    .location
                    .problem(format!("{} is also in `stops`", word.value));
                problems.push(problem.right("each word in only one of the lists"));
            }
            let is_there = |action: &LocatedValue<String>| {
                registers
                    .iter()
                    .any(|it| it.name() == Some(action.value.as_str()))
            };
            let is_silent = matches!(watchdog.stops, OptionalKey::Absent)
                && watchdog.action.valid().is_some_and(is_there);
            if is_silent && watchdog.words_that_stop(registers).is_empty() {
                let problem = location.missing("stops").problem(
                    "`stops` is missing, and the register's `values` state no stopping word",
                );
                problems.push(problem.right("the words of that register that stop the motor"));
            }
        }
        _ => {}
    }
    if let OptionalKey::Valid(digit) = &watchdog.action_digit
        && !is_digit(digit.value)
    {
        problems.push(
            digit
                .location
                .problem(format!("{} is not the place of a digit", digit.value))
                .right("1, 10, 100 or 1000"),
        );
    }
}

/// A register that is set is readable and writable, and its values are stated.
fn setting_can_be_made(setup: &SetupFile, registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    match (&setup.register, &setup.values) {
        (OptionalKey::Valid(_), OptionalKey::Absent) => {
            let problem = setup
                .location
                .missing("values")
                .problem("`register` requires `values`");
            problems.push(problem.right("the acceptable words; the first one is written"));
        }
        (OptionalKey::Absent, OptionalKey::Valid(values)) => {
            let problem = values.location.problem("`values` requires `register`");
            problems
                .push(problem.right("add the register that holds one of them, or leave it out"));
        }
        _ => {}
    }
    let OptionalKey::Valid(name) = &setup.register else {
        return;
    };
    let register = readable(name, registers, problems);
    let access = register.and_then(|register| register.access.as_ref());
    if access.is_some_and(|access| !access.value.can_write()) {
        let problem = name
            .location
            .problem(format!("`{}` is not writable", name.value));
        problems.push(
            problem.right(
                "a register that can be written, or leave it out for what is set at the drive",
            ),
        );
    }
}

/// A setting for an interface requires that the drive has that interface.
fn interface_is_there(
    setup: &SetupFile,
    interfaces: Option<&[Interface]>,
    problems: &mut Vec<Problem>,
) {
    let (OptionalKey::Valid(interface), Some(interfaces)) = (&setup.interface, interfaces) else {
        return;
    };
    if !interfaces.contains(&interface.value) {
        let what = format!(
            "the model has no {}",
            word_for(&INTERFACES, &interface.value)
        );
        problems.push(
            interface
                .location
                .problem(what)
                .right("one of `link.interfaces`"),
        );
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::testing::each_is_told;

    #[test]
    fn what_is_set_over_the_bus_can_be_read_back() {
        each_is_told(&[
            (
                "values = [2, 3]\n",
                "",
                "setup[0].values: `register` requires `values` -> \
                 the acceptable words; the first one is written",
            ),
            (
                "values = [2, 3]",
                "values = []",
                "setup[0].values: is empty -> at least a whole number from 0 to 65535",
            ),
            (
                "register = \"run_source\"\n",
                "",
                "setup[0].values: `values` requires `register` -> \
                 add the register that holds one of them, or leave it out",
            ),
            (
                "register = \"run_source\"",
                "register = \"run_command\"",
                "setup[0].register: `run_command` is not readable -> a register with access \"read\" or \"read-write\"",
            ),
            (
                "register = \"run_source\"",
                "register = \"firmware\"",
                "setup[0].register: `firmware` is not writable -> \
                 a register that can be written, or leave it out for what is set at the drive",
            ),
            (
                "register = \"run_source\"",
                "register = \"run_sauce\"",
                "setup[0].register: there is no register called `run_sauce` -> `run_source`",
            ),
        ]);
    }

    #[test]
    fn a_register_is_set_once() {
        each_is_told(&[(
            "text = \"the switch beside the plug: up\"",
            "text = \"the switch\"\nregister = \"run_source\"\nvalues = [2]",
            "setup[1].register: the register `run_source` is taken by setup[0].register -> a register that is set only once",
        )]);
    }

    #[test]
    fn what_is_set_for_an_interface_needs_it() {
        each_is_told(&[(
            "interfaces = { value = [\"rs485\", \"rs232\"]",
            "interfaces = { value = [\"rs485\"]",
            "setup[1].interface: the model has no rs232 -> one of `link.interfaces`",
        )]);
    }

    #[test]
    fn a_reaction_is_recognised_by_its_words() {
        each_is_told(&[
            (
                "keeps_running = [2]\n",
                "",
                "watchdog.keeps_running: `action` requires `keeps_running` -> \
                 the words of that register that keep the motor running; `[]` if the documents say that there are none",
            ),
            (
                "action = \"loss_reaction\"\n",
                "",
                "watchdog.keeps_running: `keeps_running` requires `action` -> \
                 add the register that holds one of them, or leave it out",
            ),
            (
                "stops = [0, 1]",
                "stops = [0, 2]",
                "watchdog.keeps_running[0]: 2 is also in `stops` -> each word in only one of the lists",
            ),
            (
                "keeps_running = [2]\nstops = [0, 1]",
                "keeps_running = [0, 1, 2]",
                "watchdog.stops: `stops` is missing, and the register's `values` state no stopping word -> \
                 the words of that register that stop the motor",
            ),
            (
                "keeps_running = [2]",
                "keeps_running = [2]\naction_digit = 20",
                "watchdog.action_digit: 20 is not the place of a digit -> 1, 10, 100 or 1000",
            ),
        ]);
    }

    #[test]
    fn a_watchdog_needs_readable_registers() {
        each_is_told(&[
            (
                "register = \"loss_time\"",
                "register = \"torque_command\"",
                "watchdog.register: `torque_command` is not readable -> \
                 a register with access \"read\" or \"read-write\"",
            ),
            (
                "action = \"loss_reaction\"",
                "action = \"reaction\"",
                "watchdog.action: there is no register called `reaction` -> the `name` of a register",
            ),
        ]);
    }
}
