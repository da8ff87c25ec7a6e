//! Checks shared by several sections: unique values and register names.

use super::super::register::{RegisterFile, find_register};
use crate::domain::problem::{Problem, nearest};
use crate::profile::model::RegisterRole;
use crate::toml_file::{LocatedValue, OptionalKey};
use std::collections::BTreeMap;

/// Reports each duplicate in `written`, at its second occurrence.
pub(super) fn once<'f, T: Ord + 'f>(
    written: impl IntoIterator<Item = &'f LocatedValue<T>>,
    called: impl Fn(&T) -> String,
    right: &str,
    problems: &mut Vec<Problem>,
) {
    let mut taken: BTreeMap<&T, &str> = BTreeMap::new();
    for LocatedValue { value, location } in written {
        match taken.get(value) {
            Some(first) => {
                problems.push(
                    location
                        .problem(format!("{} is taken by {first}", called(value)))
                        .right(right),
                );
            }
            None => {
                taken.insert(value, &location.key);
            }
        }
    }
}

/// The first register with one of the roles `wanted`, and the role as written.
pub(super) fn with_role<'f>(
    wanted: &[RegisterRole],
    registers: &'f [RegisterFile],
) -> Option<(&'f RegisterFile, &'f LocatedValue<RegisterRole>)> {
    registers.iter().find_map(|register| {
        let role = register
            .role
            .valid()
            .filter(|role| wanted.contains(&role.value))?;
        Some((register, role))
    })
}

/// Reports `register`, whose `role` shows `what`, if it is not polled.
pub(super) fn is_polled(
    register: &RegisterFile,
    role: &LocatedValue<RegisterRole>,
    what: &str,
    problems: &mut Vec<Problem>,
) {
    if matches!(register.poll, OptionalKey::Absent) {
        problems.push(
            role.location
                .problem(format!("{what} must be polled"))
                .right("a register with `poll`"),
        );
    }
}

/// The register called `name`, which must exist.
pub(super) fn there<'f>(
    name: &LocatedValue<String>,
    registers: &'f [RegisterFile],
    problems: &mut Vec<Problem>,
) -> Option<&'f RegisterFile> {
    let Some(register) = find_register(&name.value, registers) else {
        let names = registers
            .iter()
            .filter_map(|register| Some(register.name.as_ref()?.value.as_str()));
        let right = match nearest(&name.value, names) {
            Some(near) => format!("`{near}`"),
            None => "the `name` of a register".to_owned(),
        };
        problems.push(
            name.location
                .problem(format!("there is no register called `{}`", name.value))
                .right(right),
        );
        return None;
    };
    Some(register)
}

/// The register called `name`, which must be readable.
pub(super) fn readable<'f>(
    name: &LocatedValue<String>,
    registers: &'f [RegisterFile],
    problems: &mut Vec<Problem>,
) -> Option<&'f RegisterFile> {
    let register = there(name, registers, problems)?;
    if register
        .access
        .as_ref()
        .is_some_and(|access| !access.value.can_read())
    {
        let problem = name
            .location
            .problem(format!("`{}` is not readable", name.value));
        problems.push(problem.right("a register with access \"read\" or \"read-write\""));
    }
    Some(register)
}
