//! The settings that a drive needs to obey the bus, as the running gateway reads them, in text for people.

use super::CommandFailure;
use super::socket::{self, SocketRequest};
use crate::domain::ids::Name;
use crate::domain::problem::nearest;
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::PathBuf;
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

    /// What is set on it now.
    ///
    /// # Errors
    /// There is no such drive, or the gateway does not answer.
    pub fn look(&self) -> Result<Value, CommandFailure> {
        self.ask(SocketRequest::get(&self.path))
    }

    /// Sets the registers at `addresses`, and returns the outcome.
    ///
    /// # Errors
    /// There is no such drive, or the gateway does not answer.
    pub fn set(&self, addresses: &[u16]) -> Result<Value, CommandFailure> {
        let body = json!({ "addresses": addresses });
        self.ask(SocketRequest {
            method: Method::POST,
            path: &self.path,
            body: Some(&body),
        })
    }

    /// Sets its own watchdog to `time`, or off for `None`, and returns the outcome.
    ///
    /// # Errors
    /// There is no such drive, or the gateway does not answer.
    pub fn set_watchdog(&self, time: Option<Duration>) -> Result<Value, CommandFailure> {
        let body = json!({ "time_ms": time.map(|time| u64::try_from(time.as_millis()).unwrap_or(u64::MAX)) });
        self.ask(SocketRequest {
            method: Method::POST,
            path: &self.watchdog_path,
            body: Some(&body),
        })
    }

    fn ask(&self, question: SocketRequest<'_>) -> Result<Value, CommandFailure> {
        let at = self.socket.display();
        match self
            .runtime
            .block_on(socket::ask(&self.socket, question, PATIENCE))
        {
            Ok((StatusCode::OK, answer)) => Ok(answer),
            Ok((StatusCode::NOT_FOUND, answer)) => Err(CommandFailure::wrong(unknown(&answer))),
            Ok((_, answer)) => Err(CommandFailure::failed(format!(
                "gateway at {at}: {}",
                outcome(&answer)
            ))),
            Err(reason) => Err(CommandFailure::failed(format!("gateway at {at}: {reason}"))),
        }
    }
}

