//! `standby`: shows the role of this gateway on each line that it shares with another one, or gives lines to that one.

use crate::cli::tools::socket::{self, SocketArgs, SocketRequest};
use crate::cli::tools::{CommandFailure, WordTone, print, toned};
use crate::north::api::{
    ErrorDocument, HandOverBody, HandOverDocument, HealthDocument, LineHealthDocument,
    UnknownLineDocument,
};
use axum::http::StatusCode;
use serde_json::{Value, json};
use std::time::Duration;

/// Longest time for an answer about the present.
const PATIENCE: Duration = Duration::from_secs(5);
/// Longest time for a hand-over: a line may be silent for ten minutes before it is taken over, and then be taken back.
const HAND_OVER_PATIENCE: Duration = Duration::from_secs(25 * 60);

/// Arguments of `standby`.
#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Args {
    #[command(subcommand)]
    action: Option<StandbyAction>,
    #[command(flatten)]
    look: LookArgs,
}

#[derive(Debug, clap::Subcommand)]
enum StandbyAction {
    /// Show the role of this gateway on each line; `standby` alone does the same
    Status(LookArgs),
    /// Give lines to the other gateway, and wait until that one is heard
    ///
    /// If no other gateway takes a line over, this one takes it back by itself, as after the loss of the other one: with
    /// `on_gateway_lost`.
    Yield(YieldArgs),
}

