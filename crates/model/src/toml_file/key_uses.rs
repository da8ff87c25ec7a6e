//! What readers ask for, noted while a test reads a file: the reference of all keys is made from it.

use std::cell::RefCell;

/// The name of a key that the author of a file chooses.
pub const ANY: &str = "NAME";

/// What is valid under a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Form {
    /// A value.
    Value,
    /// A list of values.
    List,
    /// A table.
    Table,
    /// A list of tables.
    Tables,
    /// A value or a table.
    ValueOrTable,
}

/// A key that was asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KeyUse {
    /// The table that it belongs to, as a path without indices; empty for the file itself.
    pub table: String,
    /// Its name.
    pub key: &'static str,
    /// What is valid.
    pub form: Form,
    /// Whether it must be there.
    pub is_required: bool,
    /// What is right for its value, in words.
    pub right: String,
}

thread_local! {
    static NOTED: RefCell<Vec<KeyUse>> = const { RefCell::new(Vec::new()) };
}

/// The keys that readers of this thread ask for while `read` runs.
pub fn noted(read: impl FnOnce()) -> Vec<KeyUse> {
    NOTED.take();
    read();
    NOTED.take()
}

pub(super) fn note(table: &str, key: &'static str, form: Form, is_required: bool, right: &str) {
    let table = table
        .split('[')
        .map(|part| part.split_once(']').map_or(part, |(_, rest)| rest))
        .collect();
    let right = right.to_owned();
    NOTED.with_borrow_mut(|noted| {
        noted.push(KeyUse {
            table,
            key,
            form,
            is_required,
            right,
        })
    });
}
