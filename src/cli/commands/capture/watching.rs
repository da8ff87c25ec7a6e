//! The traffic of a line as the running gateway reports it.

use super::sse::{EventCutter, SseEvent};
use crate::cli::tools::socket::unreachable;
use crate::north::api::ErrorDocument;
use axum::body::{Body, HttpBody, to_bytes};
use axum::http::{Request, header};
use hyper::body::Incoming;
use hyper::client::conn::http1;
use hyper_util::rt::TokioIo;
use std::future::poll_fn;
use std::path::Path;
use std::pin::Pin;
use std::time::Duration;
use tokio::net::UnixStream;
use tokio::time::timeout;

/// The gateway sends something every two seconds. A gateway that is silent for this long hangs.
const PATIENCE: Duration = Duration::from_secs(10);
/// Longest refusal that is read in bytes.
const REFUSAL_BYTES_MAX: usize = 64 * 1024;

/// A streaming answer.
#[derive(Debug)]
pub struct StreamingAnswer {
    body: Incoming,
    cutter: EventCutter,
}

impl StreamingAnswer {
    /// Requests the traffic of `line` from the gateway at `socket`, after the record with the id `after`.
    ///
    /// # Errors
    /// Why the gateway refuses, for people.
    pub async fn begin(socket: &Path, line: &str, after: Option<&str>) -> Result<Self, String> {
        let asked = timeout(PATIENCE, ask(socket, line, after)).await;
        asked.unwrap_or_else(|_| Err(silent()))
    }

    /// The next event; `None` at the end of the answer.
    ///
    /// # Errors
    /// Why there is none, for people.
    pub async fn next(&mut self) -> Result<Option<SseEvent>, String> {
        loop {
            if let Some(event) = self.cutter.next() {
                return Ok(Some(event));
            }
            let frame = timeout(
                PATIENCE,
                poll_fn(|cx| Pin::new(&mut self.body).poll_frame(cx)),
            )
            .await;
            match frame.map_err(|_| silent())? {
                Some(Ok(frame)) => self
                    .cutter
                    .push(frame.data_ref().map_or(&[], |bytes| bytes))?,
                Some(Err(_)) | None => return Ok(None),
            }
        }
    }
}

async fn ask(socket: &Path, line: &str, after: Option<&str>) -> Result<StreamingAnswer, String> {
    let stream = UnixStream::connect(socket).await.map_err(unreachable)?;
    let (mut sender, connection) = http1::handshake(TokioIo::new(stream))
        .await
        .map_err(|error| error.to_string())?;
    tokio::spawn(connection);
    let mut request = Request::builder()
        .uri(format!("/api/v1/lines/{line}/traffic"))
        .header(header::HOST, "localhost");
    if let Some(after) = after {
        request = request.header("last-event-id", after);
    }
    let request = request
        .body(Body::empty())
        .map_err(|error| error.to_string())?;
    let response = sender
        .send_request(request)
        .await
        .map_err(|error| error.to_string())?;
    let status = response.status();
    let body = response.into_body();
    if status.is_success() {
        return Ok(StreamingAnswer {
            body,
            cutter: EventCutter::default(),
        });
    }
    let refusal = to_bytes(Body::new(body), REFUSAL_BYTES_MAX).await.ok();
    let refusal = refusal.and_then(|bytes| serde_json::from_slice::<ErrorDocument>(&bytes).ok());
    let reason = refusal.and_then(|refusal| refusal.error);
    Err(reason.unwrap_or_else(|| format!("it answers {status}; is it an older version?")))
}

fn silent() -> String {
    format!("no data for {} s", PATIENCE.as_secs())
}
