//! Answers that many routes give.

use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::Value;

/// A document.
pub(super) fn json(value: &Value) -> impl IntoResponse + use<> {
    (
        [(header::CONTENT_TYPE, "application/json")],
        format!("{value}\n"),
    )
}

/// A refusal with its reason.
pub(super) fn refusal(status: StatusCode, error: &str) -> Response {
    (status, json(&serde_json::json!({ "error": error }))).into_response()
}
