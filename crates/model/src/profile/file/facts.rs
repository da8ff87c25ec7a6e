//! Facts: a value with its confidence and its source.

use super::documents::{DocumentsFile, at_best};
use super::kinds::{filled, filled_list, values_of};
use crate::domain::problem::Problem;
use crate::profile::like::row_of;
use crate::profile::model::{Confidence, Fact, ModelDocument, SecondSource};
use crate::profile::words::CONFIDENCES;
use crate::toml_file::declare::{KeyForm, declare_table, no_key, optional, required};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader, TomlSection};
use std::cell::RefCell;

/// Confidence and source of a fact.
pub type Origin = (Confidence, String);

/// A fact as written: a table with the value, its confidence and its source. Parts that are `None` are already
/// reported.
#[derive(Clone, Debug)]
pub struct FactFile<T> {
    pub value: RequiredKey<T>,
    pub origin: Option<Origin>,
}

impl<T> Default for FactFile<T> {
    /// A fact without any usable part.
    fn default() -> Self {
        Self {
            value: None,
            origin: None,
        }
    }
}

impl<T> FactFile<T> {
    /// The fact with its value converted by `make`; `None` if any part is unusable.
    pub fn and_then<U>(&self, make: impl FnOnce(&T) -> Option<U>) -> Option<Fact<U>> {
        fact(make(&self.value.as_ref()?.value)?, self.origin.as_ref())
    }
}

impl<T: Clone> FactFile<T> {
    /// The fact; `None` if any part is unusable.
    pub fn ready(&self) -> Option<Fact<T>> {
        self.and_then(|value| Some(value.clone()))
    }
}

/// `value` with its origin; `None` if the origin is unusable.
pub(super) fn fact<T>(value: T, origin: Option<&Origin>) -> Option<Fact<T>> {
    let (confidence, source) = origin?.clone();
    Some(Fact {
        value,
        confidence,
        source,
    })
}

/// `Some(None)` if the fact is left out; `None` if it is unusable.
pub(super) fn given<T: Clone>(fact: &Option<FactFile<T>>) -> Option<Option<Fact<T>>> {
    match fact {
        None => Some(None),
        Some(fact) => fact.ready().map(Some),
    }
}

declare_table! {
    /// A fact is a table that says where its content comes from: `{ value = 3.5, confidence = "manual", source = "UM 9.2" }`. The
    /// tables below say which of them are facts; each row of a list of facts is one.
    SourcesFile is "[fact]" {
        /// How sure the fact is; no better than the document of its source allows.
        confidence: RequiredKey<Confidence> = required(ValueKind::one_of(&CONFIDENCES));
        /// The short name of a document of `[documents]`, a space, and the place in it. With `default`: the reason.
        source: RequiredKey<String> = required(ValueKind::parsed(
            "a document's short name and a place in it, or the reason for a default",
            filled,
        ));
        /// A second, independent source: a place in another document, neither of which was made from the other. It makes the
        /// fact no surer; `check --verbose` and `models check` say which of stop, forward and setpoint have one.
        also: OptionalKey<String> =
            optional(ValueKind::parsed("another document's short name and a place in it", filled)),
            without "none";
    }
}

/// What is valid for a fact.
pub const FACT: &str = "a fact";

/// Reads facts; checks that each cites a document, and claims no more confidence than the document supports.
#[derive(Clone, Copy)]
pub struct FactReader<'d> {
    /// `None`: the documents are unusable, so sources cannot be checked.
    pub documents: Option<&'d DocumentsFile>,
    /// The model's identifier, if usable: what a document proves depends on which models it covers.
    pub model: Option<&'d str>,
    /// Whether a fact may be a default without a document.
    pub defaults: bool,
    /// The second sources that were read.
    pub second: &'d RefCell<Vec<SecondSource>>,
    /// Facts that claim more than they may while no document is of this model at all: several are one mistake, in `id`
    /// or in `of`.
    pub without_document: &'d RefCell<Vec<Problem>>,
}

