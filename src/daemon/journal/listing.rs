//! Rows of the journal as they are shown: JSON, CSV, plain text.

use super::reader::ReadRow;
use crate::domain::calendar::rfc3339;
use crate::domain::command::Reason;
use crate::journal::{JournalRow, JournalTable};
use crate::north::shown::{fail_safe_cause, fail_safe_stage};
use crate::north::texts::{Sentence, english};
use crate::north::titles::{PartTitle, PlantTitles, labelled};
use serde_json::{Value, json};

/// The columns of CSV in a plant with `titles`, with the line break.
#[must_use]
pub fn columns(titles: &PlantTitles) -> String {
    let columns = "table,number,at,kind,name,by,tried,outcome,reason,count,body";
    with_title(columns, titles, Some("title"))
}

/// `line` of CSV with a title as its last column, if any part of the plant has one, and with its line break.
pub(super) fn with_title(line: &str, titles: &PlantTitles, title: Option<&str>) -> String {
    if titles.is_empty() {
        return format!("{line}\n");
    }
    format!("{line},{}\n", quoted(title.unwrap_or_default()))
}

/// The title of what `row` is about.
fn title_of<'t>(row: &JournalRow, titles: &'t PlantTitles) -> Option<&'t PartTitle> {
    match (row.kind.as_str(), &row.name) {
        (_, None) => titles.gateway.as_ref(),
        ("line", Some(line)) => titles.lines.get(line),
        (_, Some(drive)) => titles.drives.get(drive),
    }
}

/// A row as JSON; with its plain text if `has_text`.
#[must_use]
pub fn in_json(table: JournalTable, seen: &ReadRow, titles: &PlantTitles, has_text: bool) -> Value {
    let table = table.name();
    let number = seen.number();
    let ReadRow::Sound(row) = seen else {
        return json!({ "table": table, "number": number, "damaged": true });
    };
    let body = body(row);
    let text = has_text.then(|| words(row, &body));
    let JournalRow { at, kind, name, .. } = row;
    let mut shown = json!({ "table": table, "number": number, "at": rfc3339(*at), "kind": kind, "name": name, "body": body });
    if let Some(text) = text {
        shown["text"] = text.into();
    }
    if let Some(title) = title_of(row, titles) {
        shown["title"] = title.as_str().into();
    }
    shown
}

