//! Facts: a value with its confidence and its source.

use super::documents::{DocumentsFile, at_best};
use crate::domain::problem::Problem;
use crate::profile::like::row_of;
use crate::profile::model::{Confidence, Fact, ModelDocument, SecondSource};
use crate::profile::words::CONFIDENCES;
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader, TomlSection};
use std::cell::RefCell;

/// Confidence and source of a fact.
pub(in crate::profile) type Origin = (Confidence, String);

/// A fact as written: a table with the value, its confidence and its source. Parts that are `None` are already
/// reported.
pub(in crate::profile) struct FactFile<T> {
    pub value: RequiredKey<T>,
    pub origin: Option<Origin>,
}

impl<T> FactFile<T> {
    const UNUSABLE: Self = Self {
        value: None,
        origin: None,
    };

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
pub(super) fn optional<T: Clone>(fact: Option<&FactFile<T>>) -> Option<Option<Fact<T>>> {
    fact.map_or(Some(None), |fact| fact.ready().map(Some))
}

/// Reads facts; checks that each cites a document, and claims no more confidence than the document supports.
pub(super) struct FactReader<'d> {
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
    /// The fact `key`, with its value under `value`.
    pub fn value<T>(
        &self,
        reader: &mut TableReader<'_, '_>,
        key: &'static str,
        kind: &ValueKind<'_, T>,
    ) -> FactFile<T> {
        self.needed(reader, key, |reader| reader.required("value", kind))
    }

    /// The fact `key`, with its value under `value`; `None` if it is left out.
    pub fn optional_value<T>(
        &self,
        reader: &mut TableReader<'_, '_>,
        key: &'static str,
        kind: &ValueKind<'_, T>,
    ) -> Option<FactFile<T>> {
        self.optional(reader, key, |reader| reader.required("value", kind))
    }

    /// The fact `key`, whose presence is its only content; `None` if it is left out.
    pub fn switch(
        &self,
        reader: &mut TableReader<'_, '_>,
        key: &'static str,
    ) -> Option<FactFile<()>> {
        self.optional(reader, key, |reader| whole(reader, |_| ()))
    }

    /// The fact `key`, whose value is a list under `value`.
    pub fn list<T>(
        &self,
        reader: &mut TableReader<'_, '_>,
        key: &'static str,
        kind: &ValueKind<'_, T>,
    ) -> FactFile<Vec<T>> {
        self.needed(reader, key, |reader| filled_list(reader, "value", kind))
    }

    /// The fact `key`; `value` reads its value from the table.
    pub fn needed<T>(
        &self,
        reader: &mut TableReader<'_, '_>,
        key: &'static str,
        value: impl FnOnce(&mut TableReader<'_, '_>) -> RequiredKey<T>,
    ) -> FactFile<T> {
        match reader.required_table(key) {
            None => FactFile::UNUSABLE,
            Some(section) => self.fact(reader.open(section), value),
        }
    }

    /// Like [`Self::needed`]; `None` if it is left out.
    pub fn optional<T>(
        &self,
        reader: &mut TableReader<'_, '_>,
        key: &'static str,
        value: impl FnOnce(&mut TableReader<'_, '_>) -> RequiredKey<T>,
    ) -> Option<FactFile<T>> {
        match reader.table(key) {
            OptionalKey::Absent => None,
            OptionalKey::Invalid => Some(FactFile::UNUSABLE),
            OptionalKey::Valid(section) => Some(self.fact(reader.open(section.value), value)),
        }
    }

    /// The fact that `reader` holds; `value` reads its value.
    pub fn fact<T>(
        &self,
        mut reader: TableReader<'_, '_>,
        value: impl FnOnce(&mut TableReader<'_, '_>) -> RequiredKey<T>,
    ) -> FactFile<T> {
        let fact = FactFile {
            value: value(&mut reader),
            origin: self.origin(&mut reader),
        };
        reader.finish();
        fact
    }

    /// The keys `confidence` and `source`, which every fact and register has, and `also`, which it may have.
    pub fn origin(&self, reader: &mut TableReader<'_, '_>) -> Option<Origin> {
        let confidence = reader.required("confidence", &ValueKind::one_of(&CONFIDENCES));
        let right = "a document's short name and a place in it, or the reason for a default";
        let source = reader.required("source", &ValueKind::parsed(right, filled));
        let also = reader.optional(
            "also",
            &ValueKind::parsed("another document's short name and a place in it", filled),
        );
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

/// A value with several parts beside confidence and source, at the location of its table.
pub(super) fn whole<T>(
    reader: &mut TableReader<'_, '_>,
    parts: impl FnOnce(&mut TableReader<'_, '_>) -> T,
) -> RequiredKey<T> {
    let value = parts(reader);
    Some(LocatedValue {
        value,
        location: reader.location().clone(),
    })
}

/// A list with at least one element.
pub(super) fn filled_list<T>(
    reader: &mut TableReader<'_, '_>,
    key: &'static str,
    kind: &ValueKind<'_, T>,
) -> RequiredKey<Vec<T>> {
    let list = reader.required_list(key, kind)?;
    let LocatedValue {
        value: list,
        location,
    } = filled_with(list, kind, reader.problems())?;
    Some(LocatedValue {
        value: list.into_iter().map(|written| written.value).collect(),
        location,
    })
}

/// `list` if it has at least one element.
pub(super) fn filled_with<T>(
    list: LocatedValue<Vec<LocatedValue<T>>>,
    kind: &ValueKind<'_, T>,
    problems: &mut Vec<Problem>,
) -> RequiredKey<Vec<LocatedValue<T>>> {
    if list.value.is_empty() {
        problems.push(
            list.location
                .problem("is empty")
                .right(format!("at least {}", kind.right())),
        );
        return None;
    }
    Some(list)
}

pub(super) fn filled(text: &str) -> Option<String> {
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}
