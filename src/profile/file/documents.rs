//! `[documents]`: the documents that facts cite.

use super::facts::filled_with;
use crate::profile::model::{Confidence, Document, DocumentKind};
use crate::profile::words::DOCUMENT_KINDS;
use crate::toml_file::values::Kind;
use crate::toml_file::{Entry, OptionalKey, Reader, RequiredKey};

/// The documents of a file, each under its short name.
pub(in crate::profile) struct DocumentsFile(Vec<(String, Option<Document>)>);

impl DocumentsFile {
    /// Reads `[documents]`: each short name maps to a title, for a manual of this very model, or to a table with further
    /// keys.
    pub(in crate::profile) fn read(mut reader: Reader<'_, '_>) -> Self {
        let mut documents = Vec::new();
        for (name, entry) in reader.entries(&Kind::text()) {
            let document = match entry {
                Entry::Value(title) => {
                    let kind = DocumentKind::Manual;
                    Some(Document { name: name.clone(), title: title.value, kind, of: Vec::new() })
                }
                Entry::Table(section) => document(&name, reader.open(section)),
            };
            documents.push((name, document));
        }
        Self(documents)
    }

    /// The document called `name`: `None` if there is none, `Some(None)` if it is unusable.
    pub(in crate::profile) fn find(&self, name: &str) -> Option<Option<&Document>> {
        self.0.iter().find(|(it, _)| it == name).map(|(_, document)| document.as_ref())
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.0.iter().map(|(name, _)| name.as_str())
    }

    /// `None` if any of them is unusable.
    pub(super) fn ready(&self) -> Option<Vec<Document>> {
        self.0.iter().map(|(_, document)| document.clone()).collect()
    }
}

fn document(name: &str, mut reader: Reader<'_, '_>) -> Option<Document> {
    let title = reader.required("title", &Kind::text());
    let kind: RequiredKey<DocumentKind> = reader.required("kind", &Kind::one_of(&DOCUMENT_KINDS));
    let of = match reader.list("of", &Kind::text()) {
        OptionalKey::Valid(of) => {
            filled_with(of, &Kind::text(), reader.problems()).map_or(OptionalKey::Invalid, OptionalKey::Valid)
        }
        other => other,
    };
    reader.finish();
    let of = of.optional()?.unwrap_or_default().into_iter().map(|it| it.value).collect();
    Some(Document { name: name.to_owned(), title: title?.value, kind: kind?.value, of })
}

/// A description of `document`, and the best confidence it supports for facts of the model `id`.
pub(super) fn at_best(document: &Document, id: &str) -> (String, Confidence) {
    let article = match document.kind {
        DocumentKind::Addendum => "an",
        _ => "a",
    };
    let kind = format!("{article} {}", document.kind.word());
    let best = document.best(id);
    let of = if document.is_of(id) { "this model".to_owned() } else { document.of.join(", ") };
    (format!("`{}` is {kind} of {of}", document.name), best)
}
