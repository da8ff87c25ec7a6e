//! Makes `docs/model-reference.md`, the reference of all keys of a model file, from their declarations.

use super::like::ROWS;
use super::{file, words};
use crate::toml_file::declare::{DeclaredKey, DeclaredTable, TABLE, TABLES};
use std::collections::BTreeSet;
use std::fmt::Write;

const INTRODUCTION: &str = "# Model files: every key

What a file that describes a drive model may contain. A test makes this page from the program, in which each key is
declared. [Adding a drive from its manual](../deploy/adding-a-drive.md) is the guide with an example; `models check` reports all
mistakes of a file at once, and `models show MODEL --toml` prints a complete one.

The second column says what a key is that is left out; empty where that needs no saying. Times are text with their unit
(`\"500ms\"`, `\"2s\"`), words of 16 bits are numbers, best written as `0x0400`. `NAME` is a name that you choose.
";

const LIKE: &str = "
## A file that begins from another model

With `like` a file takes over everything that it does not say itself, except `id` and `title`; the vendor may be another one.
Rows of the lists below that both files have are distinguished by their key, and the file's own row takes the place of the other
one. Every other list, and every fact, is replaced as a whole; tables that are no facts are merged key by key. What is taken
over keeps its documents and is graded again: a document of the other model makes a fact `sibling` at best. A document of the
other model that covers this one too is declared again, with the same title and kind, and with both models in `of`.

| rows of | are distinguished by |
| --- | --- |
";

/// Lists of tables that a file with `like` replaces as a whole.
const REPLACED: [&str; 5] = [
    "barrier",
    "run.never",
    "run.start",
    "run.state",
    "register.plus",
];

/// Keys whose words explain themselves.
const PLAIN: [&str; 10] = [
    "run.reverse_by",
    "link.default.parity",
    "link.parities",
    "link.framings",
    "link.interfaces",
    "setup.interface",
    "register.unit",
    "register.access",
    "register.direction",
    "read.boundary",
];

/// What the reference is made of.
struct KeyReference {
    /// The tables of a model file.
    tables: Vec<DeclaredTable>,
    /// Tables of words, each with its meaning.
    words: Vec<Vec<(&'static str, String)>>,
}

impl KeyReference {
    fn as_declared() -> Self {
        let words = [words::meanings(), file::meanings()].concat();
        let has_meanings =
            |table: &Vec<(_, String)>| table.iter().any(|(_, meaning)| !meaning.is_empty());
        Self {
            tables: file::declared(),
            words: words.into_iter().filter(has_meanings).collect(),
        }
    }

    /// The document.
    fn text(&self) -> String {
        let mut text = INTRODUCTION.to_owned();
        for table in self.tables.iter().filter(|table| has_section(table)) {
            self.section_head(table, &mut text);
            text.push_str("| key | | what is valid | meaning |\n| --- | --- | --- | --- |\n");
            self.rows(table, "", &mut text);
        }
        text.push_str(LIKE);
        for (list, keys) in ROWS {
            let keys: Vec<_> = keys.iter().map(|key| format!("`{key}`")).collect();
            let _ = writeln!(text, "| `[[{list}]]` | {} |", keys.join(" or "));
        }
        text.push_str("\n## Words\n");
        for (at, paths) in self.of_words() {
            let heading = paths.join(", ");
            let _ = write!(
                text,
                "\n### {heading}\n\n| word | meaning |\n| --- | --- |\n"
            );
            for (word, meaning) in &self.words[at] {
                let _ = writeln!(text, "| `\"{word}\"` | {meaning} |");
            }
        }
        text
    }

    fn section_head(&self, table: &DeclaredTable, text: &mut String) {
        let heading = match table.header {
            "" => "The file itself".to_owned(),
            "[fact]" => "Every fact".to_owned(),
            header => format!("`{header}`"),
        };
        let _ = write!(text, "\n## {heading}\n\n{}", table.says);
        if let Some((_, key)) = self.keys().find(|(path, _)| path == path_of(table)) {
            text.push_str(if key.valid.is_required {
                " Required."
            } else {
                " Optional."
            });
        }
        if is_fact(table) {
            text.push_str(" With `confidence` and `source`.");
        }
        text.push_str("\n\n");
    }

    /// A row for each key of `table`, and of the tables in it that have no section; `above` is in front of their names.
    fn rows(&self, table: &DeclaredTable, above: &str, text: &mut String) {
        for key in table.keys.iter().filter(|key| has_row(key)) {
            let path = joined(path_of(table), key.name);
            let name = format!("{above}{}", key.name);
            let need = if key.valid.is_required {
                "required"
            } else {
                key.default.as_deref().unwrap_or_default()
            };
            let _ = writeln!(
                text,
                "| `{name}` | {need} | {} | {} |",
                self.valid(key, &path),
                key.about
            );
            if let Some(inner) = self.table(&path)
                && !has_section(inner)
            {
                self.rows(inner, &format!("{name}."), text);
            }
        }
    }

    /// What is valid for `key` at `path`, as a cell of a table.
    fn valid(&self, key: &DeclaredKey, path: &str) -> String {
        let right = &key.valid.right;
        if self.table(path).is_some_and(is_fact) {
            match right.as_str() {
                TABLE => return "a fact".to_owned(),
                TABLES => return "a list of facts".to_owned(),
                _ => {}
            }
        }
        let quoted = right.split_once('"').map(|(before, _)| before);
        let cell = match (self.words_of(key), quoted) {
            (Some(at), Some(before)) => {
                let before = before.strip_suffix("one of ").unwrap_or(before);
                let (_, paths) = self.of_words().into_iter().find(|it| it.0 == at).unwrap();
                let heading = paths.join(" ").replace('.', "").to_lowercase();
                format!(
                    "{before}[one of these words](#{})",
                    heading.replace(' ', "-")
                )
            }
            _ => right.clone(),
        };
        cell.replace('|', "\\|")
    }

