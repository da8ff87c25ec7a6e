//! Lists of words for enumerations.

use super::words::{ACTIONS, DIRECTIONS, ROLE_RIGHTS, RoleRight, WAYS, Way};
use crate::domain::command::Direction;
use crate::domain::control::ControlAction;
use crate::domain::problem::Problem;
use crate::north::mqtt::Tree;
use crate::toml_file::words::word_for;
use crate::toml_file::{OptionalKey, Spanned};

/// A value that a file writes as a word.
pub(super) trait Word {
    fn word(&self) -> &'static str;
}

impl Word for Way {
    fn word(&self) -> &'static str {
        word_for(&WAYS, self)
    }
}

impl Word for RoleRight {
    fn word(&self) -> &'static str {
        word_for(&ROLE_RIGHTS, self)
    }
}

impl Word for Direction {
    fn word(&self) -> &'static str {
        word_for(&DIRECTIONS, self)
    }
}

impl Word for ControlAction {
    fn word(&self) -> &'static str {
        word_for(&ACTIONS, self)
    }
}

impl Word for Tree {
    fn word(&self) -> &'static str {
        Self::word(*self)
    }
}

/// Reports each repeated word in `list`.
pub(super) fn once<T: Word + PartialEq>(list: &[Spanned<T>], problems: &mut Vec<Problem>) {
    for (index, written) in list.iter().enumerate() {
        if list
            .iter()
            .take(index)
            .any(|earlier| earlier.value == written.value)
        {
            let problem = written
                .location
                .problem(format!("\"{}\" is listed twice", written.value.word()));
            problems.push(problem.right("each once").warning());
        }
    }
}

/// The values of a list, empty if it is left out; `None` if it is unusable.
pub(super) fn values<T: Clone>(list: &OptionalKey<Vec<Spanned<T>>>) -> Option<Vec<T>> {
    match list {
        OptionalKey::Absent => Some(Vec::new()),
        OptionalKey::Invalid => None,
        OptionalKey::Valid(list) => Some(
            list.value
                .iter()
                .map(|written| written.value.clone())
                .collect(),
        ),
    }
}
