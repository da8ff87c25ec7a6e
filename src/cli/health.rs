//! `health`: asks the running gateway whether it does what it is configured for.

use super::{Failure, input, print};
use crate::daemon::http::socket::SOCKET_NAME;
use axum::body::{Body, to_bytes};
use axum::http::{Request, StatusCode, Uri, header};
use hyper::client::conn::http1;
use hyper_util::rt::TokioIo;
use serde_json::Value;
use std::fmt::{Display, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpStream, UnixStream};

/// Longest time for the whole question: a container's health check does not wait longer either.
const PATIENCE: Duration = Duration::from_secs(5);
/// Longest answer that is read. A gateway with a thousand drives says less.
const ANSWER_BYTES_MAX: usize = 1024 * 1024;
/// Where the answer is.
const PATH: &str = "/api/v1/health";

/// Arguments of `health`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The gateway's configuration file: its socket is in the data directory that it names
    #[arg(short, long, value_name = "FILE", conflicts_with = "socket")]
    config: Option<PathBuf>,
    /// Socket of the gateway, in its data directory
    #[arg(long, value_name = "PATH", default_value = "/var/lib/vfd-gateway/vfd-gateway.sock")]
    socket: PathBuf,
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
    let socket = args.config.as_deref().map_or_else(|| Ok(args.socket.clone()), socket_of)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::failed)?;
    let answer = runtime.block_on(async { tokio::time::timeout(PATIENCE, ask(&socket, url.as_ref())).await });
    let health = answer.unwrap_or_else(|_| Err(format!("no answer within {} s", PATIENCE.as_secs())));
    let place = url.map_or_else(|| socket.display().to_string(), |url| format!("{}:{}", url.host, url.port));
    let health = health.map_err(|reason| Failure::failed(format!("gateway at {place}: {reason}")))?;
    print(&if args.json { format!("{health}\n") } else { report(&health) })?;
    if health["ready"] == true { Ok(()) } else { Err(Failure::failed(format!("gateway at {place}: not ready"))) }
}

/// The socket of the gateway that runs with the configuration at `path`.
fn socket_of(path: &Path) -> Result<PathBuf, Failure> {
    let config = input::configuration(path)?;
    let directory = config.gateway.data_dir.ok_or_else(|| {
        Failure::wrong(format!("{}: without `data_dir` in [gateway] there is no socket; ask --url", path.display()))
    })?;
    Ok(directory.join(SOCKET_NAME))
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
    match url {
        Some(url) => {
            let stream = TcpStream::connect((url.host.as_str(), url.port)).await;
            get(stream.map_err(unreachable)?, &url.host).await
        }
        None => get(UnixStream::connect(socket).await.map_err(unreachable)?, "localhost").await,
    }
}

fn unreachable(error: std::io::Error) -> String {
    format!("cannot connect: {error}")
}

/// Gets the health over a fresh connection.
async fn get(stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static, host: &str) -> Result<Value, String> {
    fn text(error: impl Display) -> String {
        error.to_string()
    }
    let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await.map_err(text)?;
    tokio::spawn(connection);
    let request = Request::get(PATH).header(header::HOST, host).body(Body::empty()).map_err(text)?;
    let response = sender.send_request(request).await.map_err(text)?;
    if response.status() != StatusCode::OK {
        return Err(format!("{PATH} answers {}", response.status()));
    }
    let body = to_bytes(Body::new(response.into_body()), ANSWER_BYTES_MAX).await.map_err(text)?;
    serde_json::from_slice(&body).map_err(|error| format!("{PATH} is not understood: {error}"))
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
        let _ = writeln!(text, "drive {name} ({model} on {line}): {presence}, {run_state}");
    }
    if let Some(connected) = health["mqtt"]["connected"].as_bool() {
        let _ = writeln!(text, "mqtt: {}", if connected { "connected" } else { "not connected" });
    }
    text
}
