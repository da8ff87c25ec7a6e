//! Reads a table key by key. See the example in [`crate::toml_file`].

use super::location::{KeyLocation, LocatedValue, OptionalKey, RequiredKey};
use super::values::{ValueKind, kind_of};
use crate::domain::problem::{Problem, nearest};
use toml::de::{DeTable, DeValue};

/// A parsed document.
pub struct TomlDocument<'a> {
    root: serde_spanned::Spanned<DeTable<'a>>,
}

impl<'a> TomlDocument<'a> {
    /// The document whose outermost table is `table`.
    #[must_use]
    pub fn of(table: DeTable<'a>) -> Self {
        Self {
            root: serde_spanned::Spanned::new(0..0, table),
        }
    }

    /// The outermost table, as a value.
    #[must_use]
    pub fn into_table(self) -> DeTable<'a> {
        self.root.into_inner()
    }

    /// The outermost table.
    #[must_use]
    pub fn section(&self) -> TomlSection<'_> {
        TomlSection {
            table: self.root.get_ref(),
            location: KeyLocation {
                key: String::new(),
                span: 0..0,
            },
        }
    }
}

/// Parses `text`. Returns `None` if it is not TOML; each syntax error is then in `problems`, with an empty key.
pub fn document<'a>(text: &'a str, problems: &mut Vec<Problem>) -> Option<TomlDocument<'a>> {
    let (root, errors) = DeTable::parse_recoverable(text);
    let sound = errors.is_empty();
    problems.extend(errors.into_iter().map(|error| {
        let what = format!("not valid TOML: {}", error.message().replace('\n', ", "));
        Problem::new("", error.span().unwrap_or(0..0), what)
    }));
    sound.then_some(TomlDocument { root })
}

/// A value or a table.
pub enum TomlEntry<'a, T> {
    /// A value.
    Value(LocatedValue<T>),
    /// A table.
    Table(TomlSection<'a>),
}

/// A table of a document and its location.
#[derive(Clone, Debug)]
pub struct TomlSection<'a> {
    /// The table.
    pub table: &'a DeTable<'a>,
    /// Where it stands.
    pub location: KeyLocation,
}

/// Reads one table. Ask for every key that the table may have, then call [`TableReader::finish`].
pub struct TableReader<'a, 'p> {
    section: TomlSection<'a>,
    problems: &'p mut Vec<Problem>,
    /// Keys that the caller asked for, in that order.
    valid: Vec<&'static str>,
    /// Keys that are known but refused.
    refused: Vec<&'static str>,
}

impl<'a, 'p> TableReader<'a, 'p> {
    /// A reader of `section` that reports into `problems`.
    pub const fn new(section: TomlSection<'a>, problems: &'p mut Vec<Problem>) -> Self {
        Self {
            section,
            problems,
            valid: Vec::new(),
            refused: Vec::new(),
        }
    }

    /// The location of the table.
    #[must_use]
    pub const fn location(&self) -> &KeyLocation {
        &self.section.location
    }

