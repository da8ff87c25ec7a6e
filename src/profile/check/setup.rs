//! The rules of set-up and watchdog.

use super::{once, readable};
use crate::domain::link::Interface;
use crate::domain::problem::Problem;
use crate::profile::file::{ModelFile, SetupFile};
use crate::profile::reader::{Given, Written};
use crate::profile::register::RegisterFile;
use crate::profile::words::{INTERFACES, word_for};

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    let interfaces = file.link.as_ref().and_then(|link| Some(&link.interfaces.value.as_ref()?.value[..]));
    let registers = file.setup.iter().filter_map(|setup| setup.register.usable());
    once(registers, |name| format!("the register `{name}`"), "a register that is set once", problems);
    for setup in &file.setup {
        setting_can_be_made(setup, &file.registers, problems);
        interface_is_there(setup, interfaces, problems);
    }
    if let Given::Usable(Written { value: watchdog, .. }) = &file.watchdog {
        for name in watchdog.register.iter().chain(watchdog.action.usable()) {
            readable(name, &file.registers, problems);
        }
    }
}

/// A register that is set can be read and written, and it is said what it is set to.
fn setting_can_be_made(setup: &SetupFile, registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    match (&setup.register, &setup.values) {
        (Given::Usable(_), Given::LeftOut) => {
            let problem = setup.place.missing("values").problem("`values` is left out, and `register` is given");
            problems.push(problem.right("the words that are right, first the one that is written"));
        }
        (Given::LeftOut, Given::Usable(values)) => {
            let problem = values.place.problem("`values` is given, and `register` is left out");
            problems.push(problem.right("the register that holds one of them, or leave it out"));
        }
        _ => {}
    }
    let Given::Usable(name) = &setup.register else { return };
    let register = readable(name, registers, problems);
    let access = register.and_then(|register| register.access.as_ref());
    if access.is_some_and(|access| !access.value.can_write()) {
        let problem = name.place.problem(format!("`{}` cannot be written", name.value));
        problems.push(problem.right("a register with access \"read-write\""));
    }
}

/// What is set for an interface is set on a drive that has it.
fn interface_is_there(setup: &SetupFile, interfaces: Option<&[Interface]>, problems: &mut Vec<Problem>) {
    let (Given::Usable(interface), Some(interfaces)) = (&setup.interface, interfaces) else { return };
    if !interfaces.contains(&interface.value) {
        let what = format!("the model has no {}", word_for(&INTERFACES, &interface.value));
        problems.push(interface.place.problem(what).right("one of `link.interfaces`"));
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
                "setup[0].values: `values` is left out, and `register` is given -> \
                 the words that are right, first the one that is written",
            ),
            ("values = [2, 3]", "values = []", "setup[0].values: is empty -> at least a whole number from 0 to 65535"),
            (
                "register = \"run_source\"\n",
                "",
                "setup[0].values: `values` is given, and `register` is left out -> \
                 the register that holds one of them, or leave it out",
            ),
            (
                "register = \"run_source\"",
                "register = \"run_command\"",
                "setup[0].register: `run_command` cannot be read -> a register with access \"read\" or \"read-write\"",
            ),
            (
                "register = \"run_source\"",
                "register = \"firmware\"",
                "setup[0].register: `firmware` cannot be written -> a register with access \"read-write\"",
            ),
            (
                "register = \"run_source\"",
                "register = \"run_sauce\"",
                "setup[0].register: no register is called `run_sauce` -> `run_source`",
            ),
        ]);
    }

    #[test]
    fn a_register_is_set_once() {
        each_is_told(&[(
            "text = \"the switch beside the plug: up\"",
            "text = \"the switch\"\nregister = \"run_source\"\nvalues = [2]",
            "setup[1].register: the register `run_source` is taken by setup[0].register -> a register that is set once",
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
    fn a_watchdog_is_read_where_it_stands() {
        each_is_told(&[
            (
                "register = \"loss_time\"",
                "register = \"torque_command\"",
                "watchdog.register: `torque_command` cannot be read -> \
                 a register with access \"read\" or \"read-write\"",
            ),
            (
                "action = \"loss_reaction\"",
                "action = \"reaction\"",
                "watchdog.action: no register is called `reaction` -> the `name` of a register",
            ),
        ]);
    }
}
