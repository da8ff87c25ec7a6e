//! The rules for where orders are written: their registers, the direction.

use super::keys::there;
use crate::domain::problem::Problem;
use crate::profile::file::{FormWord, ModelFile, RunFile};
use crate::profile::model::{OrderKind, RegisterMemory, RegisterRole};
use crate::profile::register::RegisterFile;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey};
use std::collections::BTreeMap;

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    let run = file.run.valid().map(|run| &run.value);
    named_by_an_order(run, &file.registers, problems);
    let Some(run) = run else { return };
    for name in run.names() {
        takes_an_order(name, &file.registers, problems);
    }
    words_differ(run, problems);
    stop_replaces_run(run, problems);
    direction_is_whole(run, problems);
    sign_can_be_ordered(run, &file.registers, problems);
}

/// A register with the role `order` belongs to an order.
fn named_by_an_order(
    run: Option<&RunFile>,
    registers: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    for register in registers {
        let Some(role) = register
            .role
            .valid()
            .filter(|role| role.value == RegisterRole::Order)
        else {
            continue;
        };
        let is_named = |run: &RunFile| {
            run.names()
                .any(|name| Some(name.value.as_str()) == register.name())
        };
        if !run.is_some_and(is_named) {
            let problem = role.location.problem("no order names this register");
            problems.push(problem.right(
                "`register` of an order or of `direction` in `[run]`, or leave the role out",
            ));
        }
    }
}

/// The register called `name` is written, in RAM as far as is known, and for nothing else.
fn takes_an_order(
    name: &LocatedValue<String>,
    registers: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    let Some(register) = there(name, registers, problems) else {
        return;
    };
    let mut wrong =
        |what: String, right: &str| problems.push(name.location.problem(what).right(right));
    if register
        .access
        .as_ref()
        .is_some_and(|access| !access.value.can_write())
    {
        wrong(
            format!("`{}` is not writable", name.value),
            "a register with access \"write\" or \"read-write\"",
        );
    }
    if register
        .memory
        .valid()
        .is_some_and(|memory| memory.value == RegisterMemory::Stored)
    {
        wrong(
            format!("`{}` is stored, and orders wear it out", name.value),
            "a register in RAM",
        );
    }
    if register.back_door.valid().is_some() {
        wrong(
            format!("`{}` is a back door", name.value),
            "leave `back_door` out there",
        );
    }
    match register.role.valid().map(|role| role.value) {
        None | Some(RegisterRole::Order) => {}
        Some(RegisterRole::RunCommand) => {
            wrong(
                format!("`{}` takes run commands in any case", name.value),
                "leave it out",
            );
        }
        Some(_) => wrong(
            format!("`{}` has another role", name.value),
            "a register without a role",
        ),
    }
}

/// Where a word is written: the register that is named, or the one for run commands.
type Place<'f> = (Option<&'f str>, u16);

/// No two orders are the same word in the same register.
fn words_differ(run: &RunFile, problems: &mut Vec<Problem>) {
    let mut taken: BTreeMap<Place<'_>, &KeyLocation> = BTreeMap::new();
    for (kind, word) in run.words() {
        let register = run.named(kind).map(|name| name.value.as_str());
        let Some(first) = taken.insert((register, word.value), &word.location) else {
            continue;
        };
        let what = format!(
            "the word {} is taken by {}",
            run.shown(word.value),
            first.key
        );
        problems.push(
            word.location
                .problem(what)
                .right("a word that no other run command uses"),
        );
    }
    if let Some(direction) = run.direction.as_ref().and_then(|fact| fact.value.as_ref())
        && let Some(name) = direction.value.register.as_ref()
        && OrderKind::ALL
            .into_iter()
            .filter_map(|kind| run.named(kind))
            .any(|other| other.value == name.value)
    {
        let problem = name
            .location
            .problem(format!("`{}` takes an order", name.value));
        problems.push(problem.right("a register of its own for the direction"));
    }
}

