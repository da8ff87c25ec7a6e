//! A model as tables for people: its facts with confidence and source.

mod command;
mod layout;
mod line;
mod registers;

use super::model::{Model, ModelDocument, Register, RunCommand};
use layout::{Row, list, section};

/// The documents, each with its kind, the models it covers, and the highest confidence it supports.
fn documents(model: &Model) -> Vec<Row> {
    let row = |document: &ModelDocument| {
        let of = if document.is_of(&model.id) {
            "this model".to_owned()
        } else {
            list(&document.of)
        };
        let kind = document.kind.keyword().to_owned();
        let best = document.best(&model.id).keyword();
        let from = document
            .made_from
            .as_ref()
            .map(|from| format!(" (made from {from})"))
            .unwrap_or_default();
        vec![
            document.name.clone(),
            kind,
            of,
            format!("at best {best}"),
            format!("{}{from}", document.title),
        ]
    };
    model.documents.iter().map(row).collect()
}

/// Second sources of facts.
fn second_sources(model: &Model) -> Vec<Row> {
    model
        .second_sources
        .iter()
        .map(|second| vec![second.key.clone(), second.source.clone()])
        .collect()
}

/// The facts about `model`, as plain text that ends with a newline.
#[must_use]
pub fn summary(model: &Model) -> String {
    let mut text = format!("{}: {} {}\n", model.id, model.vendor, model.title);
    section(&mut text, "Documents", documents(model));
    section(
        &mut text,
        "Facts with a second, independent source",
        second_sources(model),
    );
    add_line(&mut text, model);
    if let Some(run) = &model.run {
        add_run_commands(&mut text, model, run);
    }
    add_settings(&mut text, model);
    add_readings(&mut text, model);
    add_registers(&mut text, &model.registers);
    text
}

/// Appends what holds for every exchange.
fn add_line(text: &mut String, model: &Model) {
    section(text, "Link", line::link(&model.link));
    section(text, "Timing", line::timing(&model.timing));
    section(text, "Reads and writes", line::reads_and_writes(model));
    section(
        text,
        "Barriers, after which no late reply can follow",
        line::barriers(&model.barriers),
    );
    section(text, "Exceptions", line::exceptions(model));
    section(text, "Quirks", line::quirks(&model.quirks));
}

fn add_run_commands(text: &mut String, model: &Model, run: &RunCommand) {
    section(text, "Run commands", command::run_commands(model, run));
    section(text, "Bits of run commands", command::run_bits(run));
    section(text, "Fields of run commands", command::run_fields(run));
    let heading = "Unproven control actions, each off until `accept_unverified` names it";
    section(text, heading, command::unproven_actions(model, run));
}

/// Appends what is set at the drive.
fn add_settings(text: &mut String, model: &Model) {
    section(
        text,
        "After parameters were written",
        command::commit(model),
    );
    section(text, "Set-up, in this order", command::setup(model));
    section(
        text,
        "Orders that are refused while a setting is wrong",
        command::needed(model),
    );
    section(text, "Identity", command::identity(model));
    section(text, "Watchdog of the drive", command::watchdog(model));
}

/// Appends what the drive says of itself.
fn add_readings(text: &mut String, model: &Model) {
    section(text, "Status", registers::status(model));
    section(
        text,
        "States in the drive's own words",
        registers::states(model),
    );
    section(text, "Trips", registers::trips(model));
    section(
        text,
        "Warnings, which stop no motor",
        registers::warnings(model),
    );
    section(text, "Codes", registers::codes(model.codes.as_ref()));
}