    /// The table with the meanings of the words that are valid for `key`.
    fn words_of(&self, key: &DeclaredKey) -> Option<usize> {
        let valid = words_for(key);
        let tables = self
            .words
            .iter()
            .enumerate()
            .filter(|(_, table)| table.iter().all(|(word, _)| valid.contains(word)));
        tables
            .max_by_key(|(_, table)| table.len())
            .map(|(at, _)| at)
    }

    /// The tables of words, each with the keys for which its words are valid, in the order of these.
    fn of_words(&self) -> Vec<(usize, Vec<String>)> {
        let mut all: Vec<(usize, Vec<String>)> = Vec::new();
        for (path, key) in self.keys() {
            let Some(at) = self.words_of(key) else {
                continue;
            };
            match all.iter_mut().find(|it| it.0 == at) {
                Some((_, paths)) => paths.push(path),
                None => all.push((at, vec![path])),
            }
        }
        all
    }

    /// The table at `path`.
    fn table(&self, path: &str) -> Option<&DeclaredTable> {
        self.tables.iter().find(|table| path_of(table) == path)
    }

    /// All keys with their paths.
    fn keys(&self) -> impl Iterator<Item = (String, &DeclaredKey)> {
        self.tables.iter().flat_map(|table| {
            let keys = table.keys.iter().filter(|key| is_key(key));
            keys.map(|key| (joined(path_of(table), key.name), key))
        })
    }
}

/// Whether the keys of `table` have a section of their own.
fn has_section(table: &DeclaredTable) -> bool {
    table.header.is_empty() || table.header.starts_with('[')
}

/// Whether the table has a key for its confidence and its source.
fn is_fact(table: &DeclaredTable) -> bool {
    table.keys.iter().any(|key| key.name == "origin")
}

/// Whether `key` is one that a file may have: some only stand for others.
fn is_key(key: &DeclaredKey) -> bool {
    !key.valid.notation.is_empty()
}

/// Whether `key` has a row. One without a sentence is a table with a section of its own.
fn has_row(key: &DeclaredKey) -> bool {
    is_key(key) && !key.about.is_empty()
}

fn path_of(table: &DeclaredTable) -> &'static str {
    table.header.trim_matches(['[', ']'])
}

fn joined(table: &str, key: &str) -> String {
    if table.is_empty() {
        key.to_owned()
    } else {
        format!("{table}.{key}")
    }
}

/// The words that are valid for `key`, if it takes words.
fn words_for(key: &DeclaredKey) -> Vec<&str> {
    let mut right = key.valid.right.as_str();
    for lead in ["a fact: ", "a list, each ", "a table, each ", "one of "] {
        right = right.strip_prefix(lead).unwrap_or(right);
    }
    if right.starts_with('"') {
        right.split('"').skip(1).step_by(2).collect()
    } else {
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_has_a_sentence_or_a_section() {
        let reference = KeyReference::as_declared();
        for (path, key) in reference.keys() {
            let table = reference.table(&path);
            assert!(has_row(key) || table.is_some_and(has_section), "{path}");
            let is_table = [TABLE, TABLES].contains(&key.valid.right.as_str());
            assert!(!is_table || table.is_some(), "{path} has no keys");
        }
        let paths: BTreeSet<_> = reference.keys().map(|(path, _)| path).collect();
        for table in &reference.tables {
            let is_there = ["", "fact"].contains(&path_of(table)) || paths.contains(path_of(table));
            assert!(is_there, "no key has the table {}", table.header);
        }
    }

    /// Each list of tables is merged by rows or replaced as a whole.
    #[test]
    fn every_list_of_tables_is_merged_or_replaced() {
        let reference = KeyReference::as_declared();
        let lists: BTreeSet<_> = reference
            .keys()
            .filter(|(_, key)| key.valid.right == TABLES)
            .map(|(path, _)| path)
            .collect();
        let rows = ROWS.iter().map(|(list, _)| *list);
        let known: BTreeSet<_> = rows.chain(REPLACED).map(str::to_owned).collect();
        assert_eq!(known, lists);
    }

    #[test]
    fn every_word_that_is_read_has_a_meaning() {
        let reference = KeyReference::as_declared();
        for (path, key) in reference.keys() {
            let words = words_for(key);
            let explained = reference.words_of(key).is_some() || PLAIN.contains(&path.as_str());
            assert!(
                words.is_empty() || explained,
                "the words of {path} have no meanings: {words:?}"
            );
        }
        for (word, meaning) in reference.words.iter().flatten() {
            assert!(!meaning.is_empty(), "`{word}` has no meaning");
        }
        let used: BTreeSet<_> = reference.of_words().iter().map(|it| it.0).collect();
        assert_eq!(used.len(), reference.words.len(), "no key has some words");
    }

    #[test]
    fn the_reference_is_as_declared() {
        let path = format!(
            "{}/../../docs/model-reference.md",
            env!("CARGO_MANIFEST_DIR")
        );
        let found = KeyReference::as_declared().text();
        if std::env::var_os("UPDATE_GOLDEN").is_some() {
            std::fs::write(&path, &found).unwrap();
        }
        assert!(
            found == std::fs::read_to_string(&path).unwrap(),
            "{path} is another one: UPDATE_GOLDEN=1 writes it"
        );
    }
}
