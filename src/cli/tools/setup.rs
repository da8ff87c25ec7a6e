//! The settings that a drive needs to obey the bus, as the running gateway reads them, in text for people.

use super::CommandFailure;
use super::socket::{self, SocketRequest};
use crate::domain::ids::Name;
use crate::domain::problem::nearest;
use crate::north::api::{
    AddressesBody, IdentityDocument, OrderOutcomeDocument, PassedOn, SeenWord, SetupDocument,
    SetupItemDocument, SetupWatchdogDocument, WatchdogBody, WordDocument,
};
use axum::http::StatusCode;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Longest time for one request: longer than the gateway waits for a drive.
const PATIENCE: Duration = Duration::from_secs(30);

/// One drive behind the gateway's socket.
pub struct SetupDrive {
    path: String,
    watchdog_path: String,
    socket: PathBuf,
    runtime: tokio::runtime::Runtime,
}

impl SetupDrive {
    /// The drive called `name`.
    ///
    /// # Errors
    /// No drive can have this name, or there is no socket to ask.
    pub fn new(name: &str, place: &socket::SocketArgs) -> Result<Self, CommandFailure> {
        let name = Name::new(name)
            .ok_or_else(|| CommandFailure::wrong(format!("`{name}` is not a valid drive name")))?;
        let socket = place.path()?;
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(CommandFailure::failed)?;
        let path = |what: &str| format!("/api/v1/drives/{name}/{what}");
        Ok(Self {
            path: path("setup"),
            watchdog_path: path("watchdog"),
            socket,
            runtime,
        })
    }

    /// What is set on the drive now.
    ///
    /// # Errors
    /// There is no such drive, or the gateway does not answer.
    pub fn read_settings(&self) -> Result<PassedOn<SetupDocument>, CommandFailure> {
        self.ask(SocketRequest::get(&self.path))
    }

    /// Sets the registers at `addresses`, and returns the outcome.
    ///
    /// # Errors
    /// There is no such drive, or the gateway does not answer.
    pub fn set(&self, addresses: Vec<u16>) -> Result<OrderOutcomeDocument, CommandFailure> {
        self.ask(SocketRequest::post(&self.path).with(&AddressesBody { addresses }))
    }

    /// Sets its own watchdog to `time`, or off for `None`, and returns the outcome.
    ///
    /// # Errors
    /// There is no such drive, or the gateway does not answer.
    pub fn set_watchdog(
        &self,
        time: Option<Duration>,
    ) -> Result<OrderOutcomeDocument, CommandFailure> {
        let time_ms = time.map(|time| u64::try_from(time.as_millis()).unwrap_or(u64::MAX));
        self.ask(SocketRequest::post(&self.watchdog_path).with(&WatchdogBody { time_ms }))
    }

    fn ask<T: DeserializeOwned>(&self, question: SocketRequest<'_>) -> Result<T, CommandFailure> {
        self.runtime.block_on(ask_drive(&self.socket, question))
    }
}

/// Asks the gateway behind `socket` about one drive.
///
/// # Errors
/// There is no such drive, the gateway refuses, or it does not answer.
pub async fn ask_drive<T: DeserializeOwned>(
    socket: &Path,
    question: SocketRequest<'_>,
) -> Result<T, CommandFailure> {
    let failed = |reason: String| {
        CommandFailure::failed(format!("gateway at {}: {reason}", socket.display()))
    };
    match socket::ask(socket, question, PATIENCE)
        .await
        .map_err(failed)?
    {
        (StatusCode::OK, answer) => socket::document(answer).map_err(failed),
        (StatusCode::NOT_FOUND, answer) => Err(CommandFailure::wrong(unknown(answer))),
        (_, answer) => Err(failed(outcome(&socket::refusal(answer)))),
    }
}

/// There is no such drive; the nearest one, or else all of them.
pub fn unknown(answer: Value) -> String {
    let OrderOutcomeDocument { drive, drives, .. } = socket::refusal(answer);
    let drives = drives.unwrap_or_default();
    match nearest(&drive, drives.iter().map(String::as_str)) {
        Some(near) => format!("no drive is called {drive}; did you mean {near}?"),
        None => format!(
            "no drive is called {drive}; there are {}",
            drives.join(", ")
        ),
    }
}

/// The outcome of an order, in words.
pub fn outcome(answer: &OrderOutcomeDocument) -> String {
    let mut said = answer.outcome.to_string();
    if answer.reason != "none" {
        let _ = write!(said, ": {} ({})", answer.message, answer.reason);
    }
    if let Some(held) = answer.held {
        let _ = write!(said, "; the drive holds {held}");
    }
    said.push_str(&exception(answer.exception));
    said
}