impl FactReader<'_> {
    /// A reader of facts that may be defaults.
    pub fn with_defaults(&self) -> Self {
        Self {
            defaults: true,
            ..*self
        }
    }

    /// A fact with its value under `value`.
    pub fn value<'k, T: 'k>(&'k self, kind: ValueKind<'k, T>) -> KeyForm<'k, FactFile<T>> {
        self.under_value(required(kind))
    }

    /// A fact whose value is a list under `value`.
    pub fn list<'k, T: Clone + 'k>(
        &'k self,
        kind: ValueKind<'k, T>,
    ) -> KeyForm<'k, FactFile<Vec<T>>> {
        let plain = |list: LocatedValue<Vec<LocatedValue<T>>>| LocatedValue {
            value: values_of(&list.value),
            location: list.location,
        };
        self.under_value(filled_list(kind).map(move |list| list.map(plain)))
    }

    fn under_value<'k, T: 'k>(
        &'k self,
        form: KeyForm<'k, RequiredKey<T>>,
    ) -> KeyForm<'k, FactFile<T>> {
        let right = format!("{FACT}: {}", form.valid.right);
        self.needed(move |reader| form.read(reader, "value"))
            .right(right)
    }

    /// A fact with its value under `value`, which may be left out.
    pub fn optional_value<'k, T: 'k>(
        &'k self,
        kind: ValueKind<'k, T>,
    ) -> KeyForm<'k, Option<FactFile<T>>> {
        let right = format!("{FACT}: {}", kind.right());
        self.optional(move |reader| reader.required("value", &kind))
            .right(right)
    }

    /// A fact whose presence is its only content.
    pub fn switch(&self) -> KeyForm<'_, Option<FactFile<()>>> {
        self.optional_parts(|_| ())
    }

    /// A fact with several keys beside its sources, read by `keys`.
    pub fn parts<'k, T: 'k>(
        &'k self,
        keys: impl Fn(&mut TableReader<'_, '_>) -> T + 'k,
    ) -> KeyForm<'k, FactFile<T>> {
        self.needed(move |reader| whole(reader, &keys))
    }

    /// A fact with several keys beside its sources, read by `keys`, which may be left out.
    pub fn optional_parts<'k, T: 'k>(
        &'k self,
        keys: impl Fn(&mut TableReader<'_, '_>) -> T + 'k,
    ) -> KeyForm<'k, Option<FactFile<T>>> {
        self.optional(move |reader| whole(reader, &keys))
    }

    fn needed<'k, T: 'k>(
        &'k self,
        value: impl Fn(&mut TableReader<'_, '_>) -> RequiredKey<T> + 'k,
    ) -> KeyForm<'k, FactFile<T>> {
        let form = KeyForm::new(FACT, move |reader, key| match reader.required_table(key) {
            None => FactFile::default(),
            Some(section) => self.fact(reader.open(section), &value),
        });
        form.needed()
    }

    fn optional<'k, T: 'k>(
        &'k self,
        value: impl Fn(&mut TableReader<'_, '_>) -> RequiredKey<T> + 'k,
    ) -> KeyForm<'k, Option<FactFile<T>>> {
        KeyForm::new(FACT, move |reader, key| match reader.table(key) {
            OptionalKey::Absent => None,
            OptionalKey::Invalid => Some(FactFile::default()),
            OptionalKey::Valid(section) => Some(self.fact(reader.open(section.value), &value)),
        })
    }

    /// The fact that `reader` holds; `value` reads its value.
    fn fact<T>(
        &self,
        mut reader: TableReader<'_, '_>,
        value: impl Fn(&mut TableReader<'_, '_>) -> RequiredKey<T>,
    ) -> FactFile<T> {
        let fact = FactFile {
            value: value(&mut reader),
            origin: self.origin(&mut reader),
        };
        reader.finish();
        fact
    }

    /// The keys `confidence`, `source` and `also` of a table that is a fact.
    pub fn sources(&self) -> KeyForm<'_, Option<Origin>> {
        no_key(move |reader| self.origin(reader))
    }

    fn origin(&self, reader: &mut TableReader<'_, '_>) -> Option<Origin> {
        let SourcesFile {
            confidence,
            source,
            also,
        } = SourcesFile::keys(reader);
        if let (Some(source), Some(also)) = (&source, also.valid())
            && self.is_second(source, also, confidence.as_ref(), reader.problems())
        {
            let key = key_of(reader.section());
            self.second.borrow_mut().push(SecondSource {
                key,
                source: also.value.clone(),
            });
        }
        let confidence = confidence.filter(|it| self.may_be(it, reader.problems()))?;
        let cites = confidence.value != Confidence::Default;
        let source =
            source.filter(|it| !cites || self.is_cited(it, &confidence, reader.problems()))?;
        Some((confidence.value, source.value))
    }

    /// Whether `also` is a second source beside `source`: a place in a document that is independent of the other one.
    fn is_second(
        &self,
        source: &LocatedValue<String>,
        also: &LocatedValue<String>,
        confidence: Option<&LocatedValue<Confidence>>,
        problems: &mut Vec<Problem>,
    ) -> bool {
        if confidence.is_some_and(|confidence| confidence.value == Confidence::Default) {
            problems.push(
                also.location
                    .problem("a default has no source")
                    .right("leave it out"),
            );
            return false;
        }
        let Some(documents) = self.documents else {
            return true;
        };
        let Some(Some(second)) = cited(documents, also, problems) else {
            return false;
        };
        let (first, _) = source.value.split_once(' ').unwrap_or((&source.value, ""));
        let is_second = documents.are_independent(first, &second.name);
        if !is_second {
            let how = if first == second.name {
                "is"
            } else {
                "was made from the same as"
            };
            let problem = also
                .location
                .problem(format!("`{}` {how} the document of `source`", second.name));
            problems.push(problem.right("an independent document, or leave it out"));
        }
        is_second
    }

    fn may_be(&self, confidence: &LocatedValue<Confidence>, problems: &mut Vec<Problem>) -> bool {
        let what = match confidence.value {
            Confidence::Default if !self.defaults => "`default` is allowed for timings only",
            Confidence::Configured => {
                "`configured` is reserved for registers added by the gateway's configuration"
            }
            _ => return true,
        };
        let right = "\"manual\", \"second-source\", \"third-party\", \"sibling\" or \"inferred\"";
        problems.push(confidence.location.problem(what).right(right));
        false
    }

    /// Whether `source` cites a place in a document, and that document supports the fact's confidence.
    fn is_cited(
        &self,
        source: &LocatedValue<String>,
        confidence: &LocatedValue<Confidence>,
        problems: &mut Vec<Problem>,
    ) -> bool {
        let Some(documents) = self.documents else {
            return true;
        };
        let Some(document) = cited(documents, source, problems) else {
            return false;
        };
        let (Some(document), Some(model)) = (document, self.model) else {
            return true;
        };
        let (what, best) = at_best(document, model);
        if confidence.value >= best {
            return true;
        }
        let word = confidence.value.keyword();
        let problem = confidence
            .location
            .problem(format!("the source does not support \"{word}\": {what}"));
        let problem = problem.right(format!("at best \"{}\", or another source", best.keyword()));
        if documents.cover(model) {
            problems.push(problem);
        } else {
            self.without_document.borrow_mut().push(problem);
        }
        false
    }
}

