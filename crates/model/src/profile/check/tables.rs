//! The rules for registers that are not holding registers: functions that serve their table, and words of bits.

use crate::domain::address::DataTable;
use crate::domain::problem::Problem;
use crate::profile::file::{FormWord, ModelFile, RunFile};
use crate::profile::model::{OrderKind, RegisterRole};
use crate::profile::register::{RegisterFile, called, read_by, tables_fit, written_by};
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey};

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    tables_fit(&file.registers, problems);
    conditions_are_of_bits(file, problems);
    if let OptionalKey::Valid(run) = &file.run {
        orders_are_of_bits(&run.value, &file.registers, problems);
    }
}

/// The drive serves a function for everything that is read or written.
pub(super) fn are_served(
    file: &ModelFile,
    served: &[u8],
    location: &KeyLocation,
    problems: &mut Vec<Problem>,
) {
    let is_in = |table, may: fn(&RegisterFile) -> bool| {
        file.registers
            .iter()
            .any(|register| register.table() == Some(table) && may(register))
    };
    let reads = |it: &RegisterFile| {
        it.access
            .as_ref()
            .is_some_and(|access| access.value.can_read())
    };
    let writes = |it: &RegisterFile| {
        it.access
            .as_ref()
            .is_some_and(|access| access.value.can_write())
    };
    for table in DataTable::ALL {
        let function = read_by(table);
        if is_in(table, reads) && !served.contains(&function) {
            let what = match table {
                DataTable::Holding => {
                    "registers are read by function 03, and it is not served".to_owned()
                }
                _ => format!(
                    "{} is read by function {function:02X}, and it is not served",
                    called(table)
                ),
            };
            problems.push(location.problem(what).right(format!(
                "a list with 0x{function:02X}, if the manual names it"
            )));
        }
    }
    let has_none = |table| {
        !written_by(table)
            .iter()
            .any(|function| served.contains(function))
    };
    let has_run = matches!(file.run, OptionalKey::Valid(_));
    let is_holding = is_in(DataTable::Holding, writes) || !is_in(DataTable::Coil, writes);
    if has_run && is_holding && has_none(DataTable::Holding) {
        let problem = location
            .problem("run commands are written by function 06 or 10 hex, and neither is served");
        problems.push(problem.right("a list with the one that the manual names, or no `[run]`"));
    }
    if is_in(DataTable::Coil, writes) && has_none(DataTable::Coil) {
        let problem =
            location.problem("a coil is written by function 05 or 0F hex, and neither is served");
        problems.push(problem.right("a list with the one that the manual names"));
    }
}

/// The table of the register called `name`, if it holds bits. That it is there is checked elsewhere.
fn of_bits(name: &str, registers: &[RegisterFile]) -> Option<DataTable> {
    let register = registers
        .iter()
        .find(|register| register.name() == Some(name))?;
    register.table().filter(|table| table.is_of_bits())
}

/// The words and the mask of a condition on a bit.
fn is_a_bit<'f>(
    name: Option<&str>,
    mask: Option<&LocatedValue<u16>>,
    words: impl IntoIterator<Item = &'f LocatedValue<u16>>,
    registers: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    let Some(table) = name.and_then(|name| of_bits(name, registers)) else {
        return;
    };
    if let Some(mask) = mask {
        let problem = mask
            .location
            .problem(format!("{} has no other bits", called(table)));
        problems.push(problem.right("leave it out"));
    }
    for word in words.into_iter().filter(|word| word.value > 1) {
        let problem = word
            .location
            .problem(format!("{} is never {}", called(table), word.value));
        problems.push(problem.right("0 or 1"));
    }
}

/// Flags, settings, the identity and the conditions of a start compare a bit with 0 or 1.
fn conditions_are_of_bits(file: &ModelFile, problems: &mut Vec<Problem>) {
    let all = &file.registers;
    let name = |name: &Option<LocatedValue<String>>| name.as_ref().map(|name| name.value.clone());
    for status in &file.status {
        let words = status.values.iter().flat_map(|words| &words.value);
        is_a_bit(
            name(&status.register).as_deref(),
            status.mask.valid(),
            words,
            all,
            problems,
        );
    }
    for setup in &file.setup {
        let register = setup.register.valid().map(|name| name.value.as_str());
        let words = setup
            .values
            .valid()
            .into_iter()
            .flat_map(|words| &words.value);
        is_a_bit(register, setup.mask.valid(), words, all, problems);
    }
    if let OptionalKey::Valid(identity) = &file.identity {
        let words = identity.value.values.iter().flat_map(|words| &words.value);
        is_a_bit(
            name(&identity.value.register).as_deref(),
            identity.value.mask.valid(),
            words,
            all,
            problems,
        );
    }
    let steps = file
        .run
        .valid()
        .into_iter()
        .flat_map(|run| &run.value.start);
    for until in steps
        .filter_map(|step| step.until.valid())
        .map(|until| &until.value)
    {
        let words = until.values.iter().flat_map(|words| &words.value);
        is_a_bit(
            name(&until.register).as_deref(),
            until.mask.valid(),
            words,
            all,
            problems,
        );
    }
    if let OptionalKey::Valid(watchdog) = &file.watchdog {
        for name in watchdog
            .value
            .register
            .iter()
            .chain(watchdog.value.action.valid())
        {
            if let Some(table) = of_bits(&name.value, all) {
                let problem = name
                    .location
                    .problem(format!("{} holds no time and no words", called(table)));
                problems.push(problem.right("a register of words"));
            }
        }
    }
}

