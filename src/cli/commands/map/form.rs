//! The forms of a map: CSV, Markdown, JSON.

use super::UnitMap;
use crate::north::modbus::sheet::SheetRow;
use serde_json::{Value, json};
use std::fmt::Write;

/// The columns of CSV; the first ones identify the unit of a row.
const COLUMNS: [&str; 22] = [
    "listen",
    "unit",
    "kind",
    "drive",
    "model",
    "of",
    "table",
    "address",
    "hex",
    "number",
    "input_number",
    "count",
    "functions",
    "access",
    "code",
    "name",
    "title",
    "format",
    "step",
    "unit_of_measure",
    "meaning",
    "special",
];

/// One table, a row for each value.
pub fn csv(maps: &[UnitMap]) -> String {
    let mut text = COLUMNS.join(",") + "\n";
    for map in maps {
        for row in &map.rows {
            let cells = cells(map, row).map(|cell| quoted(&cell));
            let _ = writeln!(text, "{}", cells.join(","));
        }
    }
    text
}

fn cells(map: &UnitMap, row: &SheetRow) -> [String; 22] {
    [
        map.listeners.join(" "),
        map.unit.to_string(),
        map.kind.to_owned(),
        map.drive.clone().unwrap_or_default(),
        map.model
            .as_ref()
            .map(|(model, _)| model.clone())
            .unwrap_or_default(),
        row.of.clone(),
        row.table.keyword().to_owned(),
        row.address.to_string(),
        hex(row),
        row.table.number(row.address),
        row.table.input_number(row.address).unwrap_or_default(),
        row.count.to_string(),
        row.functions(map.kind == "native").to_owned(),
        row.access().to_owned(),
        row.code.clone(),
        row.name.clone(),
        row.title.clone(),
        row.format.keyword().to_owned(),
        row.step.clone(),
        row.unit.to_owned(),
        row.meaning.clone(),
        row.special.clone(),
    ]
}

fn hex(row: &SheetRow) -> String {
    format!("0x{:04X}", row.address)
}

/// A cell quoted as in RFC 4180. A number of a table begins with 0, 1, 3 or 4 and never with what starts a formula; texts of a model
/// might.
fn quoted(cell: &str) -> String {
    let is_formula = cell.len() > 1 && cell.starts_with(['=', '+', '-', '@']);
    if !is_formula && !cell.contains([',', '"', '\n', '\r']) {
        return cell.to_owned();
    }
    format!(
        "\"{}{}\"",
        if is_formula { "'" } else { "" },
        cell.replace('"', "\"\"")
    )
}

/// A heading and a table for each unit.
pub fn markdown(maps: &[UnitMap]) -> String {
    let mut text = "# Modbus map\n\n\
        Addresses count from 0, as they are sent; `number` counts from 1 after the digit of the table, with six digits \
        above 9999. A value is the word times `step`.\n"
        .to_owned();
    for map in maps {
        section(&mut text, map);
    }
    text
}

fn section(text: &mut String, map: &UnitMap) {
    let head = match (&map.drive, &map.model) {
        (Some(drive), Some((model, line))) => format!("{drive}, {} ({model} on {line})", map.kind),
        _ => "the gateway itself (unit 0 reads the same)".to_owned(),
    };
    let _ = write!(
        text,
        "\n## Unit {}: {head}\n\nAt {}\n\n",
        map.unit,
        map.listeners.join(", ")
    );
    let is_of_several = map.rows.iter().any(|row| !row.of.is_empty());
    let of = if is_of_several { "of | " } else { "" };
    let _ = writeln!(
        text,
        "| table | address | number | {of}functions (hex) | access | what | format | step | values |"
    );
    let _ = writeln!(
        text,
        "|{}",
        " --- |".repeat(if is_of_several { 10 } else { 9 })
    );
    for row in &map.rows {
        let of = if is_of_several {
            format!("{} | ", escaped(&row.of))
        } else {
            String::new()
        };
        let _ = writeln!(
            text,
            "| {} | {} | {} | {of}{} | {} | {} | {} | {} | {} |",
            row.table.keyword(),
            span(row),
            numbers(row),
            row.functions(map.kind == "native"),
            row.access(),
            escaped(&meaning_cell(row)),
            row.format.keyword(),
            [row.step.as_str(), row.unit].join(" ").trim(),
            escaped(&values(row))
        );
    }
}