/// A stop ends what forward and reverse began: it replaces their word, or is a command of its own.
fn stop_replaces_run(run: &RunFile, problems: &mut Vec<Problem>) {
    let name = |kind| run.named(kind).map(|name| name.value.as_str());
    let stop = name(OrderKind::Stop);
    let is_of_bits = run
        .form
        .as_ref()
        .is_some_and(|form| form.value == FormWord::Bits);
    let runs = [
        (OrderKind::Forward, true),
        (OrderKind::Reverse, run.reverse.is_some()),
    ];
    let runs: Vec<_> = runs
        .into_iter()
        .filter(|(_, is_there)| *is_there)
        .map(|(kind, _)| kind)
        .collect();
    let together = runs.iter().filter(|kind| name(**kind) == stop).count();
    let elsewhere = runs.iter().find(|kind| name(**kind) != stop);
    let Some(first) = elsewhere else {
        return;
    };
    if together == 0 && !is_of_bits {
        return;
    }
    let Some(location) = [*first, OrderKind::Stop]
        .into_iter()
        .find_map(|kind| run.named(kind))
    else {
        return;
    };
    let what = format!(
        "a stop does not replace the word of {}, which stays in its register",
        first.keyword()
    );
    let right = "stop, forward and reverse in one register, or with form = \"values\" a stop in one of its own";
    problems.push(location.location.problem(what).right(right));
}

/// The direction is given by two different words, and by nothing else.
fn direction_is_whole(run: &RunFile, problems: &mut Vec<Problem>) {
    let Some(direction) = run.direction.as_ref().and_then(|fact| fact.value.as_ref()) else {
        return;
    };
    let forward = direction.value.forward.as_ref().map(|word| word.value);
    if let Some(reverse) = direction
        .value
        .reverse
        .valid()
        .filter(|reverse| Some(reverse.value) == forward)
    {
        let problem = reverse
            .location
            .problem(format!("{} is also the word for forward", reverse.value));
        problems.push(problem.right("two different words"));
    }
    if let Some(reverse) = run.word(OrderKind::Reverse) {
        let problem = reverse
            .location
            .problem("`direction` says how reverse is ordered");
        problems.push(problem.right("leave `reverse` out, or `direction`"));
    }
}

