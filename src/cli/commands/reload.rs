//! `reload`: makes the running gateway read its configuration file again.

use crate::cli::tools::{CommandFailure, print, socket};
use crate::north::api::{ConfigurationChange, ConfigurationWarning, RefusedReload, ReloadDocument};
use axum::http::StatusCode;
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
    let question = socket::SocketRequest::post("/api/v1/reload");
    let answer = runtime.block_on(socket::ask(&socket, question, PATIENCE));
    let (status, answer) =
        answer.map_err(|error| CommandFailure::failed(format!("{}: {error}", socket.display())))?;
    if args.json {
        print(&format!("{answer}\n"))?;
    } else if status.is_success() {
        let done = socket::document(answer.clone()).map_err(CommandFailure::failed)?;
        print(&reload_message(&done))?;
    }
    let RefusedReload { message, .. } = socket::refusal(answer);
    let message = message.unwrap_or_default();
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

fn reload_message(done: &ReloadDocument) -> String {
    let warning = |it: &ConfigurationWarning| {
        let right = it.right.as_deref().unwrap_or_default();
        format!("warning: {}: {}; {right}\n", it.key, it.what)
    };
    let warnings: String = done.warnings.iter().map(warning).collect();
    if done.changes.is_empty() {
        return format!("{warnings}reloaded; nothing has changed\n");
    }
    let line = |it: &ConfigurationChange| match &it.name {
        Some(name) => format!("{} {name}: {}\n", it.part, it.change),
        None => format!("{}: {}\n", it.part, it.change),
    };
    warnings + &done.changes.iter().map(line).collect::<String>()
}
