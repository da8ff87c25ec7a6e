//! Facts: a value beside how sure it is and where it comes from.

use super::documents::{DocumentsFile, at_best};
use crate::domain::problem::Problem;
use crate::profile::model::{Confidence, Fact};
use crate::profile::words::CONFIDENCES;
use crate::toml_file::values::Kind;
use crate::toml_file::{OptionalKey, Reader, RequiredKey, Section, Spanned};

/// How sure something is, and where it comes from.
pub(in crate::profile) type Origin = (Confidence, String);

/// A fact as written: a table that holds the value, its confidence and its source. What of it is nothing is
/// already reported.
pub(in crate::profile) struct FactFile<T> {
    pub value: RequiredKey<T>,
    pub origin: Option<Origin>,
}

impl<T> FactFile<T> {
    const UNUSABLE: Self = Self { value: None, origin: None };

    /// The fact with its value made into another, where all of it can be used.
    pub fn and_then<U>(&self, make: impl FnOnce(&T) -> Option<U>) -> Option<Fact<U>> {
        fact(make(&self.value.as_ref()?.value)?, self.origin.as_ref())
    }
}

impl<T: Clone> FactFile<T> {
    /// The fact, where all of it can be used.
    pub fn ready(&self) -> Option<Fact<T>> {
        self.and_then(|value| Some(value.clone()))
    }
}

/// `value` with where it comes from, where that can be used.
pub(super) fn fact<T>(value: T, origin: Option<&Origin>) -> Option<Fact<T>> {
    let (confidence, source) = origin?.clone();
    Some(Fact { value, confidence, source })
}

/// Nothing inside where the fact is left out; nothing at all where it cannot be used.
pub(super) fn optional<T: Clone>(fact: Option<&FactFile<T>>) -> Option<Option<Fact<T>>> {
    fact.map_or(Some(None), |fact| fact.ready().map(Some))
}

/// Reads facts and checks that each names one of the documents, and is no surer than that document makes it.
pub(super) struct Facts<'d> {
    /// Nothing: the documents themselves cannot be read, so no source can be told wrong.
    pub documents: Option<&'d DocumentsFile>,
    /// The model's identifier, where it can be used: what a document proves depends on what it is about.
    pub model: Option<&'d str>,
    /// Whether a fact may be a choice without a document.
    pub defaults: bool,
}

