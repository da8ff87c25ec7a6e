//! The rules for status flags, trips and exceptions.

use super::keys::{is_polled, once, readable, with_role};
use crate::domain::problem::Problem;
use crate::profile::file::{CodeFile, ModelFile, StatusFile};
use crate::profile::model::{ClearWords, RegisterRole};
use crate::profile::register::RegisterFile;
use crate::profile::words::FLAGS;
use crate::toml_file::words::word_for;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey};

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    let flags = file.status.iter().filter_map(|status| status.flag.as_ref());
    once(
        flags,
        |flag| format!("the flag `{}`", word_for(&FLAGS, flag)),
        "a flag that is declared only once",
        problems,
    );
    for status in &file.status {
        flag_can_be_seen(status, &file.registers, problems);
        a_field_is_not_compared_whole(status, &file.registers, problems);
        values_fit_the_mask(status, problems);
        clear_is_documented(file, status, problems);
    }
    codes_differ(
        file.exceptions.iter().map(|it| &it.code),
        |code| format!("exception 0x{code:02X}"),
        problems,
    );
    let (bits, codes): (Vec<_>, Vec<_>) = file.trips.iter().partition(|trip| trip.is_bit());
    codes_differ(
        codes.iter().map(|trip| &trip.code),
        |code| format!("trip {code}"),
        problems,
    );
    codes_differ(
        bits.iter().map(|trip| &trip.code),
        |code| format!("trip bit {}", code.saturating_sub(1)),
        problems,
    );
    trips_have_a_register(file, problems);
    bits_are_there(
        &file.trips,
        RegisterRole::TripBits,
        &file.registers,
        problems,
    );
    bits_stand_alone(&file.registers, problems);
    super::warnings::check(file, problems);
}

/// The flag's register is polled.
fn flag_can_be_seen(status: &StatusFile, registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    let Some(name) = &status.register else { return };
    let Some(register) = readable(name, registers, problems) else {
        return;
    };
    if matches!(register.poll, OptionalKey::Absent) {
        let problem = name
            .location
            .problem(format!("`{}` is not polled", name.value));
        problems.push(problem.right("a register with `poll`"));
    }
}

/// A flag is read from the whole word of its register. Where the register is a field of that word, a flag without a mask
/// would compare the other bits too.
fn a_field_is_not_compared_whole(
    status: &StatusFile,
    registers: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    let (Some(name), OptionalKey::Absent) = (&status.register, &status.mask) else {
        return;
    };
    let register = registers
        .iter()
        .find(|it| it.name.as_ref().is_some_and(|it| it.value == name.value));
    if let Some(field) = register.and_then(|register| register.form.mask.valid()) {
        let problem = name.location.problem(format!(
            "`{}` is a field of its word, and the flag has no mask",
            name.value
        ));
        let mask = field.value;
        problems.push(problem.right(format!(
            "`mask = 0x{mask:04X}`, with `values` in place within the word"
        )));
    }
}

fn values_fit_the_mask(status: &StatusFile, problems: &mut Vec<Problem>) {
    let Some(mask) = status.mask() else {
        return;
    };
    let clear = status.clear.valid().map(|clear| &clear.value);
    let values = status.values.as_ref().map(|values| &values.value);
    if let Some(both) = clear
        .into_iter()
        .flatten()
        .find(|word| values.is_some_and(|it| it.iter().any(|v| v.value == word.value)))
    {
        problems.push(
            both.location
                .problem(format!("0x{:04X} is one of `values` too", both.value))
                .right("one of the two"),
        );
    }
    let words = values.into_iter().chain(clear).flatten();
    for LocatedValue { value, location } in words.filter(|word| word.value & !mask != 0) {
        let problem = location.problem(format!(
            "0x{value:04X} has bits outside the mask 0x{mask:04X}"
        ));
        problems.push(problem.right(format!("0x{:04X}, or a wider mask", value & mask)));
    }
}

/// Some word is known with which the flag is not set: otherwise it could never end.
fn clear_is_documented(file: &ModelFile, status: &StatusFile, problems: &mut Vec<Problem>) {
    let (Some(flag), Some(values)) = (status.ready(file), &status.values) else {
        return;
    };
    let ClearWords::Named(named) = &flag.clear else {
        return;
    };
    if !named
        .iter()
        .any(|word| word.mask & flag.mask != flag.mask || !flag.holds(word.value))
    {
        let problem = values
            .location
            .problem("no word is named with which the flag is not set");
        problems.push(problem.right(
            "`clear` with such words, or `values` in its register; other words prove nothing",
        ));
    }
}

