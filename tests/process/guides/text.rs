//! A guide as text: its fenced blocks with what is said before each, and the statements of a block of the shell.

use super::super::rig::text_of;
use std::path::Path;

/// A fenced block.
pub struct Block {
    pub language: String,
    pub text: String,
    /// What is said between the block before this one and this one.
    pub before: String,
}

/// The blocks of a document in order. The last one has no text: what is said behind all others stands before it.
pub fn blocks(document: &str) -> Vec<Block> {
    let (mut found, mut before, mut open): (Vec<Block>, _, Option<Block>) =
        (Vec::new(), String::new(), None);
    for line in document.lines() {
        match (line.strip_prefix("```"), open.take()) {
            (Some(language), None) => {
                let (language, before) = (language.to_owned(), std::mem::take(&mut before));
                open = Some(Block {
                    language,
                    text: String::new(),
                    before,
                });
            }
            (Some(_), Some(block)) => found.push(block),
            (None, Some(mut block)) => {
                block.text.extend([line, "\n"]);
                open = Some(block);
            }
            (None, None) => before.extend([line, "\n"]),
        }
    }
    assert!(open.is_none(), "a block does not end");
    found.push(Block {
        language: "end".to_owned(),
        text: String::new(),
        before,
    });
    found
}

/// What is typed in a block of the shell, one entry for each line; a line that goes on in the next one is one with it.
pub fn statements(text: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    let mut goes_on = false;
    for line in text.lines() {
        match found.last_mut().filter(|_| goes_on) {
            Some(last) => last.extend(["\n", line]),
            None if line.is_empty() || line.starts_with('#') => continue,
            None => found.push(line.to_owned()),
        }
        goes_on = line.ends_with(['\\', '|']);
    }
    found
}

/// The comment behind a statement.
pub fn comment(statement: &str) -> &str {
    statement
        .split_once(" # ")
        .map_or("", |(_, comment)| comment)
}

/// The file that is named last in what is said before a block of TOML.
pub fn named_file(before: &str) -> Option<&str> {
    let marked = before.split('`').skip(1).step_by(2);
    marked
        .filter(|word| word.ends_with(".toml") && !word.contains(['/', ' ']))
        .last()
}

/// All documents under `docs/`, by their path there.
pub fn documents() -> Vec<(String, String)> {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let mut found = Vec::new();
    let mut folders = vec![docs.clone()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|it| it == "md") {
                let name = path
                    .strip_prefix(&docs)
                    .unwrap()
                    .to_str()
                    .unwrap()
                    .to_owned();
                found.push((name, std::fs::read_to_string(&path).unwrap()));
            }
        }
    }
    found.sort();
    found
}

/// The document at `path` of this repository.
pub fn document(path: &str) -> String {
    text_of(path)
}