/// A row as a line of CSV, with its line break.
#[must_use]
pub fn in_csv(table: JournalTable, seen: &ReadRow, titles: &PlantTitles) -> String {
    let ReadRow::Sound(row) = seen else {
        let damaged = format!("{},{},,damaged,,,,,,,", table.name(), seen.number());
        return with_title(&damaged, titles, None);
    };
    let body = body(row);
    let word = |key: &str| match &body[key] {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    let name = row.name.clone().unwrap_or_default();
    let first = [
        table.name().to_owned(),
        row.number.to_string(),
        rfc3339(row.at),
        row.kind.clone(),
        name,
    ];
    let others = ["by", "tried", "outcome", "reason", "count"].map(word);
    let fields: Vec<_> = first
        .into_iter()
        .chain(others)
        .chain([row.body.clone()])
        .map(|it| quoted(&it))
        .collect();
    let title = title_of(row, titles).map(PartTitle::as_str);
    with_title(&fields.join(","), titles, title)
}

/// How a text begins that a spreadsheet may take for a formula, also in the wide forms of East Asian input.
const FORMULA_SIGNS: [char; 10] = ['=', '+', '-', '@', '\t', '\r', '＝', '＋', '－', '＠'];

/// Quotes a field as RFC 4180 requires. A text that a spreadsheet would take for a formula is marked as text.
fn quoted(field: &str) -> String {
    let mark = if field.starts_with(FORMULA_SIGNS) {
        "'"
    } else {
        ""
    };
    if mark.is_empty() && !field.contains([',', '"', '\n', '\r']) {
        return field.to_owned();
    }
    format!("\"{mark}{}\"", field.replace('"', "\"\""))
}

/// A row as a line of plain text, with its line break.
#[must_use]
pub fn in_words(table: JournalTable, seen: &ReadRow, titles: &PlantTitles) -> String {
    match seen {
        ReadRow::Damaged(number) => format!("{:24} {} {number} is damaged\n", "?", table.name()),
        ReadRow::Sound(row) => {
            let name = row.name.as_deref().unwrap_or("gateway");
            let label = labelled(name, title_of(row, titles));
            format!("{} {label} {}\n", rfc3339(row.at), words(row, &body(row)))
        }
    }
}

fn body(row: &JournalRow) -> Value {
    serde_json::from_str(&row.body).unwrap_or(Value::Null)
}

fn word(body: &Value, key: &str) -> String {
    body[key].as_str().unwrap_or("?").to_owned()
}

fn attempt(body: &Value) -> String {
    let outcome = body["outcome"].as_str().unwrap_or("no end is known");
    let times = match body["count"].as_u64() {
        Some(count) if count > 1 => format!(" ({count} times)"),
        _ => String::new(),
    };
    let by = body["by"].as_str().unwrap_or("unknown");
    format!(
        "{by}: {}: {outcome}{}{times}",
        word(body, "tried"),
        why(body)
    )
}

fn fail_safe(body: &Value) -> String {
    let cause = fail_safe_cause(&word(body, "cause"));
    let tried = word(body, "tried");
    match body["stage"].as_str() {
        Some(stage) => format!("{cause}. {}", fail_safe_stage(&tried, stage)),
        // Rows of versions before 0.9 have no stage.
        None => format!("{cause}. The declared action is {tried}"),
    }
}

fn may_still_run(body: &Value) -> String {
    let state = |state: &str| {
        english(&format!("finding.state.{state}"))
            .unwrap_or(state)
            .to_owned()
    };
    let hertz = body["output_hz"]
        .as_f64()
        .map(|hertz| format!(" at {hertz:.2} Hz"))
        .unwrap_or_default();
    let seen = body["run_state"]
        .as_str()
        .map(|seen| format!(", last seen {}{hertz}", state(seen)));
    format!("out of sight{}: it may still run", seen.unwrap_or_default())
}

fn tripped(number: u64, body: &Value) -> String {
    let away = if body["while_away"] == true {
        " while away"
    } else {
        ""
    };
    let text = body["text"]
        .as_str()
        .map(|text| format!(": {text}"))
        .unwrap_or_default();
    let code = body["code"]
        .as_u64()
        .map_or_else(|| "?".to_owned(), |code| code.to_string());
    let after = body["running_hours"]
        .as_f64()
        .map(|hours| format!(", after {hours} running hours"));
    format!(
        "tripped{away}, code {code}{text}{} (event {number})",
        after.unwrap_or_default()
    )
}

/// The text of a row, without time and name.
fn words(row: &JournalRow, body: &Value) -> String {
    let word = |key| word(body, key);
    let said = match row.kind.as_str() {
        "attempt" => attempt(body),
        "failsafe" => fail_safe(body),
        "lease" => lease(body, &word("by")),
        "usage_reset" => format!(
            "{} set energy, running hours, starts and trips back to 0",
            word("by")
        ),
        "may_still_run" => may_still_run(body),
        "standstill_confirmed" => format!("{} confirmed that the motor stands", word("by")),
        "stop_given_up" => "a STOP was given up: the drive stayed offline".to_owned(),
        "tripped" => tripped(row.number, body),
        "cleared" => format!("trip cleared (event {})", row.number),
        _ => {
            let reason = body["reason"]
                .as_str()
                .map(|reason| format!(": {reason}"))
                .unwrap_or_default();
            format!("{} {}{reason}", row.kind, word("state"))
        }
    };
    // Text from a client must not control the reader's terminal.
    said.chars()
        .map(|c| if c.is_control() { '?' } else { c })
        .collect()
}

/// Why an attempt ended as it did, behind its outcome; empty without a reason.
fn why(body: &Value) -> String {
    let Some(reason) = body["reason"]
        .as_str()
        .filter(|reason| *reason != Reason::None.keyword())
    else {
        return String::new();
    };
    let plain = english(&format!("reason.{reason}")).unwrap_or(reason);
    match body["holder"].as_str() {
        Some(holder) => format!(
            ": {}",
            Sentence::new("reason.held_by").with("holder", holder)
        ),
        None => format!(": {plain}"),
    }
}

/// How control changed hands, and whom it concerns.
fn lease(body: &Value, owner: &str) -> String {
    match body["state"].as_str().unwrap_or("?") {
        "opened" => format!("{owner} holds control"),
        "ended" => format!("{owner} does not hold control any more"),
        "taken_over" => format!(
            "{owner} took control over from {}",
            body["from"].as_str().unwrap_or("?")
        ),
        "orphaned" => format!("{owner} held control when the gateway ended, and may take it again"),
        "taken_up" => format!("{owner} is back and holds control"),
        state => format!("lease {state}: {owner}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::fail_safe::{FailSafeCause, FailSafeStage};
    use crate::domain::time::WallTime;
    use std::collections::BTreeMap;

    fn none() -> PlantTitles {
        PlantTitles::default()
    }

    #[test]
    fn csv_survives_what_clients_send() {
        let table = [
            ("a", "a"),
            ("a,b", "\"a,b\""),
            ("say \"no\"", "\"say \"\"no\"\"\""),
            ("=1+1", "\"'=1+1\""),
            ("\t=1+1", "\"'\t=1+1\""),
            ("\r=1+1", "\"'\r=1+1\""),
            ("＝1+1", "\"'＝1+1\""),
        ];
        for (field, right) in table {
            assert_eq!(quoted(field), right);
        }
    }

    #[test]
    fn a_row_shows_the_title_of_what_it_is_about() {
        let title = |text| PartTitle::new(text).unwrap();
        let of = |name: &str, text| BTreeMap::from([(name.to_owned(), title(text))]);
        let titles = PlantTitles {
            drives: of("one", "=1+1,\"a\""),
            gateway: Some(title("Werk Süd")),
            groups: BTreeMap::new(),
            lines: of("one", "قاعة"),
        };
        let row = |kind, name| {
            let at = WallTime { unix_ms: 0 };
            ReadRow::Sound(JournalRow::new(at, kind, name, &json!({ "state": "up" })))
        };
        let table = JournalTable::Availability;
        for (kind, name, title, csv, label) in [
            (
                "drive",
                Some("one"),
                "=1+1,\"a\"",
                "\"'=1+1,\"\"a\"\"\"",
                "one \"=1+1,'a'\"",
            ),
            (
                "line",
                Some("one"),
                "قاعة",
                "قاعة",
                "one \"\u{2068}قاعة\u{2069}\"",
            ),
            (
                "gateway",
                None,
                "Werk Süd",
                "Werk Süd",
                "gateway \"Werk Süd\"",
            ),
        ] {
            let row = row(kind, name);
            assert_eq!(in_json(table, &row, &titles, false)["title"], title);
            let line = in_csv(table, &row, &titles);
            assert!(line.ends_with(&format!(",{csv}\n")), "{line}");
            let words = in_words(table, &row, &titles);
            assert!(words.contains(&format!("Z {label} {kind} up\n")), "{words}");
        }
        let (plain, damaged) = (row("drive", Some("two")), ReadRow::Damaged(7));
        for row in [&plain, &damaged] {
            assert!(in_json(table, row, &titles, false).get("title").is_none());
            let (with, without) = (in_csv(table, row, &titles), in_csv(table, row, &none()));
            assert_eq!(with.trim_end(), without.trim_end().to_owned() + ",");
        }
        assert_eq!(
            columns(&titles).trim_end(),
            columns(&none()).trim_end().to_owned() + ",title"
        );
    }

    #[test]
    fn rows_have_words_and_no_control_characters() {
        let at = WallTime { unix_ms: 0 };
        let attempt = json!({ "by": "mqtt", "tried": "run\u{1b}[2J", "outcome": "refused", "reason": "tripped", "count": 3 });
        let none = none();
        let said = |row| in_words(JournalTable::Audit, &ReadRow::Sound(row), &none);
        let row = JournalRow::new(at, "attempt", Some("pump-1"), &attempt);
        assert_eq!(
            in_json(
                JournalTable::Audit,
                &ReadRow::Sound(row.clone()),
                &none,
                true
            )["text"],
            "mqtt: run?[2J: refused: the drive is tripped: reset it first (3 times)"
        );
        assert_eq!(
            said(row),
            "1970-01-01T00:00:00.000Z pump-1 mqtt: run?[2J: refused: the drive is tripped: reset it first (3 times)\n"
        );
        for (body, expected) in [
            (
                json!({ "code": 7, "text": "overload", "while_away": true }),
                "tripped while away, code 7: overload",
            ),
            (
                json!({ "code": null, "while_away": false }),
                "tripped, code ?",
            ),
            (json!({ "code": 7 }), "tripped, code 7"),
        ] {
            let row = JournalRow::new(at, "tripped", Some("pump-1"), &body);
            assert_eq!(
                said(row),
                format!("1970-01-01T00:00:00.000Z pump-1 {expected} (event 0)\n")
            );
        }
        let down = json!({ "state": "down", "reason": "the port is gone" });
        let said = said(JournalRow::new(at, "line", Some("hall-1"), &down));
        assert_eq!(
            said,
            "1970-01-01T00:00:00.000Z hall-1 line down: the port is gone\n"
        );
    }

    #[test]
    fn no_row_shows_a_word_for_programs() {
        let said = |kind, body: Value| {
            words(
                &JournalRow::new(WallTime { unix_ms: 0 }, kind, Some("pump-1"), &body),
                &body,
            )
        };
        for reason in Reason::ALL {
            let body = json!({ "by": "mqtt", "tried": "run forward", "outcome": "refused", "reason": reason.keyword() });
            let text = said("attempt", body);
            assert!(
                !reason.keyword().contains('_') || !text.contains(reason.keyword()),
                "{text}"
            );
        }
        let held = json!({ "by": "mqtt", "tried": "stop", "outcome": "refused", "reason": "other_owner", "holder": "bob" });
        assert_eq!(
            said("attempt", held),
            "mqtt: stop: refused: bob holds control of the drive"
        );
        for cause in FailSafeCause::ALL {
            for stage in FailSafeStage::ALL {
                let body =
                    json!({ "tried": "stop", "cause": cause.keyword(), "stage": stage.keyword() });
                let text = said("failsafe", body);
                assert!(
                    text.contains("The declared action (stop) ") && !text.contains('_'),
                    "{text}"
                );
            }
            let old = said(
                "failsafe",
                json!({ "tried": "coast", "cause": cause.keyword() }),
            );
            assert!(old.ends_with(". The declared action is coast"), "{old}");
        }
        let held = said(
            "failsafe",
            json!({ "tried": "hold", "cause": "shutdown", "stage": "effective" }),
        );
        assert!(
            held.starts_with("the gateway shuts down. ") && held.contains("left as it is"),
            "{held}"
        );
        let unseen = said(
            "may_still_run",
            json!({ "run_state": "forward", "output_hz": 20 }),
        );
        assert_eq!(
            unseen,
            "out of sight, last seen running forward at 20.00 Hz: it may still run"
        );
    }
}