/// Each bit lies within the words of the register that holds them.
pub(super) fn bits_are_there(
    of: &[CodeFile],
    role: RegisterRole,
    registers: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    let Some((register, _)) = with_role(&[role], registers) else {
        return;
    };
    let bits = match register.form.mask.valid() {
        Some(mask) => mask.value.count_ones(),
        None if register.form.is_pair() => 32,
        None => 16,
    };
    for code in of
        .iter()
        .filter(|code| code.is_bit())
        .filter_map(|code| code.code.as_ref())
    {
        if u32::from(code.value) > bits {
            let what = format!(
                "`{}` has bits 0 to {}",
                register.name().unwrap_or_default(),
                bits.saturating_sub(1)
            );
            let right = if bits == 16 {
                "one of them, or `words = 2` in the register"
            } else {
                "one of them"
            };
            problems.push(code.location.problem(what).right(right));
        }
    }
}

pub(super) fn codes_differ<'f>(
    codes: impl IntoIterator<Item = &'f RequiredKey<u16>>,
    called: impl Fn(&u16) -> String,
    problems: &mut Vec<Problem>,
) {
    let numbers = codes.into_iter().filter_map(Option::as_ref);
    once(
        numbers,
        called,
        "a code that is declared only once",
        problems,
    );
}

/// Texts for trips require a register that holds the trip's number, texts for bits one that holds the bits.
fn trips_have_a_register(file: &ModelFile, problems: &mut Vec<Problem>) {
    let has = |roles: &[RegisterRole]| {
        file.registers.iter().any(|register| match &register.role {
            OptionalKey::Absent => false,
            OptionalKey::Invalid => true,
            OptionalKey::Valid(role) => roles.contains(&role.value),
        })
    };
    let first = |is_bit: bool| file.trips.iter().find(|trip| trip.is_bit() == is_bit);
    if let Some(trip) = first(false)
        && !has(&[RegisterRole::TripCode, RegisterRole::TripCause])
    {
        let problem = trip
            .location
            .problem("no register holds the number of a trip");
        problems.push(problem.right("a register with `role = \"trip-code\"` or \"trip-cause\""));
    }
    if let Some(trip) = first(true)
        && !has(&[RegisterRole::TripBits])
    {
        let problem = trip.location.problem("no register holds the bits of trips");
        problems.push(problem.right("a register with `role = \"trip-bits\"`, or `code`"));
    }
}