#[derive(Debug, clap::Args)]
struct LookArgs {
    #[command(flatten)]
    place: SocketArgs,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct YieldArgs {
    /// Name of the line; default: all lines on which this gateway sends
    line: Option<String>,
    #[command(flatten)]
    place: SocketArgs,
    /// Print the answer as JSON
    #[arg(long)]
    json: bool,
}

/// Prints a row for each line, or hands lines over.
pub fn standby(args: &Args) -> Result<(), CommandFailure> {
    match &args.action {
        None => status(&args.look),
        Some(StandbyAction::Status(look)) => status(look),
        Some(StandbyAction::Yield(args)) => hand_over(args),
    }
}

fn ask(
    place: &SocketArgs,
    question: SocketRequest<'_>,
    patience: Duration,
) -> Result<(StatusCode, Value), CommandFailure> {
    let socket = place.path()?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    let answer = runtime.block_on(socket::ask(&socket, question, patience));
    answer.map_err(|reason| {
        CommandFailure::failed(format!("gateway at {}: {reason}", socket.display()))
    })
}

fn status(args: &LookArgs) -> Result<(), CommandFailure> {
    let (status, health) = ask(&args.place, SocketRequest::get("/api/v1/health"), PATIENCE)?;
    if status != StatusCode::OK {
        return Err(CommandFailure::failed(format!(
            "the gateway answers {status}"
        )));
    }
    if args.json {
        // As it came: what an older gateway does not send is not made up.
        let lines = health["lines"].as_array().into_iter().flatten();
        let lines: Vec<_> = lines
            .map(|line| json!({ "name": line["name"], "state": line["state"], "standby": line["standby"] }))
            .collect();
        return print(&format!("{}\n", json!({ "lines": lines })));
    }
    let health: HealthDocument = socket::document(health).map_err(CommandFailure::failed)?;
    print(&health.lines.iter().map(row).collect::<String>())
}

/// One line for people.
fn row(line: &LineHealthDocument) -> String {
    let name = &line.name;
    let Some(standby) = &line.standby else {
        return format!("line {name}: no second gateway\n");
    };
    let partner = standby.partner.as_deref().unwrap_or("?");
    let listens = match standby.listener {
        Some(true) => format!("{partner} would take over"),
        Some(false) => toned(WordTone::Problem, &format!("{partner} does not answer")),
        None => format!("whether {partner} would take over is not known yet"),
    };
    let state = match (&*standby.role, standby.hears_other, line.state == "up") {
        (_, _, false) => format!(
            "{}; nothing can be heard",
            toned(WordTone::Problem, "the port cannot be used")
        ),
        ("active", true, _) => format!(
            "active; {}",
            toned(WordTone::Problem, "another master is heard")
        ),
        ("active", false, _) => format!("{}; {listens}", toned(WordTone::Good, "active")),
        ("listening", true, _) => {
            format!("{}; {partner} sends", toned(WordTone::Good, "listening"))
        }
        ("listening", false, _) => format!(
            "listening; {}",
            toned(WordTone::Notice, "no other gateway is heard")
        ),
        (role, ..) => role.to_owned(),
    };
    format!(
        "line {name}: {} is {state}; taken over {}, given up {}, rivals {}\n",
        standby.half.as_deref().unwrap_or("?"),
        standby.take_overs,
        standby.given_up,
        standby.rivals
    )
}

fn hand_over(args: &YieldArgs) -> Result<(), CommandFailure> {
    let question = SocketRequest::post("/api/v1/standby/yield").with(&HandOverBody {
        line: args.line.clone(),
    });
    let (status, answer) = ask(&args.place, question, HAND_OVER_PATIENCE)?;
    if args.json {
        print(&format!("{answer}\n"))?;
    } else if status == StatusCode::OK || status == StatusCode::CONFLICT {
        let ended = socket::document(answer.clone()).map_err(CommandFailure::failed)?;
        print(&yield_message(&ended))?;
    }
    match status {
        StatusCode::OK => Ok(()),
        StatusCode::CONFLICT => Err(CommandFailure::failed("not all lines were handed over")),
        StatusCode::NOT_FOUND => Err(CommandFailure::wrong(unknown(&socket::refusal(answer)))),
        status => {
            let ErrorDocument { error } = socket::refusal(answer);
            Err(CommandFailure::failed(format!(
                "the gateway answers {status}: {}",
                error.as_deref().unwrap_or("?")
            )))
        }
    }
}

fn unknown(answer: &UnknownLineDocument) -> String {
    format!(
        "{}; the lines are {}",
        answer.error,
        answer.lines.join(", ")
    )
}

/// The outcome for each line, for people.
fn yield_message(answer: &HandOverDocument) -> String {
    if answer.lines.is_empty() {
        return "no line has a second gateway: there is nothing to hand over\n".to_owned();
    }
    let lines = answer.lines.iter();
    lines
        .map(|it| format!("line {}: {}\n", it.line, it.message))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::de::DeserializeOwned;

    /// A document as it is read from the wire.
    fn parsed<T: DeserializeOwned>(json: Value) -> T {
        serde_json::from_value(json).unwrap()
    }

    fn line(state: &str, role: &str, hears_other: bool, listener: Option<bool>) -> Value {
        json!({ "name": "hall-1", "state": state, "standby": {
            "role": role, "half": "a", "partner": "b", "take_overs": 3, "given_up": 2, "rivals": 1, "hears_other": hears_other,
            "listener": listener,
        } })
    }

    #[test]
    fn each_role_is_a_row() {
        let counts = "taken over 3, given up 2, rivals 1";
        for (state, role, hears, listener, expected) in [
            (
                "up",
                "active",
                false,
                Some(true),
                "active; b would take over",
            ),
            (
                "up",
                "active",
                false,
                Some(false),
                "active; b does not answer",
            ),
            (
                "up",
                "active",
                false,
                None,
                "active; whether b would take over is not known yet",
            ),
            (
                "up",
                "active",
                true,
                None,
                "active; another master is heard",
            ),
            ("up", "listening", true, None, "listening; b sends"),
            (
                "up",
                "listening",
                false,
                None,
                "listening; no other gateway is heard",
            ),
            (
                "down",
                "listening",
                false,
                None,
                "the port cannot be used; nothing can be heard",
            ),
        ] {
            assert_eq!(
                row(&parsed(line(state, role, hears, listener))),
                format!("line hall-1: a is {expected}; {counts}\n")
            );
        }
        let alone = json!({ "name": "hall-2", "state": "up", "standby": null });
        assert_eq!(row(&parsed(alone)), "line hall-2: no second gateway\n");
    }

    #[test]
    fn each_line_says_what_came_of_it() {
        let answer = json!({ "yielded": true, "lines": [{ "line": "hall-1", "outcome": "handed_over", "message": "done" }] });
        assert_eq!(yield_message(&parsed(answer)), "line hall-1: done\n");
        assert!(yield_message(&parsed(json!({ "lines": [] }))).contains("nothing to hand over"));
        let refused = json!({ "error": "there is no line `c`", "lines": ["a", "b"] });
        assert_eq!(
            unknown(&parsed(refused)),
            "there is no line `c`; the lines are a, b"
        );
    }
}
