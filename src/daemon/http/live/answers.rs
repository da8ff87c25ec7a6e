//! Answers of the live documents.

use crate::daemon::http::answers::json;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

/// A document that must not be cached.
pub fn fresh(document: &Value) -> Response {
    ([(header::CACHE_CONTROL, "no-store")], json(document)).into_response()
}

/// What is wrong, for people.
pub fn wrong(status: StatusCode, what: impl Into<String>) -> Response {
    (status, json(&json!({ "error": what.into() }))).into_response()
}
