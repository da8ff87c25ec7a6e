//! `models`: the known drives, with sources and confidence.

mod new_model;

use crate::cli::tools::model_facts::{OrderWord, UnprovenFacts, orders, orders_text};
use crate::cli::tools::own_models::ModelDirs;
use crate::cli::tools::{CommandFailure, input, print};
use crate::profile::catalog::id_of;
use crate::profile::model::{Model, ModelDocument, Register};
use crate::profile::summary;
use crate::profile::words::POLL_CLASSES;
use crate::toml_file::words::{FRAMINGS, word_for};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Arguments of `models`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    own: ModelDirs,
    #[command(subcommand)]
    action: Option<ModelsAction>,
}

#[derive(Debug, clap::Subcommand)]
enum ModelsAction {
    /// List the models, built-in and your own (default)
    List {
        /// Only the models of this maker: a part of its name, or the beginning of the identifiers
        #[arg(long, value_name = "MAKER")]
        vendor: Option<String>,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Show a model with its registers, units, access, sources and confidence
    Show {
        /// Identifier, as `models list` shows it
        model: String,
        /// Print JSON
        #[arg(long)]
        json: bool,
        /// Print it as one complete model file, also one that begins from another model
        #[arg(long, conflicts_with = "json")]
        toml: bool,
    },
    /// Check a model file of your own: reports all problems at once, or lists unproven facts
    Check {
        /// The file
        file: PathBuf,
    },
    /// Write a model file from your answers, from a drive that is read meanwhile, or from a device template; check and simulate it
    New(Box<new_model::Args>),
}

/// Lists, shows or checks.
pub fn models(args: &Args) -> Result<(), CommandFailure> {
    match &args.action {
        None => list(&args.own, None, false),
        Some(ModelsAction::List { vendor, json }) => list(&args.own, vendor.as_deref(), *json),
        Some(ModelsAction::Show {
            model, toml: true, ..
        }) => print(&input::model_text(model, &args.own)?),
        Some(ModelsAction::Show { model, json, .. }) => show(model, &args.own, *json),
        Some(ModelsAction::Check { file }) => check_file(file, &args.own),
        Some(ModelsAction::New(new)) => new_model::new(new, &args.own),
    }
}

fn list(own: &ModelDirs, vendor: Option<&str>, as_json: bool) -> Result<(), CommandFailure> {
    let catalog = input::catalog_with(own)?;
    let models = of_vendor(catalog.models(), vendor)?;
    if as_json {
        return print(&format!(
            "{:#}\n",
            Value::Array(models.iter().map(|model| in_short(model)).collect())
        ));
    }
    let head = ["id", "model", "framings", "unproven", "can be ordered"].map(str::to_owned);
    let rows = models.iter().map(|model| {
        [
            model.id.clone(),
            format!("{} {}", model.vendor, model.title),
            framings(model).join(", "),
            UnprovenFacts::of(model).count().to_string(),
            orders_text(&orders(model)),
        ]
    });
    print(&table(
        &std::iter::once(head).chain(rows).collect::<Vec<_>>(),
    ))
}

/// The models whose maker is called `vendor`: by a part of the maker's name, or by the beginning of the identifier.
fn of_vendor<'a>(
    models: impl Iterator<Item = &'a Arc<Model>>,
    vendor: Option<&str>,
) -> Result<Vec<&'a Arc<Model>>, CommandFailure> {
    let all: Vec<_> = models.collect();
    let Some(vendor) = vendor else { return Ok(all) };
    let wished = vendor.trim().to_lowercase();
    let id_begins = format!("{}-", wished.replace(' ', "-"));
    let is_of = |model: &&&Arc<Model>| {
        model.id.starts_with(&id_begins)
            || (!wished.is_empty() && model.vendor.to_lowercase().contains(&wished))
    };
    let found: Vec<_> = all.iter().filter(is_of).copied().collect();
    if found.is_empty() {
        let makers: BTreeSet<_> = all.iter().map(|model| model.vendor.as_str()).collect();
        let makers = makers.into_iter().collect::<Vec<_>>().join(", ");
        return Err(CommandFailure::wrong(format!(
            "no model is of the maker {vendor}; the makers are {makers}"
        )));
    }
    Ok(found)
}

fn show(id: &str, own: &ModelDirs, as_json: bool) -> Result<(), CommandFailure> {
    let model = input::model(id, own)?;
    if as_json {
        return print(&format!("{:#}\n", in_full(&model)));
    }
    print(&summary::summary(&model))
}

/// Reports the problems of the file at `path`, or what of it is unproven.
fn check_file(path: &Path, own: &ModelDirs) -> Result<(), CommandFailure> {
    let mut files = input::own_models(own)?;
    files
        .read_file(path)
        .map_err(|unread| CommandFailure::wrong(unread.what))?;
    let catalog = input::joined(&files)?;
    let id = files
        .files()
        .find(|(other, _)| *other == path)
        .and_then(|(_, text)| id_of(text));
    let Some(model) = id.and_then(|id| catalog.find(&id).cloned()) else {
        return Ok(());
    };
    let mut text = match model.registers.len() {
        0 => format!(
            "{} is valid, but has no register: nothing can be read from its drives\n",
            model.id
        ),
        1 => format!("{} is valid: 1 register\n", model.id),
        count => format!("{} is valid: {count} registers\n", model.id),
    };
    let _ = writeln!(text, "can be ordered: {}", orders_text(&orders(&model)));
    let basics = model.unproven_basics();
    if !basics.is_empty() {
        text.push_str("its drives take orders only with accept_unverified = [\"basic\"]\n");
    }
    for basic in basics {
        let sources = if basic.also.is_some() {
            "two independent sources"
        } else {
            "one source"
        };
        let _ = writeln!(
            text,
            "  {}: {}, {sources}",
            basic.what,
            basic.confidence.keyword()
        );
    }
    text.push_str(&unproven_text(&model));
    print(&text)
}

