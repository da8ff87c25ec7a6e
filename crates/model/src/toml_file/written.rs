//! Tables as text, and tables whose locations are moved.

use serde_spanned::Spanned;
use std::fmt::Write;
use toml::de::{DeArray, DeTable, DeValue};

/// `table` with all locations moved by `by` bytes.
#[must_use]
pub fn moved<'a>(table: DeTable<'a>, by: usize) -> DeTable<'a> {
    let entries = table.into_iter();
    entries
        .map(|(key, value)| {
            let span = key.span();
            let key = Spanned::new(span.start + by..span.end + by, key.into_inner());
            (key, moved_value(value, by))
        })
        .collect()
}

fn moved_value<'a>(value: Spanned<DeValue<'a>>, by: usize) -> Spanned<DeValue<'a>> {
    let span = value.span();
    let value = match value.into_inner() {
        DeValue::Table(inner) => DeValue::Table(moved(inner, by)),
        DeValue::Array(inner) => DeValue::Array(
            inner
                .into_iter()
                .map(|value| moved_value(value, by))
                .collect::<DeArray<'_>>(),
        ),
        other => other,
    };
    Spanned::new(span.start + by..span.end + by, value)
}

/// `table` as a TOML document, its keys in the order of their locations. Tables of tables, and lists of tables in them,
/// have headers; everything deeper is inline.
#[must_use]
pub fn text_of(table: &DeTable<'_>) -> String {
    let mut text = String::new();
    lines(table, |_| false, &mut text);
    for (key, value) in in_order(table)
        .into_iter()
        .filter(|(_, value)| has_header(value))
    {
        section(&name(key), value, &mut text);
    }
    text
}

/// The table or list of tables called `path`, with the lists of tables in it.
fn section(path: &str, value: &DeValue<'_>, text: &mut String) {
    match value {
        DeValue::Table(inner) => {
            let _ = write!(text, "\n[{path}]\n");
            lines(inner, is_list_of_tables, text);
            for (key, list) in in_order(inner)
                .into_iter()
                .filter(|(_, value)| is_list_of_tables(value))
            {
                section(&format!("{path}.{}", name(key)), list, text);
            }
        }
        DeValue::Array(rows) => {
            for row in rows.iter().filter_map(|row| row.get_ref().as_table()) {
                let _ = write!(text, "\n[[{path}]]\n");
                lines(row, |_| false, text);
            }
        }
        _ => {}
    }
}

/// A line for each key of `table` that has no header; `but` those.
fn lines(table: &DeTable<'_>, but: fn(&DeValue<'_>) -> bool, text: &mut String) {
    let is_top = text.is_empty();
    for (key, value) in in_order(table) {
        if but(value) || (is_top && has_header(value)) {
            continue;
        }
        let _ = write!(text, "{} = ", name(key));
        inline(value, text);
        text.push('\n');
    }
}

fn has_header(value: &DeValue<'_>) -> bool {
    matches!(value, DeValue::Table(_)) || is_list_of_tables(value)
}

fn is_list_of_tables(value: &DeValue<'_>) -> bool {
    let DeValue::Array(rows) = value else {
        return false;
    };
    !rows.is_empty()
        && rows
            .iter()
            .all(|row| matches!(row.get_ref(), DeValue::Table(_)))
}

fn in_order<'t>(table: &'t DeTable<'_>) -> Vec<(&'t str, &'t DeValue<'t>)> {
    let mut entries: Vec<_> = table.iter().collect();
    entries.sort_by_key(|(key, _)| key.span().start);
    entries
        .into_iter()
        .map(|(key, value)| (&**key.get_ref(), value.get_ref()))
        .collect()
}

fn inline(value: &DeValue<'_>, text: &mut String) {
    let _ = match value {
        DeValue::String(value) => write!(text, "{}", quoted(value)),
        DeValue::Integer(value) => write!(text, "{value}"),
        DeValue::Float(value) => write!(text, "{value}"),
        DeValue::Boolean(value) => write!(text, "{value}"),
        DeValue::Datetime(value) => write!(text, "{value}"),
        DeValue::Array(values) => {
            text.push('[');
            for (at, value) in values.iter().enumerate() {
                text.push_str(if at == 0 { "" } else { ", " });
                inline(value.get_ref(), text);
            }
            write!(text, "]")
        }
        DeValue::Table(table) => {
            let entries = in_order(table);
            text.push_str(if entries.is_empty() { "{" } else { "{ " });
            for (at, (key, value)) in entries.iter().enumerate() {
                let _ = write!(text, "{}{} = ", if at == 0 { "" } else { ", " }, name(key));
                inline(value, text);
            }
            write!(text, "{}", if entries.is_empty() { "}" } else { " }" })
        }
    };
}

fn name(key: &str) -> String {
    let is_bare = !key.is_empty()
        && key
            .bytes()
            .all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'-');
    if is_bare { key.to_owned() } else { quoted(key) }
}

fn quoted(value: &str) -> String {
    let mut text = String::from("\"");
    for letter in value.chars() {
        let _ = match letter {
            '"' | '\\' => write!(text, "\\{letter}"),
            '\n' => write!(text, "\\n"),
            '\t' => write!(text, "\\t"),
            control if control.is_control() => write!(text, "\\u{:04X}", u32::from(control)),
            other => write!(text, "{other}"),
        };
    }
    text + "\""
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_printed_as_it_was_written() {
        let text = "id = \"a\"\nrange = [0.1, 600.0]\nword = 0x0400\n\n[link]\nbaud = { value = [1, -2], source = \"UM\" }\n\n\
                    [run]\nform = \"bits\"\n\n[[run.bit]]\nbit = 1\n\n[[register]]\nname = \"x\\\"\\\\\\n\\u0007 é\"\n\
                    values = { \"0\" = \"off\", \"a b\" = \"on\" }\nplus = [{ address = 1 }]\nempty = {}\nnone = []\nyes = true\n";
        let table = DeTable::parse(text).unwrap().into_inner();
        // Bare keys may consist of digits only.
        assert_eq!(text_of(&table), text.replace("\"0\" =", "0 ="));
    }

    #[test]
    fn moved_tables_keep_their_content() {
        let table = DeTable::parse("a = { b = [1, { c = 2 }] }")
            .unwrap()
            .into_inner();
        let there = moved(table.clone(), 100);
        assert_eq!(text_of(&there), text_of(&table));
        let (key, value) = there.get_key_value("a").unwrap();
        assert_eq!((key.span(), value.span().start), (100..101, 104));
    }
}
