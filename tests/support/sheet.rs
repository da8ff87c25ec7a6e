//! `tests/sheets/<id>.toml`: what the documents say of a drive, typed apart from its model file. What a row may have is
//! told in `tests/sheets/README.md`.

use std::path::Path;
use toml::{Table, Value};
use vfd_gateway::domain::address::{self, Address};

/// The tables of a sheet, and the keys of their rows; the first ones are required.
const ROWS: [(&str, usize, &[&str]); 7] = [
    ("register", 1, &["at", "role", "scale", "unit", "signed"]),
    ("order", 3, &["do", "writes", "grade"]),
    ("word", 4, &["at", "write", "then", "why", "before"]),
    ("status", 2, &["words", "flags"]),
    ("trip", 0, &["code", "bit"]),
    ("reading", 3, &["words", "register_at", "value"]),
    ("frame", 1, &["request", "reply", "misprint", "source"]),
];

/// One sheet.
pub struct Sheet {
    /// The model that it is about.
    pub id: String,
    table: Table,
}

/// One row of a sheet.
#[derive(Clone, Copy)]
pub struct Row<'s>(&'s Table);

/// All sheets, in the order of their names.
pub fn sheets() -> Vec<Sheet> {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/sheets");
    let paths = std::fs::read_dir(dir)
        .expect("the sheets")
        .map(|entry| entry.expect("an entry").path());
    let mut paths: Vec<_> = paths
        .filter(|path| path.extension().is_some_and(|it| it == "toml"))
        .collect();
    paths.sort();
    paths.iter().map(|path| Sheet::read(path)).collect()
}

impl Sheet {
    fn read(path: &Path) -> Self {
        let name = path.display();
        let text = std::fs::read_to_string(path).expect("a text");
        let table: Table = text.parse().unwrap_or_else(|why| panic!("{name}: {why}"));
        let id = table
            .get("id")
            .and_then(Value::as_str)
            .unwrap_or_default()
            .to_owned();
        assert_eq!(
            path.file_stem().and_then(|it| it.to_str()),
            Some(id.as_str()),
            "{name} is named after its model"
        );
        let sheet = Self { id, table };
        for key in sheet.table.keys().filter(|key| *key != "id") {
            assert!(
                ROWS.iter().any(|(kind, ..)| kind == key),
                "{name}: unknown table `{key}`"
            );
        }
        for (kind, required, keys) in ROWS {
            for row in sheet.rows(kind) {
                let unknown = row.0.keys().find(|key| !keys.contains(&key.as_str()));
                let missing = keys[..required]
                    .iter()
                    .find(|key| !row.0.contains_key(**key));
                assert!(
                    unknown.is_none() && missing.is_none(),
                    "{name}: {kind}: {unknown:?} {missing:?}"
                );
            }
        }
        sheet
    }

    /// The rows of one kind.
    pub fn rows(&self, kind: &str) -> impl Iterator<Item = Row<'_>> {
        let rows = self.table.get(kind).and_then(Value::as_array);
        rows.into_iter()
            .flatten()
            .map(|row| Row(row.as_table().expect("a table")))
    }
}

impl<'s> Row<'s> {
    /// A text; empty if there is none.
    pub fn text(self, key: &str) -> &'s str {
        self.maybe(key).unwrap_or_default()
    }

    /// A text, if there is one.
    pub fn maybe(self, key: &str) -> Option<&'s str> {
        self.0.get(key).map(|it| it.as_str().expect("a text"))
    }

    /// A number, if there is one.
    pub fn number(self, key: &str) -> Option<i64> {
        self.0.get(key).map(|it| it.as_integer().expect("a number"))
    }

    /// A switch, if there is one.
    pub fn switch(self, key: &str) -> Option<bool> {
        self.0
            .get(key)
            .map(|it| it.as_bool().expect("true or false"))
    }

    /// How a number with a sign is encoded: in two's complement or without a sign, both for `signed = "not stated"`; nothing if
    /// the row does not say.
    pub fn signs(self) -> Vec<bool> {
        match self.0.get("signed") {
            None => Vec::new(),
            Some(Value::Boolean(signed)) => vec![*signed],
            Some(Value::String(text)) if text == "not stated" => vec![true, false],
            Some(other) => panic!("{other} is no sign"),
        }
    }

    /// A list of texts; empty if there is none.
    pub fn list(self, key: &str) -> Vec<&'s str> {
        let all = self.0.get(key).map(|it| it.as_array().expect("a list"));
        all.into_iter()
            .flatten()
            .map(|it| it.as_str().expect("a text"))
            .collect()
    }
}

impl std::fmt::Display for Row<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0.to_string().trim_end().replace('\n', ", "))
    }
}

/// The rows of `text` in which model and sheet differ, each with the reason why both stay as they are: a line with the row, and
/// indented lines with the reason.
pub fn open_rows(text: &str) -> Vec<(&str, String)> {
    let mut rows: Vec<(&str, String)> = Vec::new();
    for line in text
        .lines()
        .filter(|line| !line.trim().is_empty() && !line.starts_with('#'))
    {
        match (line.strip_prefix("    "), rows.last_mut()) {
            (Some(reason), Some((_, reasons))) => {
                *reasons = format!("{reasons} {}", reason.trim()).trim().to_owned()
            }
            (Some(reason), None) => panic!("a reason without a row: {reason}"),
            (None, _) => rows.push((line, String::new())),
        }
    }
    for (at, (row, reason)) in rows.iter().enumerate() {
        assert!(
            reason.split_whitespace().count() > 3,
            "open.txt has no reason below this row:\n{row}"
        );
        assert!(
            rows[..at].iter().all(|(other, _)| other != row),
            "open.txt has this row twice:\n{row}"
        );
    }
    rows
}

/// Table, address and words, as in `holding 2000 0012`.
pub fn place(text: &str) -> (Address, Vec<u16>) {
    let mut parts = text.split_whitespace();
    let table = parts.next().and_then(|word| {
        address::DataTable::ALL
            .into_iter()
            .find(|it| it.keyword() == word)
    });
    let table = table.unwrap_or_else(|| panic!("no table in `{text}`"));
    let numbers: Vec<_> = parts
        .map(|it| u16::from_str_radix(it, 16).expect("hexadecimal"))
        .collect();
    let (number, words) = numbers
        .split_first()
        .unwrap_or_else(|| panic!("no address in `{text}`"));
    (Address::new(table, *number), words.to_vec())
}

/// Bytes as in `01 06 20 00`.
pub fn bytes(text: &str) -> Vec<u8> {
    text.split_whitespace()
        .map(|it| u8::from_str_radix(it, 16).expect("hexadecimal"))
        .collect()
}