/// Bits are polled, and no other register says which trip is active.
fn bits_stand_alone(registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    let Some((register, role)) = with_role(&[RegisterRole::TripBits], registers) else {
        return;
    };
    is_polled(register, role, "bits of trips", problems);
    if let Some(access) = register
        .access
        .as_ref()
        .filter(|access| !access.value.can_read())
    {
        let problem = access.location.problem("bits of trips must be readable");
        problems.push(problem.right("a register that the documents show being read"));
    }
    if let Some((_, other)) = with_role(
        &[RegisterRole::TripCode, RegisterRole::TripCause],
        registers,
    ) {
        let problem = role
            .location
            .problem(format!("{} says which trip is active", other.location.key));
        problems.push(problem.right("bits or a number, not both"));
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::testing::{EVERYTHING, each_is_told, told_with};

    #[test]
    fn a_flag_is_declared_once_in_a_polled_register() {
        each_is_told(&[
            (
                "flag = \"tripped\"",
                "flag = \"running\"",
                "status[1].flag: the flag `running` is taken by status[0].flag -> a flag that is declared only once",
            ),
            (
                "register = \"trip_code\"",
                "register = \"trip_kode\"",
                "status[1].register: there is no register called `trip_kode` -> `trip_code`",
            ),
            (
                "register = \"trip_code\"",
                "register = \"nothing_like_it\"",
                "status[1].register: there is no register called `nothing_like_it` -> the `name` of a register",
            ),
            (
                "register = \"trip_code\"",
                "register = \"loss_time\"",
                "status[1].register: `loss_time` is not polled -> a register with `poll`",
            ),
        ]);
        let found = told_with(
            EVERYTHING,
            "register = \"trip_code\"",
            "register = \"run_command\"",
        );
        assert!(
            found.contains("status[1].register: `run_command` is not readable\n"),
            "{found}"
        );
    }

    #[test]
    fn values_lie_within_the_mask() {
        each_is_told(&[
            (
                "values = [0x0400, 0x0C00]",
                "values = [0x0400, 0x1C00]",
                "status[0].values[1]: 0x1C00 has bits outside the mask 0x0C00 -> 0x0C00, or a wider mask",
            ),
            (
                "values = [0x0400, 0x0C00]",
                "values = []",
                "status[0].values: is empty -> at least a whole number from 0 to 65535",
            ),
            (
                "mask = 0x0C00",
                "mask = 0",
                "status[0].mask: 0 is out of range -> a whole number from 1 to 65535",
            ),
        ]);
    }

    #[test]
    fn a_flag_of_a_field_has_a_mask() {
        let role = "role = \"trip-code\"\n";
        let found = told_with(EVERYTHING, role, &format!("{role}mask = 0x00FF\n"));
        let expected = "status[1].register: `trip_code` is a field of its word, and the flag has no mask\n    right: `mask = \
                        0x00FF`, with `values` in place within the word\n";
        assert!(found.contains(expected), "{found}");
    }

    #[test]
    fn codes_have_one_text() {
        each_is_told(&[
            (
                "code = 2\n",
                "code = 0x51\n",
                "exception[1].code: exception 0x51 is taken by exception[0].code -> a code that is declared only once",
            ),
            (
                "code = 1\n",
                "code = 24\n",
                "trip[1].code: trip 24 is taken by trip[0].code -> a code that is declared only once",
            ),
            (
                "code = 2\n",
                "code = 256\n",
                "exception[1].code: 256 is out of range -> a whole number from 1 to 255",
            ),
            (
                "role = \"trip-code\"\n",
                "",
                "trip[0]: no register holds the number of a trip -> a register with `role = \"trip-code\"` or \"trip-cause\"",
            ),
        ]);
    }

    #[test]
    fn bits_of_trips_have_one_polled_register_and_one_text_each() {
        let bits = EVERYTHING
            .replace("role = \"trip-code\"", "role = \"trip-bits\"")
            .replace("code = 24\n", "bit = 3\n")
            .replace("code = 1\n", "bit = 0\n");
        crate::profile::check::model(&bits).unwrap();
        let pair = "role = \"trip-bits\"\nwords = 2\nword_order = \"high-first\"\n";
        let of_two = bits
            .replace("address = 0x2101\n", "address = 0x2150\n")
            .replace("address = 0x2100, count = 2", "address = 0x2102, count = 2")
            .replace("role = \"trip-bits\"\n", pair)
            .replace("bit = 0\ntext", "bit = 31\ntext");
        crate::profile::check::model(&of_two).unwrap();
        for (from, to, expected) in [
            (
                "bit = 0\ntext",
                "bit = 3\ntext",
                "trip[1].bit: trip bit 3 is taken by trip[0].bit",
            ),
            (
                "bit = 0\ntext",
                "bit = 32\ntext",
                "trip[1].bit: 32 is out of range",
            ),
            (
                "bit = 0\ntext",
                "bit = 16\ntext",
                "trip[1].bit: `trip_code` has bits 0 to 15",
            ),
            (
                "role = \"trip-bits\"\n",
                "role = \"trip-bits\"\nmask = 0x0007\n",
                "trip[0].bit: `trip_code` has bits 0 to 2",
            ),
            (
                "bit = 0\ntext",
                "bit = 0\ncode = 7\ntext",
                "trip[1].code: has a bit already",
            ),
            (
                "bit = 0\ntext",
                "code = 7\ntext",
                "trip[1]: no register holds the number of a trip",
            ),
            (
                "role = \"trip-bits\"\n",
                "",
                "trip[0]: no register holds the bits of trips",
            ),
            (
                "role = \"trip-bits\"\npoll = \"second\"\n",
                "role = \"trip-bits\"\n",
                "bits of trips must be polled",
            ),
            (
                "role = \"trip-history\"",
                "role = \"trip-cause\"",
                "says which trip is active",
            ),
        ] {
            let found = told_with(&bits, from, to);
            assert!(found.contains(expected), "{to}: {found}");
        }
    }
}
