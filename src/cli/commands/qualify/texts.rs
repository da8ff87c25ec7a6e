//! The texts of `qualify` for people: the list, the beginning, an order before it is sent, and the summary.

use super::session::ActionResult;
use crate::cli::tools::setup::{table, text_or_unknown};
use crate::north::api::{TrialActionDocument, TrialDocument, TrialFrame};
use std::fmt::Write;

/// What is to be tried at a drive and what was found.
pub(super) fn list(document: &TrialDocument) -> String {
    let TrialDocument {
        drive, model, line, ..
    } = document;
    let mut said = format!("drive {drive} ({model} on {line})\n");
    if document.actions.is_empty() {
        said.push_str("  nothing to try\n");
    }
    let rows = document
        .actions
        .iter()
        .map(|it| [it.action.to_string(), it.rests_on.join(", "), standing(it)]);
    said.push_str(&table(rows));
    if let Some(why) = &document.void {
        let _ = writeln!(said, "what was found no longer counts: {why}");
    }
    if let Some(why) = &document.damaged {
        let _ = writeln!(said, "the file of qualified drives cannot be used: {why}");
    }
    if document.qualify {
        said.push_str("it is open to trials (`qualify = true`)\n");
    }
    said
}

/// What stands with one action.
fn standing(action: &TrialActionDocument) -> String {
    let found = match &action.result {
        None => "not tried".to_owned(),
        Some(result) => format!(
            "{result} by {}, {}",
            text_or_unknown(action.by.as_deref()),
            text_or_unknown(action.at.as_deref())
        ),
    };
    let is_confirmed = action.result.as_deref() == Some("confirmed");
    let counts = match (action.listed, action.in_force) {
        _ if action.proven => "; proven, as the model file says",
        (true, _) => "; listed in accept_unverified",
        (false, true) => "; accepted for this drive (site)",
        (false, false) if is_confirmed && action.counts => "; counts after a reload",
        (false, false) => "; refused",
    };
    format!("{found}{counts}")
}

/// What a person must know before the first order.
pub(super) fn beginning(document: &TrialDocument) -> String {
    let TrialDocument {
        drive, model, line, ..
    } = document;
    let setpoint = document.setpoint_hz.unwrap_or_default();
    let lost = text_or_unknown(document.on_commander_lost.as_deref());
    let after = document.lost_after_ms.unwrap_or_default() as f64 / 1000.0;
    format!(
        "Trials at drive {drive} ({model} on {line}).\n\
         The motor will turn at {setpoint:.2} Hz. Uncouple it or let it turn freely, keep people away, and keep a hand on\n\
         the hard-wired stop. This program is no safety function. Ctrl-C sends a STOP; if this program dies, the drive\n\
         gets `{lost}` after {after:.1} s.\n\
         y sends an order, skip leaves it out, anything else ends the trials.\n"
    )
}

/// One trial before it begins: what is sent, and what should be seen.
pub(super) fn trial(
    document: &TrialDocument,
    title: &str,
    orders: &[&str],
    expected: &str,
) -> String {
    let mut said = format!("\n{title}\n");
    for order in orders {
        let frames = document.orders.as_ref().and_then(|all| all.get(*order));
        for TrialFrame { words, frame } in frames.into_iter().flatten() {
            let words: Vec<_> = words
                .iter()
                .map(|it| format!("{} = {}", it.register, it.word))
                .collect();
            let words = words.join(", ");
            let _ = writeln!(said, "  sent:     {words} ({order}), frame {frame}");
        }
    }
    let _ = writeln!(said, "  expected: {expected}");
    said
}

/// The results of all trials.
pub(super) fn summary(found: &[ActionResult]) -> String {
    let rows = found.iter().map(|it| {
        [
            it.action.to_owned(),
            it.result.keyword().to_owned(),
            it.why.clone(),
        ]
    });
    if found.is_empty() {
        "\nnothing was tried\n".to_owned()
    } else {
        format!("\n{}", table(rows))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::qualified::TrialFinding;
    use serde_json::{Value, json};

    #[test]
    fn an_order_is_reported_with_register_word_and_frame() {
        let frame = json!({ "words": [{ "register": "0x2501", "word": 0 }], "frame": "01 06 25 01 00 00 D2 C6" });
        let document = json!({ "orders": { "stop": [frame] } });
        let document = serde_json::from_value(document).unwrap();
        let said = trial(&document, "stop", &["stop"], "nothing moves");
        assert_eq!(
            said,
            "\nstop\n  sent:     0x2501 = 0 (stop), frame 01 06 25 01 00 00 D2 C6\n  expected: nothing moves\n"
        );
    }

    #[test]
    fn the_list_says_what_counts() {
        let action = |more: Value| {
            let mut action = json!({ "action": "basic", "rests_on": ["stop (sibling)"], "by": "anna", "at": "t" });
            for (key, value) in more.as_object().unwrap() {
                action[key] = value.clone();
            }
            let document = json!({ "drive": "d", "model": "m", "line": "l", "actions": [action], "void": "it changed" });
            list(&serde_json::from_value(document).unwrap())
        };
        for (more, expected) in [
            (json!({}), "not tried; refused"),
            (
                json!({ "listed": true, "in_force": true }),
                "not tried; listed in accept_unverified",
            ),
            (
                json!({ "proven": true, "in_force": true }),
                "not tried; proven, as the model file says",
            ),
            (
                json!({ "result": "confirmed", "in_force": true }),
                "confirmed by anna, t; accepted for this drive (site)",
            ),
            (
                json!({ "result": "confirmed", "counts": true }),
                "confirmed by anna, t; counts after a reload",
            ),
            (
                json!({ "result": "contradicted", "counts": true }),
                "contradicted by anna, t; refused",
            ),
        ] {
            let said = action(more);
            assert!(
                said.contains(&format!("basic  stop (sibling)  {expected}\n")),
                "{said}"
            );
            assert!(said.contains("no longer counts: it changed"), "{said}");
        }
    }

    #[test]
    fn the_summary_names_each_result() {
        let found = [ActionResult {
            action: "basic",
            result: TrialFinding::Contradicted,
            why: "the motor moves".to_owned(),
        }];
        assert_eq!(
            summary(&found),
            "\n  basic  contradicted  the motor moves\n"
        );
        assert_eq!(summary(&[]), "\nnothing was tried\n");
    }
}
