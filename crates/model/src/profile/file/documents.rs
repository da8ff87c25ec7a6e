//! `[documents]`: the documents that facts cite.

use super::kinds::{optional_filled_list, values_of};
use crate::domain::problem::Problem;
use crate::profile::model::{Confidence, DocumentKind, ModelDocument};
use crate::profile::words::DOCUMENT_KINDS;
#[cfg(test)]
use crate::toml_file::declare::{DeclaredKey, DeclaredTable, KeyForm};
use crate::toml_file::declare::{declare_table, optional, required};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader, TomlEntry};
use std::collections::BTreeSet;

declare_table! {
    /// A document whose facts may be less sure than those of a manual, or of other models.
    DocumentFile is "documents.NAME" {
        /// The title.
        title: RequiredKey<String> = required(ValueKind::text());
        /// What the document is. It decides how sure its facts may be.
        kind: RequiredKey<DocumentKind> = required(ValueKind::one_of(&DOCUMENT_KINDS));
        /// The models that it is about, this one by its `id`. What it says of others is `sibling` here.
        of: OptionalKey<Vec<LocatedValue<String>>> = optional_filled_list(ValueKind::text()),
            without "this model";
        /// The short name of the document that it was made from: the two are no two sources.
        made_from: OptionalKey<String> = optional(ValueKind::text()), without "not known";
    }
}

impl DocumentFile {
    /// The document called `name`; `None` if any part is unusable.
    fn ready(&self, name: &str) -> Option<ModelDocument> {
        Some(ModelDocument {
            name: name.to_owned(),
            title: self.title.as_ref()?.value.clone(),
            kind: self.kind.as_ref()?.value,
            of: match &self.of {
                OptionalKey::Absent => Vec::new(),
                OptionalKey::Invalid => return None,
                OptionalKey::Valid(of) => values_of(&of.value),
            },
            made_from: self.made_from.clone().optional()?,
        })
    }
}

/// The documents of a file, each under its short name.
#[derive(Clone, Debug, Default)]
pub struct DocumentsFile(Vec<(String, Option<ModelDocument>)>);

impl DocumentsFile {
    /// Reads `[documents]`: each short name maps to a title, for a manual of this very model, or to a table with further
    /// keys.
    pub fn read(mut reader: TableReader<'_, '_>) -> Self {
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
                TomlEntry::Table(section) => {
                    let document = DocumentFile::read(reader.open(section));
                    made_from.extend(document.made_from.valid().cloned());
                    document.ready(&name)
                }
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

    /// `[documents]` as it is declared.
    #[cfg(test)]
    pub(super) fn declared() -> DeclaredTable {
        let title = KeyForm::of(ValueKind::text(), |_, _, _| ());
        let right = format!("{}, or a table", title.valid.right);
        DeclaredTable {
            header: "[documents]",
            says: "The documents that facts cite, each under a short name of your choice."
                .to_owned(),
            keys: vec![DeclaredKey {
                name: "NAME",
                valid: title.right(right).valid,
                default: None,
                has_valid_default: true,
                about: "The title, of a manual of this very model; or a table with the keys below."
                    .to_owned(),
            }],
            refused: &[],
        }
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
    pub fn find(&self, name: &str) -> Option<Option<&ModelDocument>> {
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
