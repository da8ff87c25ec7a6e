//! A model as tables for people: its facts with confidence and source.

mod command;
mod layout;
mod line;
mod registers;

use super::model::{Document, Model};
use layout::{Row, list, section};

/// The documents, each with its kind, the models it covers, and the highest confidence it supports.
fn documents(model: &Model) -> Vec<Row> {
    let row = |document: &Document| {
        let of = if document.is_of(&model.id) {
            "this model".to_owned()
        } else {
            list(&document.of)
        };
        let kind = document.kind.word().to_owned();
        let best = document.best(&model.id).word();
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
    section(&mut text, "Link", line::link(&model.link));
    section(&mut text, "Timing", line::timing(&model.timing));
    section(&mut text, "Reads and writes", line::reads_and_writes(model));
    section(
        &mut text,
        "Barriers, after which no late reply can follow",
        line::barriers(&model.barriers),
    );
    section(&mut text, "Exceptions", line::exceptions(model));
    section(&mut text, "Quirks", line::quirks(&model.quirks));
    if let Some(run) = &model.run {
        section(&mut text, "Run commands", command::run_commands(model, run));
        section(&mut text, "Bits of run commands", command::run_bits(run));
        section(
            &mut text,
            "Fields of run commands",
            command::run_fields(run),
        );
        let heading = "Unproven control actions, each off until `accept_unverified` names it";
        section(&mut text, heading, command::unproven_actions(model, run));
    }
    section(
        &mut text,
        "After parameters were written",
        command::commit(model),
    );
    section(&mut text, "Set-up, in this order", command::setup(model));
    section(
        &mut text,
        "Orders that are refused while a setting is wrong",
        command::needed(model),
    );
    section(&mut text, "Identity", command::identity(model));
    section(&mut text, "Watchdog of the drive", command::watchdog(model));
    section(&mut text, "Status", registers::status(model));
    section(
        &mut text,
        "States in the drive's own words",
        registers::states(model),
    );
    section(&mut text, "Trips", registers::trips(model));
    section(
        &mut text,
        "Warnings, which stop no motor",
        registers::warnings(model),
    );
    section(&mut text, "Codes", registers::codes(model.codes.as_ref()));
    section(
        &mut text,
        "Registers",
        registers::registers(&model.registers),
    );
    section(
        &mut text,
        "Meanings of words",
        registers::meanings(&model.registers),
    );
    section(
        &mut text,
        "Registers after whose write the drive hears nothing",
        registers::deaf(&model.registers),
    );
    section(
        &mut text,
        "Registers whose write is not answered",
        registers::silent(&model.registers),
    );
    section(
        &mut text,
        "Back doors, which no client may write",
        registers::back_doors(&model.registers),
    );
    text
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
        let text = include_str!("../../../tests/golden/models/orders.toml");
        golden("orders.txt", &summary(&check::model(text).unwrap()));
        let text = include_str!("../../../tests/golden/models/pairs.toml");
        golden("pairs.txt", &summary(&check::model(text).unwrap()));
        let text = include_str!("../../../tests/golden/models/signed.toml");
        golden("signed.txt", &summary(&check::model(text).unwrap()));
        let text = include_str!("../../../tests/golden/models/coils.toml");
        golden("coils.txt", &summary(&check::model(text).unwrap()));
        let text = include_str!("../../../tests/golden/models/start.toml");
        golden("start.txt", &summary(&check::model(text).unwrap()));
        let text = include_str!("../../../tests/golden/models/by-time.toml");
        golden("by-time.txt", &summary(&check::model(text).unwrap()));
    }

    #[test]
    fn values_are_shown_with_what_they_depend_on() {
        let text = include_str!("../../../tests/golden/models/values.toml");
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
