//! Connections to the HTTP side: how many, how long, how fast.

use super::lasting::{self, ConnectionLife, StreamSlot};
use axum::Router;
use axum::response::Response;
use axum::serve::Listener;
use hyper::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::convert::Infallible;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::Semaphore;

/// Most connections at once on one listener; more wait to be accepted. One scraper, a few browsers and health checks
/// need ten.
pub const CONNECTIONS_MAX: usize = 64;
/// Longest time for the last answer, which a client that does not read would never take.
const LAST_ANSWER_WITHIN: Duration = Duration::from_secs(10);
/// Longest request head in bytes. Clients of these routes need little.
const HEAD_BYTES_MAX: usize = 16 * 1024;

/// How long a connection may take.
#[derive(Clone, Copy, Debug)]
pub(super) struct ConnectionPatience {
    /// For a whole request head, from when the connection is ready for one. Also closes idle connections.
    pub head: Duration,
    /// For the connection. After that it answers the current request and closes, so that no client holds a place for
    /// ever. An endless answer continues.
    pub connection: Duration,
    /// For a client to take a piece of its answer.
    pub piece: Duration,
}

impl Default for ConnectionPatience {
    fn default() -> Self {
        Self {
            head: Duration::from_secs(10),
            connection: Duration::from_secs(300),
            piece: Duration::from_secs(10),
        }
    }
}

/// Serves `router` on `listener` until the task is dropped.
pub(super) async fn serve<L: Listener>(
    mut listener: L,
    router: Router,
    patience: ConnectionPatience,
) {
    let places = Arc::new(Semaphore::new(CONNECTIONS_MAX));
    let lasting = lasting::places();
    // The semaphore is never closed, so there is always a place in the end.
    while let Ok(place) = Arc::clone(&places).acquire_owned().await {
        let (stream, _) = listener.accept().await;
        let router = router.clone();
        let lasting = Arc::clone(&lasting);
        tokio::task::spawn_local(async move {
            converse(stream, router, patience, lasting).await;
            drop(place);
        });
    }
}

/// Serves `router` on one connection until it closes. An endless answer takes one of the `lasting` places.
pub(super) async fn converse(
    stream: impl AsyncRead + AsyncWrite + Unpin + 'static,
    router: Router,
    patience: ConnectionPatience,
    lasting: Arc<Semaphore>,
) {
    converse_by(
        stream,
        TowerToHyperService::new(router),
        patience,
        StreamSlot::new(lasting),
    )
    .await;
}

/// Serves `service`, whose routes know more about the connection, on one connection until it closes.
pub(super) async fn converse_by(
    stream: impl AsyncRead + AsyncWrite + Unpin + 'static,
    service: impl Service<Request<Incoming>, Response = Response, Error = Infallible>,
    patience: ConnectionPatience,
    (lasting, life): (StreamSlot, ConnectionLife),
) {
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new())
        .header_read_timeout(patience.head)
        .max_buf_size(HEAD_BYTES_MAX);
    let service = service_fn(move |mut request: Request<Incoming>| {
        request.extensions_mut().insert(lasting.clone());
        service.call(request)
    });
    let mut connection = pin!(http.serve_connection(TokioIo::new(stream), service));
    let end = tokio::select! {
        end = connection.as_mut() => end,
        () = life.clone().until_cut() => return,
        () = is_over(life, patience) => {
            connection.as_mut().graceful_shutdown();
            tokio::time::timeout(LAST_ANSWER_WITHIN, connection).await.unwrap_or(Ok(()))
        }
    };
    if let Err(error) = end {
        tracing::debug!(%error, "HTTP connection failed");
    }
}

/// Waits until the time of a connection is over and no endless answer is in progress.
async fn is_over(life: ConnectionLife, patience: ConnectionPatience) {
    tokio::time::sleep(patience.connection).await;
    life.has_no_stay().await;
}
