//! Lists of words for enumerations.

use super::words::{ACTIONS, CommandInterface, DIRECTIONS, ROLE_RIGHTS, RoleRight, WAYS};
use crate::domain::command::Direction;
use crate::domain::control::ControlAction;
use crate::domain::problem::Problem;
use crate::north::mqtt::TopicTree;
use crate::toml_file::words::word_for;
use crate::toml_file::{LocatedValue, OptionalKey};

/// A value that a file writes as a word.
pub(super) trait FileWord {
    fn keyword(&self) -> &'static str;
}

impl FileWord for CommandInterface {
    fn keyword(&self) -> &'static str {
        word_for(&WAYS, self)
    }
}

impl FileWord for RoleRight {
    fn keyword(&self) -> &'static str {
        word_for(&ROLE_RIGHTS, self)
    }
}

impl FileWord for Direction {
    fn keyword(&self) -> &'static str {
        word_for(&DIRECTIONS, self)
    }
}

impl FileWord for ControlAction {
    fn keyword(&self) -> &'static str {
        word_for(&ACTIONS, self)
    }
}

impl FileWord for TopicTree {
    fn keyword(&self) -> &'static str {
        Self::keyword(*self)
    }
}

/// Reports each repeated word in `list`.
pub(super) fn once<T: FileWord + PartialEq>(list: &[LocatedValue<T>], problems: &mut Vec<Problem>) {
    for (index, written) in list.iter().enumerate() {
        if list
            .iter()
            .take(index)
            .any(|earlier| earlier.value == written.value)
        {
            let problem = written
                .location
                .problem(format!("\"{}\" is listed twice", written.value.keyword()));
            problems.push(problem.right("each once").warning());
        }
    }
}

/// The values of a list, empty if it is left out; `None` if it is unusable.
pub(super) fn values<T: Clone>(list: &OptionalKey<Vec<LocatedValue<T>>>) -> Option<Vec<T>> {
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
