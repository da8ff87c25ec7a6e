//! Tables and kinds of values shared by several sections.

use super::super::keys;
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, TableReader};
use std::path::PathBuf;

/// The tables `[[key]]`, each read by `read`.
pub(super) fn each<'a, T>(
    reader: &mut TableReader<'a, '_>,
    key: &'static str,
    read: impl Fn(TableReader<'a, '_>) -> T,
) -> Vec<T> {
    let sections = reader.tables(key);
    sections
        .into_iter()
        .map(|section| read(reader.open(section)))
        .collect()
}

/// The table `key`, read by `read`.
pub(super) fn inner<'a, T>(
    reader: &mut TableReader<'a, '_>,
    key: &'static str,
    read: impl FnOnce(TableReader<'a, '_>) -> T,
) -> OptionalKey<T> {
    match reader.table(key) {
        OptionalKey::Absent => OptionalKey::Absent,
        OptionalKey::Invalid => OptionalKey::Invalid,
        OptionalKey::Valid(LocatedValue { value, location }) => OptionalKey::Valid(LocatedValue {
            value: read(reader.open(value)),
            location,
        }),
    }
}

/// Refuses each key of `section` that is known but not supported.
pub(super) fn refuse_not_served(reader: &mut TableReader<'_, '_>, section: keys::ConfigSection) {
    for key in keys::not_served(section) {
        reader.refuse(key.name, key.refusal(), key.instead);
    }
}

/// An absolute path.
pub(super) fn absolute_path() -> ValueKind<'static, PathBuf> {
    ValueKind::parsed("an absolute path", |text| {
        Some(PathBuf::from(text)).filter(|path| path.is_absolute())
    })
}

/// The value converted by `turn`, which accepts every value of the kind.
pub(super) fn turned<T, U>(given: OptionalKey<T>, turn: impl Fn(T) -> Option<U>) -> OptionalKey<U> {
    match given {
        OptionalKey::Absent => OptionalKey::Absent,
        OptionalKey::Invalid => OptionalKey::Invalid,
        OptionalKey::Valid(LocatedValue { value, location }) => turn(value)
            .map_or(OptionalKey::Invalid, |value| {
                OptionalKey::Valid(LocatedValue { value, location })
            }),
    }
}
