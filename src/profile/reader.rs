//! Reads a TOML document table by table and reports every mistake in it, with its place, not only the first.
//!
//! Whoever reads a table asks a [`Reader`] for each key by name and says with a [`Kind`] what the value may be.
//! What is wrong goes into the list of problems and reading goes on; [`Reader::finish`] then reports each key
//! that nobody asked for.
//!
//! ```
//! use vfd_gateway::profile::reader::{Reader, document};
//! use vfd_gateway::profile::values::Kind;
//!
//! let mut problems = Vec::new();
//! if let Some(root) = document("baud = 0\nparrot = 'none'", &mut problems) {
//!     let mut reader = Reader::new(root.section(), &mut problems);
//!     let baud = reader.required("baud", &Kind::number(2400..=38_400_u32));
//!     let parity = reader.optional("parity", &Kind::one_of(&[("none", 0), ("even", 1)]));
//!     reader.finish();
//!     assert_eq!((baud, parity.or(0)), (None, Some(0)));
//! }
//! assert_eq!(problems.len(), 2);
//! ```

use super::values::Kind;
use crate::domain::problem::{Problem, nearest};
use serde_spanned::Spanned;
use std::ops::Range;
use toml::de::{DeTable, DeValue};

/// Where something stands in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The key as a path, `line[0].drive[2].station`; empty for the file itself.
    pub key: String,
    /// Bytes of the text; empty at 0 for the file itself.
    pub span: Range<usize>,
}

impl Place {
    /// A problem at this place.
    #[must_use]
    pub fn problem(&self, what: impl Into<String>) -> Problem {
        Problem::new(self.key.clone(), self.span.clone(), what)
    }

    /// The place of the key `name`, which is not there, in the table at this place.
    #[must_use]
    pub fn missing(&self, name: &str) -> Self {
        self.inner(name, self.span.clone())
    }

    /// The place of the key `name`, which stands at `span`, in the table at this place.
    fn inner(&self, name: &str, span: Range<usize>) -> Self {
        let key = if self.key.is_empty() { name.to_owned() } else { format!("{}.{name}", self.key) };
        Self { key, span }
    }

    /// The place of the element `index`, which stands at `span`, of the list at this place.
    fn element(&self, index: usize, span: Range<usize>) -> Self {
        Self { key: format!("{}[{index}]", self.key), span }
    }
}

/// A value and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Written<T> {
    /// The value.
    pub value: T,
    /// Where it stands.
    pub place: Place,
}

/// What became of a key that may be left out.
#[derive(Clone, Debug, PartialEq)]
pub enum Given<T> {
    /// The key is not there.
    LeftOut,
    /// The key is there with a value that cannot be used; the problem is already reported.
    Unusable,
    /// The key is there.
    Usable(Written<T>),
}

impl<T> Given<T> {
    /// The value, where it is there and usable.
    pub const fn usable(&self) -> Option<&Written<T>> {
        match self {
            Self::Usable(written) => Some(written),
            Self::LeftOut | Self::Unusable => None,
        }
    }

    /// The value, or nothing inside where it is left out; nothing at all where it is unusable.
    pub fn optional(self) -> Option<Option<T>> {
        match self {
            Self::LeftOut => Some(None),
            Self::Unusable => None,
            Self::Usable(written) => Some(Some(written.value)),
        }
    }
}

impl<T: Clone> Given<T> {
    /// The value, or `default` where it is left out; nothing where it is unusable.
    pub fn or(&self, default: T) -> Option<T> {
        match self {
            Self::LeftOut => Some(default),
            Self::Unusable => None,
            Self::Usable(written) => Some(written.value.clone()),
        }
    }
}

/// A value that must be there; nothing: the problem is already reported.
pub type Needed<T> = Option<Written<T>>;

/// A parsed document.
pub struct Document<'a> {
    root: Spanned<DeTable<'a>>,
}

impl Document<'_> {
    /// The outermost table.
    #[must_use]
    pub fn section(&self) -> Section<'_> {
        Section { table: self.root.get_ref(), place: Place { key: String::new(), span: 0..0 } }
    }
}

