//! The rules of status flags, trips and exceptions.

use super::{once, readable};
use crate::domain::problem::Problem;
use crate::profile::file::{CodeFile, ModelFile, StatusFile};
use crate::profile::model::Role;
use crate::profile::reader::{Given, Written};
use crate::profile::register::RegisterFile;
use crate::profile::words::{FLAGS, word_for};

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    let flags = file.status.iter().filter_map(|status| status.flag.as_ref());
    once(flags, |flag| format!("the flag `{}`", word_for(&FLAGS, flag)), "a flag that is told once", problems);
    for status in &file.status {
        flag_can_be_seen(status, &file.registers, problems);
        values_fit_the_mask(status, problems);
    }
    codes_differ(&file.exceptions, "exception", problems);
    codes_differ(&file.trips, "trip", problems);
    trips_have_a_register(file, problems);
}

/// The flag's register is one that the gateway looks at of its own.
fn flag_can_be_seen(status: &StatusFile, registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    let Some(name) = &status.register else { return };
    let Some(register) = readable(name, registers, problems) else { return };
    if matches!(register.poll, Given::LeftOut) {
        let problem = name.place.problem(format!("`{}` is not polled", name.value));
        problems.push(problem.right("a register with `poll`"));
    }
}

fn values_fit_the_mask(status: &StatusFile, problems: &mut Vec<Problem>) {
    let (Some(mask), Some(values)) = (status.mask.or(u16::MAX), &status.values) else { return };
    for Written { value, place } in values.value.iter().filter(|value| value.value & !mask != 0) {
        let problem = place.problem(format!("0x{value:04X} has bits outside the mask 0x{mask:04X}"));
        problems.push(problem.right(format!("0x{:04X}, or a wider mask", value & mask)));
    }
}

fn codes_differ(codes: &[CodeFile], called: &str, problems: &mut Vec<Problem>) {
    let numbers = codes.iter().filter_map(|code| code.code.as_ref());
    once(numbers, |number| format!("{called} {number}"), "a code that is told once", problems);
}

/// Words for trips are of use only where a trip's number can be read.
fn trips_have_a_register(file: &ModelFile, problems: &mut Vec<Problem>) {
    let may_be = |register: &RegisterFile| match &register.role {
        Given::LeftOut => false,
        Given::Unusable => true,
        Given::Usable(role) => matches!(role.value, Role::TripCode | Role::TripCause),
    };
    let Some(first) = file.trips.first().filter(|_| !file.registers.iter().any(may_be)) else { return };
    let problem = first.place.problem("no register holds the number of a trip");
    problems.push(problem.right("a register with `role = \"trip-code\"` or \"trip-cause\""));
}
