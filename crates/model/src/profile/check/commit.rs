//! The rules for the words that take over or store parameters.

use super::keys::there;
use crate::domain::problem::Problem;
use crate::profile::file::{CommitFile, CommitWordFile, ModelFile};
use crate::profile::register::RegisterFile;
use crate::toml_file::{LocatedValue, OptionalKey};

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    let OptionalKey::Valid(LocatedValue {
        value: commit,
        location,
    }) = &file.commit
    else {
        return;
    };
    if matches!(
        (&commit.apply, &commit.store),
        (OptionalKey::Absent, OptionalKey::Absent)
    ) {
        problems.push(
            location
                .problem("states no word")
                .right("a table `apply` or `store`, or leave it out"),
        );
    }
    for word in commit.words() {
        is_written_by_nobody_else(word, &file.registers, problems);
    }
    words_differ(commit, problems);
}

/// The register is there for this alone: a client that wrote it could wear out the drive's memory, or apply what
/// another client only tried.
fn is_written_by_nobody_else(
    word: &CommitWordFile,
    registers: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    let Some(name) = &word.register else { return };
    let Some(register) = there(name, registers, problems) else {
        return;
    };
    let problem = |what: &str| name.location.problem(format!("`{}` {what}", name.value));
    if register
        .access
        .as_ref()
        .is_some_and(|access| !access.value.can_write())
    {
        problems.push(
            problem("is not writable").right("a register with access \"write\" or \"read-write\""),
        );
    } else if matches!(register.role, OptionalKey::Valid(_)) {
        problems.push(problem("has a role").right("the register that is there for this alone"));
    } else if matches!(register.back_door, OptionalKey::Absent) {
        let right = "`back_door` in that register, with the reason: only the gateway may write it";
        problems.push(problem("is open to clients").right(right));
    }
}

/// A word that does both is the one that stores.
fn words_differ(commit: &CommitFile, problems: &mut Vec<Problem>) {
    let [apply, store] = [&commit.apply, &commit.store].map(|word| {
        let word = &word.valid()?.value;
        Some((
            &word.register.as_ref()?.value,
            word.value.as_ref()?.value,
            &word.location,
        ))
    });
    if let (Some((name, word, location)), Some((other, stores, _))) = (apply, store)
        && (name, word) == (other, stores)
    {
        let problem = location
            .problem("is the word of `commit.store`, which is written as often as a memory lasts");
        problems
            .push(problem.right("another word, or leave it out: the one that stores applies too"));
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::testing::{MEMORY, each_is_told_of};

    #[test]
    fn a_commit_is_written_by_the_gateway_alone() {
        each_is_told_of(
            MEMORY,
            &[
                (
                    "register = \"enter\"",
                    "register = \"entre\"",
                    "commit.apply.register: there is no register called `entre` -> `enter`",
                ),
                (
                    "register = \"enter\"",
                    "register = \"status\"",
                    "commit.apply.register: `status` is not writable -> a register with access \"write\" or \"read-write\"",
                ),
                (
                    "register = \"enter\"",
                    "register = \"run_command\"",
                    "commit.apply.register: `run_command` has a role -> the register that is there for this alone",
                ),
                (
                    "back_door = \"it takes over what was only tried\"\n",
                    "",
                    "commit.apply.register: `enter` is open to clients -> \
                     `back_door` in that register, with the reason: only the gateway may write it",
                ),
                (
                    "register = \"enter\"\nvalue = 1",
                    "register = \"save\"\nvalue = 2",
                    "commit.apply: is the word of `commit.store`, which is written as often as a memory lasts -> \
                     another word, or leave it out: the one that stores applies too",
                ),
                (
                    "at_standstill = true",
                    "at_standstill = 1",
                    "commit.store.at_standstill: must be true or false, not a whole number -> true or false",
                ),
            ],
        );
    }
}