/// The addresses, also in hexadecimal if they are large.
fn span(row: &SheetRow) -> String {
    let last = row.address.saturating_add(row.count.saturating_sub(1));
    let hex = if row.address > 9 {
        format!(" ({})", hex(row))
    } else {
        String::new()
    };
    if row.count > 1 {
        format!("{} to {last}", row.address)
    } else {
        format!("{}{hex}", row.address)
    }
}

fn numbers(row: &SheetRow) -> String {
    let numbers = [
        Some(row.table.number(row.address)),
        row.table.input_number(row.address),
    ];
    numbers.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

fn meaning_cell(row: &SheetRow) -> String {
    let code = if row.code.is_empty() {
        String::new()
    } else {
        format!("{} ", row.code)
    };
    let name = if row.name.is_empty() {
        String::new()
    } else {
        format!(" (`{}`)", row.name)
    };
    format!("{code}{}{name}", row.title)
}

fn values(row: &SheetRow) -> String {
    let parts = [row.meaning.as_str(), row.special.as_str()];
    parts
        .into_iter()
        .filter(|part| !part.is_empty())
        .collect::<Vec<_>>()
        .join("; ")
}

/// Without characters that would end a cell.
fn escaped(text: &str) -> String {
    text.replace('|', "\\|").replace(['\n', '\r'], " ")
}

/// One document for programs. Absent values are `null`.
pub fn json(maps: &[UnitMap]) -> String {
    let maps: Vec<_> = maps.iter().map(of_map).collect();
    format!("{:#}\n", json!({ "maps": maps }))
}

fn of_map(map: &UnitMap) -> Value {
    let (model, line) = map.model.clone().unzip();
    let rows: Vec<_> = map
        .rows
        .iter()
        .map(|row| of_row(row, map.kind == "native"))
        .collect();
    json!({
        "unit": map.unit, "kind": map.kind, "drive": map.drive, "model": model, "line": line,
        "listen": map.listeners, "rows": rows,
    })
}

fn of_row(row: &SheetRow, is_native: bool) -> Value {
    let given = |text: &str| {
        if text.is_empty() {
            Value::Null
        } else {
            text.into()
        }
    };
    json!({
        "table": row.table.keyword(), "address": row.address, "count": row.count,
        "number": row.table.number(row.address), "input_number": row.table.input_number(row.address),
        "functions": row.functions(is_native), "readable": row.is_read, "writable": row.is_written,
        "of": given(&row.of), "code": given(&row.code), "name": given(&row.name), "title": row.title,
        "format": row.format.keyword(), "step": number(&row.step), "unit": given(row.unit),
        "meaning": given(&row.meaning), "special": given(&row.special),
    })
}

/// The number in `step`, a decimal or a fraction.
fn number(step: &str) -> Option<f64> {
    match step.split_once('/') {
        Some((above, below)) => Some(above.parse::<f64>().ok()? / below.parse::<f64>().ok()?),
        None => step.parse().ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_hold_what_texts_hold() {
        for (cell, right) in [
            ("plain", "plain"),
            ("a, b", "\"a, b\""),
            ("a \"b\"", "\"a \"\"b\"\"\""),
            ("=1+1", "\"'=1+1\""),
            ("-", "-"),
            ("00001", "00001"),
        ] {
            assert_eq!(quoted(cell), right);
        }
        assert_eq!(escaped("a|b\nc"), "a\\|b c");
        assert_eq!(
            ["0.01", "1/4", ""].map(number),
            [Some(0.01), Some(0.25), None]
        );
    }
}
