//! Makes `docs/model-reference.md`, the reference of all keys of a model file, from what the readers ask for.
//!
//! The sentences are in [`file`], [`orders`], [`registers`] and [`words`]. A key or a word without a sentence fails the test.

mod file;
mod orders;
mod registers;
mod schema;
mod words;

use crate::profile::like::ROWS;
use crate::toml_file::key_uses::Form;
use schema::Schema;
use std::collections::BTreeSet;
use std::fmt::Write;

/// The sentences about one table. Inner tables belong to it unless they have a section of their own.
struct Section {
    /// Path of the table; empty for the file itself.
    table: &'static str,
    /// What it says.
    says: &'static str,
    keys: &'static [Key],
}

/// Name of a key in its table, its value if it is left out, and what it says.
type Key = (&'static str, &'static str, &'static str);

/// The words under keys, each with its meaning.
struct Words {
    /// Paths of the keys.
    of: &'static [&'static str],
    words: &'static [(&'static str, &'static str)],
}

/// Lists of tables that a file with `like` replaces as a whole.
#[cfg(test)]
const REPLACED: [&str; 5] = [
    "barrier",
    "run.never",
    "run.start",
    "run.state",
    "register.plus",
];

/// Keys whose words explain themselves.
const PLAIN: [&str; 9] = [
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

fn sections() -> impl Iterator<Item = &'static Section> {
    [
        file::FILE,
        file::LINE,
        orders::ORDERS,
        orders::STATES,
        registers::REGISTERS,
    ]
    .into_iter()
    .flatten()
}

fn path_of(section: &Section, key: &str) -> String {
    schema::joined(section.table, key)
}

/// The document.
fn reference(schema: &Schema) -> String {
    let mut text = words::INTRODUCTION.to_owned();
    for section in sections() {
        section_head(schema, section, &mut text);
        text.push_str("| key | | what is valid | meaning |\n| --- | --- | --- | --- |\n");
        for (key, absent, says) in section.keys {
            let path = path_of(section, key);
            let need = if schema.is_required(&path) {
                "required"
            } else {
                absent
            };
            let _ = writeln!(
                text,
                "| `{key}` | {need} | {} | {says} |",
                kind(schema, &path)
            );
        }
    }
    text.push_str(words::LIKE);
    for (list, keys) in ROWS {
        let keys: Vec<_> = keys.iter().map(|key| format!("`{key}`")).collect();
        let _ = writeln!(text, "| `[[{list}]]` | {} |", keys.join(" or "));
    }
    text.push_str("\n## Words\n");
    for Words { of, words } in words::WORDS {
        let _ = write!(
            text,
            "\n### {}\n\n| word | meaning |\n| --- | --- |\n",
            of.join(", ")
        );
        for (word, says) in *words {
            let _ = writeln!(text, "| `\"{word}\"` | {says} |");
        }
    }
    text
}

fn section_head(schema: &Schema, section: &Section, text: &mut String) {
    let table = section.table;
    let heading = match (table, schema.form(table)) {
        ("", _) => "The file itself".to_owned(),
        (words::FACT, _) => "Every fact".to_owned(),
        (_, Some(Form::Tables)) => format!("`[[{table}]]`"),
        _ => format!("`[{table}]`"),
    };
    let _ = write!(text, "\n## {heading}\n\n{}", section.says);
    if !table.is_empty() && schema.form(table).is_some() {
        text.push_str(if schema.is_required(table) {
            " Required."
        } else {
            " Optional."
        });
    }
    if schema.is_fact(table) {
        text.push_str(" With `confidence` and `source`.");
    }
    text.push_str("\n\n");
}

/// What is valid at `path`, as a cell of a table.
fn kind(schema: &Schema, path: &str) -> String {
    let list = words::WORDS.iter().find(|words| words.of.contains(&path));
    let link = |words: &Words| {
        let anchor: String = words
            .of
            .join(", ")
            .to_lowercase()
            .chars()
            .filter(|c| !['.', ','].contains(c))
            .collect();
        format!("[one of these words](#{})", anchor.replace(' ', "-"))
    };
    schema
        .kind(path, list.map(link).as_deref())
        .replace('|', "\\|")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all_keys() -> BTreeSet<String> {
        let keys = sections()
            .flat_map(|section| section.keys.iter().map(|(key, ..)| path_of(section, key)));
        let tables = sections()
            .map(|section| section.table.to_owned())
            .filter(|table| !table.is_empty());
        keys.chain(tables.filter(|table| *table != words::FACT))
            .collect()
    }

    #[test]
    fn every_key_that_is_read_has_a_sentence() {
        let schema = Schema::of_the_readers();
        assert_eq!(
            schema.unread_tables(),
            [""; 0],
            "no model file of this repository has these tables"
        );
        let documented = all_keys();
        let read: BTreeSet<_> = schema.paths().collect();
        let silent: Vec<_> = read
            .iter()
            .filter(|path| !documented.contains(**path))
            .collect();
        assert!(
            silent.is_empty(),
            "keys without a sentence in `src/profile/reference`: {silent:?}"
        );
        let stale: Vec<_> = documented
            .iter()
            .filter(|path| !read.contains(path.as_str()))
            .collect();
        assert!(
            stale.is_empty(),
            "sentences about keys that no reader asks for: {stale:?}"
        );
    }

    /// Each list of tables is merged by rows or replaced as a whole.
    #[test]
    fn every_list_of_tables_is_merged_or_replaced() {
        let schema = Schema::of_the_readers();
        let lists: BTreeSet<_> = schema
            .paths()
            .filter(|path| schema.form(path) == Some(Form::Tables))
            .collect();
        let rows = ROWS.iter().map(|(list, _)| *list);
        assert_eq!(rows.chain(REPLACED).collect::<BTreeSet<_>>(), lists);
    }

    #[test]
    fn every_word_that_is_read_has_a_meaning() {
        let schema = Schema::of_the_readers();
        let read = schema.words();
        let with_meanings: Vec<_> = words::WORDS
            .iter()
            .flat_map(|words| words.of)
            .chain(&PLAIN)
            .collect();
        for (path, words) in &read {
            assert!(
                with_meanings.contains(&path),
                "the words of {path} have no meanings: {words:?}"
            );
        }
        for Words { of, words } in words::WORDS {
            let documented: BTreeSet<_> = words.iter().map(|(word, _)| *word).collect();
            let read: BTreeSet<_> = of
                .iter()
                .filter_map(|path| read.get(path))
                .flatten()
                .copied()
                .collect();
            assert_eq!(documented, read, "{of:?}");
        }
    }

    #[test]
    fn the_reference_is_what_the_readers_ask_for() {
        let path = format!(
            "{}/../../docs/model-reference.md",
            env!("CARGO_MANIFEST_DIR")
        );
        let found = reference(&Schema::of_the_readers());
        if std::env::var_os("UPDATE_GOLDEN").is_some() {
            std::fs::write(&path, &found).unwrap();
        }
        assert!(
            found == std::fs::read_to_string(&path).unwrap(),
            "{path} is another one: UPDATE_GOLDEN=1 writes it"
        );
    }
}
