//! The rules between functions, reads, writes and barriers.

use super::tables;
use crate::domain::address::{Address, DataTable};
use crate::domain::link::Framing;
use crate::domain::problem::Problem;
use crate::profile::file::{BarrierFile, BarrierForm, BlockFile, ModelFile, ReadFile};
use crate::profile::model::{RefusedWrite, RegisterAccess};
use crate::profile::register::has_decimal_digits;
use crate::toml_file::LocatedValue;
use crate::wire::exception::ILLEGAL_FUNCTION;
use crate::wire::pdu::function;
use std::collections::BTreeSet;

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    functions_suffice(file, problems);
    ascii_is_there(file, problems);
    block_is_writable(file, problems);
    replies_carry_values(file, problems);
    exceptions_are_of_one_kind(file, problems);
    areas_are_apart(file, problems);
    frames_are_short(file, problems);
    for barrier in &file.barriers {
        barrier_is_sound(barrier, file, problems);
    }
}

/// The drive serves the functions used for reading, commanding and broadcasting.
fn functions_suffice(file: &ModelFile, problems: &mut Vec<Problem>) {
    let Some(LocatedValue {
        value: served,
        location,
    }) = &file.functions.value
    else {
        return;
    };
    tables::are_served(file, served, location, problems);
    let broadcast = file
        .link
        .as_ref()
        .and_then(|link| link.broadcast.as_ref()?.value.as_ref());
    let Some(broadcast) = broadcast.and_then(|it| it.value.functions.as_ref()) else {
        return;
    };
    if let Some(function) = broadcast
        .value
        .iter()
        .map(|function| function.value)
        .find(|function| !served.contains(function))
    {
        let problem = broadcast
            .location
            .problem(format!("function {function:02X} hex is not in `functions`"));
        problems.push(problem.right("functions listed in `functions`"));
    }
}

/// Whether the drive serves `function`; `None` if the list is unusable.
fn serves(function: u8, file: &ModelFile) -> Option<bool> {
    Some(file.functions.value.as_ref()?.value.contains(&function))
}

/// Only a drive that understands ASCII frames may have a limit for them.
fn ascii_is_there(file: &ModelFile, problems: &mut Vec<Problem>) {
    let words = file
        .read
        .as_ref()
        .and_then(|read| read.max_words_ascii.as_ref()?.value.as_ref());
    let framings = file
        .link
        .as_ref()
        .and_then(|link| link.framings.value.as_ref());
    let (Some(words), Some(framings)) = (words, framings) else {
        return;
    };
    if !framings.value.contains(&Framing::Ascii) {
        let problem = words
            .location
            .problem("the model does not support ASCII framing");
        problems.push(
            problem.right("leave it out, or \"ascii\" in `link.framings` if the manual names it"),
        );
    }
}

/// Every register of a block is writable, and the drive serves the function that writes blocks.
fn block_is_writable(file: &ModelFile, problems: &mut Vec<Problem>) {
    let block = file
        .write
        .as_ref()
        .and_then(|write| write.block.as_ref()?.value.as_ref());
    let Some(LocatedValue {
        value: block,
        location,
    }) = block
    else {
        return;
    };
    let of_bits = block
        .table
        .valid()
        .is_some_and(|table| table.value.is_of_bits());
    let function = if of_bits {
        function::WRITE_COILS
    } else {
        function::WRITE_MULTIPLE
    };
    if serves(function, file) == Some(false) {
        let problem = location.problem(format!(
            "writing a block requires function {function:02X} hex"
        ));
        problems.push(problem.right(format!(
            "leave it out, or 0x{function:02X} in `functions` if the manual names it"
        )));
    }
    if let Some(address) = first_without(block, RegisterAccess::can_write, file) {
        let problem = location.problem(format!("there is no writable register at {address}"));
        problems.push(problem.right("a range of writable registers only"));
    }
}

/// What the value in a reply says needs replies with a value: those to function 10 hex have none.
fn replies_carry_values(file: &ModelFile, problems: &mut Vec<Problem>) {
    let refused = file
        .write
        .as_ref()
        .and_then(|write| write.refused.value.as_ref());
    let Some(refused) = refused.filter(|it| it.value != RefusedWrite::Exception) else {
        return;
    };
    if serves(0x06, file) == Some(false) {
        let problem = refused
            .location
            .problem("the reply to a write by function 10 hex carries no value");
        problems.push(problem.right("\"exception\", or add 0x06 to `functions`"));
    }
}

