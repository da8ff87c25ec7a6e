//! What documents list of all models, made from the models. `UPDATE_GOLDEN=1` rewrites it.

use super::CATALOG;
use crate::profile::model::{Confidence, FactPart, IndicatedState, Model, OrderKind, RegisterRole};
use crate::toml_file::words::{FRAMINGS, INTERFACES, word_for};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

const BEGIN: &str = "<!-- made from the models -->\n";
const END: &str = "<!-- end -->\n";

/// The models of each maker.
fn makers() -> BTreeMap<&'static str, Vec<&'static Model>> {
    let mut makers = BTreeMap::<_, Vec<_>>::new();
    for model in CATALOG.models() {
        makers
            .entry(model.vendor.as_str())
            .or_default()
            .push(&**model);
    }
    makers
}

fn shown(confidence: Option<Confidence>) -> &'static str {
    confidence.map_or("-", Confidence::keyword)
}

/// How sure it is where an order is given with the register that it is written to.
fn of_order(model: &Model, kind: OrderKind) -> Option<Confidence> {
    let (address, fact) = model.order(kind)?;
    let register = model.writable_at(address).map(|it| {
        it.confidence
            .max(of_writing(it.not_stated.contains(&FactPart::Writing)))
    });
    Some(register.map_or(fact.confidence, |it| it.max(fact.confidence)))
}

const fn of_writing(is_open: bool) -> Confidence {
    if is_open {
        Confidence::Inferred
    } else {
        Confidence::Manual
    }
}

fn row(model: &Model) -> String {
    let order = |kind| shown(of_order(model, kind));
    let role = |role| model.register_for(role).map(|it| it.confidence);
    let flag = |flag| model.status_flag(flag).map(|it| it.confidence);
    let setpoint = model
        .run
        .as_ref()
        .and_then(|_| role(RegisterRole::FrequencyCommand));
    let status = flag(IndicatedState::Running).map_or_else(
        || {
            role(RegisterRole::OutputFrequency).map_or_else(
                || "-".to_owned(),
                |it| format!("output only, {}", it.keyword()),
            )
        },
        |it| it.keyword().to_owned(),
    );
    let trip =
        flag(IndicatedState::Tripped).or_else(|| model.trip_register().map(|it| it.confidence));
    let mut lines: Vec<_> = model
        .link
        .interfaces
        .value
        .iter()
        .map(|it| word_for(&INTERFACES, it).to_uppercase())
        .collect();
    lines.extend(
        model
            .link
            .framings
            .value
            .iter()
            .map(|it| word_for(&FRAMINGS, it).to_uppercase()),
    );
    let orders = match (&model.run, model.unproven_basics().is_empty()) {
        (None, _) => "**only read**",
        (Some(_), true) => "yes",
        (Some(_), false) => "`basic` accepted",
    };
    format!(
        "| `{}` | {} | {} | {orders} | {} | {} | {} | {} | {} | {} | {status} | {} |\n",
        model.id,
        model.title,
        lines.join(", "),
        order(OrderKind::Stop),
        order(OrderKind::Forward),
        shown(setpoint),
        order(OrderKind::Reverse),
        order(OrderKind::Coast),
        order(OrderKind::Reset),
        shown(trip),
    )
}

/// One section for each maker, below the list of all makers.
fn of_document() -> String {
    let mut text = of_makers();
    for (maker, models) in makers() {
        let _ = write!(
            text,
            "\n### {maker}\n\n| model | drive | line | takes orders | stop | forward | setpoint | reverse | coast | reset | \
             status | trip |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n"
        );
        models
            .into_iter()
            .for_each(|model| text.push_str(&row(model)));
    }
    text + "\n"
}

/// Makers and series.
fn of_makers() -> String {
    let mut text = "\n| maker | drives |\n| --- | --- |\n".to_owned();
    for (maker, models) in makers() {
        let anchor = maker.to_lowercase().replace(' ', "-");
        let names = names_of(&models);
        let _ = writeln!(text, "| [{maker}](#{anchor}) | {names} |");
    }
    text
}

/// The titles of `models`.
fn names_of(models: &[&Model]) -> String {
    let name = |model: &&Model| {
        let only_read = if model.run.is_none() {
            " (only read)"
        } else {
            ""
        };
        format!("{}{only_read}", model.title)
    };
    let names: Vec<_> = models.iter().map(name).collect();
    names.join("; ")
}

/// The pages of first steps, each with the models that it names.
fn of_first_steps() -> String {
    let entries = std::fs::read_dir(root().join("docs/first-steps")).unwrap();
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let mut text = "\n| maker | drives | guide |\n| --- | --- | --- |\n".to_owned();
    for path in paths {
        let page = std::fs::read_to_string(&path).unwrap();
        let is_in = |model: &&Model| page.contains(&format!("`model = \"{}\"`", model.id));
        for (maker, mut models) in makers() {
            models.retain(is_in);
            if !models.is_empty() {
                let file = path.file_name().unwrap().display();
                let names = names_of(&models);
                let _ = writeln!(text, "| {maker} | {names} | [{file}]({file}) |");
            }
        }
    }
    text + "\n"
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Holds what stands between `begin` and `end` in `document` against what is `made`.
fn compare(document: &str, begin: &str, end: &str, made: &str) {
    let path = root().join(document);
    let text = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = text.split_once(begin).unwrap();
    let (found, after) = rest.split_once(end).unwrap();
    if std::env::var_os("UPDATE_GOLDEN").is_some() && found != made {
        std::fs::write(&path, format!("{before}{begin}{made}{end}{after}")).unwrap();
        return;
    }
    assert_eq!(found, made, "{document}");
}

#[test]
fn documents_list_the_models_that_there_are() {
    compare("docs/drives.md", BEGIN, END, &of_document());
    compare("docs/first-steps/README.md", BEGIN, END, &of_first_steps());
    let models = CATALOG.models().count();
    let sum = format!("{models} models of {} makers", makers().len());
    compare("README.md", "It knows [", "](docs/drives.md)", &sum);
}
