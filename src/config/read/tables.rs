//! Tables and kinds of values shared by several sections.

use super::super::keys;
use crate::toml_file::values::Kind;
use crate::toml_file::{OptionalKey, Reader, Spanned};
use std::path::PathBuf;

/// The tables `[[key]]`, each read by `read`.
pub(super) fn each<'a, T>(
    reader: &mut Reader<'a, '_>,
    key: &'static str,
    read: impl Fn(Reader<'a, '_>) -> T,
) -> Vec<T> {
    let sections = reader.tables(key);
    sections
        .into_iter()
        .map(|section| read(reader.open(section)))
        .collect()
}

/// The table `key`, read by `read`.
pub(super) fn inner<'a, T>(
    reader: &mut Reader<'a, '_>,
    key: &'static str,
    read: impl FnOnce(Reader<'a, '_>) -> T,
) -> OptionalKey<T> {
    match reader.table(key) {
        OptionalKey::Absent => OptionalKey::Absent,
        OptionalKey::Invalid => OptionalKey::Invalid,
        OptionalKey::Valid(Spanned { value, location }) => OptionalKey::Valid(Spanned {
            value: read(reader.open(value)),
            location,
        }),
    }
}

/// Refuses each key of `section` that is known but not supported.
pub(super) fn refuse_not_served(reader: &mut Reader<'_, '_>, section: keys::Section) {
    for key in keys::not_served(section) {
        reader.refuse(key.name, key.refusal(), key.instead);
    }
}

/// An absolute path.
pub(super) fn absolute_path() -> Kind<'static, PathBuf> {
    Kind::parsed("an absolute path", |text| {
        Some(PathBuf::from(text)).filter(|path| path.is_absolute())
    })
}

/// The value converted by `turn`, which accepts every value of the kind.
pub(super) fn turned<T, U>(given: OptionalKey<T>, turn: impl Fn(T) -> Option<U>) -> OptionalKey<U> {
    match given {
        OptionalKey::Absent => OptionalKey::Absent,
        OptionalKey::Invalid => OptionalKey::Invalid,
        OptionalKey::Valid(Spanned { value, location }) => turn(value)
            .map_or(OptionalKey::Invalid, |value| {
                OptionalKey::Valid(Spanned { value, location })
            }),
    }
}