/// A barrier that is refused with exception 01 needs that exception to mean nothing else.
fn exceptions_are_of_one_kind(file: &ModelFile, problems: &mut Vec<Problem>) {
    let is_refused =
        |barrier: &BarrierFile| matches!(barrier.form(), Some(BarrierForm::Refused(_)));
    if !file.barriers.iter().any(is_refused) {
        return;
    }
    let is_first = |code: &u16| *code == u16::from(ILLEGAL_FUNCTION);
    let firsts = file
        .exceptions
        .iter()
        .filter(|it| it.code.as_ref().is_some_and(|code| is_first(&code.value)));
    for kind in firsts.filter_map(|it| it.kind.valid()) {
        let problem = kind
            .location
            .problem("a barrier takes exception 01 for the refusal of its function");
        problems.push(problem.right("leave it out, or no `refused_function`"));
    }
}

/// Areas of reads are ranges that do not overlap.
fn areas_are_apart(file: &ModelFile, problems: &mut Vec<Problem>) {
    let areas = file.read.iter().flat_map(|read| &read.areas);
    let mut ranges: Vec<(DataTable, u16, u16)> = Vec::new();
    for area in areas {
        let (Some(from), Some(to), Some(table)) = (&area.from, &area.to, area.table()) else {
            continue;
        };
        if from.value > to.value {
            let problem = to.location.problem(format!(
                "the area ends before it begins, at 0x{:04X}",
                from.value
            ));
            problems.push(problem.right("the last address of the area"));
        } else if let Some((_, first, last)) = ranges.iter().find(|(other, first, last)| {
            *other == table && *first <= to.value && from.value <= *last
        }) {
            let problem = from.location.problem(format!(
                "overlaps the area from 0x{first:04X} to 0x{last:04X}"
            ));
            problems.push(problem.right("areas without a common address"));
        }
        if file
            .quirks
            .valid()
            .is_some_and(|quirks| quirks.value.decimal_numbers.is_some())
        {
            let problem = from
                .location
                .problem("the words of an area cannot be counted in decimal addresses");
            problems.push(problem.right("no areas, or no `decimal_numbers`"));
        }
        ranges.push((table, from.value, to.value));
    }
}

/// Writes fit into the longest frame.
fn frames_are_short(file: &ModelFile, problems: &mut Vec<Problem>) {
    let most = file
        .read
        .as_ref()
        .and_then(|read| read.max_bytes.as_ref()?.value.as_ref());
    let block = file
        .write
        .as_ref()
        .and_then(|write| write.block.as_ref()?.value.as_ref()?.value.count.as_ref());
    let (Some(most), Some(count)) = (most, block) else {
        return;
    };
    let words = (most.value - WRITE_BYTES) / 2;
    if count.value > words {
        let what = format!(
            "a write of {} words is longer than `read.max_bytes`",
            count.value
        );
        problems.push(
            count
                .location
                .problem(what)
                .right(format!("at most {words}")),
        );
    }
}

/// Bytes of a write by function 10 hex that are not words.
const WRITE_BYTES: u16 = 9;

/// A barrier can be sent, and its reply cannot be mistaken for that to another request.
fn barrier_is_sound(barrier: &BarrierFile, file: &ModelFile, problems: &mut Vec<Problem>) {
    match barrier.form() {
        None => {}
        Some(BarrierForm::Read(block)) => read_is_sound(block, barrier, file, problems),
        Some(BarrierForm::LoopTest(_)) if serves(0x08, file) == Some(false) => {
            let problem = barrier
                .location
                .problem("the drive does not serve the loop test");
            problems.push(
                problem.right("another barrier, or 0x08 in `functions` if the manual names it"),
            );
        }
        Some(BarrierForm::LoopTest(_)) => {}
        Some(BarrierForm::Refused(function)) => {
            let function = function.value.as_ref();
            if let Some(function) = function.filter(|it| serves(it.value, file) == Some(true)) {
                let what = format!(
                    "function {:02X} hex is served, so the drive does not refuse it",
                    function.value
                );
                problems.push(
                    function
                        .location
                        .problem(what)
                        .right("a function that is not in `functions`"),
                );
            }
        }
    }
}

/// A barrier read fits into one read and covers readable registers only.
fn read_is_sound(
    block: &BlockFile,
    barrier: &BarrierFile,
    file: &ModelFile,
    problems: &mut Vec<Problem>,
) {
    let limits = file.read.as_ref().and_then(ReadFile::ready);
    if limits
        .as_ref()
        .is_some_and(|limits| limits.max_words.value == 1)
    {
        let problem = barrier
            .location
            .problem("with at most one word per read, all reads look alike");
        problems.push(problem.right(
            "leave it out, or `loop_test` or `refused_function` if the documents show them",
        ));
        return;
    }
    let (Some(address), Some(count)) = (block.first(), &block.count) else {
        return;
    };
    let most = limits.map(|limits| {
        let ascii = limits
            .max_words_ascii
            .as_ref()
            .map_or(u16::MAX, |words| words.value);
        limits.words_at(address).min(ascii)
    });
    if let Some(most) = most.filter(|most| *most < count.value) {
        let problem = count
            .location
            .problem("more words than one read from this address may cover");
        problems.push(problem.right(format!("at most {most}")));
        return;
    }
    if let Some(address) = first_without(block, RegisterAccess::can_read, file) {
        let what = format!("there is no readable register at {address}");
        problems.push(
            barrier
                .location
                .problem(what)
                .right("a range of readable registers only"),
        );
    }
}