/// The setup report of a drive, for people.
pub fn report(setup: &SetupDocument) -> String {
    let SetupDocument {
        drive, model, line, ..
    } = setup;
    let mut said = format!(
        "drive {drive} ({model} on {line})\n{}",
        identity(setup.identity.as_ref(), model)
    );
    let (by_line, by_hand): (Vec<_>, Vec<_>) = setup
        .items
        .iter()
        .partition(|item| item.result != "at_the_drive");
    said.push_str(&table(by_line.into_iter().map(row)));
    if !by_hand.is_empty() {
        said.push_str("at the drive itself, where the gateway cannot read:\n");
        let rows = by_hand.into_iter();
        said.push_str(&table(
            rows.map(|item| [item.what.to_string(), item.text.to_string()]),
        ));
    }
    said.push_str(&watchdog(setup.watchdog.as_ref()));
    if setup.takes_priority {
        said.push_str(
            "note: this drive obeys the bus whatever these settings say; a STOP, too, takes control from panel and \
             terminals\n",
        );
    }
    said
}

/// What is wrong in a report, in a few words.
///
/// # Errors
/// Anything is wrong.
pub fn judge(setup: &SetupDocument) -> Result<(), CommandFailure> {
    if setup.right {
        return Ok(());
    }
    let count = |result: &str| {
        let items = setup.items.iter();
        items.filter(|item| item.result == *result).count()
    };
    let watchdog = setup.watchdog.as_ref();
    let is_watchdog_silent = watchdog.is_some_and(|it| it.state == "not_answered");
    let identity = setup.identity.as_ref();
    let is_identity_silent = identity.is_some_and(|it| it.result == "not_answered");
    let wrong = count("wrong") + usize::from(is_another_drive(setup));
    let silent =
        count("not_answered") + usize::from(is_watchdog_silent) + usize::from(is_identity_silent);
    Err(CommandFailure::failed(format!(
        "{}: {wrong} wrong, {silent} not answered",
        setup.drive
    )))
}

/// Whether the drive tells that it is not the one that it is taken for: then it gets no order.
pub fn is_another_drive(setup: &SetupDocument) -> bool {
    let identity = setup.identity.as_ref();
    identity.is_some_and(|it| it.result == "wrong" || it.result == "not_tried")
}

fn row(item: &SetupItemDocument) -> [String; 5] {
    let wanted: Vec<_> = item.wanted.iter().map(word_with_meaning).collect();
    let result = match &*item.result {
        "right" => "ok".to_owned(),
        "wrong" => "WRONG".to_owned(),
        "not_answered" => why_silent(&item.seen),
        other => other.to_owned(),
    };
    let found = match &item.seen.found {
        Some(found) => format!("found {}", word_with_meaning(found)),
        None => "-".to_owned(),
    };
    let wanted = format!("wanted {}", wanted.join(" or "));
    [
        item.what.to_string(),
        item.text.to_string(),
        wanted,
        found,
        result,
    ]
}

/// Which drive answered, for people. `model` is the one that the configuration names.
fn identity(identity: Option<&IdentityDocument>, model: &str) -> String {
    let Some(identity) = identity else {
        return "the drive's identity: this model has no register that shows it\n".to_owned();
    };
    let wanted: Vec<_> = identity.wanted.iter().map(u16::to_string).collect();
    let wanted = wanted.join(" or ");
    let said = match (&*identity.result, &identity.other) {
        ("right", _) => format!("{}: {model}, ok", found_as(identity)),
        ("not_tried", _) => {
            format!(
                "{}: WRONG, it is a {model}, but not the drive of the trials, which showed \
                 {wanted}",
                found_as(identity)
            )
        }
        ("not_answered", _) => why_silent(&identity.seen),
        (_, Some(other)) => format!(
            "{}: WRONG, {other}, and not {model}, which shows {wanted}",
            found_as(identity)
        ),
        (_, None) => format!(
            "{}: WRONG, an unknown drive; {model} shows {wanted}",
            found_as(identity)
        ),
    };
    format!(
        "the drive's identity ({}): {said}\n",
        text_or_unknown(identity.what.as_deref())
    )
}

/// The word that was found, also without the bits that do not count.
fn found_as(identity: &IdentityDocument) -> String {
    let Some(word) = &identity.seen.found else {
        return "found ?".to_owned();
    };
    let found = format!("found {}", word_with_meaning(word));
    match identity.mask {
        Some(mask) if mask != 0xFFFF => {
            format!("{found}, of which {} counts", word.raw & u32::from(mask))
        }
        _ => found,
    }
}

