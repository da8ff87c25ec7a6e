//! Shared test helpers: sound models, and problems as text.

use super::check;
use crate::domain::problem::Problem;
pub(super) use crate::vendors::testing::MODEL;

/// A model file with one of every possible item.
pub(super) const EVERYTHING: &str = include_str!("../../../../tests/golden/models/everything.toml");

/// A drive that ignores a run command of zeros.
pub(super) const ZERO_IGNORED: &str =
    include_str!("../../../../tests/golden/models/zero-ignored.toml");

/// A drive whose motor runs on after a run command of zeros.
pub(super) const ZERO_NOTHING: &str =
    include_str!("../../../../tests/golden/models/zero-nothing.toml");

/// A drive that coasts with a run command of zeros.
pub(super) const ZERO_COAST: &str = include_str!("../../../../tests/golden/models/zero-coast.toml");

/// One entry per problem: position, key, what is wrong, what would be right.
pub(super) fn problem_lines(problems: &[Problem], text: &str) -> String {
    let lines = problems.iter().map(|problem| {
        let (line, column) = problem.place_in(text);
        let right = problem.right.as_deref().unwrap_or("-");
        format!(
            "{line}:{column} {}: {}\n    right: {right}\n",
            problem.key, problem.what
        )
    });
    lines.collect()
}

/// A sound model whose drive has rules of its own for the exchange of frames.
pub(super) const EXCHANGE: &str = include_str!("../../../../tests/golden/models/exchange.toml");

/// A sound model whose drive takes over and stores parameters by words of their own.
pub(super) const MEMORY: &str = include_str!("../../../../tests/golden/models/memory.toml");

/// A sound model whose drive writes stored registers in RAM by another address.
pub(super) const RAM_FORM: &str = include_str!("../../../../tests/golden/models/ram-form.toml");

/// A sound model whose drive takes some writes without an answer.
pub(super) const UNANSWERED: &str = include_str!("../../../../tests/golden/models/unanswered.toml");

/// Asserts that each replacement in [`EXCHANGE`] is reported, with place, mistake and what would be right.
pub(super) fn each_mistake_is_told(changes: &[(&str, &str, &str)]) {
    check::model(EXCHANGE).unwrap();
    for (from, to, expected) in changes {
        let found = told_with(EXCHANGE, from, to).replace("\n    right: ", " -> ");
        assert!(found.contains(expected), "{from} -> {to}: {found}");
    }
}

/// The problems reported after replacing `from` with `to` in the sound `model`.
pub(super) fn told_with(model: &str, from: &str, to: &str) -> String {
    assert!(model.contains(from), "{from}");
    let text = model.replacen(from, to, 1);
    problem_lines(&check::model(&text).unwrap_err(), &text)
}

/// Asserts that each replacement in [`EVERYTHING`] is reported: a line per problem, with key, what is wrong and what
/// would be right.
pub(super) fn each_is_told(changes: &[(&str, &str, &str)]) {
    each_is_told_of(EVERYTHING, changes);
}

/// Asserts that each replacement in `model` is reported: a line per problem, with key, what is wrong and what would be
/// right.
pub(super) fn each_is_told_of(model: &str, changes: &[(&str, &str, &str)]) {
    check::model(model).unwrap();
    for (from, to, expected) in changes {
        let found = told_with(model, from, to).replace("\n    right: ", " -> ");
        let without_place = |line: &str| line.split_once(' ').unwrap().1.to_owned();
        let found = found
            .lines()
            .map(without_place)
            .collect::<Vec<_>>()
            .join("\n");
        assert_eq!(found, *expected, "{from} -> {to}");
    }
}

/// Compares with the file `name`, or writes it if `UPDATE_GOLDEN` is set.
pub(super) fn golden(name: &str, found: &str) {
    let path = format!(
        "{}/../../tests/golden/models/{name}",
        env!("CARGO_MANIFEST_DIR")
    );
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&path, found).unwrap();
    }
    assert_eq!(found, std::fs::read_to_string(&path).unwrap(), "{path}");
}
