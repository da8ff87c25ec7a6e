//! The rules for registers whose write is not answered.

use crate::domain::problem::Problem;
use crate::profile::file::{CommitWordFile, ModelFile};
use crate::profile::model::{OrderKind, RegisterRole};
use crate::profile::register::RegisterFile;
use crate::toml_file::OptionalKey;

/// All orders but a reset.
const OTHERS: [OrderKind; 5] = [
    OrderKind::Stop,
    OrderKind::Forward,
    OrderKind::Reverse,
    OrderKind::Coast,
    OrderKind::Release,
];

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    for register in &file.registers {
        let Some(silence) = register.no_reply.valid().filter(|silence| silence.value) else {
            continue;
        };
        let mut wrong =
            |what: &str, right: &str| problems.push(silence.location.problem(what).right(right));
        if register
            .access
            .as_ref()
            .is_some_and(|access| !access.value.can_write())
        {
            wrong(
                "the register cannot be written",
                "leave it out, or use access \"write\" or \"read-write\"",
            );
        } else if takes_an_order_that_must_be_answered(register, file) {
            wrong(
                "a drive that does not answer an order cannot be known to follow it",
                "leave it out: of all orders, only a reset may have no answer",
            );
        } else if is_a_commit(register, file) {
            wrong(
                "nothing else shows that parameters were taken over",
                "leave it out",
            );
        } else if is_in_the_block(register, file) {
            wrong(
                "the register is in the block of `write`, which is answered",
                "leave it out, or a smaller block",
            );
        } else if matches!(register.deaf_after, OptionalKey::Absent) {
            wrong(
                "it is not stated how long the drive is left alone then",
                "`deaf_after` beside it: how long it takes until the drive hears again",
            );
        }
    }
}

/// Whether the register takes a run command, a setpoint, or any order but a reset.
fn takes_an_order_that_must_be_answered(register: &RegisterFile, file: &ModelFile) -> bool {
    let role = register.role.valid().map(|role| role.value);
    if matches!(
        role,
        Some(RegisterRole::RunCommand | RegisterRole::FrequencyCommand)
    ) {
        return true;
    }
    let Some(run) = file.run.valid().map(|run| &run.value) else {
        return false;
    };
    let reset = run.named(OrderKind::Reset).map(|name| name.value.as_str());
    let takes_another = OTHERS.into_iter().filter_map(|kind| run.named(kind));
    // The direction is written before the run command.
    let named = run
        .names()
        .filter(|name| Some(name.value.as_str()) != reset);
    takes_another
        .chain(named)
        .any(|name| Some(name.value.as_str()) == register.name())
}

fn is_a_commit(register: &RegisterFile, file: &ModelFile) -> bool {
    let words = file
        .commit
        .valid()
        .into_iter()
        .flat_map(|commit| commit.value.words());
    let name = |word: &CommitWordFile| word.register.as_ref().map(|name| name.value.clone());
    words
        .filter_map(name)
        .any(|name| Some(name.as_str()) == register.name())
}

fn is_in_the_block(register: &RegisterFile, file: &ModelFile) -> bool {
    let block = file
        .write
        .as_ref()
        .and_then(|write| write.block.as_ref()?.value.as_ref());
    let Some(block) = block.map(|block| &block.value) else {
        return false;
    };
    let (Some(first), Some(count), Some(place)) = (block.first(), &block.count, register.place())
    else {
        return false;
    };
    place
        .value
        .offset_from(first)
        .is_some_and(|offset| offset < count.value)
}

#[cfg(test)]
mod tests {
    use crate::profile::testing::{MEMORY, UNANSWERED, each_is_told_of};

    #[test]
    fn only_what_is_read_afterwards_may_have_no_answer() {
        let order = "a drive that does not answer an order cannot be known to follow it -> \
                     leave it out: of all orders, only a reset may have no answer";
        each_is_told_of(
            UNANSWERED,
            &[
                (
                    "role = \"frequency-command\"",
                    "role = \"frequency-command\"\nno_reply = true",
                    &format!("register[1].no_reply: {order}"),
                ),
                (
                    "role = \"run-command\"",
                    "role = \"run-command\"\nno_reply = true",
                    &format!("register[0].no_reply: {order}"),
                ),
                (
                    "stop = { value = 1,",
                    "stop = { register = \"restart\", value = 1,",
                    &format!("register[5].no_reply: {order}"),
                ),
                (
                    "deaf_after = \"500ms\"\n",
                    "",
                    "register[7].no_reply: it is not stated how long the drive is left alone then -> \
                     `deaf_after` beside it: how long it takes until the drive hears again",
                ),
                (
                    "refused = { value = \"exception\", confidence = \"manual\", source = \"IM 3\" }",
                    "refused = { value = \"exception\", confidence = \"manual\", source = \"IM 3\" }\n\
                     block = { address = 0x0101, count = 2, confidence = \"manual\", source = \"IM 3\" }",
                    "register[6].no_reply: the register is in the block of `write`, which is answered -> \
                     leave it out, or a smaller block\n\
                     register[7].no_reply: the register is in the block of `write`, which is answered -> \
                     leave it out, or a smaller block",
                ),
                (
                    "title = \"Status word\"",
                    "title = \"Status word\"\nno_reply = true",
                    "register[2].no_reply: the register cannot be written -> \
                     leave it out, or use access \"write\" or \"read-write\"",
                ),
            ],
        );
        each_is_told_of(
            MEMORY,
            &[(
                "title = \"Stores all parameters\"",
                "title = \"Stores all parameters\"\nno_reply = true",
                "register[8].no_reply: nothing else shows that parameters were taken over -> leave it out",
            )],
        );
    }
}
