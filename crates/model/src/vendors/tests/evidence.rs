//! How sure each fact is, held against the table of the documents and not against its own label.

use crate::profile::check;
use std::collections::BTreeMap;
use toml::de::{DeTable, DeValue};

/// Labels of what is proven.
const PROVEN: [&str; 2] = ["manual", "second-source"];

/// A fact as its file states it.
struct Stated {
    /// Where it stands.
    key: String,
    confidence: String,
    source: String,
    not_stated: usize,
    value: Option<i64>,
}

impl Stated {
    fn is_proven(&self) -> bool {
        PROVEN.contains(&self.confidence.as_str())
    }

    fn document(&self) -> &str {
        self.source.split(' ').next().unwrap()
    }
}

fn text_at<'t>(table: &'t DeTable<'_>, key: &str) -> Option<&'t str> {
    table.get(key)?.get_ref().as_str()
}

/// All facts of a file.
fn facts(table: &DeTable<'_>, key: &str, into: &mut Vec<Stated>) {
    if let (Some(confidence), Some(source)) =
        (text_at(table, "confidence"), text_at(table, "source"))
    {
        let number = |key| match table.get(key).map(|it| it.get_ref()) {
            Some(DeValue::Integer(it)) => i64::from_str_radix(it.as_str(), it.radix()).ok(),
            _ => None,
        };
        let not_stated = match table.get("not_stated").map(|it| it.get_ref()) {
            Some(DeValue::Array(parts)) => parts.len(),
            _ => 0,
        };
        let (confidence, source) = (confidence.to_owned(), source.to_owned());
        into.push(Stated {
            key: key.to_owned(),
            confidence,
            source,
            not_stated,
            value: number("value"),
        });
    }
    for (name, value) in table {
        match value.get_ref() {
            DeValue::Table(inner) => facts(inner, &format!("{key}{}.", name.get_ref()), into),
            DeValue::Array(all) => {
                for (at, inner) in all.iter().enumerate() {
                    if let DeValue::Table(inner) = inner.get_ref() {
                        facts(inner, &format!("{key}{}[{at}].", name.get_ref()), into);
                    }
                }
            }
            _ => {}
        }
    }
}

/// Identifier and text of every model, together with what it takes over from others.
fn wholes() -> Vec<(&'static str, String)> {
    super::CATALOG
        .ids()
        .filter_map(|id| Some((id, super::CATALOG.text_of(id)?)))
        .collect()
}

fn facts_of(text: &str) -> Vec<Stated> {
    let document = DeTable::parse(text).unwrap();
    let mut all = Vec::new();
    facts(document.get_ref(), "", &mut all);
    all
}

/// Each document's kind, and whether it is of the model.
fn documents_of(text: &str) -> BTreeMap<String, (String, bool)> {
    let document = DeTable::parse(text).unwrap();
    let id = text_at(document.get_ref(), "id").unwrap();
    let DeValue::Table(documents) = document.get_ref()["documents"].get_ref() else {
        panic!("{id}")
    };
    let each = documents.iter().map(|(name, document)| {
        let DeValue::Table(document) = document.get_ref() else {
            panic!("{id}: {name} says nothing of itself")
        };
        let DeValue::Array(of) = document["of"].get_ref() else {
            panic!("{id}: {name}")
        };
        let is_of = of.iter().any(|of| of.get_ref().as_str() == Some(id));
        (
            name.get_ref().to_string(),
            (text_at(document, "kind").unwrap().to_owned(), is_of),
        )
    });
    each.collect()
}

#[test]
fn only_a_document_of_the_model_that_its_maker_or_seller_wrote_proves_a_fact() {
    let mut wrong = Vec::new();
    for (name, text) in &wholes() {
        let documents = documents_of(text);
        for fact in facts_of(text)
            .iter()
            .filter(|fact| fact.confidence != "default")
        {
            let (kind, is_of) = &documents[fact.document()];
            let best = match (kind.as_str(), is_of) {
                (_, false) => 3,
                ("manual" | "addendum", true) => 0,
                ("distributor-manual", true) => 1,
                (_, true) => 2,
            };
            let scale = [
                "manual",
                "second-source",
                "third-party",
                "sibling",
                "inferred",
            ];
            if scale.iter().position(|it| *it == fact.confidence).unwrap() < best {
                wrong.push(format!(
                    "{name} {}{}: {}",
                    fact.key, fact.confidence, fact.source
                ));
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "{} facts are labelled better than their documents allow:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}

#[test]
fn the_check_of_a_model_file_holds_the_same_scale() {
    for (name, text) in &wholes() {
        assert!(check::model(text).is_ok(), "{name}");
        for fact in facts_of(text) {
            let (kind, is_of) = match documents_of(text).remove(fact.document()) {
                Some(document) if fact.confidence != "default" => document,
                _ => continue,
            };
            let is_manual =
                is_of && ["manual", "addendum", "distributor-manual"].contains(&kind.as_str());
            assert!(is_manual || !fact.is_proven(), "{name} {}", fact.key);
        }
    }
}

#[test]
fn what_a_proven_fact_leaves_open_is_named() {
    let mut wrong = Vec::new();
    for (name, text) in &wholes() {
        for fact in facts_of(text)
            .iter()
            .filter(|fact| fact.is_proven() && fact.not_stated == 0)
        {
            let is_open = [
                "inferred",
                "not seen",
                "of the E510",
                "taken over",
                " as C",
                "the rule of",
                "by the rule",
            ];
            if is_open.iter().any(|words| fact.source.contains(words)) {
                wrong.push(format!(
                    "{name} {}{}: {}",
                    fact.key, fact.confidence, fact.source
                ));
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "these rest on more than their document:\n{}",
        wrong.join("\n")
    );
}

#[test]
fn an_example_that_shows_several_bits_states_their_sum_only() {
    let mut wrong = Vec::new();
    for (name, text) in &wholes() {
        for fact in facts_of(text)
            .iter()
            .filter(|fact| fact.is_proven() && fact.source.contains("example"))
        {
            let states = |word: i64| fact.source.contains(&format!("{word:04X}"));
            let is_bit = fact.key.starts_with("run.bit[") || fact.key.starts_with("status[");
            let is_command = fact.key.starts_with("run.") && !is_bit;
            let is_stated = fact.value.is_some_and(states) && !fact.source.contains("without");
            if is_bit || (is_command && !is_stated) {
                wrong.push(format!(
                    "{name} {}{}: {}",
                    fact.key, fact.confidence, fact.source
                ));
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "these read more out of an example than it shows:\n{}",
        wrong.join("\n")
    );
}

#[test]
fn what_is_inferred_says_what_of_it() {
    let says = [
        "inferred",
        "taken over",
        "neighbours",
        "twin",
        "leftover",
        "relative",
        "computed",
        "not seen",
    ];
    for (name, text) in wholes()
        .iter()
        .filter(|(name, _)| crate::vendors::reviewed().contains(name))
    {
        for fact in facts_of(text)
            .iter()
            .filter(|fact| fact.confidence == "inferred")
        {
            assert!(
                says.iter().any(|word| fact.source.contains(word)),
                "{name} {}: {}",
                fact.key,
                fact.source
            );
        }
    }
}