/// The drive's own watchdog, for people.
pub fn watchdog(watchdog: Option<&SetupWatchdogDocument>) -> String {
    let Some(watchdog) = watchdog else {
        return "the drive's own watchdog: none is known for this model\n".to_owned();
    };
    let is_on = watchdog.state == "on";
    let advice = match watchdog.judged.as_deref() {
        _ if !is_on => "",
        Some("keeps_running") => {
            "warning: with this setting the motor keeps running without the gateway\n"
        }
        Some("too_short") => {
            "warning: it is at most twice the longest gap between two frames, and may stop the \
             motor without cause; see `check`\n"
        }
        Some("too_long") => {
            "warning: it is longer than a commander may be silent; see `lost_after`\n"
        }
        _ => "",
    };
    let volatile = if watchdog.is_stored == Some(false) && is_on {
        "note: the drive keeps this in RAM and loses it with its power\n"
    } else {
        ""
    };
    format!("{}{advice}{volatile}", watchdog_as_found(watchdog))
}

fn watchdog_as_found(watchdog: &SetupWatchdogDocument) -> String {
    let what = text_or_unknown(watchdog.what.as_deref());
    match &*watchdog.state {
        "off" => {
            format!(
                "warning: the drive's own watchdog is off ({what}): a lost gateway would not stop the motor\n"
            )
        }
        "on" => {
            let action = match &watchdog.action {
                Some(action) => format!(", then {}", word_with_meaning(action)),
                None => String::new(),
            };
            format!(
                "the drive's own watchdog ({what}): {}{action}\n",
                found_word(&watchdog.seen)
            )
        }
        _ => format!(
            "the drive's own watchdog ({what}): {}\n",
            why_silent(&watchdog.seen)
        ),
    }
}

fn why_silent(seen: &SeenWord) -> String {
    format!(
        "not answered: {}{}",
        text_or_unknown(seen.message.as_deref()),
        exception(seen.exception)
    )
}

fn exception(code: Option<u8>) -> String {
    code.map(|code| format!("; exception {code:02X}"))
        .unwrap_or_default()
}

/// The word that was read, with its meaning; `?` if none was.
pub fn found_word(seen: &SeenWord) -> String {
    seen.found
        .as_ref()
        .map_or_else(|| "?".to_owned(), word_with_meaning)
}

/// A word with its meaning.
pub fn word_with_meaning(word: &WordDocument) -> String {
    match &word.text {
        Some(text) => format!("{} ({text})", word.raw),
        None => word.raw.to_string(),
    }
}

/// A text that may be missing; `?` then.
pub fn text_or_unknown(text: Option<&str>) -> &str {
    text.unwrap_or("?")
}

