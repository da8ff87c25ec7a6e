//! The rules for warnings: one polled register shows them, as a number or as bits, and each has one text.

use super::keys::{is_polled, with_role};
use super::status::{bits_are_there, codes_differ};
use crate::domain::problem::Problem;
use crate::profile::file::ModelFile;
use crate::profile::model::RegisterRole;
use crate::toml_file::OptionalKey;

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    let (bits, codes): (Vec<_>, Vec<_>) =
        file.warnings.iter().partition(|warning| warning.is_bit());
    codes_differ(
        codes.iter().map(|warning| &warning.code),
        |code| format!("warning {code}"),
        problems,
    );
    codes_differ(
        bits.iter().map(|warning| &warning.code),
        |code| format!("warning bit {}", code.saturating_sub(1)),
        problems,
    );
    bits_are_there(
        &file.warnings,
        RegisterRole::WarningBits,
        &file.registers,
        problems,
    );
    let code = with_role(&[RegisterRole::WarningCode], &file.registers);
    let bits = with_role(&[RegisterRole::WarningBits], &file.registers);
    for (register, role) in code.into_iter().chain(bits) {
        is_polled(register, role, "warnings", problems);
    }
    if let (Some((_, code)), Some((_, bits))) = (code, bits) {
        let problem = bits.location.problem(format!(
            "{} says which warning is active",
            code.location.key
        ));
        problems.push(problem.right("bits or a number, not both"));
    }
    if file
        .registers
        .iter()
        .any(|register| matches!(register.role, OptionalKey::Invalid))
    {
        return;
    }
    let first = |is_bit: bool| {
        file.warnings
            .iter()
            .find(|warning| warning.is_bit() == is_bit)
    };
    if code.is_none()
        && let Some(warning) = first(false)
    {
        let problem = warning
            .location
            .problem("no register holds the number of a warning");
        problems.push(problem.right("a register with `role = \"warning-code\"`"));
    }
    if bits.is_none()
        && let Some(warning) = first(true)
    {
        let problem = warning
            .location
            .problem("no register holds the bits of warnings");
        problems.push(problem.right("a register with `role = \"warning-bits\"`, or `code`"));
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::check::model;
    use crate::profile::testing::{EVERYTHING, told_with};

    #[test]
    fn warnings_have_one_polled_register_and_one_text_each() {
        let bits = EVERYTHING
            .replace("role = \"warning-code\"", "role = \"warning-bits\"")
            .replace("[[warning]]\ncode = 5\n", "[[warning]]\nbit = 4\n")
            .replace("[[warning]]\ncode = 9\n", "[[warning]]\nbit = 8\n");
        model(&bits).unwrap();
        let second_role = (
            "role = \"trip-history\"",
            "role = \"warning-bits\"\npoll = \"slow\"",
        );
        for (text, from, to, expected) in [
            (
                EVERYTHING,
                "code = 9\n",
                "code = 5\n",
                "warning[1].code: warning 5 is taken by warning[0].code",
            ),
            (
                EVERYTHING,
                "code = 9\n",
                "bit = 4\n",
                "warning[1]: no register holds the bits of warnings",
            ),
            (
                EVERYTHING,
                "role = \"warning-code\"\n",
                "",
                "warning[0]: no register holds the number of a warning",
            ),
            (
                EVERYTHING,
                "role = \"warning-code\"\npoll = \"slow\"",
                "role = \"warning-code\"",
                "must be polled",
            ),
            (
                EVERYTHING,
                second_role.0,
                second_role.1,
                "says which warning is active",
            ),
            (
                &bits,
                "bit = 8\n",
                "bit = 4\n",
                "warning[1].bit: warning bit 4 is taken by warning[0].bit",
            ),
            (
                &bits,
                "bit = 8\n",
                "bit = 32\n",
                "warning[1].bit: 32 is out of range",
            ),
            (&bits, "bit = 8\n", "bit = 16\n", "has bits 0 to 15"),
            (
                &bits,
                "bit = 8\n",
                "bit = 8\ncode = 7\n",
                "warning[1].code: has a bit already",
            ),
        ] {
            let found = told_with(text, from, to);
            assert!(found.contains(expected), "{to}: {found}");
        }
    }
}