fn unproven_text(model: &Model) -> String {
    let unproven = UnprovenFacts::of(model);
    if unproven.count() == 0 {
        return "Nothing is unproven\n".to_owned();
    }
    let mut text = "Unproven\n".to_owned();
    for (confidence, names) in unproven.groups() {
        let _ = writeln!(text, "  {}: {}", confidence.keyword(), names.join(", "));
    }
    text
}

fn framings(model: &Model) -> Vec<&'static str> {
    model
        .link
        .framings
        .value
        .iter()
        .map(|framing| word_for(&FRAMINGS, framing))
        .collect()
}

fn in_short(model: &Model) -> Value {
    let order = |(word, confidence): &OrderWord| json!({ "order": word, "confidence": confidence.keyword() });
    let orders = orders(model).unwrap_or_default();
    json!({
        "id": model.id,
        "vendor": model.vendor,
        "title": model.title,
        "framings": framings(model),
        "registers": model.registers.len(),
        "unproven": UnprovenFacts::of(model).count(),
        "orders": orders.iter().map(order).collect::<Vec<_>>(),
    })
}

fn in_full(model: &Model) -> Value {
    let mut value = in_short(model);
    let unproven = UnprovenFacts::of(model);
    let unproven = unproven
        .groups()
        .map(|(confidence, names)| (confidence.keyword().to_owned(), json!(names)));
    value["unproven"] = Value::Object(unproven.collect());
    let second = model
        .second_sources
        .iter()
        .map(|it| (it.key.clone(), json!(it.source)));
    value["second_sources"] = Value::Object(second.collect());
    value["registers"] = model.registers.iter().map(of_register).collect();
    value["documents"] = model
        .documents
        .iter()
        .map(|document| of_document(document, model))
        .collect();
    value
}

fn of_document(document: &ModelDocument, model: &Model) -> Value {
    json!({
        "name": document.name,
        "title": document.title,
        "kind": document.kind.keyword(),
        "of_this_model": document.is_of(&model.id),
        "of": document.of,
        "made_from": document.made_from,
        "best": document.best(&model.id).keyword(),
    })
}

fn of_register(register: &Register) -> Value {
    json!({
        "address": register.address.number(),
        "table": register.address.table().keyword(),
        "code": register.code,
        "name": register.name,
        "title": register.title,
        "unit": register.unit.symbol(),
        "scale": register.scale,
        "words": register.form.words(),
        "is_plain": register.form.is_plain(),
        "signed": register.signed,
        "access": register.access.keyword(),
        "poll": register.poll.map(|poll| word_for(&POLL_CLASSES, &poll)),
        "memory": register.memory.map(|memory| memory.keyword()),
        "confidence": register.confidence.keyword(),
        "source": register.source,
        "not_stated": register.not_stated.iter().map(|part| part.keyword()).collect::<Vec<_>>(),
    })
}

/// The rows with each column as wide as its widest cell.
fn table<const N: usize>(rows: &[[String; N]]) -> String {
    let width = |column: usize| {
        rows.iter()
            .map(|row| row[column].chars().count())
            .max()
            .unwrap_or(0)
    };
    let widths: [usize; N] = std::array::from_fn(width);
    let mut text = String::new();
    for row in rows {
        let cells: Vec<_> = row
            .iter()
            .zip(widths)
            .map(|(cell, width)| format!("{cell:width$}"))
            .collect();
        let _ = writeln!(text, "{}", cells.join("  ").trim_end());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vendors;

    #[test]
    fn a_maker_is_found_by_its_name_or_the_beginning_of_the_identifiers() {
        let catalog = vendors::catalog();
        let ids = |vendor| {
            let found = of_vendor(catalog.models(), Some(vendor)).map_err(|why| why.to_string());
            found.map(|found| {
                found
                    .iter()
                    .map(|model| model.id.clone())
                    .collect::<Vec<_>>()
            })
        };
        assert_eq!(
            ids("eaton").unwrap(),
            ["eaton-dc1", "eaton-de1", "eaton-mmax"]
        );
        assert_eq!(
            ids("Control Techniques").unwrap(),
            ids("control-techniques").unwrap()
        );
        assert_eq!(ids(" EATON ").unwrap().len(), 3);
        assert_eq!(
            of_vendor(catalog.models(), None).unwrap().len(),
            catalog.ids().count()
        );
        let error = ids("etaon").unwrap_err();
        assert!(
            error.contains("no model is of the maker etaon")
                && error.contains("Danfoss, Delta, Eaton"),
            "{error}"
        );
        assert!(ids("").is_err());
    }
}