/// The document that `source` cites; `None`: there is none, which is reported. `Some(None)`: it is unusable.
fn cited<'d>(
    documents: &'d DocumentsFile,
    source: &LocatedValue<String>,
    problems: &mut Vec<Problem>,
) -> Option<Option<&'d ModelDocument>> {
    let (name, location) = source.value.split_once(' ').unwrap_or((&source.value, ""));
    let document = if location.is_empty() {
        None
    } else {
        documents.find(name)
    };
    if document.is_none() {
        let names: Vec<_> = documents
            .names()
            .map(|name| format!("`{name} ...`"))
            .collect();
        let what = format!(
            "`{}` does not cite a place in a declared document",
            source.value
        );
        problems.push(source.location.problem(what).right(names.join(" or ")));
    }
    document
}

/// The fact in `section`, as `without` calls it.
fn key_of(section: &TomlSection<'_>) -> String {
    let key = &section.location.key;
    let row = key
        .split_once('[')
        .and_then(|(list, _)| row_of(list, section.table));
    row.unwrap_or_else(|| key.clone())
}

/// A value with several keys, at the location of its table.
fn whole<T>(
    reader: &mut TableReader<'_, '_>,
    parts: impl FnOnce(&mut TableReader<'_, '_>) -> T,
) -> RequiredKey<T> {
    let value = parts(reader);
    Some(LocatedValue {
        value,
        location: reader.location().clone(),
    })
}