/// There is no such drive; the nearest one, or else all of them.
pub fn unknown(answer: &Value) -> String {
    let name = text(answer, "drive");
    let drives: Vec<_> = answer["drives"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(Value::as_str)
        .collect();
    match nearest(name, drives.iter().copied()) {
        Some(near) => format!("no drive is called {name}; did you mean {near}?"),
        None => format!("no drive is called {name}; there are {}", drives.join(", ")),
    }
}

/// The outcome of an order, in words.
pub fn outcome(answer: &Value) -> String {
    let mut said = text(answer, "outcome").to_owned();
    if answer["reason"] != "none" {
        let _ = write!(
            said,
            ": {} ({})",
            text(answer, "message"),
            text(answer, "reason")
        );
    }
    if let Some(held) = answer["held"].as_u64() {
        let _ = write!(said, "; the drive holds {held}");
    }
    said.push_str(&exception(answer));
    said
}

/// The items of a report; none if it cannot be parsed.
pub fn items(setup: &Value) -> impl Iterator<Item = &Value> {
    setup["items"].as_array().into_iter().flatten()
}

/// The setup report of a drive, for people.
pub fn report(setup: &Value) -> String {
    let drive = text(setup, "drive");
    let model = text(setup, "model");
    let line = text(setup, "line");
    let mut said = format!(
        "drive {drive} ({model} on {line})\n{}",
        identity(&setup["identity"], model)
    );
    let (by_line, by_hand): (Vec<_>, Vec<_>) =
        items(setup).partition(|item| item["result"] != "at_the_drive");
    said.push_str(&table(by_line.into_iter().map(row)));
    if !by_hand.is_empty() {
        said.push_str("at the drive itself, where the gateway cannot read:\n");
        said.push_str(&table(by_hand.into_iter().map(|item| {
            [text(item, "what"), text(item, "text")].map(str::to_owned)
        })));
    }
    said.push_str(&watchdog(&setup["watchdog"]));
    if setup["takes_priority"] == true {
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
pub fn judge(setup: &Value) -> Result<(), CommandFailure> {
    if setup["right"] == true {
        return Ok(());
    }
    let count = |result: &str| items(setup).filter(|item| item["result"] == result).count();
    let is_watchdog_silent = setup["watchdog"]["state"] == "not_answered";
    let is_identity_silent = setup["identity"]["result"] == "not_answered";
    let wrong = count("wrong") + usize::from(is_another_drive(setup));
    let silent =
        count("not_answered") + usize::from(is_watchdog_silent) + usize::from(is_identity_silent);
    Err(CommandFailure::failed(format!(
        "{}: {wrong} wrong, {silent} not answered",
        text(setup, "drive")
    )))
}

/// Whether the drive tells that it is not the one that it is taken for: then it gets no order.
pub fn is_another_drive(setup: &Value) -> bool {
    ["wrong", "not_tried"]
        .iter()
        .any(|result| setup["identity"]["result"] == *result)
}

fn row(item: &Value) -> [String; 5] {
    let wanted: Vec<_> = item["wanted"]
        .as_array()
        .into_iter()
        .flatten()
        .map(word_with_meaning)
        .collect();
    let result = match text(item, "result") {
        "right" => "ok".to_owned(),
        "wrong" => "WRONG".to_owned(),
        "not_answered" => why_silent(item),
        other => other.to_owned(),
    };
    let found = if item["found"].is_null() {
        "-".to_owned()
    } else {
        format!("found {}", word_with_meaning(&item["found"]))
    };
    let wanted = format!("wanted {}", wanted.join(" or "));
    [
        text(item, "what").to_owned(),
        text(item, "text").to_owned(),
        wanted,
        found,
        result,
    ]
}

/// Which drive answered, for people. `model` is the one that the configuration names.
fn identity(identity: &Value, model: &str) -> String {
    let Some(result) = identity["result"].as_str() else {
        return "the drive's identity: this model has no register that tells it\n".to_owned();
    };
    let wanted: Vec<_> = identity["wanted"]
        .as_array()
        .into_iter()
        .flatten()
        .map(Value::to_string)
        .collect();
    let wanted = wanted.join(" or ");
    let said = match (result, identity["other"].as_str()) {
        ("right", _) => format!("{}: {model}, ok", found_as(identity)),
        ("not_tried", _) => {
            format!(
                "{}: WRONG, {model}, but not the drive of the trials, which showed {wanted}",
                found_as(identity)
            )
        }
        ("not_answered", _) => why_silent(identity),
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
        text(identity, "what")
    )
}

/// The word that was found, also without the bits that do not count.
fn found_as(identity: &Value) -> String {
    let found = format!("found {}", word_with_meaning(&identity["found"]));
    match (identity["found"]["raw"].as_u64(), identity["mask"].as_u64()) {
        (Some(raw), Some(mask)) if mask != 0xFFFF => {
            format!("{found}, of which {} counts", raw & mask)
        }
        _ => found,
    }
}

/// The drive's own watchdog, for people.
pub fn watchdog(watchdog: &Value) -> String {
    let is_on = watchdog["state"] == "on";
    let advice = match watchdog["judged"].as_str() {
        _ if !is_on => "",
        Some("keeps_running") => "warning: with that the motor runs on without the gateway\n",
        Some("too_short") => {
            "warning: it is no longer than twice the longest gap between two frames, and may stop the motor although \
             all is well; see `check`\n"
        }
        Some("too_long") => {
            "warning: it takes longer than a commander may be silent; see `lost_after`\n"
        }
        _ => "",
    };
    let volatile = if watchdog["is_stored"] == false && is_on {
        "note: the drive keeps this in RAM and forgets it with its power\n"
    } else {
        ""
    };
    format!("{}{advice}{volatile}", watchdog_as_found(watchdog))
}

fn watchdog_as_found(watchdog: &Value) -> String {
    match watchdog["state"].as_str() {
        None => "the drive's own watchdog: none is known for this model\n".to_owned(),
        Some("off") => {
            let what = text(watchdog, "what");
            format!(
                "warning: the drive's own watchdog is off ({what}): a lost gateway would not stop the motor\n"
            )
        }
        Some("on") => {
            let action = &watchdog["action"];
            let action = if action.is_null() {
                String::new()
            } else {
                format!(", then {}", word_with_meaning(action))
            };
            format!(
                "the drive's own watchdog ({}): {}{action}\n",
                text(watchdog, "what"),
                word_with_meaning(&watchdog["found"])
            )
        }
        Some(_) => format!(
            "the drive's own watchdog ({}): {}\n",
            text(watchdog, "what"),
            why_silent(watchdog)
        ),
    }
}

fn why_silent(seen: &Value) -> String {
    format!("not answered: {}{}", text(seen, "message"), exception(seen))
}

fn exception(answer: &Value) -> String {
    answer["exception"]
        .as_u64()
        .map(|code| format!("; exception {code:02X}"))
        .unwrap_or_default()
}

/// A word with its meaning.
pub fn word_with_meaning(word: &Value) -> String {
    let raw = word["raw"]
        .as_u64()
        .map_or_else(|| "?".to_owned(), |raw| raw.to_string());
    match word["text"].as_str() {
        Some(text) => format!("{raw} ({text})"),
        None => raw,
    }
}

/// A text of `of`; `?` if it is missing, because another version may send less.
pub fn text<'a>(of: &'a Value, key: &str) -> &'a str {
    of[key].as_str().unwrap_or("?")
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

    fn seen(result: &str, found: Value) -> Value {
        json!({
            "what": "C1", "text": "source: bus", "address": 7, "wanted": [{ "raw": 3, "text": "bus" }, { "raw": 5 }],
            "found": found, "result": result, "message": "the drive did not answer", "exception": null,
        })
    }

    fn setup(items: Vec<Value>, watchdog: Value) -> Value {
        json!({ "drive": "d", "model": "m", "line": "l", "right": false, "items": items, "watchdog": watchdog })
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
the drive's identity: this model has no register that tells it
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
            setup["identity"] = json!({
                "what": "D0", "mask": mask, "wanted": [16, 17], "found": { "raw": 280 }, "result": result,
                "other": other, "message": "the drive did not answer", "exception": 3,
            });
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
            "the drive's identity (D0): found 280: WRONG, m, but not the drive of the trials, which showed 16 or 17"
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
        setup["takes_priority"] = true.into();
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
        setup["right"] = true.into();
        assert!(judge(&setup).is_ok());
    }

    #[test]
    fn an_outcome_says_why_and_what_the_drive_says() {
        let refused =
            json!({ "outcome": "refused", "reason": "moving", "message": "the motor may turn" });
        assert_eq!(outcome(&refused), "refused: the motor may turn (moving)");
        assert_eq!(
            outcome(&json!({ "outcome": "confirmed", "reason": "none", "message": "" })),
            "confirmed"
        );
        let kept = json!({ "outcome": "failed", "reason": "r", "message": "no", "held": 2, "exception": 3 });
        assert_eq!(
            outcome(&kept),
            "failed: no (r); the drive holds 2; exception 03"
        );
    }

    #[test]
    fn a_slip_of_the_pen_is_answered_with_the_right_name() {
        let answer = |name: &str| unknown(&json!({ "drive": name, "drives": ["pump-1", "fan"] }));
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
