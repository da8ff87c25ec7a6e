//! The routes of the live documents.

use super::answers::{error_answer, fresh};
use super::{LiveDocuments, journal, trend, usage};
use crate::daemon::http::lasting::StreamSlot;
use crate::north::api::AdviceDocument;
use axum::body::Body;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Extension, Router};
use std::sync::Arc;

/// Proxies must not cache or buffer the stream.
const EVENTS: [(header::HeaderName, &str); 3] = [
    (header::CONTENT_TYPE, "text/event-stream"),
    (header::CACHE_CONTROL, "no-store"),
    (header::HeaderName::from_static("x-accel-buffering"), "no"),
];

/// The routes. All of them only read.
pub fn router(live: Arc<LiveDocuments>) -> Router {
    Router::new()
        .route("/api/v1/state", get(everything))
        .route("/api/v1/events", get(events))
        .route("/api/v1/trend", get(trend::trend))
        .route("/api/v1/advice", get(advice))
        .route("/api/v1/journal", get(journal::rows))
        .route("/api/v1/usage", get(usage::days))
        .with_state(live)
}

async fn everything(State(live): State<Arc<LiveDocuments>>) -> Response {
    fresh(&live.lock().source(&live, |source| source.document()))
}

async fn advice(State(live): State<Arc<LiveDocuments>>) -> Response {
    let advice = live
        .lock()
        .source(&live, |source| source.documents(&source.advice()));
    fresh(&AdviceDocument { advice })
}

async fn events(
    State(live): State<Arc<LiveDocuments>>,
    Extension(lasting): Extension<StreamSlot>,
) -> Response {
    let Some(stay) = lasting.stay() else {
        return error_answer(
            StatusCode::SERVICE_UNAVAILABLE,
            "too many event streams are open; close other windows",
        );
    };
    let Some(listener) = live.lock().listen(&live, stay) else {
        return error_answer(
            StatusCode::SERVICE_UNAVAILABLE,
            "other clients are reading large responses; retry in a few seconds",
        );
    };
    (EVENTS, Body::new(listener)).into_response()
}