fn add_registers(text: &mut String, all: &[Register]) {
    section(text, "Registers", registers::registers(all));
    section(text, "Meanings of words", registers::meanings(all));
    section(
        text,
        "Registers after whose write the drive hears nothing",
        registers::deaf(all),
    );
    section(
        text,
        "Registers whose write is not answered",
        registers::silent(all),
    );
    section(
        text,
        "Back doors, which no client may write",
        registers::back_doors(all),
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;
    use crate::profile::testing::{
        EVERYTHING, EXCHANGE, MEMORY, MODEL, RAM_FORM, UNANSWERED, ZERO_COAST, ZERO_IGNORED,
        ZERO_NOTHING, golden,
    };

    #[test]
    fn only_what_is_known_is_shown() {
        let text = summary(&check::model(MODEL).unwrap());
        assert!(
            text.starts_with(
                "acme-1: Acme One\n\nDocuments\n  IM  manual  this model  at best manual  Interface manual\n\nLink\n"
            ),
            "{text}"
        );
        let absent = [
            "broadcast",
            "processing",
            "Barrier",
            "Quirks",
            "Run",
            "Unproven",
            "Set-up",
            "Status",
            "Meanings",
        ];
        for absent in absent {
            assert!(!text.contains(absent), "{text}");
        }
        assert!(
            text.ends_with("  manual      IM 4    Output frequency\n"),
            "{text}"
        );
        let row =
            "  0x0101   D001  output_frequency  Hz    x100   read    fast  -       -      manual";
        assert!(text.contains(row), "{text}");
    }

    #[test]
    fn orders_are_shown_with_their_registers() {
        let text = include_str!("../../../../../tests/golden/models/orders.toml");
        golden("orders.txt", &summary(&check::model(text).unwrap()));
        let text = include_str!("../../../../../tests/golden/models/pairs.toml");
        golden("pairs.txt", &summary(&check::model(text).unwrap()));
        let text = include_str!("../../../../../tests/golden/models/signed.toml");
        golden("signed.txt", &summary(&check::model(text).unwrap()));
        let text = include_str!("../../../../../tests/golden/models/coils.toml");
        golden("coils.txt", &summary(&check::model(text).unwrap()));
        let text = include_str!("../../../../../tests/golden/models/start.toml");
        golden("start.txt", &summary(&check::model(text).unwrap()));
        let text = include_str!("../../../../../tests/golden/models/by-time.toml");
        golden("by-time.txt", &summary(&check::model(text).unwrap()));
    }

    #[test]
    fn values_are_shown_with_what_they_depend_on() {
        let text = include_str!("../../../../../tests/golden/models/values.toml");
        golden("values.txt", &summary(&check::model(text).unwrap()));
    }

    #[test]
    fn what_a_run_word_means_is_shown() {
        golden(
            "zero-ignored.txt",
            &summary(&check::model(ZERO_IGNORED).unwrap()),
        );
        golden(
            "zero-nothing.txt",
            &summary(&check::model(ZERO_NOTHING).unwrap()),
        );
        golden(
            "zero-coast.txt",
            &summary(&check::model(ZERO_COAST).unwrap()),
        );
    }

    #[test]
    fn the_rules_of_an_exchange_are_shown() {
        golden("exchange.txt", &summary(&check::model(EXCHANGE).unwrap()));
        golden("memory.txt", &summary(&check::model(MEMORY).unwrap()));
        golden(
            "unanswered.txt",
            &summary(&check::model(UNANSWERED).unwrap()),
        );
        golden("ram-form.txt", &summary(&check::model(RAM_FORM).unwrap()));
    }

    #[test]
    fn everything_is_shown() {
        golden(
            "everything.txt",
            &summary(&check::model(EVERYTHING).unwrap()),
        );
    }

    #[test]
    fn a_model_whose_actions_are_all_proven_says_so() {
        let mut text = EVERYTHING.to_owned();
        for weak in ["third-party", "sibling", "inferred"] {
            text = text.replace(&format!("\"{weak}\""), "\"manual\"");
        }
        let text = summary(&check::model(&text).unwrap());
        assert!(
            text.contains("until `accept_unverified` names it\n  none\n"),
            "{text}"
        );
    }
}
