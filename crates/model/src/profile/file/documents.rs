//! `[documents]`: the documents that facts cite.

use super::facts::filled_with;
use crate::domain::problem::Problem;
use crate::profile::model::{Confidence, DocumentKind, ModelDocument};
use crate::profile::words::DOCUMENT_KINDS;
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader, TomlEntry};
use std::collections::BTreeSet;

/// The documents of a file, each under its short name.
pub(in crate::profile) struct DocumentsFile(Vec<(String, Option<ModelDocument>)>);

impl DocumentsFile {
    /// Reads `[documents]`: each short name maps to a title, for a manual of this very model, or to a table with further
    /// keys.
    pub(in crate::profile) fn read(mut reader: TableReader<'_, '_>) -> Self {
        let mut documents = Vec::new();
        let mut made_from = Vec::new();
        for (name, entry) in reader.entries(&ValueKind::text()) {
            let document = match entry {
                TomlEntry::Value(title) => {
                    let kind = DocumentKind::Manual;
                    let title = title.value;
                    Some(ModelDocument {
                        name: name.clone(),
                        title,
                        kind,
                        of: Vec::new(),
                        made_from: None,
                    })
                }
                TomlEntry::Table(section) => document(&name, reader.open(section), &mut made_from),
            };
            documents.push((name, document));
        }
        let all = Self(documents);
        for from in made_from {
            if all.find(&from.value).is_none() {
                let names: Vec<_> = all.names().map(|name| format!("\"{name}\"")).collect();
                let problem = from
                    .location
                    .problem(format!("there is no document `{}`", from.value));
                reader.problems().push(problem.right(names.join(" or ")));
            }
        }
        all
    }

    /// Whether neither of two documents was made from the other, nor both from a third one.
    pub(super) fn are_independent(&self, one: &str, other: &str) -> bool {
        self.origins(one).is_disjoint(&self.origins(other))
    }

    /// Whether any of them is of the model `id`.
    pub(super) fn cover(&self, id: &str) -> bool {
        self.0
            .iter()
            .any(|(_, document)| document.as_ref().is_none_or(|it| it.is_of(id)))
    }

    /// What to report where no document is of the model `id` and the facts of `claims` claim more than that supports.
    pub(super) fn without_document(
        &self,
        id: &LocatedValue<String>,
        claims: Vec<Problem>,
    ) -> Vec<Problem> {
        if claims.len() < 2 {
            return claims;
        }
        let of: BTreeSet<_> = self
            .0
            .iter()
            .filter_map(|(_, it)| it.as_ref())
            .flat_map(|it| &it.of)
            .collect();
        let of: Vec<_> = of.into_iter().map(|of| format!("`{of}`")).collect();
        let what = format!(
            "no document is of `{}`, and {} facts need one",
            id.value,
            claims.len()
        );
        let right = format!("{}, or this one in `of` of its manual", of.join(", "));
        vec![id.location.problem(what).right(right)]
    }

    /// The document called `name` and everything that it was made from.
    fn origins<'d>(&'d self, name: &'d str) -> BTreeSet<&'d str> {
        let mut origins = BTreeSet::new();
        let mut next = Some(name);
        while let Some(name) = next.filter(|name| origins.insert(*name)) {
            next = self
                .find(name)
                .flatten()
                .and_then(|document| document.made_from.as_deref());
        }
        origins
    }

    /// The document called `name`: `None` if there is none, `Some(None)` if it is unusable.
    pub(in crate::profile) fn find(&self, name: &str) -> Option<Option<&ModelDocument>> {
        self.0
            .iter()
            .find(|(it, _)| it == name)
            .map(|(_, document)| document.as_ref())
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.0.iter().map(|(name, _)| name.as_str())
    }

    /// `None` if any of them is unusable.
    pub(super) fn ready(&self) -> Option<Vec<ModelDocument>> {
        self.0
            .iter()
            .map(|(_, document)| document.clone())
            .collect()
    }
}

fn document(
    name: &str,
    mut reader: TableReader<'_, '_>,
    all_from: &mut Vec<LocatedValue<String>>,
) -> Option<ModelDocument> {
    let title = reader.required("title", &ValueKind::text());
    let kind: RequiredKey<DocumentKind> =
        reader.required("kind", &ValueKind::one_of(&DOCUMENT_KINDS));
    let of = match reader.list("of", &ValueKind::text()) {
        OptionalKey::Valid(of) => filled_with(of, &ValueKind::text(), reader.problems())
            .map_or(OptionalKey::Invalid, OptionalKey::Valid),
        other => other,
    };
    let made_from = reader.optional("made_from", &ValueKind::text());
    all_from.extend(made_from.valid().cloned());
    reader.finish();
    let made_from = made_from.optional()?;
    let of = of
        .optional()?
        .unwrap_or_default()
        .into_iter()
        .map(|it| it.value)
        .collect();
    Some(ModelDocument {
        name: name.to_owned(),
        title: title?.value,
        kind: kind?.value,
        of,
        made_from,
    })
}

/// A description of `document`, and the best confidence it supports for facts of the model `id`.
pub(super) fn at_best(document: &ModelDocument, id: &str) -> (String, Confidence) {
    let article = match document.kind {
        DocumentKind::Addendum => "an",
        _ => "a",
    };
    let kind = format!("{article} {}", document.kind.keyword());
    let best = document.best(id);
    let of = if document.is_of(id) {
        "this model".to_owned()
    } else {
        document.of.join(", ")
    };
    (format!("`{}` is {kind} of {of}", document.name), best)
}
