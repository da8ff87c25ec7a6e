//! `health`: asks the running gateway whether it does what it is configured for.

use super::socket::{self, Question, exchange, unreachable, within};
use super::{Failure, print};
use axum::http::{StatusCode, Uri};
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;
use std::time::Duration;
use tokio::net::TcpStream;

/// Longest time for the whole question: a container's health check does not wait longer either.
const PATIENCE: Duration = Duration::from_secs(5);
/// Where the answer is.
const PATH: &str = "/api/v1/health";

/// Arguments of `health`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    place: socket::Place,
    /// Ask over HTTP instead, at an address such as http://127.0.0.1:8080
    #[arg(long, value_name = "URL", conflicts_with_all = ["socket", "config"])]
    url: Option<Uri>,
    /// Print the gateway's own JSON
    #[arg(long)]
    json: bool,
}

/// Prints a line for each line and drive. It fails unless the gateway is ready.
pub fn health(args: &Args) -> Result<(), Failure> {
    let url = args.url.as_ref().map(Url::new).transpose()?;
    let socket = args.place.path()?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::failed)?;
    let health = runtime.block_on(ask(&socket, url.as_ref()));
    let place = url.map_or_else(|| socket.display().to_string(), |url| format!("{}:{}", url.host, url.port));
    let health = health.map_err(|reason| Failure::failed(format!("gateway at {place}: {reason}")))?;
    print(&if args.json { format!("{health}\n") } else { report(&health) })?;
    if health["ready"] == true { Ok(()) } else { Err(Failure::failed(format!("gateway at {place}: not ready"))) }
}

/// What is needed of a URL.
struct Url {
    host: String,
    port: u16,
}

impl Url {
    fn new(uri: &Uri) -> Result<Self, Failure> {
        let host = uri.host().filter(|_| uri.scheme_str() == Some("http") && matches!(uri.path(), "" | "/"));
        let host =
            host.ok_or_else(|| Failure::wrong(format!("{uri} is not an address such as http://127.0.0.1:8080")))?;
        // A version 6 address stands in brackets.
        let host = host.trim_start_matches('[').trim_end_matches(']').to_owned();
        Ok(Self { host, port: uri.port_u16().unwrap_or(80) })
    }
}

async fn ask(socket: &Path, url: Option<&Url>) -> Result<Value, String> {
    let question = Question::look(PATH);
    let answer = match url {
        Some(url) => {
            let asked = async {
                let stream = TcpStream::connect((url.host.as_str(), url.port)).await.map_err(unreachable)?;
                exchange(stream, &url.host, question).await
            };
            within(PATIENCE, asked).await
        }
        None => socket::ask(socket, question, PATIENCE).await,
    };
    match answer? {
        (StatusCode::OK, health) => Ok(health),
        (status, _) => Err(format!("{PATH} answers {status}")),
    }
}

/// The answer for people. What is missing from it shows as `?`: another version may say less.
fn report(health: &Value) -> String {
    fn word<'a>(of: &'a Value, key: &str) -> &'a str {
        of[key].as_str().unwrap_or("?")
    }
    let items = |key: &str| health[key].as_array().into_iter().flatten();
    let mut text = String::new();
    let uptime = health["uptime_seconds"].as_u64().unwrap_or(0);
    let _ = writeln!(text, "gateway {}: version {}, up {uptime} s", word(health, "gateway"), word(health, "version"));
    for line in items("lines") {
        let reason = line["reason"].as_str().map(|reason| format!(": {reason}")).unwrap_or_default();
        let _ = writeln!(text, "line {}: {}{reason}", word(line, "name"), word(line, "state"));
    }
    for drive in items("drives") {
        let (name, line, model) = (word(drive, "name"), word(drive, "line"), word(drive, "model"));
        let (presence, run_state) = (word(drive, "presence"), word(drive, "run_state"));
        let watchdog = drive["watchdog"].as_str().map(|state| format!(", its watchdog {}", state.replace('_', " ")));
        let watchdog = watchdog.unwrap_or_default();
        let _ = writeln!(text, "drive {name} ({model} on {line}): {presence}, {run_state}{watchdog}");
    }
    if let Some(connected) = health["mqtt"]["connected"].as_bool() {
        let rival = if health["mqtt"]["contested"] == true {
            "; another client has the same client identifier: give each its own, with `client_id`"
        } else {
            ""
        };
        let _ = writeln!(text, "mqtt: {}{rival}", if connected { "connected" } else { "not connected" });
        if let Some(refused) = health["mqtt"]["events_refused"].as_u64().filter(|refused| *refused > 0) {
            let _ = writeln!(text, "mqtt: the broker would not take {refused} trip events; the log says why");
        }
    }
    if let Some(connected) = health["sparkplug"]["connected"].as_bool() {
        let state = match (connected, health["sparkplug"]["host_awaited"] == true) {
            (true, _) => "told to its hosts",
            (false, true) => "waits for its primary host",
            (false, false) => "not connected",
        };
        let _ = writeln!(text, "sparkplug: {state}");
    }
    if let Some(state) = health["journal"]["state"].as_str() {
        let reason = health["journal"]["reason"].as_str().map(|reason| format!(": {reason}")).unwrap_or_default();
        let _ = writeln!(text, "journal: {state}{reason}");
        if let Some(aside) = health["journal"]["moved_aside"].as_str() {
            let _ = writeln!(text, "journal: a damaged one was moved aside to {aside}");
        }
    }
    text
}
