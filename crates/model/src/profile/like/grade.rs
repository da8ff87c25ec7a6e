//! How sure the facts of one model are for another one that begins from it.

use crate::domain::problem::Problem;
use crate::profile::file::DocumentsFile;
use crate::profile::model::Confidence;
use crate::profile::words::CONFIDENCES;
use crate::toml_file::{KeyLocation, TableReader, TomlDocument};
use serde_spanned::Spanned;
use std::borrow::Cow;
use toml::de::{DeArray, DeTable, DeValue};

/// Makes `base`, the file of the model `of`, one that the model `id` may take over: without its name, with documents that
/// say whose they are, and with facts that are no surer than those documents let them be for `id`.
pub(super) fn take_over(
    base: &mut DeTable<'_>,
    of: &str,
    own: &DeTable<'_>,
    id: &str,
    problems: &mut Vec<Problem>,
) {
    base.remove("id");
    base.remove("title");
    let mut own_documents = DeTable::new();
    if let Some(DeValue::Table(documents)) = own.get("documents").map(Spanned::get_ref) {
        own_documents = documents.clone();
    }
    let Some(DeValue::Table(documents)) = base.get_mut("documents").map(Spanned::get_mut) else {
        return;
    };
    documents
        .iter_mut()
        .for_each(|(_, document)| say_of(document, of));
    are_the_same(&read(documents), of, &own_documents, problems);
    let mut all = documents.clone();
    all.extend(own_documents);
    let all = read(&all);
    grade(base, &all, id);
}

/// The documents of a table, whose mistakes are reported elsewhere.
fn read(documents: &DeTable<'_>) -> DocumentsFile {
    let document = TomlDocument::of(documents.clone());
    DocumentsFile::read(TableReader::new(document.section(), &mut Vec::new()))
}

/// States that `document` is of the model `of` if it says nothing else.
fn say_of(document: &mut Spanned<DeValue<'_>>, of: &str) {
    let span = document.span();
    let text = |text: String| Spanned::new(span.clone(), DeValue::String(Cow::Owned(text)));
    let key = |key: &'static str| Spanned::new(span.clone(), Cow::Borrowed(key));
    if let DeValue::String(title) = document.get_ref() {
        let title = title.to_string();
        let mut table = DeTable::new();
        table.insert(key("title"), text(title));
        table.insert(key("kind"), text("manual".to_owned()));
        *document.get_mut() = DeValue::Table(table);
    }
    let DeValue::Table(table) = document.get_mut() else {
        return;
    };
    if !table.contains_key("of") {
        let models: DeArray<'_> = [text(of.to_owned())].into_iter().collect();
        table.insert(
            key("of"),
            Spanned::new(span.clone(), DeValue::Array(models)),
        );
    }
}

/// A document that both files declare is the same one: what is taken over cites it, and must not cite another one.
fn are_the_same(base: &DocumentsFile, of: &str, own: &DeTable<'_>, problems: &mut Vec<Problem>) {
    let files = read(own);
    for (name, value) in own {
        let name: &str = name.get_ref();
        let (Some(Some(theirs)), Some(Some(ours))) = (base.find(name), files.find(name)) else {
            continue;
        };
        let location = KeyLocation {
            key: format!("documents.{name}"),
            span: value.span(),
        };
        if (&theirs.title, theirs.kind, &theirs.made_from)
            != (&ours.title, ours.kind, &ours.made_from)
        {
            let problem = location.problem(format!(
                "in `{of}`, `{name}` is another document: {}",
                theirs.title
            ));
            problems.push(problem.right("another short name"));
        } else if ours.of.is_empty() {
            let problem = location.problem(format!(
                "`{name}` is a document of `{of}`; it does not say whether of this model"
            ));
            problems.push(problem.right("`of` with all models that it is about, or leave it out"));
        }
    }
}

/// Lowers each `confidence` in `table` to what its document supports for the model `id`.
fn grade(table: &mut DeTable<'_>, documents: &DocumentsFile, id: &str) {
    let best = table.get("source").and_then(|source| {
        let (name, _) = source.get_ref().as_str()?.split_once(' ')?;
        Some(documents.find(name)??.best(id))
    });
    if let (Some(best), Some(confidence)) = (best, table.get_mut("confidence")) {
        let stated = confidence.get_ref().as_str().and_then(confidence_of);
        if stated.is_some_and(|stated| stated < best) {
            *confidence.get_mut() = DeValue::String(Cow::Borrowed(best.keyword()));
        }
    }
    for (_, value) in table.iter_mut() {
        match value.get_mut() {
            DeValue::Table(inner) => grade(inner, documents, id),
            DeValue::Array(rows) => {
                for row in rows.iter_mut() {
                    if let DeValue::Table(inner) = row.get_mut() {
                        grade(inner, documents, id);
                    }
                }
            }
            _ => {}
        }
    }
}

fn confidence_of(word: &str) -> Option<Confidence> {
    CONFIDENCES
        .iter()
        .find(|(it, _)| *it == word)
        .map(|(_, confidence)| *confidence)
}
