//! `reload`: makes the running gateway read its configuration file again.

use crate::cli::tools::{CommandFailure, print, socket};
use axum::http::{Method, StatusCode};
use serde_json::Value;
use std::time::Duration;

/// Longer than a reload takes, including the stops of removed drives and the shutdown of their lines.
const PATIENCE: Duration = Duration::from_secs(30);

/// Arguments of `reload`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    place: socket::SocketArgs,
    /// Print the answer as JSON
    #[arg(long)]
    json: bool,
}

/// Requests a reload, and prints what has changed or why nothing has.
pub fn reload(args: &Args) -> Result<(), CommandFailure> {
    let socket = args.place.path()?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    let question = socket::SocketRequest {
        method: Method::POST,
        path: "/api/v1/reload",
        body: None,
    };
    let answer = runtime.block_on(socket::ask(&socket, question, PATIENCE));
    let (status, answer) =
        answer.map_err(|error| CommandFailure::failed(format!("{}: {error}", socket.display())))?;
    if args.json {
        print(&format!("{answer}\n"))?;
    } else if status.is_success() {
        print(&reload_message(&answer))?;
    }
    let message = answer["message"].as_str().unwrap_or_default();
    match status {
        StatusCode::OK => Ok(()),
        StatusCode::UNPROCESSABLE_ENTITY => Err(CommandFailure::wrong(format!(
            "{message}\nconfiguration unchanged"
        ))),
        _ => Err(CommandFailure::failed(format!(
            "configuration unchanged: {message}"
        ))),
    }
}

fn reload_message(answer: &Value) -> String {
    let all = |key: &str| {
        answer[key]
            .as_array()
            .map(Vec::as_slice)
            .unwrap_or_default()
    };
    let of = |value: &Value, key: &str| value[key].as_str().unwrap_or_default().to_owned();
    let warning = |it: &Value| {
        format!(
            "warning: {}: {}; {}\n",
            of(it, "key"),
            of(it, "what"),
            of(it, "right")
        )
    };
    let warnings: String = all("warnings").iter().map(warning).collect();
    let changes = all("changes");
    if changes.is_empty() {
        return format!("{warnings}reloaded; nothing is different\n");
    }
    let line = |change: &Value| {
        let text = |key: &str| of(change, key);
        let name = change["name"]
            .as_str()
            .map(|name| format!(" {name}"))
            .unwrap_or_default();
        format!("{}{name}: {}\n", text("part"), text("change"))
    };
    warnings + &changes.iter().map(line).collect::<String>()
}