/// The first address of `block` without a register that `may`; `None` if there is none, or if a register is too
/// incomplete to decide.
fn first_without(
    block: &BlockFile,
    may: impl Fn(RegisterAccess) -> bool,
    file: &ModelFile,
) -> Option<Address> {
    let first = block.first()?;
    let count = block.count.as_ref()?.value;
    let mut fit = BTreeSet::new();
    for register in &file.registers {
        let words = if register.form.is_pair() { 2 } else { 1 };
        let is_fit = may(register.access.as_ref()?.value);
        let place = register.place()?.value;
        if is_fit {
            fit.extend(place.onwards().take(words));
        }
    }
    let in_decimal = file
        .quirks
        .valid()
        .is_some_and(|quirks| quirks.value.decimal_numbers.is_some());
    let counts = |address: &Address| !in_decimal || has_decimal_digits(address.number());
    first
        .onwards()
        .filter(counts)
        .take(count.into())
        .find(|address| !fit.contains(address))
}

#[cfg(test)]
mod tests {
    use crate::profile::check::model;
    use crate::profile::testing::{
        EVERYTHING, MODEL, each_is_told, each_mistake_is_told, told_with,
    };

    #[test]
    fn functions_are_those_that_the_rest_needs() {
        each_is_told(&[
            (
                "[0x03, 0x06, 0x08, 0x10]",
                "[0x06, 0x08, 0x10]",
                "functions.value: registers are read by function 03, and it is not served -> \
                 a list with 0x03, if the manual names it",
            ),
            (
                "[0x03, 0x06, 0x08, 0x10]",
                "[0x03, 0x06, 0x08]",
                "write.block: writing a block requires function 10 hex -> leave it out, or 0x10 in `functions` if the manual names it",
            ),
            (
                "[0x03, 0x06, 0x08, 0x10]",
                "[0x03, 0x06, 0x10]",
                "barrier[1]: the drive does not serve the loop test -> another barrier, or 0x08 in `functions` if the manual names it",
            ),
            (
                "[0x03, 0x06, 0x08, 0x10]",
                "[0x03, 0x06, 0x08, 0x10, 0x2B]",
                "barrier[2].refused_function.value: function 2B hex is served, so the drive does not refuse it -> \
                 a function that is not in `functions`",
            ),
            (
                "functions = [6]",
                "functions = [6, 5]",
                "link.broadcast.functions: function 05 hex is not in `functions` -> functions listed in `functions`",
            ),
        ]);
    }

    #[test]
    fn areas_and_frames_are_such_as_can_be_read() {
        let area = "[[read.area]]\nfrom = 0x0100\nto = 0x01FF\n";
        let another = format!(
            "[[read.area]]\nfrom = 0x01FF\nto = 0x02FF\nmax_words = 1\nconfidence = \"manual\"\nsource = \"IM 3\"\n\n{area}"
        );
        each_mistake_is_told(&[
            (
                area,
                "[[read.area]]\nfrom = 0x0100\nto = 0x00FF\n",
                "read.area[0].to: the area ends before it begins, at 0x0100 -> the last address of the area",
            ),
            (
                area,
                &another,
                "read.area[1].from: overlaps the area from 0x01FF to 0x02FF -> areas without a common address",
            ),
            (
                "[run]\n",
                "[quirks]\ndecimal_numbers = { confidence = \"manual\", source = \"IM 3\" }\n\n[run]\n",
                "read.area[0].from: the words of an area cannot be counted in decimal addresses -> \
                 no areas, or no `decimal_numbers`",
            ),
            (
                "holes = { value = \"zero\"",
                "holes = { value = \"empty\"",
                "read.holes.value: `empty` is not an allowed value -> one of \"refused\", \"zero\", \"read\"",
            ),
            (
                "max_bytes = { value = 21",
                "max_bytes = { value = 10",
                "read.max_bytes.value: 10 is out of range -> a whole number from 11 to 256",
            ),
        ]);
        let block = "block = { address = 0x2000, count = 2";
        let narrow =
            "max_bytes = { value = 11, confidence = \"manual\", source = \"IM 3\" }\n\n[write]\n";
        let found = told_with(
            &EVERYTHING.replacen("[write]\n", narrow, 1),
            block,
            &block.replace("count = 2", "count = 3"),
        );
        let expected = "write.block.count: a write of 3 words is longer than `read.max_bytes`\n    right: at most 1\n";
        assert!(found.contains(expected), "{found}");
    }