/// Parses `text`. Nothing: it is no TOML, and every place where it is none is in `problems` (with an empty key).
pub fn document<'a>(text: &'a str, problems: &mut Vec<Problem>) -> Option<Document<'a>> {
    let (root, errors) = DeTable::parse_recoverable(text);
    let sound = errors.is_empty();
    problems.extend(errors.into_iter().map(|error| {
        let what = format!("this is no TOML: {}", error.message().replace('\n', ", "));
        Problem::new("", error.span().unwrap_or(0..0), what)
    }));
    sound.then_some(Document { root })
}

/// A value, or a table in its place.
pub enum Entry<'a, T> {
    /// A value.
    Value(Written<T>),
    /// A table.
    Table(Section<'a>),
}

/// A table of a document and where it stands.
#[derive(Clone, Debug)]
pub struct Section<'a> {
    /// The table.
    pub table: &'a DeTable<'a>,
    /// Where it stands.
    pub place: Place,
}

/// Reads one table. Ask for every key that the table may hold, then call [`Reader::finish`].
pub struct Reader<'a, 'p> {
    section: Section<'a>,
    problems: &'p mut Vec<Problem>,
    /// Keys that were asked for, in that order.
    valid: Vec<&'static str>,
    /// Keys that are known but refused.
    refused: Vec<&'static str>,
}

impl<'a, 'p> Reader<'a, 'p> {
    /// A reader of `section` that reports into `problems`.
    pub const fn new(section: Section<'a>, problems: &'p mut Vec<Problem>) -> Self {
        Self { section, problems, valid: Vec::new(), refused: Vec::new() }
    }

    /// Where the table stands.
    #[must_use]
    pub const fn place(&self) -> &Place {
        &self.section.place
    }