/// An order in a coil is 0 or 1, and needs no bits of its own.
fn orders_are_of_bits(run: &RunFile, registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    let own = registers.iter().find(|it| {
        it.role
            .valid()
            .is_some_and(|role| role.value == RegisterRole::RunCommand)
    });
    let own = own.and_then(RegisterFile::name);
    if let (Some(form), Some(DataTable::Coil)) =
        (&run.form, own.and_then(|own| of_bits(own, registers)))
        && form.value == FormWord::Bits
    {
        let problem = form.location.problem("a coil has one bit");
        problems.push(problem.right("\"values\", with the orders 0 and 1"));
    }
    let mut takes = |name: Option<&str>, words: &mut dyn Iterator<Item = &LocatedValue<u16>>| {
        is_a_bit(name, None, words, registers, problems);
    };
    for (kind, word) in run.words() {
        let named = run.named(kind).map(|name| name.value.as_str());
        takes(named.or(own), &mut std::iter::once(word));
    }
    let reset = run.named(OrderKind::Reset).map(|name| name.value.as_str());
    takes(reset, &mut run.clear().into_iter());
    for step in run
        .reset_sequence
        .valid()
        .into_iter()
        .flat_map(|sequence| &sequence.value)
    {
        let named = step.register.valid().map(|name| name.value.as_str());
        takes(named.or(own), &mut step.value.iter());
    }
    takes(own, &mut run.start_words());
    for (name, word) in run.never() {
        takes(name.or(own), &mut std::iter::once(word));
    }
    if let Some(direction) = run.direction.as_ref().and_then(|fact| fact.value.as_ref()) {
        let name = direction
            .value
            .register
            .as_ref()
            .map(|name| name.value.as_str());
        takes(
            name,
            &mut direction
                .value
                .forward
                .iter()
                .chain(direction.value.reverse.valid()),
        );
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::check;
    use crate::profile::testing::{MODEL, each_is_told_of, told_with};

    const COILS: &str = include_str!("../../../../../tests/golden/models/coils.toml");
    const START: &str = include_str!("../../../../../tests/golden/models/start.toml");

    #[test]
    fn functions_serve_the_tables() {
        let served = "value = [0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F]";
        let case = |functions: &str, what: &str| {
            (
                format!("value = [{functions}, 0x0F]"),
                format!("functions.value: {what}, if the manual names it"),
            )
        };
        let cases = [
            case(
                "2, 3, 4, 5, 6",
                "a coil is read by function 01, and it is not served -> a list with 0x01",
            ),
            case(
                "1, 3, 4, 5, 6",
                "a discrete input is read by function 02, and it is not served -> a list with 0x02",
            ),
            case(
                "1, 2, 4, 5, 6",
                "registers are read by function 03, and it is not served -> a list with 0x03",
            ),
            case(
                "1, 2, 3, 5, 6",
                "an input register is read by function 04, and it is not served -> a list with 0x04",
            ),
        ];
        for (to, expected) in &cases {
            each_is_told_of(COILS, &[(served, to, expected)]);
        }
        let found = told_with(COILS, served, "value = [1, 2, 3, 4, 6]");
        assert!(
            found.contains(
                "functions.value: a coil is written by function 05 or 0F hex, and neither is"
            ),
            "{found}"
        );
        assert!(
            found.contains("write.block: writing a block requires function 0F hex"),
            "{found}"
        );
        let found = told_with(COILS, served, "value = [1, 2, 3, 4, 5, 0x0F]");
        assert!(
            found.contains(
                "run commands are written by function 06 or 10 hex, and neither is served"
            ),
            "{found}"
        );
        // Nothing of such a device is read by 03.
        let text = MODEL
            .replace("value = [3, 6]", "value = [4]")
            .replace("address = 0x0101", "address = 0x0101\ntable = \"input\"");
        check::model(&text).unwrap();
    }

    #[test]
    fn a_bit_is_0_or_1_and_an_input_is_not_written() {
        let ready = "title = \"Ready\"\ntable = \"discrete\"";
        let flag = "flag = \"ready\"\nregister = \"ready\"\nvalues = [1]";
        each_is_told_of(
            COILS,
            &[
                (
                    ready,
                    &format!("{ready}\nscale = 10"),
                    "register[8].scale: a discrete input is 0 or 1 -> leave it out",
                ),
                (
                    "title = \"Ready\"",
                    "title = \"Ready\"\nrole = \"torque\"",
                    "register[8].role: a discrete input is 0 or 1, and this role needs a number -> \
                     leave it out; a state of the drive is a `[[status]]` flag",
                ),
                (
                    "{ \"0\" = \"panel\", \"1\" = \"bus\" }",
                    "{ \"0\" = \"panel\", \"2\" = \"bus\" }",
                    "register[7].address: a coil is 0 or 1, and 2 has a meaning -> `values` of \"0\" and \"1\" only",
                ),
                (
                    "address = 0x1001\nscale = 10\nunit = \"A\"\naccess = \"read\"",
                    "address = 0x1001\nscale = 10\nunit = \"A\"\naccess = \"read-write\"",
                    "register[11].access: an input register cannot be written -> \"read\", or another `table`",
                ),
                (
                    flag,
                    &flag.replace("[1]", "[2]"),
                    "status[3].values[0]: a discrete input is never 2 -> 0 or 1",
                ),
                (
                    flag,
                    &flag.replace("values", "mask = 1\nvalues"),
                    "status[3].mask: a discrete input has no other bits -> leave it out",
                ),
                (
                    "values = [1]\nneeded_for",
                    "values = [3]\nneeded_for",
                    "setup[0].values[0]: a coil is never 3 -> 0 or 1",
                ),
                (
                    "table = \"coil\"\nfrom = 0x0000",
                    "table = \"coils\"\nfrom = 0x0000",
                    "read.area[0].table: `coils` is not an allowed value -> \"coil\"",
                ),
            ],
        );
    }

    #[test]
    fn an_order_in_a_coil_is_0_or_1() {
        each_is_told_of(
            COILS,
            &[
                (
                    "forward = { value = 1,",
                    "forward = { value = 2,",
                    "run.forward.value: a coil is never 2 -> 0 or 1",
                ),
                (
                    "value = 1, clear = 0",
                    "value = 1, clear = 7",
                    "run.reset.clear: a coil is never 7 -> 0 or 1",
                ),
                (
                    "forward = 0, reverse = 1",
                    "forward = 0, reverse = 0xFF00",
                    "run.direction.reverse: a coil is never 65280 -> 0 or 1",
                ),
                (
                    "[[status]]",
                    "[[run.never]]\nvalue = 2\nregister = \"cut_off\"\nconfidence = \"manual\"\nsource = \"IM 5\"\n\n[[status]]",
                    "run.never[0].value: a coil is never 2 -> 0 or 1",
                ),
            ],
        );
        let found = told_with(COILS, "form = \"values\"", "form = \"bits\"");
        assert!(
            found.contains(
                "run.form: a coil has one bit\n    right: \"values\", with the orders 0 and 1"
            ),
            "{found}"
        );
        let reset = "reset = { register = \"fault_reset\", value = 1, clear = 0,";
        let sequence =
            format!("reset_sequence = [0, {{ register = \"fault_reset\", value = 3 }}]\n{reset}");
        let found = told_with(COILS, reset, &sequence);
        assert!(
            found.contains("a coil is never 3\n    right: 0 or 1"),
            "{found}"
        );
        // The same number in another table is another place.
        let found = told_with(COILS, "address = 0x0004", "address = 0x0003");
        assert!(
            found.contains("address coil 0x0003 is taken by register[2].address"),
            "{found}"
        );
    }

    #[test]
    fn a_start_may_wait_for_a_bit() {
        let ready = "[[register]]\nname = \"followed\"\ntitle = \"Followed\"\ntable = \"discrete\"\naddress = 5\nunit = \"-\"\n\
                     access = \"read\"\nconfidence = \"manual\"\nsource = \"IM 6\"\n\n[[register]]";
        let functions = START
            .lines()
            .find(|line| line.starts_with("value = [0x03"))
            .unwrap();
        let until = START
            .lines()
            .find(|line| line.starts_with("until = "))
            .unwrap();
        let text = START.replacen("[[register]]", ready, 1).replacen(
            functions,
            "value = [2, 3, 6, 0x10]",
            1,
        );
        let by_bit = |values: &str| {
            text.replacen(
                until,
                &format!("until = {{ register = \"followed\", {values} }}"),
                1,
            )
        };
        let model = check::model(&by_bit("values = [1]")).unwrap();
        let steps = model.run.unwrap().start.steps;
        assert_eq!(
            steps[0].until.as_ref().unwrap().address.to_string(),
            "discrete 0x0005"
        );
        let found = told_with(
            &by_bit("values = [1]"),
            "\"followed\", values = [1]",
            "\"followed\", mask = 1, values = [1]",
        );
        assert!(
            found.contains("run.start[0].until.mask: a discrete input has no other bits"),
            "{found}"
        );
    }
}