impl Facts<'_> {
    /// The fact `key`, whose value stands under `value`.
    pub fn value<T>(&self, reader: &mut Reader<'_, '_>, key: &'static str, kind: &Kind<'_, T>) -> FactFile<T> {
        self.needed(reader, key, |reader| reader.required("value", kind))
    }

    /// The fact `key`, whose value stands under `value`; nothing where it is left out.
    pub fn optional_value<T>(
        &self,
        reader: &mut Reader<'_, '_>,
        key: &'static str,
        kind: &Kind<'_, T>,
    ) -> Option<FactFile<T>> {
        self.optional(reader, key, |reader| reader.required("value", kind))
    }

    /// The fact `key` that says by being there all that it says; nothing where it is left out.
    pub fn switch(&self, reader: &mut Reader<'_, '_>, key: &'static str) -> Option<FactFile<()>> {
        self.optional(reader, key, |reader| whole(reader, |_| ()))
    }

    /// The fact `key`, whose value is a list under `value`.
    pub fn list<T>(&self, reader: &mut Reader<'_, '_>, key: &'static str, kind: &Kind<'_, T>) -> FactFile<Vec<T>> {
        self.needed(reader, key, |reader| filled_list(reader, "value", kind))
    }

    /// The fact `key`, from whose table `value` reads what it says.
    pub fn needed<T>(
        &self,
        reader: &mut Reader<'_, '_>,
        key: &'static str,
        value: impl FnOnce(&mut Reader<'_, '_>) -> RequiredKey<T>,
    ) -> FactFile<T> {
        match reader.required_table(key) {
            None => FactFile::UNUSABLE,
            Some(section) => self.fact(reader.open(section), value),
        }
    }

    /// As [`Self::needed`]; nothing where it is left out.
    pub fn optional<T>(
        &self,
        reader: &mut Reader<'_, '_>,
        key: &'static str,
        value: impl FnOnce(&mut Reader<'_, '_>) -> RequiredKey<T>,
    ) -> Option<FactFile<T>> {
        match reader.table(key) {
            OptionalKey::Absent => None,
            OptionalKey::Invalid => Some(FactFile::UNUSABLE),
            OptionalKey::Valid(section) => Some(self.fact(reader.open(section.value), value)),
        }
    }

    /// The facts of the list `key`, each with its value under `value`.
    pub fn each<T>(&self, reader: &mut Reader<'_, '_>, key: &'static str, kind: &Kind<'_, T>) -> Vec<FactFile<T>> {
        let sections: Vec<Section<'_>> = reader.tables(key);
        let read = |section| self.fact(reader.open(section), |reader| reader.required("value", kind));
        sections.into_iter().map(read).collect()
    }

    fn fact<T>(
        &self,
        mut reader: Reader<'_, '_>,
        value: impl FnOnce(&mut Reader<'_, '_>) -> RequiredKey<T>,
    ) -> FactFile<T> {
        let fact = FactFile { value: value(&mut reader), origin: self.origin(&mut reader) };
        reader.finish();
        fact
    }

    /// The keys `confidence` and `source`, which stand in every fact and every register.
    pub fn origin(&self, reader: &mut Reader<'_, '_>) -> Option<Origin> {
        let confidence = reader.required("confidence", &Kind::one_of(&CONFIDENCES));
        let right = "a document's short name and a place in it, or the reason of a default";
        let source = reader.required("source", &Kind::parsed(right, filled));
        let confidence = confidence.filter(|it| self.may_be(it, reader.problems()))?;
        let cites = confidence.value != Confidence::Default;
        let source = source.filter(|it| !cites || self.is_cited(it, &confidence, reader.problems()))?;
        Some((confidence.value, source.value))
    }

    fn may_be(&self, confidence: &Spanned<Confidence>, problems: &mut Vec<Problem>) -> bool {
        let what = match confidence.value {
            Confidence::Default if !self.defaults => "`default` is for timings only: an unknown is never a default",
            Confidence::Configured => "`configured` is for registers that the gateway's configuration adds",
            _ => return true,
        };
        let right = "\"manual\", \"second-source\", \"third-party\", \"sibling\" or \"inferred\"";
        problems.push(confidence.location.problem(what).right(right));
        false
    }

    /// Whether `source` begins with a document and a place in it, and that document lets the fact be as sure as it says.
    fn is_cited(
        &self,
        source: &Spanned<String>,
        confidence: &Spanned<Confidence>,
        problems: &mut Vec<Problem>,
    ) -> bool {
        let Some(documents) = self.documents else { return true };
        let (name, location) = source.value.split_once(' ').unwrap_or((&source.value, ""));
        let Some(document) = documents.find(name).filter(|_| !location.is_empty()) else {
            let names: Vec<_> = documents.names().map(|name| format!("`{name} ...`")).collect();
            let problem = source.location.problem(format!("`{}` cites no place in a declared document", source.value));
            problems.push(problem.right(names.join(" or ")));
            return false;
        };
        let (Some(document), Some(model)) = (document, self.model) else { return true };
        let (what, best) = at_best(document, model);
        if confidence.value >= best {
            return true;
        }
        let word = confidence.value.word();
        let problem = confidence.location.problem(format!("the source does not make it \"{word}\": {what}"));
        problems.push(problem.right(format!("at best \"{}\", or another source", best.word())));
        false
    }
}

/// A value that has several parts beside confidence and source, which stands where its table stands.
pub(super) fn whole<T>(reader: &mut Reader<'_, '_>, parts: impl FnOnce(&mut Reader<'_, '_>) -> T) -> RequiredKey<T> {
    let value = parts(reader);
    Some(Spanned { value, location: reader.location().clone() })
}

/// A list with at least one element.
pub(super) fn filled_list<T>(
    reader: &mut Reader<'_, '_>,
    key: &'static str,
    kind: &Kind<'_, T>,
) -> RequiredKey<Vec<T>> {
    let list = reader.required_list(key, kind)?;
    let Spanned { value: list, location } = filled_with(list, kind, reader.problems())?;
    Some(Spanned { value: list.into_iter().map(|written| written.value).collect(), location })
}

/// `list`, where it has at least one element.
pub(super) fn filled_with<T>(
    list: Spanned<Vec<Spanned<T>>>,
    kind: &Kind<'_, T>,
    problems: &mut Vec<Problem>,
) -> RequiredKey<Vec<Spanned<T>>> {
    if list.value.is_empty() {
        problems.push(list.location.problem("is empty").right(format!("at least {}", kind.right())));
        return None;
    }
    Some(list)
}

fn filled(text: &str) -> Option<String> {
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}
