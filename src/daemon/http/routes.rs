//! The routes that every client may use.

use super::answers::json;
use super::entrance::AuthorityExtension;
use super::live::LiveDocuments;
use super::report::CountHistory;
use super::state::HttpState;
use super::{health, live, metrics, report, traffic};
use crate::daemon::host::clock;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Extension, Router};
use std::sync::Arc;

/// The media type of metrics, as Prometheus asks for it.
const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// The older text format, for clients that do not accept OpenMetrics.
const OLDER_METRICS: &str = "text/plain; version=0.0.4; charset=utf-8";

/// The media type of a certificate that browsers and phones offer to install (RFC 2585 has another one, which they do not).
const CERTIFICATE_TYPE: &str = "application/x-x509-ca-cert";

/// The documents behind the routes.
#[derive(Clone, Debug)]
pub struct RouteDocuments {
    /// What the HTTP side knows.
    pub state: Arc<HttpState>,
    /// Live documents for the page.
    pub live: Arc<LiveDocuments>,
    /// The counts of some minutes ago.
    pub history: Arc<CountHistory>,
}

impl RouteDocuments {
    /// Documents about a gateway that was just started.
    #[must_use]
    pub fn new(state: Arc<HttpState>) -> Self {
        Self {
            live: Arc::new(LiveDocuments::new(Arc::clone(&state))),
            history: Arc::new(CountHistory::new(Arc::clone(&state))),
            state,
        }
    }
}

/// The routes for every client. Other paths are answered with 404, other methods than GET with 405.
pub(super) fn router(documents: RouteDocuments) -> Router {
    let RouteDocuments {
        state,
        live,
        history,
    } = documents;
    super::page::router()
        .route("/authority.crt", get(authority))
        .route("/healthz", get(alive))
        .route("/readyz", get(ready))
        .route("/metrics", get(measured))
        .route("/api/v1/health", get(healthy))
        .with_state(Arc::clone(&state))
        .merge(traffic::router(state))
        .merge(report::router(history))
        .merge(live::routes::router(live))
}

/// The authority behind the certificate of the page, for clients that are to trust it. On the socket there is none.
async fn authority(of: Option<Extension<AuthorityExtension>>) -> Response {
    match of.and_then(|Extension(authority)| authority.0) {
        Some(certificate) => (
            [(header::CONTENT_TYPE, CERTIFICATE_TYPE)],
            Vec::from(certificate.as_ref()),
        )
            .into_response(),
        None => (
            StatusCode::NOT_FOUND,
            "the chain in `cert_file` does not end with an authority\n",
        )
            .into_response(),
    }
}

/// This answer shows that the main thread runs, which gives it. A line whose thread hangs sends no stop: the gateway
/// should then be restarted.
async fn alive(State(gateway): State<Arc<HttpState>>) -> Response {
    let shared = gateway.shared.get();
    let hung: Vec<_> = shared
        .lines
        .iter()
        .filter(|line| line.hangs())
        .map(|line| line.name.as_str())
        .collect();
    if hung.is_empty() {
        return "ok\n".into_response();
    }
    (
        StatusCode::SERVICE_UNAVAILABLE,
        format!("lines whose threads hang: {}\n", hung.join(", ")),
    )
        .into_response()
}

async fn ready(State(gateway): State<Arc<HttpState>>) -> Response {
    let readiness = health::readiness(&gateway);
    let status = if readiness.ready {
        StatusCode::OK
    } else {
        StatusCode::SERVICE_UNAVAILABLE
    };
    (status, json(&readiness)).into_response()
}

async fn healthy(State(gateway): State<Arc<HttpState>>) -> Response {
    json(&health::health(&gateway, clock::now())).into_response()
}

async fn measured(State(gateway): State<Arc<HttpState>>, headers: HeaderMap) -> Response {
    let accepted = headers
        .get(header::ACCEPT)
        .and_then(|accept| accept.to_str().ok())
        .unwrap_or_default();
    match metrics::text(gateway, clock::now()) {
        Ok(text) if accepted.contains("text/plain") && !accepted.contains("openmetrics") => (
            [(header::CONTENT_TYPE, OLDER_METRICS)],
            metrics::older(&text),
        )
            .into_response(),
        Ok(text) => ([(header::CONTENT_TYPE, OPEN_METRICS)], text).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
    }
}