    #[test]
    fn a_reply_without_a_value_says_nothing_about_it() {
        let expected = "write.refused.value: the reply to a write by function 10 hex carries no value -> \
                        \"exception\", or add 0x06 to `functions`";
        each_mistake_is_told(&[("value = [3, 6]", "value = [3, 0x10]", expected)]);
    }

    #[test]
    fn an_exception_on_which_a_barrier_rests_means_nothing_else() {
        each_mistake_is_told(&[(
            "kind = \"busy\"",
            "kind = \"bussy\"",
            "exception[2].kind: `bussy` is not an allowed value -> \"busy\"",
        )]);
        let first = "code = 2\ntext = \"no such register\"";
        let found = told_with(
            EVERYTHING,
            first,
            "code = 1\ntext = \"no\"\nkind = \"in-trip\"",
        );
        let expected = "exception[1].kind: a barrier takes exception 01 for the refusal of its function\n    \
                        right: leave it out, or no `refused_function`\n";
        assert!(found.contains(expected), "{found}");
    }

    #[test]
    fn run_commands_need_the_function_that_writes_them() {
        let found = told_with(EVERYTHING, "[0x03, 0x06, 0x08, 0x10]", "[0x03, 0x08]");
        let expected = "functions.value: run commands are written by function 06 or 10 hex, and neither is served\n";
        assert!(found.contains(expected), "{found}");
        let found = told_with(EVERYTHING, "[0x03, 0x06, 0x08, 0x10]", "[0x03, 0x08, 0x10]");
        assert!(!found.contains("run commands"), "10 hex is enough: {found}");
    }

    #[test]
    fn ascii_limits_need_ascii_frames() {
        each_is_told(&[(
            "value = [\"rtu\", \"ascii\"]",
            "value = [\"rtu\"]",
            "read.max_words_ascii.value: the model does not support ASCII framing -> \
             leave it out, or \"ascii\" in `link.framings` if the manual names it",
        )]);
    }

    #[test]
    fn a_block_is_writable_as_a_whole() {
        each_is_told(&[(
            "block = { address = 0x2000, count = 2",
            "block = { address = 0x2001, count = 3",
            "write.block: there is no writable register at 0x2003 -> \
             a range of writable registers only",
        )]);
    }

    #[test]
    fn a_barrier_has_one_form() {
        each_is_told(&[
            (
                "loop_test = { confidence = \"manual\", source = \"IM 3.5\" }\n",
                "",
                "barrier[1]: is not a barrier -> exactly one of `read`, `loop_test` and `refused_function`",
            ),
            (
                "loop_test = {",
                "read = { address = 0x2100, count = 1 }\nloop_test = {",
                "barrier[1]: has more than one form -> exactly one of `read`, `loop_test` and `refused_function`",
            ),
        ]);
    }

    #[test]
    fn barriers_keep_to_what_one_read_may_have() {
        each_is_told(&[
            (
                "read = { address = 0x2100, count = 2 }",
                "read = { address = 0x2100, count = 5 }",
                "barrier[0].read.count: more words than one read from this address may cover -> at most 4",
            ),
            (
                "read = { address = 0x2100, count = 2 }",
                "read = { address = 0x2102, count = 3 }",
                "barrier[0]: there is no readable register at 0x2104 -> a range of readable registers only",
            ),
        ]);
        let barrier = "boundary = \"high-byte\"\n\n[[barrier]]\nread = { address = 0x01FF, count = 2 }\n\n[write]";
        assert!(told_with(MODEL, "[write]", barrier).contains("right: at most 1\n"));
    }

    #[test]
    fn a_read_is_no_barrier_where_every_read_looks_the_same() {
        each_is_told(&[(
            "max_words = { value = 16",
            "max_words = { value = 1",
            "barrier[0]: with at most one word per read, all reads look alike -> \
                 leave it out, or `loop_test` or `refused_function` if the documents show them",
        )]);
    }

    #[test]
    fn a_range_follows_the_drive_in_its_counting() {
        let barrier = |address: &str| format!("read = {{ address = {address}, count = 2 }}");
        let register = |address: &str| {
            format!(
                "[[register]]\nname = \"next\"\ntitle = \"Next\"\naddress = {address}\nunit = \"-\"\n\
                 access = \"read\"\nconfidence = \"manual\"\nsource = \"IM 6\"\n\n[[register]]\nname = \"status\""
            )
        };
        let text = EVERYTHING
            .replacen(&barrier("0x2100"), &barrier("0x3009"), 1)
            .replacen("[[register]]\nname = \"status\"", &register("0x3010"), 1);
        assert_eq!(model(&text).err(), None);
    }
}
