//! The running gateway's HTTP interface for the program's commands: over the socket in its data directory.

use super::{CommandFailure, input};
use crate::daemon::http::socket::SOCKET_NAME;
use crate::north::api::read_tolerantly;
use axum::body::{Body, Bytes, to_bytes};
use axum::http::{Method, Request, StatusCode, header};
use hyper::client::conn::http1;
use hyper_util::rt::TokioIo;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::UnixStream;

/// Longest answer that is read. The longest are diagnostics of a gateway with many lines.
const ANSWER_BYTES_MAX: usize = 64 * 1024 * 1024;

/// Where the gateway's socket is.
#[derive(Debug, clap::Args)]
pub struct SocketArgs {
    /// The gateway's configuration file: its socket is in the data directory that it names
    #[arg(short, long, value_name = "FILE", conflicts_with = "socket")]
    config: Option<PathBuf>,
    /// Socket of the gateway, in its data directory
    #[arg(
        long,
        value_name = "PATH",
        default_value = "/var/lib/vfd-gateway/vfd-gateway.sock"
    )]
    socket: PathBuf,
}

impl SocketArgs {
    /// The configuration file, if it is given.
    #[must_use]
    pub fn config(&self) -> Option<&Path> {
        self.config.as_deref()
    }

    /// The socket.
    ///
    /// # Errors
    /// The configuration cannot be read, or names no data directory.
    pub fn path(&self) -> Result<PathBuf, CommandFailure> {
        self.config
            .as_deref()
            .map_or_else(|| Ok(self.socket.clone()), socket_of)
    }
}

/// The socket of the gateway that runs with the configuration at `path`.
fn socket_of(path: &Path) -> Result<PathBuf, CommandFailure> {
    let config = input::configuration(path)?;
    let directory = config.gateway.data_dir.ok_or_else(|| {
        CommandFailure::wrong(format!(
            "{}: without `data_dir` in [gateway] there is no socket",
            path.display()
        ))
    })?;
    Ok(directory.join(SOCKET_NAME))
}

/// A request.
pub struct SocketRequest<'q> {
    method: Method,
    path: &'q str,
    body: Option<Value>,
}

impl<'q> SocketRequest<'q> {
    /// A GET of `path`.
    #[must_use]
    pub const fn get(path: &'q str) -> Self {
        Self {
            method: Method::GET,
            path,
            body: None,
        }
    }

    /// A POST to `path`, without a body.
    #[must_use]
    pub const fn post(path: &'q str) -> Self {
        Self {
            method: Method::POST,
            path,
            body: None,
        }
    }

    /// The request with this body.
    #[must_use]
    pub fn with(self, body: &impl Serialize) -> Self {
        Self {
            body: Some(json!(body)),
            ..self
        }
    }
}

/// Sends a request over a new connection to `socket`, with at most `patience`.
///
/// # Errors
/// Why there is no answer, for people.
pub async fn ask(
    socket: &Path,
    question: SocketRequest<'_>,
    patience: Duration,
) -> Result<(StatusCode, Value), String> {
    within(patience, async {
        exchange(connect(socket).await?, "localhost", question).await
    })
    .await
}

/// The document that `answer` is.
///
/// # Errors
/// The answer is no such document, in words for people.
pub fn document<T: DeserializeOwned>(answer: Value) -> Result<T, String> {
    read_tolerantly(answer).map_err(|error| format!("its answer cannot be understood: {error}"))
}

/// The refusal that `answer` is; without content if it is none.
pub fn refusal<T: DeserializeOwned + Default>(answer: Value) -> T {
    serde_json::from_value(answer).unwrap_or_default()
}

/// A new connection to `socket`.
///
/// # Errors
/// Why there is none, for people.
pub async fn connect(socket: &Path) -> Result<UnixStream, String> {
    UnixStream::connect(socket).await.map_err(unreachable)
}

/// Waits for an answer at most for `patience`.
///
/// # Errors
/// Those of `asking`, or that it takes too long.
pub async fn within<T>(
    patience: Duration,
    asking: impl Future<Output = Result<T, String>>,
) -> Result<T, String> {
    let answer = tokio::time::timeout(patience, asking).await;
    answer.unwrap_or_else(|_| Err(format!("no answer within {} s", patience.as_secs())))
}

/// Why there is no connection, for people.
#[must_use]
pub fn unreachable(error: std::io::Error) -> String {
    format!("cannot connect: {error}")
}

/// Sends a request on `stream`, and reads a JSON answer whatever its status is.
///
/// # Errors
/// Why there is none, for people.
pub async fn exchange(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    host: &str,
    question: SocketRequest<'_>,
) -> Result<(StatusCode, Value), String> {
    let path = question.path;
    let (status, body) = exchange_bytes(stream, host, question).await?;
    match serde_json::from_slice(&body) {
        Ok(answer) => Ok((status, answer)),
        Err(error) if status.is_success() => Err(format!("{path} cannot be parsed: {error}")),
        Err(_) => Err(format!("{path} answers {status}")),
    }
}

/// Sends a request on `stream`, and reads the answer whatever it is.
///
/// # Errors
/// Why there is none, for people.
pub async fn exchange_bytes(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    host: &str,
    question: SocketRequest<'_>,
) -> Result<(StatusCode, Bytes), String> {
    fn text(error: impl Display) -> String {
        error.to_string()
    }
    let SocketRequest { method, path, body } = question;
    let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await.map_err(text)?;
    tokio::spawn(connection);
    let body = body.map_or_else(Body::empty, |body| Body::from(body.to_string()));
    let request = Request::builder()
        .method(method)
        .uri(path)
        .header(header::HOST, host)
        .body(body)
        .map_err(text)?;
    let response = sender.send_request(request).await.map_err(text)?;
    let status = response.status();
    let body = to_bytes(Body::new(response.into_body()), ANSWER_BYTES_MAX)
        .await
        .map_err(text)?;
    Ok((status, body))
}
