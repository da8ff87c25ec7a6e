//! What a file says in place of the file that it begins from, and what it leaves out.

use crate::domain::problem::{Problem, nearest};
use crate::toml_file::LocatedValue;
use serde_spanned::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

/// Lists of tables whose rows are identified by a key. A row of the file takes the place of the row with the same key;
/// any other list takes the place of the whole list.
pub(in crate::profile) const ROWS: [(&str, &[&str]); 9] = [
    ("register", &["name"]),
    ("status", &["flag"]),
    ("trip", &["code", "bit"]),
    ("warning", &["code", "bit"]),
    ("exception", &["code"]),
    ("setup", &["what"]),
    ("run.bit", &["bit"]),
    ("run.field", &["mask"]),
    ("read.area", &["from"]),
];

/// `base` with everything that `own` says in its place. A fact is replaced as a whole, so that no value keeps the source
/// of another one; a table that is no fact is merged key by key. Rows of `own` come first.
pub(super) fn merged<'s>(own: DeTable<'s>, base: DeTable<'s>) -> DeTable<'s> {
    merged_at("", own, base)
}

fn merged_at<'s>(path: &str, mut own: DeTable<'s>, base: DeTable<'s>) -> DeTable<'s> {
    for (key, value) in base {
        let inner = joined(path, key.get_ref());
        let Some(own_value) = own.remove(&**key.get_ref()) else {
            own.insert(key, value);
            continue;
        };
        let span = own_value.span();
        let value = match (own_value.into_inner(), value.into_inner()) {
            (DeValue::Table(one), DeValue::Table(other)) if !is_fact(&one) && !is_fact(&other) => {
                DeValue::Table(merged_at(&inner, one, other))
            }
            (DeValue::Array(one), DeValue::Array(other)) => match keys_of_rows(&inner) {
                Some(keys) => DeValue::Array(rows(keys, one, other)),
                None => DeValue::Array(one),
            },
            (one, _) => one,
        };
        // With the place of the other file: printed, the whole is in its order.
        own.insert(key, Spanned::new(span, value));
    }
    own
}

fn rows<'s>(keys: &[&str], own: DeArray<'s>, base: DeArray<'s>) -> DeArray<'s> {
    let taken: Vec<_> = own
        .iter()
        .filter_map(|row| row_name(keys, row.get_ref()))
        .collect();
    let is_free = |row: &Spanned<DeValue<'_>>| {
        row_name(keys, row.get_ref()).is_none_or(|name| !taken.contains(&name))
    };
    let rest: Vec<_> = base.into_iter().filter(is_free).collect();
    own.into_iter().chain(rest).collect()
}

/// Leaves out of `base`, the file of the model `id`, what `without` names.
pub(super) fn remove(
    base: &mut DeTable<'_>,
    without: &[LocatedValue<String>],
    id: &str,
    problems: &mut Vec<Problem>,
) {
    for LocatedValue {
        value: path,
        location,
    } in without
    {
        if !remove_at(base, "", path) {
            let mut names = Vec::new();
            names_in(base, "", &mut names);
            let right = match nearest(path, names.iter().map(String::as_str)) {
                Some(near) => format!("\"{near}\""),
                None => {
                    "a table, a key or a row of it, as \"watchdog\", \"run.coast\" or \"trip.7\""
                        .to_owned()
                }
            };
            problems.push(
                location
                    .problem(format!("`{id}` has no `{path}`"))
                    .right(right),
            );
        }
    }
}

/// Whether there was something at `path`.
fn remove_at(table: &mut DeTable<'_>, above: &str, path: &str) -> bool {
    if table.remove(path).is_some() {
        return true;
    }
    let Some((key, rest)) = path.split_once('.') else {
        return false;
    };
    let inner = joined(above, key);
    match table.get_mut(key).map(Spanned::get_mut) {
        Some(DeValue::Table(table)) if !is_fact(table) => remove_at(table, &inner, rest),
        Some(DeValue::Array(list)) => {
            let Some(keys) = keys_of_rows(&inner) else {
                return false;
            };
            let rest = number(rest).map_or_else(|| rest.to_owned(), |number| number.to_string());
            let before = list.len();
            let kept = list
                .iter()
                .filter(|row| row_name(keys, row.get_ref()).as_ref() != Some(&rest));
            *list = kept.cloned().collect();
            list.len() != before
        }
        _ => false,
    }
}

/// Everything that may be left out.
fn names_in(table: &DeTable<'_>, above: &str, names: &mut Vec<String>) {
    for (key, value) in table {
        let path = joined(above, key.get_ref());
        match value.get_ref() {
            DeValue::Table(inner) if !is_fact(inner) => names_in(inner, &path, names),
            DeValue::Array(list) => {
                let rows = keys_of_rows(&path)
                    .map(|keys| list.iter().filter_map(|row| row_name(keys, row.get_ref())));
                names.extend(rows.into_iter().flatten().map(|row| joined(&path, &row)));
            }
            _ => {}
        }
        names.push(path);
    }
}

fn keys_of_rows(path: &str) -> Option<&'static [&'static str]> {
    ROWS.iter()
        .find(|(list, _)| *list == path)
        .map(|(_, keys)| *keys)
}

/// What tells `row` from the others, numbers in decimal.
fn row_name(keys: &[&str], row: &DeValue<'_>) -> Option<String> {
    name_among(keys, row.as_table()?)
}

fn name_among(keys: &[&str], row: &DeTable<'_>) -> Option<String> {
    match keys.iter().find_map(|key| row.get(*key))?.get_ref() {
        DeValue::String(text) => Some(text.trim().to_owned()),
        DeValue::Integer(integer) => number(&integer.to_string()).map(|number| number.to_string()),
        _ => None,
    }
}

/// The row of the list `list` that `table` is, as `without` calls it.
pub(in crate::profile) fn row_of(list: &str, table: &DeTable<'_>) -> Option<String> {
    Some(joined(list, &name_among(keys_of_rows(list)?, table)?))
}

/// The number that `text` is, in decimal or with `0x`.
fn number(text: &str) -> Option<i64> {
    match text.strip_prefix("0x") {
        Some(digits) => i64::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}

fn is_fact(table: &DeTable<'_>) -> bool {
    table.contains_key("confidence") || table.contains_key("source")
}

fn joined(path: &str, key: &str) -> String {
    if path.is_empty() {
        key.to_owned()
    } else {
        format!("{path}.{key}")
    }
}