    /// The table.
    #[must_use]
    pub const fn section(&self) -> &TomlSection<'a> {
        &self.section
    }

    /// Whether the table has no keys.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.section.table.is_empty()
    }

    /// The number of keys in the table.
    #[must_use]
    pub fn len(&self) -> usize {
        self.section.table.len()
    }

    /// A reader of a table inside this one, from [`Self::table`] or [`Self::tables`].
    pub const fn open(&mut self, section: TomlSection<'a>) -> TableReader<'a, '_> {
        TableReader::new(section, self.problems)
    }

    /// The list that problems go to, for checks of the caller's own.
    pub const fn problems(&mut self) -> &mut Vec<Problem> {
        self.problems
    }

    /// The value of the required key `key`.
    pub fn required<T>(&mut self, key: &'static str, kind: &ValueKind<'_, T>) -> RequiredKey<T> {
        let Some(found) = self.find(key) else {
            self.report_missing(key, kind.right());
            return None;
        };
        self.read(found, kind)
    }

    /// The value of the optional key `key`.
    pub fn optional<T>(&mut self, key: &'static str, kind: &ValueKind<'_, T>) -> OptionalKey<T> {
        match self.find(key) {
            None => OptionalKey::Absent,
            Some(found) => self
                .read(found, kind)
                .map_or(OptionalKey::Invalid, OptionalKey::Valid),
        }
    }

    /// The optional list `key`. One invalid element makes the whole list invalid; each invalid element is
    /// reported.
    pub fn list<T>(
        &mut self,
        key: &'static str,
        kind: &ValueKind<'_, T>,
    ) -> OptionalKey<Vec<LocatedValue<T>>> {
        match self.find(key) {
            None => OptionalKey::Absent,
            Some(found) => self
                .read_list(found, kind)
                .map_or(OptionalKey::Invalid, OptionalKey::Valid),
        }
    }

    /// The required list `key`; otherwise as [`Self::list`].
    pub fn required_list<T>(
        &mut self,
        key: &'static str,
        kind: &ValueKind<'_, T>,
    ) -> RequiredKey<Vec<LocatedValue<T>>> {
        let Some(found) = self.find(key) else {
            self.report_missing(key, &format!("a list, each {}", kind.right()));
            return None;
        };
        self.read_list(found, kind)
    }

    /// The optional table `key`, read by `read`.
    pub fn inner<T>(
        &mut self,
        key: &'static str,
        read: impl FnOnce(TableReader<'a, '_>) -> T,
    ) -> OptionalKey<T> {
        match self.table(key) {
            OptionalKey::Absent => OptionalKey::Absent,
            OptionalKey::Invalid => OptionalKey::Invalid,
            OptionalKey::Valid(LocatedValue { value, location }) => {
                OptionalKey::Valid(LocatedValue {
                    value: read(self.open(value)),
                    location,
                })
            }
        }
    }

    /// The optional table `key`.
    pub fn table(&mut self, key: &'static str) -> OptionalKey<TomlSection<'a>> {
        match self.find(key) {
            None => OptionalKey::Absent,
            Some(found) => match self.as_section(found) {
                Some(section) => OptionalKey::Valid(LocatedValue {
                    location: section.location.clone(),
                    value: section,
                }),
                None => OptionalKey::Invalid,
            },
        }
    }

    /// The optional key `key`, a value or a table.
    pub fn value_or_table<T>(
        &mut self,
        key: &'static str,
        kind: &ValueKind<'_, T>,
    ) -> OptionalKey<TomlEntry<'a, T>> {
        match self.find(key) {
            None => OptionalKey::Absent,
            Some((location, DeValue::Table(table))) => {
                let section = TomlSection {
                    table,
                    location: location.clone(),
                };
                OptionalKey::Valid(LocatedValue {
                    value: TomlEntry::Table(section),
                    location,
                })
            }
            Some(found) => match self.read(found, kind) {
                Some(value) => {
                    let location = value.location.clone();
                    OptionalKey::Valid(LocatedValue {
                        value: TomlEntry::Value(value),
                        location,
                    })
                }
                None => OptionalKey::Invalid,
            },
        }
    }

    /// The optional list `key` of values and tables. One invalid element makes the whole list invalid; each invalid element
    /// is reported.
    pub fn values_or_tables<T>(
        &mut self,
        key: &'static str,
        kind: &ValueKind<'_, T>,
    ) -> OptionalKey<Vec<TomlEntry<'a, T>>> {
        let right = format!("{}, or a table", kind.right());
        let Some((location, value)) = self.find(key) else {
            return OptionalKey::Absent;
        };
        let DeValue::Array(elements) = value else {
            let what = format!("must be a list, not {}", kind_of(value));
            self.problems.push(
                location
                    .problem(what)
                    .right(format!("a list, each {right}")),
            );
            return OptionalKey::Invalid;
        };
        let mut list = Vec::new();
        for (index, element) in elements.iter().enumerate() {
            let place = location.element(index, element.span());
            list.extend(match element.get_ref() {
                DeValue::Table(table) => Some(TomlEntry::Table(TomlSection {
                    table,
                    location: place,
                })),
                value => self.read((place, value), kind).map(TomlEntry::Value),
            });
        }
        if list.len() == elements.len() {
            OptionalKey::Valid(LocatedValue {
                value: list,
                location,
            })
        } else {
            OptionalKey::Invalid
        }
    }

    /// The required table `key`.
    pub fn required_table(&mut self, key: &'static str) -> Option<TomlSection<'a>> {
        let Some(found) = self.find(key) else {
            self.report_missing(key, &format!("a table `{key}`"));
            return None;
        };
        self.as_section(found)
    }

    /// The tables `[[key]]` in the order of the file; empty if there are none.
    pub fn tables(&mut self, key: &'static str) -> Vec<TomlSection<'a>> {
        let Some((location, value)) = self.find(key) else {
            return Vec::new();
        };
        let DeValue::Array(elements) = value else {
            let what = format!("must be a list of tables, not {}", kind_of(value));
            self.problems.push(
                location
                    .problem(what)
                    .right(format!("headers in double brackets: `[[{key}]]`")),
            );
            return Vec::new();
        };
        let elements = elements.iter().enumerate();
        elements
            .filter_map(|(index, element)| {
                self.as_section((location.element(index, element.span()), element.get_ref()))
            })
            .collect()
    }

    /// The values of all keys, for a table whose keys the author of the file chooses. Invalid values are reported
    /// and omitted.
    pub fn all<T>(self, kind: &ValueKind<'_, T>) -> Vec<(String, LocatedValue<T>)> {
        let table = self.section.table;
        let entries = table.iter();
        entries
            .filter_map(|(key, value)| {
                let location = self.section.location.inner(key.get_ref(), value.span());
                let written = read_value(location, value.get_ref(), kind, self.problems)?;
                Some((key.get_ref().to_string(), written))
            })
            .collect()
    }

    /// The tables and values of all keys; otherwise as [`Self::all`].
    pub fn entries<T>(&mut self, kind: &ValueKind<'_, T>) -> Vec<(String, TomlEntry<'a, T>)> {
        let table = self.section.table;
        let mut entries = Vec::new();
        for (key, value) in table {
            let location = self.section.location.inner(key.get_ref(), value.span());
            let entry = match value.get_ref() {
                DeValue::Table(table) => Some(TomlEntry::Table(TomlSection { table, location })),
                value => read_value(location, value, kind, self.problems).map(TomlEntry::Value),
            };
            entries.extend(entry.map(|entry| (key.get_ref().to_string(), entry)));
        }
        entries
    }

    /// The lists of all keys; otherwise as [`Self::all`].
    pub fn all_lists<T>(
        mut self,
        kind: &ValueKind<'_, T>,
    ) -> Vec<(String, LocatedValue<Vec<LocatedValue<T>>>)> {
        let table = self.section.table;
        let mut lists = Vec::new();
        for (key, value) in table {
            let location = self.section.location.inner(key.get_ref(), value.span());
            let list = self.read_list((location, value.get_ref()), kind);
            lists.extend(list.map(|list| (key.get_ref().to_string(), list)));
        }
        lists
    }

    /// Refuses `key`, a known key that is not valid here, for the reason `what`. Does nothing if the table does not have it.
    pub fn refuse(&mut self, key: &'static str, what: &str, right: &str) {
        self.refused.push(key);
        if let Some((name, _)) = self.section.table.get_key_value(key) {
            let location = self.section.location.inner(key, name.span());
            location.refuse(what, right, self.problems);
        }
    }

    /// Refuses `key`, a known key that nothing serves. Does nothing if the table does not have it.
    pub fn refuse_unserved(&mut self, key: &'static str, right: &str) {
        let what =
            format!("`{key}` is not supported by this version; a key without effect is refused");
        self.refuse(key, &what, right);
    }

    /// Reports each unknown key (neither asked for nor refused), with the nearest valid one.
    pub fn finish(self) {
        for (name, _) in self.section.table {
            let key: &str = name.get_ref();
            if self.valid.contains(&key) || self.refused.contains(&key) {
                continue;
            }
            let location = self.section.location.inner(key, name.span());
            let right = match nearest(key, self.valid.iter().copied()) {
                Some(near) => format!("`{near}`"),
                None => format!("one of {}", self.valid.join(", ")),
            };
            self.problems.push(
                location
                    .problem(format!("unknown key `{key}`"))
                    .right(right),
            );
        }
    }

    fn find(&mut self, key: &'static str) -> Option<(KeyLocation, &'a DeValue<'a>)> {
        self.valid.push(key);
        let value = self.section.table.get(key)?;
        Some((
            self.section.location.inner(key, value.span()),
            value.get_ref(),
        ))
    }

    fn report_missing(&mut self, key: &str, right: &str) {
        let location = self.section.location.missing(key);
        self.problems
            .push(location.problem(format!("`{key}` is missing")).right(right));
    }

    fn read<T>(
        &mut self,
        (location, value): (KeyLocation, &DeValue<'_>),
        kind: &ValueKind<'_, T>,
    ) -> RequiredKey<T> {
        read_value(location, value, kind, self.problems)
    }

    fn read_list<T>(
        &mut self,
        (location, value): (KeyLocation, &DeValue<'_>),
        kind: &ValueKind<'_, T>,
    ) -> RequiredKey<Vec<LocatedValue<T>>> {
        let DeValue::Array(elements) = value else {
            let what = format!("must be a list, not {}", kind_of(value));
            self.problems.push(
                location
                    .problem(what)
                    .right(format!("a list, each {}", kind.right())),
            );
            return None;
        };
        let mut list = Vec::new();
        for (index, element) in elements.iter().enumerate() {
            list.extend(self.read(
                (location.element(index, element.span()), element.get_ref()),
                kind,
            ));
        }
        (list.len() == elements.len()).then_some(LocatedValue {
            value: list,
            location,
        })
    }

    fn as_section(
        &mut self,
        (location, value): (KeyLocation, &'a DeValue<'a>),
    ) -> Option<TomlSection<'a>> {
        if let DeValue::Table(table) = value {
            return Some(TomlSection { table, location });
        }
        let problem = location.problem(format!("must be a table, not {}", kind_of(value)));
        self.problems.push(problem.right("a table: `{ ... }`"));
        None
    }
}

fn read_value<T>(
    location: KeyLocation,
    value: &DeValue<'_>,
    kind: &ValueKind<'_, T>,
    problems: &mut Vec<Problem>,
) -> RequiredKey<T> {
    match kind.read(value) {
        Ok(value) => Some(LocatedValue { value, location }),
        Err(wrong) => {
            let right = wrong.right.unwrap_or_else(|| kind.right().to_owned());
            problems.push(location.problem(wrong.what).right(right));
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problems_of(text: &str, read: impl FnOnce(&mut TableReader<'_, '_>)) -> String {
        let mut problems = Vec::new();
        if let Some(document) = document(text, &mut problems) {
            let mut reader = TableReader::new(document.section(), &mut problems);
            read(&mut reader);
            reader.finish();
        }
        let lines = problems.iter().map(|problem| {
            let (line, column) = problem.place_in(text);
            format!(
                "{line}:{column} {}: {} -> {}\n",
                problem.key,
                problem.what,
                problem.right.as_deref().unwrap_or("")
            )
        });
        lines.collect()
    }

    #[test]
    fn every_mistake_is_reported_with_its_place() {
        let text = "buad = 1\nname = 5\n[[line]]\nsize = 'x'\n[[line]]\n[one]\nlist = [1, 'b', 300]\nold = 1\n";
        let found = problems_of(text, |reader| {
            assert_eq!(reader.required("name", &ValueKind::text()), None);
            assert_eq!(
                reader.optional("baud", &ValueKind::number(1..=9_u8)),
                OptionalKey::Absent
            );
            for section in reader.tables("line") {
                let mut line = reader.open(section);
                assert_eq!(line.required("size", &ValueKind::number(1..=9_u8)), None);
                line.finish();
            }
            let one = reader.required_table("one").unwrap();
            let mut one = reader.open(one);
            assert_eq!(
                one.list("list", &ValueKind::number(0..=255_u8)),
                OptionalKey::Invalid
            );
            one.refuse("old", "`old` does nothing", "leave it out");
            one.finish();
            assert!(reader.required_table("two").is_none());
        });
        let expected = "\
2:8 name: must be text, not a whole number -> text, not empty
4:8 line[0].size: must be a whole number, not text -> a whole number from 1 to 9
5:1 line[1].size: `size` is missing -> a whole number from 1 to 9
7:12 one.list[1]: must be a whole number, not text -> a whole number from 0 to 255
7:17 one.list[2]: 300 is out of range -> a whole number from 0 to 255
8:1 one.old: `old` does nothing -> leave it out
1:1 two: `two` is missing -> a table `two`
1:1 buad: unknown key `buad` -> `baud`
";
        assert_eq!(found, expected);
    }

    #[test]
    fn every_break_of_the_grammar_is_reported() {
        let found = problems_of("a = \nb = 1\nb = 2\n", |_| unreachable!("no table to read"));
        assert_eq!(found.lines().count(), 2, "{found}");
        assert!(found.contains("3:1") && found.starts_with("1:"), "{found}");
    }

    #[test]
    fn a_list_or_table_of_the_wrong_kind_is_reported() {
        let found = problems_of("a = 1\nb = 2\nc = 3\n", |reader| {
            assert!(reader.tables("a").is_empty());
            assert!(matches!(reader.table("b"), OptionalKey::Invalid));
            assert!(reader.required_list("c", &ValueKind::flag()).is_none());
            assert!(reader.required_list("d", &ValueKind::flag()).is_none());
        });
        let expected = "\
1:5 a: must be a list of tables, not a whole number -> headers in double brackets: `[[a]]`
2:5 b: must be a table, not a whole number -> a table: `{ ... }`
3:5 c: must be a list, not a whole number -> a list, each true or false
1:1 d: `d` is missing -> a list, each true or false
";
        assert_eq!(found, expected);
    }

    #[test]
    fn a_table_of_free_keys_is_read_whole() {
        let mut problems = Vec::new();
        let document = document("x = 'a'\ny = 1\nz = 'b'\n", &mut problems).unwrap();
        let all = TableReader::new(document.section(), &mut problems).all(&ValueKind::text());
        let all: Vec<_> = all
            .iter()
            .map(|(key, text)| (key.as_str(), text.value.as_str()))
            .collect();
        assert_eq!(all, [("x", "a"), ("z", "b")]);
        assert_eq!(problems[0].key, "y");
    }
}
