//! What was tried at drives on the site, and what of it a configuration accepts.

use super::*;
use crate::config::qualified::{QualifiedDrive, QualifiedFact, QualifiedResults, TrialFinding};
use crate::config::{is_tried, is_unproven, load_at_site};
use crate::domain::control::{ControlAction, ControlSettings};
use std::sync::Arc;

const AT: &str = "line[0].drive[0].control";

/// A drive of a model of which stop and coast are unproven.
fn text(lines: &str) -> String {
    let text = with(CONTROLLED, "[line.drive.native]\nwrite = [\"F007\"]\n", "");
    let text = with(
        &text,
        "[[line.drive]]\nname = \"pump-2\"\nmodel = \"hyundai-n700\"\nstation = 2\n",
        "",
    );
    let text = with(&text, "hyundai-n700", "toshiba-vf-s15");
    let text = with(
        &text,
        "station = 1\n",
        "station = 1\nrated_current_a = 11.0\nrated_voltage_v = 400.0\n",
    );
    with(
        &text,
        "on_shutdown = \"hold\"\n",
        &format!("on_shutdown = \"hold\"\n{lines}\n"),
    )
}

/// These actions were confirmed at the drive, when its model's file had this digest.
fn tried(actions: &[ControlAction], digest: u64) -> QualifiedResults {
    let mut qualified = QualifiedResults::default();
    let (line, model) = ("hall-1".to_owned(), "toshiba-vf-s15".to_owned());
    let drive = QualifiedDrive {
        line,
        station: 1,
        model,
        digest,
        identity: None,
    };
    for action in actions {
        let fact = QualifiedFact {
            action: *action,
            result: TrialFinding::Confirmed,
            by: "anna".to_owned(),
            at: "t".to_owned(),
        };
        qualified.record(&drive, fact).unwrap();
    }
    qualified
}

/// The control section and the warnings, or all problems.
fn loaded(
    text: &str,
    site: Result<&QualifiedResults, &str>,
) -> Result<(Arc<ControlSettings>, Vec<String>), Vec<String>> {
    let problem_lines = |problems: &[Problem]| {
        problems
            .iter()
            .map(|it| format!("{}: {}", it.key, it.what))
            .collect::<Vec<_>>()
    };
    match load_at_site(text, &catalog(), site) {
        Ok(config) => Ok((
            config.lines[0].drives[0].control.clone().unwrap(),
            problem_lines(&config.warnings),
        )),
        Err(problems) => Err(problem_lines(&problems)),
    }
}

fn is_named(reported: &[String], key: &str, words: &str) -> bool {
    reported
        .iter()
        .any(|it| it.starts_with(&format!("{AT}{key}: ")) && it.contains(words))
}

#[test]
fn a_drive_that_is_being_qualified_starts_with_warnings_and_accepts_nothing() {
    let nothing = QualifiedResults::default();
    let refused = loaded(&text(""), Ok(&nothing)).unwrap_err();
    assert!(
        is_named(&refused, ".accept_unverified", "takes no orders"),
        "{refused:?}"
    );
    let (control, warnings) = loaded(&text("qualify = true"), Ok(&nothing)).unwrap();
    assert!(
        control.qualify && control.accept_unverified.is_empty(),
        "{control:?}"
    );
    assert!(
        is_named(&warnings, ".accept_unverified", "takes no orders"),
        "{warnings:?}"
    );
    assert!(
        is_named(&warnings, ".qualify", "being qualified"),
        "{warnings:?}"
    );
    let homeless = with(
        &text("qualify = true"),
        "data_dir = \"/var/lib/vfd-gateway\"\n",
        "",
    );
    let (_, warnings) = loaded(
        &with(&homeless, "[journal]\nmax_size = \"10MB\"\n", ""),
        Ok(&nothing),
    )
    .unwrap();
    assert!(
        is_named(&warnings, ".qualify", "no result can be kept"),
        "{warnings:?}"
    );
}

