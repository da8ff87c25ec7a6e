//! `standstill`: a person who has looked confirms that the motor of a drive that is out of sight stands.

use crate::cli::tools::consent::ask;
use crate::cli::tools::socket::{self, SocketArgs, SocketRequest};
use crate::cli::tools::unseen::unseen_row;
use crate::cli::tools::{CommandFailure, print, setup};
use crate::domain::ids::Name;
use crate::north::api::{ErrorDocument, HealthDocument};
use axum::http::StatusCode;
use serde_json::Value;
use std::time::Duration;

/// Longest time for an answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// Arguments of `standstill`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the drive, as in the gateway's configuration
    drive: String,
    #[command(flatten)]
    place: SocketArgs,
    /// Do not ask: you have checked the motor
    #[arg(long)]
    yes: bool,
}

/// Confirms it over the socket. Nothing is sent to the drive.
pub fn standstill(args: &Args) -> Result<(), CommandFailure> {
    let name = Name::new(&args.drive).ok_or_else(|| {
        CommandFailure::wrong(format!("`{}` is not a valid drive name", args.drive))
    })?;
    let socket = args.place.path()?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    let answered = |question: SocketRequest<'_>| {
        let answer = runtime.block_on(socket::ask(&socket, question, PATIENCE));
        answer.map_err(|reason| {
            CommandFailure::failed(format!("gateway at {}: {reason}", socket.display()))
        })
    };
    if !args.yes {
        let (_, health) = answered(SocketRequest::get("/api/v1/health"))?;
        print(&last_seen(
            &socket::document(health).unwrap_or_default(),
            name.as_str(),
        ))?;
        ask(
            "have you checked that the motor stands still?",
            "nothing was confirmed",
        )?;
    }
    let path = format!("/api/v1/drives/{name}/standstill");
    let (status, answer) = answered(SocketRequest::post(&path))?;
    match status {
        StatusCode::OK => print(&format!(
            "drive {name}: confirmed that the motor stands still; a pending stop stays pending\n"
        )),
        StatusCode::NOT_FOUND => Err(CommandFailure::wrong(setup::unknown(answer))),
        status => Err(CommandFailure::failed(format!(
            "drive {name}: {}",
            why(status, answer)
        ))),
    }
}

/// What was last seen of the drive; empty if it does not run out of sight.
fn last_seen(health: &HealthDocument, name: &str) -> String {
    let drives = health.drives.iter();
    let mut unseen = drives.filter(|drive| drive.name == *name && drive.may_still_run);
    unseen
        .next()
        .map(|drive| unseen_row(drive, &health.titles))
        .unwrap_or_default()
}

/// Why it was not confirmed.
fn why(status: StatusCode, answer: Value) -> String {
    let ErrorDocument { error } = socket::refusal(answer);
    error.unwrap_or_else(|| format!("the gateway answers {status}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn who_confirms_is_shown_what_was_last_seen_of_that_drive() {
        let drive = |name: &str| json!({ "name": name, "may_still_run": true, "last_seen": null });
        let health = json!({ "drives": [drive("pump-1"), drive("pump-2"), { "name": "fan", "may_still_run": false }] });
        let health = serde_json::from_value(health).unwrap();
        assert_eq!(
            last_seen(&health, "pump-2"),
            "drive pump-2 MAY STILL RUN; go to the drive\n"
        );
        assert_eq!(last_seen(&health, "fan"), "");
    }

    #[test]
    fn a_refusal_is_told_in_the_words_of_the_gateway() {
        assert_eq!(
            why(
                StatusCode::CONFLICT,
                json!({ "error": "nothing to confirm" })
            ),
            "nothing to confirm"
        );
        assert_eq!(
            why(StatusCode::BAD_GATEWAY, Value::Null),
            "the gateway answers 502 Bad Gateway"
        );
    }
}
