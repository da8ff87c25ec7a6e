//! Lists of values, and values that must differ.

use super::words::FileWord;
use crate::domain::problem::Problem;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey};
use std::collections::BTreeMap;
use std::fmt::Display;

/// Reports each name that an earlier one has; `whose` says what has them.
pub(super) fn names_differ<'a, T: Ord + Display + 'a>(
    names: impl Iterator<Item = &'a LocatedValue<T>>,
    whose: &str,
    problems: &mut Vec<Problem>,
) {
    let right = format!("a name that no other {whose} uses");
    let called = |name: &T| format!("the name `{name}`");
    differ(names, |name| name, called, &right, problems);
}

/// Reports each value of which an earlier one has the `key`.
pub(super) fn differ<'a, T: 'a, K: Ord>(
    values: impl Iterator<Item = &'a LocatedValue<T>>,
    key: impl Fn(&'a T) -> K,
    called: impl Fn(&T) -> String,
    right: &str,
    problems: &mut Vec<Problem>,
) {
    let mut seen: BTreeMap<K, &KeyLocation> = BTreeMap::new();
    for written in values {
        let key = key(&written.value);
        let Some(first) = seen.get(&key) else {
            seen.insert(key, &written.location);
            continue;
        };
        let what = format!("{} is taken by {}", called(&written.value), first.key);
        written.refuse(what, right, problems);
    }
}

/// Reports each repeated word in `list`.
pub(super) fn once<T: FileWord + PartialEq>(list: &[LocatedValue<T>], problems: &mut Vec<Problem>) {
    for (index, written) in list.iter().enumerate() {
        if has(list.iter().take(index), &written.value) {
            let what = format!("\"{}\" is listed twice", written.value.word());
            written.warn(what, "each once", problems);
        }
    }
}

/// Whether `value` is one of `list`.
pub(super) fn has<'a, T: PartialEq + 'a>(
    list: impl IntoIterator<Item = &'a LocatedValue<T>>,
    value: &T,
) -> bool {
    list.into_iter().any(|written| written.value == *value)
}

/// The values of a list, empty if it is left out; `None` if it is unusable.
pub(super) fn values<T: Clone>(list: &OptionalKey<Vec<LocatedValue<T>>>) -> Option<Vec<T>> {
    some_values(list).map(Option::unwrap_or_default)
}

/// The values of a list: `Some(None)` if it is left out; `None` if it is unusable.
pub(super) fn some_values<T: Clone>(
    list: &OptionalKey<Vec<LocatedValue<T>>>,
) -> Option<Option<Vec<T>>> {
    list.settle(|list| Some(list.iter().map(|written| written.value.clone()).collect()))
}
