//! Layout of a summary: headings and columns.

use crate::profile::model::Fact;
use std::fmt::Display;

/// One line: the text of each column.
pub(super) type Row = Vec<String>;

/// A line for a fact: name, value, confidence, source.
pub(super) fn row<T>(name: &str, value: impl Display, fact: &Fact<T>) -> Row {
    vec![
        name.to_owned(),
        value.to_string(),
        fact.confidence.keyword().to_owned(),
        fact.source.clone(),
    ]
}

/// `items`, separated by commas.
pub(super) fn list<T: Display>(items: impl IntoIterator<Item = T>) -> String {
    joined(items, ", ")
}

/// `items` as alternatives.
pub(super) fn choice<T: Display>(items: impl IntoIterator<Item = T>) -> String {
    joined(items, " or ")
}

fn joined<T: Display>(items: impl IntoIterator<Item = T>, between: &str) -> String {
    items
        .into_iter()
        .map(|item| item.to_string())
        .collect::<Vec<_>>()
        .join(between)
}

/// Appends a heading and `rows`, each column as wide as its widest cell. Without rows, appends nothing.
pub(super) fn section(text: &mut String, heading: &str, rows: Vec<Row>) {
    if rows.is_empty() {
        return;
    }
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        rows.iter()
            .map(|row| row.get(column).map_or(0, |cell| cell.chars().count()))
            .max()
    };
    let widths: Vec<usize> = (0..columns)
        .map(|column| width(column).unwrap_or(0))
        .collect();
    text.push_str(&format!("\n{heading}\n"));
    for row in &rows {
        let cells = row
            .iter()
            .zip(&widths)
            .map(|(cell, width)| format!("  {cell:width$}"));
        text.push_str(cells.collect::<String>().trim_end());
        text.push('\n');
    }
}
