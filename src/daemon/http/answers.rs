//! Answers that many routes give.

use crate::north::api::ErrorDocument;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

/// A document, its keys in alphabetical order.
pub(super) fn json<T: Serialize>(document: &T) -> impl IntoResponse + use<T> {
    // All keys are texts, so it cannot fail.
    let document = serde_json::to_value(document).unwrap_or_default();
    (
        [(header::CONTENT_TYPE, "application/json")],
        format!("{document}\n"),
    )
}

/// A refusal with its reason.
pub(super) fn refusal(status: StatusCode, error: &str) -> Response {
    let error = ErrorDocument {
        error: Some(error.to_owned()),
    };
    (status, json(&error)).into_response()
}