/// Rows, indented, each column as wide as it needs.
pub fn table<const N: usize>(rows: impl Iterator<Item = [String; N]>) -> String {
    let rows: Vec<_> = rows.collect();
    let width = |column: usize| {
        rows.iter()
            .map(|row| row[column].chars().count())
            .max()
            .unwrap_or(0)
    };
    let widths: Vec<_> = (0..N).map(width).collect();
    let mut drawn = String::new();
    for row in &rows {
        let cells: String = row
            .iter()
            .zip(&widths)
            .map(|(cell, width)| format!("  {cell:width$}"))
            .collect();
        let _ = writeln!(drawn, "{}", cells.trim_end());
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn seen(result: &str, found: Value) -> Value {
        json!({
            "what": "C1", "text": "source: bus", "address": 7, "wanted": [{ "raw": 3, "text": "bus" }, { "raw": 5 }],
            "found": found, "result": result, "message": "the drive did not answer", "exception": null,
        })
    }

    fn setup(items: Vec<Value>, watchdog: Value) -> SetupDocument {
        let setup = json!({ "drive": "d", "model": "m", "line": "l", "right": false, "items": items, "watchdog": watchdog });
        serde_json::from_value(setup).unwrap()
    }

    #[test]
    fn each_item_says_what_is_wanted_and_what_was_found() {
        let by_hand =
            json!({ "what": "SW2", "text": "switch: on", "wanted": [], "result": "at_the_drive" });
        let items = vec![
            seen("right", json!({ "raw": 3, "text": "bus" })),
            seen("wrong", json!({ "raw": 2 })),
            seen("not_answered", Value::Null),
            by_hand,
        ];
        let said = report(&setup(items, Value::Null));
        let expected = "\
drive d (m on l)
the drive's identity: this model has no register that shows it
  C1  source: bus  wanted 3 (bus) or 5  found 3 (bus)  ok
  C1  source: bus  wanted 3 (bus) or 5  found 2        WRONG
  C1  source: bus  wanted 3 (bus) or 5  -              not answered: the drive did not answer
at the drive itself, where the gateway cannot read:
  SW2  switch: on
the drive's own watchdog: none is known for this model
";
        assert_eq!(said, expected);
    }

    #[test]
    fn the_drive_that_answered_is_named() {
        let seen = |result: &str, other: Option<&str>, mask: u16| {
            let mut setup = setup(Vec::new(), Value::Null);
            let identity = json!({
                "what": "D0", "mask": mask, "wanted": [16, 17], "found": { "raw": 280 }, "result": result,
                "other": other, "message": "the drive did not answer", "exception": 3,
            });
            setup.identity = serde_json::from_value(identity).unwrap();
            let judged = judge(&setup).unwrap_err().message;
            (
                report(&setup).lines().nth(1).unwrap_or_default().to_owned(),
                judged,
            )
        };
        let said = |result, other| seen(result, other, 0xFFFF).0;
        assert_eq!(
            said("right", None),
            "the drive's identity (D0): found 280: m, ok"
        );
        assert_eq!(
            said("wrong", Some("Acme 2")),
            "the drive's identity (D0): found 280: WRONG, Acme 2, and not m, which shows 16 or 17"
        );
        assert_eq!(
            seen("wrong", None, 0xFF).0,
            "the drive's identity (D0): found 280, of which 24 counts: WRONG, an unknown drive; m shows 16 or 17"
        );
        assert_eq!(
            said("not_tried", None),
            "the drive's identity (D0): found 280: WRONG, it is a m, but not the drive of the trials, which showed 16 or 17"
        );
        assert_eq!(
            said("not_answered", None),
            "the drive's identity (D0): not answered: the drive did not answer; exception 03"
        );
        let judged = |result| seen(result, None, 0xFFFF).1;
        assert_eq!(judged("wrong"), "d: 1 wrong, 0 not answered");
        assert_eq!(judged("not_tried"), "d: 1 wrong, 0 not answered");
        assert_eq!(judged("not_answered"), "d: 0 wrong, 1 not answered");
    }

    #[test]
    fn a_watchdog_that_is_off_is_warned_about() {
        let time = json!({ "raw": 20, "text": "2.0 s" });
        let watchdog = |state: &str| {
            let of = json!({
                "what": "C9", "state": state, "found": time, "action": { "raw": 1, "text": "coast" },
                "message": "the line is down",
            });
            report(&setup(Vec::new(), of))
        };
        assert!(
            watchdog("off").contains("warning: the drive's own watchdog is off (C9)"),
            "{}",
            watchdog("off")
        );
        assert!(
            watchdog("on").contains("own watchdog (C9): 20 (2.0 s), then 1 (coast)\n"),
            "{}",
            watchdog("on")
        );
        assert!(watchdog("not_answered").contains("not answered: the line is down\n"));
    }

    #[test]
    fn a_drive_that_the_bus_overrules_is_noted() {
        let mut setup = setup(Vec::new(), Value::Null);
        assert!(!report(&setup).contains("note:"));
        setup.takes_priority = true;
        assert!(report(&setup).contains("note:") && report(&setup).contains("STOP"));
    }

    #[test]
    fn what_is_wrong_is_counted() {
        let items = vec![
            seen("wrong", Value::Null),
            seen("right", Value::Null),
            seen("not_answered", Value::Null),
        ];
        let mut setup = setup(items, json!({ "state": "not_answered" }));
        assert_eq!(
            judge(&setup).unwrap_err().message,
            "d: 1 wrong, 2 not answered"
        );
        setup.right = true;
        assert!(judge(&setup).is_ok());
    }

    #[test]
    fn an_outcome_says_why_and_what_the_drive_says() {
        let outcome = |json: Value| outcome(&serde_json::from_value(json).unwrap());
        let refused =
            json!({ "outcome": "refused", "reason": "moving", "message": "the motor may turn" });
        assert_eq!(outcome(refused), "refused: the motor may turn (moving)");
        assert_eq!(
            outcome(json!({ "outcome": "confirmed", "reason": "none", "message": "" })),
            "confirmed"
        );
        let kept = json!({ "outcome": "failed", "reason": "r", "message": "no", "held": 2, "exception": 3 });
        assert_eq!(
            outcome(kept),
            "failed: no (r); the drive holds 2; exception 03"
        );
    }

    #[test]
    fn a_slip_of_the_pen_is_answered_with_the_right_name() {
        let answer = |name: &str| unknown(json!({ "drive": name, "drives": ["pump-1", "fan"] }));
        assert_eq!(
            answer("pmup-1"),
            "no drive is called pmup-1; did you mean pump-1?"
        );
        assert_eq!(
            answer("mixer"),
            "no drive is called mixer; there are pump-1, fan"
        );
    }
}
