//! All keys of a model file, as its readers ask for them.

use super::words::FACT;
use crate::profile::check;
use crate::toml_file::key_uses::{ANY, Form, KeyUse, noted};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Forms of tables that no file of this repository has.
const OTHER_FORMS: &str = "[documents]\n[[trip]]\nbit = 3\n[[warning]]\nbit = 3\n";

/// Keys that every fact has.
const OF_FACTS: [&str; 3] = ["confidence", "source", "also"];

/// What is valid under a key.
#[derive(Clone, Debug)]
struct Valid {
    form: Form,
    is_required: bool,
    right: String,
}

/// All keys.
#[derive(Default)]
pub(super) struct Schema {
    /// By their paths.
    keys: BTreeMap<String, Valid>,
    /// The tables that were read.
    tables: BTreeSet<String>,
    /// The tables that are facts.
    facts: BTreeSet<String>,
}

impl Schema {
    /// What is asked for while all model files of this repository are read.
    pub(super) fn of_the_readers() -> Self {
        let texts = model_files();
        let asked = noted(|| {
            for text in &texts {
                let _ = check::model(text);
            }
        });
        let free: BTreeSet<_> = asked
            .iter()
            .filter(|it| it.key == ANY)
            .map(|it| it.table.clone())
            .collect();
        let mut schema = Self::default();
        for key in asked {
            schema.add(key, &free);
        }
        schema
    }

    fn add(&mut self, asked: KeyUse, free: &BTreeSet<String>) {
        let mut table = with_any(&asked.table, free);
        self.tables.insert(table.clone());
        if OF_FACTS.contains(&asked.key) {
            self.facts.insert(table);
            table = FACT.to_owned();
        }
        let valid = Valid {
            form: asked.form,
            is_required: asked.is_required,
            right: asked.right,
        };
        let known = self
            .keys
            .entry(joined(&table, asked.key))
            .or_insert_with(|| valid.clone());
        // It may be required in one form of its table only.
        known.is_required &= valid.is_required;
        known.form = known.form.max(valid.form);
        if known.right.is_empty() {
            known.right = valid.right;
        }
    }

    pub(super) fn form(&self, path: &str) -> Option<Form> {
        self.keys.get(path).map(|valid| valid.form)
    }

    pub(super) fn is_required(&self, path: &str) -> bool {
        self.keys.get(path).is_some_and(|valid| valid.is_required)
    }

    pub(super) fn is_fact(&self, table: &str) -> bool {
        self.facts.contains(table)
    }

    /// The keys of a table.
    fn keys_of<'s>(&'s self, table: &'s str) -> impl Iterator<Item = &'s str> {
        let inner = |path: &'s String| path.rsplit_once('.').unwrap_or(("", path));
        self.keys
            .keys()
            .map(inner)
            .filter(move |(of, _)| *of == table)
            .map(|(_, key)| key)
    }

    /// Whether the table is a fact whose only content is under `value`, so that both are one key to a reader.
    fn is_one_value(&self, table: &str) -> bool {
        self.is_fact(table) && self.keys_of(table).eq(["value"])
    }

    /// The keys that need a sentence.
    pub(super) fn paths(&self) -> impl Iterator<Item = &str> {
        let is_part = |path: &&str| {
            path.strip_suffix(".value")
                .is_some_and(|fact| self.is_one_value(fact))
        };
        self.keys
            .keys()
            .map(String::as_str)
            .filter(move |path| !is_part(path))
    }

    /// Tables that may be in a file and that were never read, so that their keys are not known.
    pub(super) fn unread_tables(&self) -> Vec<&str> {
        let tables = self
            .keys
            .iter()
            .filter(|(_, valid)| valid.form >= Form::Table);
        tables
            .map(|(path, _)| path.as_str())
            .filter(|path| !self.tables.contains(*path))
            .collect()
    }

    /// The words that are valid under each key that takes words.
    pub(super) fn words(&self) -> BTreeMap<&str, Vec<&str>> {
        let takes_words =
            |valid: &Valid| valid.right.trim_start_matches("one of ").starts_with('"');
        let all = self.keys.iter().filter(|(_, valid)| takes_words(valid));
        all.map(|(path, valid)| {
            let path = path
                .strip_suffix(".value")
                .filter(|fact| self.is_one_value(fact))
                .unwrap_or(path);
            (path, valid.right.split('"').skip(1).step_by(2).collect())
        })
        .collect()
    }

    /// What is valid at `path`; `words` in place of its words.
    pub(super) fn kind(&self, path: &str, words: Option<&str>) -> String {
        let Some(valid) = self.keys.get(path) else {
            return String::new();
        };
        let inner = if self.is_one_value(path) {
            self.keys.get(&joined(path, "value"))
        } else {
            None
        };
        let plain = |valid: &Valid| {
            let right = words.unwrap_or(&valid.right);
            match valid.form {
                Form::Value => right.to_owned(),
                Form::List => format!("a list, each {right}"),
                Form::ValueOrTable => format!("{right}, or a table"),
                Form::Table => "a table".to_owned(),
                Form::Tables => "a list of tables".to_owned(),
            }
        };
        match (self.is_fact(path), valid.form, inner) {
            (false, ..) => plain(valid),
            (true, Form::Tables, Some(inner)) => format!("a list of facts, each {}", plain(inner)),
            (true, Form::Tables, None) => "a list of facts".to_owned(),
            (true, _, Some(inner)) => format!("a fact: {}", plain(inner)),
            (true, _, None) => "a fact".to_owned(),
        }
    }
}

pub(super) fn joined(table: &str, key: &str) -> String {
    if table.is_empty() {
        key.to_owned()
    } else {
        format!("{table}.{key}")
    }
}

/// `path` with [`ANY`] in place of names that the author of a file chose.
fn with_any(path: &str, free: &BTreeSet<String>) -> String {
    let mut found = String::new();
    for part in path.split('.').filter(|part| !part.is_empty()) {
        let part = if free.contains(&found) { ANY } else { part };
        found = joined(&found, part);
    }
    found
}

/// All model files of this repository, sound or not.
fn model_files() -> Vec<String> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    let mut folders = vec![
        root.join("tests/golden/models"),
        root.join("crates/model/src/vendors"),
    ];
    let mut texts = vec![OTHER_FORMS.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|it| it == "toml") {
                texts.push(std::fs::read_to_string(path).unwrap());
            }
        }
    }
    texts
}