#[test]
fn a_motor_in_a_trial_can_be_stopped() {
    let hold = with(
        &text("qualify = true"),
        "on_commander_lost = \"stop\"",
        "on_commander_lost = \"hold\"",
    );
    let refused = loaded(&hold, Ok(&QualifiedResults::default())).unwrap_err();
    assert!(
        is_named(&refused, ".on_commander_lost", "would run on"),
        "{refused:?}"
    );
    let run = text("qualify = true\nbus = \"run\"");
    let refused = loaded(&run, Ok(&QualifiedResults::default())).unwrap_err();
    assert!(is_named(&refused, ".bus", "over the bus"), "{refused:?}");
}

#[test]
fn what_was_confirmed_is_accepted_for_that_drive_as_it_was() {
    let digest = catalog().find("toshiba-vf-s15").unwrap().digest;
    let confirmed = tried(&[ControlAction::Basic, ControlAction::Coast], digest);
    let (control, warnings) = loaded(&text(""), Ok(&confirmed)).unwrap();
    assert_eq!(
        control.accept_unverified,
        [ControlAction::Basic, ControlAction::Coast]
    );
    assert_eq!(
        control.site.actions,
        [ControlAction::Basic, ControlAction::Coast]
    );
    assert!(warnings.is_empty(), "{warnings:?}");
    let (control, _) = loaded(&text("accept_unverified = [\"basic\"]"), Ok(&confirmed)).unwrap();
    assert_eq!(
        control.site.actions,
        [ControlAction::Coast],
        "what is listed rests on the list"
    );
    let elsewhere = with(&text(""), "name = \"hall-1\"", "name = \"hall-9\"");
    assert!(
        loaded(&elsewhere, Ok(&confirmed)).is_err(),
        "it is for that drive alone"
    );
}

#[test]
fn what_no_longer_counts_is_reported_and_keeps_no_gateway_from_starting() {
    let digest = catalog().find("toshiba-vf-s15").unwrap().digest;
    let void = tried(&[ControlAction::Basic], digest ^ 1);
    let (control, warnings) = loaded(&text(""), Ok(&void)).unwrap();
    assert!(control.accept_unverified.is_empty() && control.site.actions.is_empty());
    assert!(
        is_named(
            &warnings,
            "",
            "no longer counts (basic): the model file has changed since"
        ),
        "{warnings:?}"
    );
    assert!(
        is_named(&warnings, ".accept_unverified", "takes no orders"),
        "{warnings:?}"
    );

    let (control, warnings) = loaded(&text(""), Err("it is damaged")).unwrap();
    assert!(control.accept_unverified.is_empty());
    assert!(
        warnings
            .iter()
            .any(|it| it.starts_with("gateway.data_dir: qualified.json")
                && it.ends_with("it is damaged"))
    );
}

#[test]
fn a_fail_safe_action_does_not_change_with_the_drive() {
    let digest = catalog().find("toshiba-vf-s15").unwrap().digest;
    let confirmed = tried(&[ControlAction::Basic, ControlAction::Coast], digest);
    let coast = with(
        &text(""),
        "on_commander_lost = \"stop\"",
        "on_commander_lost = \"coast\"",
    );
    let refused = loaded(&coast, Ok(&confirmed)).unwrap_err();
    assert!(
        is_named(&refused, ".on_commander_lost", "coast is unproven"),
        "{refused:?}"
    );
    assert!(
        loaded(
            &with(
                &coast,
                "lost_after",
                "accept_unverified = [\"coast\"]\nlost_after"
            ),
            Ok(&confirmed)
        )
        .is_ok()
    );
}

#[test]
fn all_orders_of_a_model_that_is_not_built_in_are_tried_whatever_its_grades() {
    let own = include_str!("../../../../../tests/golden/models/everything.toml");
    let catalog = vendors::catalog().with_texts([("own.toml", own)]).unwrap();
    let own = catalog
        .models()
        .find(|it| vendors::catalog().find(&it.id).is_none())
        .unwrap();
    assert!(
        !is_unproven(own, ControlAction::Basic),
        "its writer calls it proven"
    );
    assert!(is_tried(own, ControlAction::Basic));
    let built_in = catalog
        .models()
        .find(|it| it.run.is_some() && it.unproven_basics().is_empty() && it.id != own.id);
    assert!(!is_tried(built_in.unwrap(), ControlAction::Basic));
    let only_read = catalog.models().find(|it| it.run.is_none()).unwrap();
    assert!(!is_tried(only_read, ControlAction::Basic));
}