    /// Whether the table holds no key at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.section.table.is_empty()
    }

    /// A reader of a table inside this one, from [`Self::table`] or [`Self::tables`].
    pub const fn open(&mut self, section: Section<'a>) -> Reader<'a, '_> {
        Reader::new(section, self.problems)
    }

    /// The list that problems go to, for checks of the caller's own.
    pub const fn problems(&mut self) -> &mut Vec<Problem> {
        self.problems
    }

    /// The value of `key`, which must be there.
    pub fn required<T>(&mut self, key: &'static str, kind: &Kind<'_, T>) -> Needed<T> {
        let Some(found) = self.find(key) else {
            self.report_missing(key, kind.right());
            return None;
        };
        self.read(found, kind)
    }

    /// The value of `key`, which may be left out.
    pub fn optional<T>(&mut self, key: &'static str, kind: &Kind<'_, T>) -> Given<T> {
        match self.find(key) {
            None => Given::LeftOut,
            Some(found) => self.read(found, kind).map_or(Given::Unusable, Given::Usable),
        }
    }

    /// The list `key`, which may be left out. It is unusable as soon as one element is wrong; each wrong one
    /// is reported.
    pub fn list<T>(&mut self, key: &'static str, kind: &Kind<'_, T>) -> Given<Vec<Written<T>>> {
        match self.find(key) {
            None => Given::LeftOut,
            Some(found) => self.read_list(found, kind).map_or(Given::Unusable, Given::Usable),
        }
    }

    /// The list `key`, which must be there; otherwise as [`Self::list`].
    pub fn required_list<T>(&mut self, key: &'static str, kind: &Kind<'_, T>) -> Needed<Vec<Written<T>>> {
        let Some(found) = self.find(key) else {
            self.report_missing(key, &format!("a list, each {}", kind.right()));
            return None;
        };
        self.read_list(found, kind)
    }

    /// The table `key`, which may be left out.
    pub fn table(&mut self, key: &'static str) -> Given<Section<'a>> {
        match self.find(key) {
            None => Given::LeftOut,
            Some(found) => match self.as_section(found) {
                Some(section) => Given::Usable(Written { place: section.place.clone(), value: section }),
                None => Given::Unusable,
            },
        }
    }

    /// The table `key`, which must be there.
    pub fn required_table(&mut self, key: &'static str) -> Option<Section<'a>> {
        let Some(found) = self.find(key) else {
            self.report_missing(key, &format!("a table `{key}`"));
            return None;
        };
        self.as_section(found)
    }

    /// The tables `[[key]]`, in the order of the file; none if they are left out.
    pub fn tables(&mut self, key: &'static str) -> Vec<Section<'a>> {
        let Some((place, value)) = self.find(key) else { return Vec::new() };
        let DeValue::Array(elements) = value else {
            let what = format!("must be a list of tables, not {}", kind_of(value));
            self.problems.push(place.problem(what).right(format!("headers in double brackets: `[[{key}]]`")));
            return Vec::new();
        };
        let elements = elements.iter().enumerate();
        elements
            .filter_map(|(index, element)| self.as_section((place.element(index, element.span()), element.get_ref())))
            .collect()
    }

    /// The values of all keys, for a table whose keys the writer of the file chooses. Each wrong one is reported
    /// and left out.
    pub fn all<T>(self, kind: &Kind<'_, T>) -> Vec<(String, Written<T>)> {
        let table = self.section.table;
        let entries = table.iter();
        entries
            .filter_map(|(key, value)| {
                let place = self.section.place.inner(key.get_ref(), value.span());
                let written = read_value(place, value.get_ref(), kind, self.problems)?;
                Some((key.get_ref().to_string(), written))
            })
            .collect()
    }

    /// What stands under all keys, a table or a value; otherwise as [`Self::all`].
    pub fn entries<T>(&mut self, kind: &Kind<'_, T>) -> Vec<(String, Entry<'a, T>)> {
        let table = self.section.table;
        let mut entries = Vec::new();
        for (key, value) in table {
            let place = self.section.place.inner(key.get_ref(), value.span());
            let entry = match value.get_ref() {
                DeValue::Table(table) => Some(Entry::Table(Section { table, place })),
                value => read_value(place, value, kind, self.problems).map(Entry::Value),
            };
            entries.extend(entry.map(|entry| (key.get_ref().to_string(), entry)));
        }
        entries
    }

    /// The lists of all keys; otherwise as [`Self::all`].
    pub fn all_lists<T>(mut self, kind: &Kind<'_, T>) -> Vec<(String, Written<Vec<Written<T>>>)> {
        let table = self.section.table;
        let mut lists = Vec::new();
        for (key, value) in table {
            let place = self.section.place.inner(key.get_ref(), value.span());
            let list = self.read_list((place, value.get_ref()), kind);
            lists.extend(list.map(|list| (key.get_ref().to_string(), list)));
        }
        lists
    }

    /// Refuses the key `key`, which the reader knows but does not take. Nothing happens where it is not there.
    pub fn refuse(&mut self, key: &'static str, what: impl Into<String>, right: impl Into<String>) {
        self.refused.push(key);
        if let Some((name, _)) = self.section.table.get_key_value(key) {
            let place = self.section.place.inner(key, name.span());
            self.problems.push(place.problem(what).right(right));
        }
    }

    /// Reports each key that was neither asked for nor refused, with the nearest valid one.
    pub fn finish(self) {
        for (name, _) in self.section.table {
            let key: &str = name.get_ref();
            if self.valid.contains(&key) || self.refused.contains(&key) {
                continue;
            }
            let place = self.section.place.inner(key, name.span());
            let right = match nearest(key, self.valid.iter().copied()) {
                Some(near) => format!("`{near}`"),
                None => format!("one of {}", self.valid.join(", ")),
            };
            self.problems.push(place.problem(format!("there is no key `{key}` here")).right(right));
        }
    }

    fn find(&mut self, key: &'static str) -> Option<(Place, &'a DeValue<'a>)> {
        self.valid.push(key);
        let value = self.section.table.get(key)?;
        Some((self.section.place.inner(key, value.span()), value.get_ref()))
    }

    fn report_missing(&mut self, key: &str, right: &str) {
        let place = self.section.place.missing(key);
        self.problems.push(place.problem(format!("`{key}` is missing")).right(right));
    }

    fn read<T>(&mut self, (place, value): (Place, &DeValue<'_>), kind: &Kind<'_, T>) -> Needed<T> {
        read_value(place, value, kind, self.problems)
    }

    fn read_list<T>(&mut self, (place, value): (Place, &DeValue<'_>), kind: &Kind<'_, T>) -> Needed<Vec<Written<T>>> {
        let DeValue::Array(elements) = value else {
            let what = format!("must be a list, not {}", kind_of(value));
            self.problems.push(place.problem(what).right(format!("a list, each {}", kind.right())));
            return None;
        };
        let mut list = Vec::new();
        for (index, element) in elements.iter().enumerate() {
            list.extend(self.read((place.element(index, element.span()), element.get_ref()), kind));
        }
        (list.len() == elements.len()).then_some(Written { value: list, place })
    }

    fn as_section(&mut self, (place, value): (Place, &'a DeValue<'a>)) -> Option<Section<'a>> {
        if let DeValue::Table(table) = value {
            return Some(Section { table, place });
        }
        let problem = place.problem(format!("must be a table, not {}", kind_of(value)));
        self.problems.push(problem.right("a table: `{ ... }`"));
        None
    }
}

/// What `value` is, as a message calls it.
pub(super) const fn kind_of(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "text",
        DeValue::Integer(_) => "a whole number",
        DeValue::Float(_) => "a decimal number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}

fn read_value<T>(place: Place, value: &DeValue<'_>, kind: &Kind<'_, T>, problems: &mut Vec<Problem>) -> Needed<T> {
    match kind.read(value) {
        Ok(value) => Some(Written { value, place }),
        Err(wrong) => {
            let right = wrong.right.unwrap_or_else(|| kind.right().to_owned());
            problems.push(place.problem(wrong.what).right(right));
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problems_of(text: &str, read: impl FnOnce(&mut Reader<'_, '_>)) -> String {
        let mut problems = Vec::new();
        if let Some(document) = document(text, &mut problems) {
            let mut reader = Reader::new(document.section(), &mut problems);
            read(&mut reader);
            reader.finish();
        }
        let lines = problems.iter().map(|problem| {
            let (line, column) = problem.place_in(text);
            format!("{line}:{column} {}: {} -> {}\n", problem.key, problem.what, problem.right.as_deref().unwrap_or(""))
        });
        lines.collect()
    }

    #[test]
    fn every_mistake_is_reported_with_its_place() {
        let text = "buad = 1\nname = 5\n[[line]]\nsize = 'x'\n[[line]]\n[one]\nlist = [1, 'b', 300]\nold = 1\n";
        let found = problems_of(text, |reader| {
            assert_eq!(reader.required("name", &Kind::text()), None);
            assert_eq!(reader.optional("baud", &Kind::number(1..=9_u8)), Given::LeftOut);
            for section in reader.tables("line") {
                let mut line = reader.open(section);
                assert_eq!(line.required("size", &Kind::number(1..=9_u8)), None);
                line.finish();
            }
            let one = reader.required_table("one").unwrap();
            let mut one = reader.open(one);
            assert_eq!(one.list("list", &Kind::number(0..=255_u8)), Given::Unusable);
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
1:1 buad: there is no key `buad` here -> `baud`
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
            assert!(matches!(reader.table("b"), Given::Unusable));
            assert!(reader.required_list("c", &Kind::flag()).is_none());
            assert!(reader.required_list("d", &Kind::flag()).is_none());
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
        let all = Reader::new(document.section(), &mut problems).all(&Kind::text());
        let all: Vec<_> = all.iter().map(|(key, text)| (key.as_str(), text.value.as_str())).collect();
        assert_eq!(all, [("x", "a"), ("z", "b")]);
        assert_eq!(problems[0].key, "y");
    }
}
