//! Kinds of values and forms of keys that several tables have.

use crate::domain::problem::Problem;
use crate::toml_file::declare::{KeyForm, listing};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey};
use std::time::Duration;

/// A time of `count` milliseconds.
pub const fn ms(count: u64) -> Duration {
    Duration::from_millis(count)
}

/// A time of `count` seconds.
pub const fn seconds(count: u64) -> Duration {
    Duration::from_secs(count)
}

/// A time that a model may state.
pub fn time() -> ValueKind<'static, Duration> {
    ValueKind::duration(ms(1)..=seconds(60))
}

/// A word of a register.
pub fn word() -> ValueKind<'static, u16> {
    ValueKind::number(0..=u16::MAX)
}

/// Bits of a word.
pub fn mask() -> ValueKind<'static, u16> {
    ValueKind::number(1..=u16::MAX)
}

/// The code of a function.
pub fn function_code() -> ValueKind<'static, u8> {
    ValueKind::number(1..=127)
}

/// A list of at least one value.
pub fn filled_list<'k, T: 'k>(
    kind: ValueKind<'k, T>,
) -> KeyForm<'k, RequiredKey<Vec<LocatedValue<T>>>> {
    let form = KeyForm::of(kind, |reader, key, kind| {
        filled_with(reader.required_list(key, kind)?, kind, reader.problems())
    });
    listing(form).needed()
}

/// A list of at least one value, which may be left out.
pub fn optional_filled_list<'k, T: 'k>(
    kind: ValueKind<'k, T>,
) -> KeyForm<'k, OptionalKey<Vec<LocatedValue<T>>>> {
    listing(KeyForm::of(kind, |reader, key, kind| {
        match reader.list(key, kind) {
            OptionalKey::Valid(list) => filled_with(list, kind, reader.problems())
                .map_or(OptionalKey::Invalid, OptionalKey::Valid),
            other => other,
        }
    }))
}

/// `list` if it has at least one element.
fn filled_with<T>(
    list: LocatedValue<Vec<LocatedValue<T>>>,
    kind: &ValueKind<'_, T>,
    problems: &mut Vec<Problem>,
) -> RequiredKey<Vec<LocatedValue<T>>> {
    if list.value.is_empty() {
        problems.push(
            list.location
                .problem("is empty")
                .right(format!("at least {}", kind.right())),
        );
        return None;
    }
    Some(list)
}

/// Values without their locations.
pub fn values_of<T: Clone>(list: &[LocatedValue<T>]) -> Vec<T> {
    list.iter().map(|written| written.value.clone()).collect()
}

/// Text that is not blank.
pub fn filled(text: &str) -> Option<String> {
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}