/// A direction that the sign of the setpoint orders is ordered by nothing else, and every register of the setpoint has
/// that sign.
fn sign_can_be_ordered(run: &RunFile, registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    let Some(by_sign) = run.reverse_by.as_ref().and_then(|fact| fact.value.as_ref()) else {
        return;
    };
    let reverse = run.word(OrderKind::Reverse).map(|word| &word.location);
    let direction = run
        .direction
        .as_ref()
        .and_then(|fact| fact.value.as_ref())
        .map(|it| &it.location);
    for (location, key) in [(reverse, "reverse"), (direction, "direction")] {
        let Some(location) = location else { continue };
        let problem = location.problem("`reverse_by` says how reverse is ordered");
        problems.push(problem.right(format!("leave `{key}` out, or `reverse_by`")));
    }
    let of_setpoint = |register: &&RegisterFile| {
        let role = register.role.valid().map(|role| role.value);
        let is_shown = register
            .access
            .as_ref()
            .is_none_or(|access| access.value.can_read());
        role == Some(RegisterRole::FrequencyCommand)
            || (role == Some(RegisterRole::FrequencySetting) && is_shown)
    };
    for register in registers.iter().filter(of_setpoint) {
        let name = register.name().unwrap_or_default();
        if !matches!(register.form.direction, OptionalKey::Absent) {
            if let Some(words) = register.form.words.valid().filter(|words| words.value == 2) {
                let problem = words
                    .location
                    .problem("a setpoint whose sign is the direction is one word");
                problems.push(problem.right("a register of one word, or leave `reverse_by` out"));
            }
        } else {
            let problem = by_sign
                .location
                .problem(format!("the sign of `{name}` is no direction"));
            let right = "`signed = true` and `direction = \"sign\"` there, if the documents say so";
            problems.push(problem.right(right));
        }
        if let Some(from) = register
            .form
            .full_scale
            .valid()
            .and_then(|scale| scale.value.from.valid())
        {
            let problem = from
                .location
                .problem("0 is not 0 Hz there, so that the sign is no direction");
            problems.push(problem.right("leave it out, or `reverse_by`"));
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::check;
    use crate::profile::model::Confidence;
    use crate::profile::testing::{MODEL, told_with};

    const ORDERS: &str = include_str!("../../../../../tests/golden/models/orders.toml");
    const RESET: &str = "reset = { register = \"fault_reset\", value = 1, clear = 0,";
    const DIRECTION: &str = "direction = { register = \"direction\", forward = 0, reverse = 1,";

    fn each_is_told(changes: &[(&str, &str, &str)]) {
        check::model(ORDERS).unwrap();
        for (from, to, expected) in changes {
            let found = told_with(ORDERS, from, to).replace("\n    right: ", " -> ");
            assert!(found.contains(expected), "{from} -> {to}: {found}");
        }
    }

    #[test]
    fn a_sign_orders_the_direction_where_the_setpoint_has_one() {
        const SIGNED: &str = include_str!("../../../../../tests/golden/models/signed.toml");
        let model = check::model(SIGNED).unwrap();
        let run = model.run.as_ref().unwrap();
        assert_eq!(
            run.reverse.as_ref().map(|fact| fact.value),
            Some(run.forward.value)
        );
        let by = "reverse_by = { value = \"sign\", confidence = \"manual\", source = \"IM 5\" }\n";
        let reverse =
            format!("{by}reverse = {{ value = 2, confidence = \"manual\", source = \"IM 5\" }}\n");
        let direction = format!(
            "{by}direction = {{ register = \"turn\", forward = 0, reverse = 1, confidence = \"manual\", source = \"IM 5\" }}\n"
        );
        let turn = "[[register]]\nname = \"turn\"\ntitle = \"T\"\naddress = 0x2050\nunit = \"-\"\naccess = \"write\"\n\
                    memory = \"ram\"\nconfidence = \"manual\"\nsource = \"IM 5\"\n\n[[register]]\nname = \"run\"";
        let sign = "scale = 100\nsigned = true\ndirection = \"sign\"\nunit = \"Hz\"\naccess = \"read-write\"";
        let setting = "[[register]]\nname = \"setting\"\ntitle = \"T\"\naddress = 0x2050\nscale = 100\nunit = \"Hz\"\n\
                       access = \"read\"\nrole = \"frequency-setting\"\nconfidence = \"manual\"\nsource = \"IM 5\"\n\n\
                       [[register]]\nname = \"run\"";
        let with_turn = SIGNED.replacen("[[register]]\nname = \"run\"", turn, 1);
        for (text, from, to, expected) in [
            (
                SIGNED,
                by,
                reverse.as_str(),
                "run.reverse.value: `reverse_by` says how reverse is ordered -> leave `reverse` out",
            ),
            (
                &with_turn,
                by,
                &direction,
                "`reverse_by` says how reverse is ordered -> leave `direction` out, or `reverse_by`",
            ),
            (
                SIGNED,
                sign,
                &sign.replace("direction = \"sign\"\n", ""),
                "the sign of `frequency_command` is no direction",
            ),
            (
                SIGNED,
                sign,
                &sign.replace(
                    "scale = 100",
                    "words = 2\nword_order = \"low-first\"\nscale = 100",
                ),
                "is one word",
            ),
            (
                SIGNED,
                "[[register]]\nname = \"run\"",
                setting,
                "the sign of `setting` is no direction -> `signed = true` and",
            ),
            (
                SIGNED,
                "\"sign\", confidence",
                "\"bit\", confidence",
                "run.reverse_by.value: ",
            ),
        ] {
            let found = told_with(text, from, to).replace("\n    right: ", " -> ");
            assert!(found.contains(expected), "{to}: {found}");
        }
    }

    #[test]
    fn reverse_by_the_sign_is_as_sure_as_the_sign() {
        const SIGNED: &str = include_str!("../../../../../tests/golden/models/signed.toml");
        let sure = |text: &str| {
            check::model(text)
                .unwrap()
                .run
                .unwrap()
                .reverse
                .unwrap()
                .confidence
        };
        assert_eq!(sure(SIGNED), Confidence::Manual);
        let unstated = SIGNED.replacen(
            "role = \"frequency-command\"",
            "role = \"frequency-command\"\nnot_stated = [\"sign\"]",
            1,
        );
        assert_eq!(sure(&unstated), Confidence::Inferred);
    }

    #[test]
    fn an_order_goes_to_a_register_that_takes_it() {
        let reset = |register: &str| RESET.replace("fault_reset", register);
        each_is_told(&[
            (
                RESET,
                &reset("fault_rest"),
                "there is no register called `fault_rest` -> `fault_reset`",
            ),
            (
                RESET,
                &reset("status"),
                "run.reset.register: `status` is not writable -> a register with access",
            ),
            (
                RESET,
                &reset("frequency_command"),
                "run.reset.register: `frequency_command` has another role -> a register without a role",
            ),
            (
                RESET,
                &reset("run"),
                "run.reset.register: `run` takes run commands in any case -> leave it out",
            ),
            (
                "access = \"read-write\"\nmemory = \"ram\"",
                "access = \"read-write\"\nmemory = \"stored\"",
                "run.direction.register: `direction` is stored, and orders wear it out -> a register in RAM",
            ),
            (
                "access = \"read-write\"\nmemory = \"ram\"",
                "access = \"read-write\"\nback_door = \"it turns\"",
                "run.direction.register: `direction` is a back door -> leave `back_door` out there",
            ),
        ]);
        let role = "access = \"read\"\nrole = \"order\"";
        let found = told_with(
            MODEL,
            "access = \"read\"\nrole = \"output-frequency\"",
            role,
        );
        assert!(
            found.contains("register[0].role: no order names this register"),
            "{found}"
        );
    }

    #[test]
    fn words_are_compared_in_their_registers() {
        each_is_told(&[
            (
                "coast = { value = 2,",
                "coast = { register = \"fault_reset\", value = 1,",
                "run.reset.value: the word 1 is taken by run.coast.value -> a word that no other run command uses",
            ),
            (
                "register = \"fault_reset\", value = 9,",
                "register = \"fault_reset\", value = 1,",
                "run.never[1].value: the word 1 is the command run.reset.value -> a word that is not a command",
            ),
        ]);
        check::model(&ORDERS.replace("    { value = 8,", "    { value = 7,")).unwrap();
        let found = told_with(ORDERS, "    { value = 8,", "    { value = 1,");
        assert!(
            found.contains("run.never[0].value: the word 1 is the command run.forward.value"),
            "{found}"
        );
    }

    #[test]
    fn a_stop_ends_what_a_run_word_began() {
        let wrong = "a stop does not replace the word of forward, which stays in its register";
        let reverse = "reverse = { value = 3, confidence = \"manual\", source = \"IM 5\" }\n";
        let separate = "forward = { register = \"fault_reset\", value = 4,";
        let text = ORDERS
            .replace("direction = {", "# direction = {")
            .replace("\"direction\"", "\"d\"");
        let text = text.replace(
            "coast = { value = 2,",
            &format!("{reverse}coast = {{ value = 2,"),
        );
        check::model(&text).unwrap();
        let found = told_with(&text, "forward = { value = 1,", separate);
        assert!(found.contains(wrong), "{found}");
        let apart = text.replace(
            "reverse = { value",
            "reverse = { register = \"fault_reset\", value",
        );
        check::model(&apart.replace("forward = { value = 1,", separate)).unwrap();
        // Bits are states: a stop elsewhere leaves them set.
        let bits = "form = \"bits\"\nbit = [{ bit = 0, meaning = \"run\", confidence = \"manual\", source = \"IM 5\" }]";
        let apart = apart.replace("forward = { value = 1,", separate);
        let found = told_with(&apart, "form = \"values\"", bits);
        assert!(found.contains(wrong), "{found}");
    }

    #[test]
    fn a_reset_in_a_register_of_its_own_is_cleared_there() {
        each_is_told(&[
            (
                RESET,
                &format!("reset_sequence = [0, 1]\n{RESET}"),
                "run.reset_sequence: a reset in a register of its own is a stop, the reset and `clear` -> leave it out",
            ),
            (
                RESET,
                "reset_sequence = [0, 4]\nreset = { value = 4, clear = 0,",
                "run.reset.clear: only a register of the reset alone is cleared -> `register` beside it",
            ),
            (
                RESET,
                &RESET.replace("clear = 0", "clear = 1"),
                "run.reset.clear: the word 1 is an order in this register -> a word that orders nothing",
            ),
        ]);
    }

    #[test]
    fn a_direction_is_two_words_in_a_register_of_its_own() {
        each_is_told(&[
            (
                DIRECTION,
                &DIRECTION.replace("reverse = 1", "reverse = 0"),
                "run.direction.reverse: 0 is also the word for forward -> two different words",
            ),
            (
                DIRECTION,
                &DIRECTION.replace("\"direction\"", "\"fault_reset\""),
                "run.direction.register: `fault_reset` takes an order -> a register of its own for the direction",
            ),
            (
                "coast = { value = 2,",
                "reverse = { value = 2,",
                "run.reverse.value: `direction` says how reverse is ordered -> leave `reverse` out, or `direction`",
            ),
        ]);
    }
}
