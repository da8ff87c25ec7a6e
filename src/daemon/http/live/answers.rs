//! Answers of the live documents.

use crate::daemon::http::answers::{json, refusal};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

/// A document that must not be cached.
pub fn fresh<T: Serialize>(document: &T) -> Response {
    ([(header::CACHE_CONTROL, "no-store")], json(document)).into_response()
}

/// What is wrong, for people.
pub fn error_answer(status: StatusCode, what: impl Into<String>) -> Response {
    refusal(status, &what.into())
}

/// There is no journal to read.
pub fn no_journal() -> Response {
    error_answer(
        StatusCode::NOT_FOUND,
        "there is no journal: it needs `data_dir` in [gateway]",
    )
}

/// The answer while as many clients read the journal as may at once.
pub fn too_many_readers() -> Response {
    error_answer(
        StatusCode::SERVICE_UNAVAILABLE,
        "other clients are reading the journal; try again in a moment",
    )
}

/// The form of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LiveFormat {
    /// One document.
    Json,
    /// Rows with commas.
    Csv,
}

impl LiveFormat {
    /// The form that `format` of a query names: JSON without one.
    ///
    /// # Errors
    /// What would be right, for people.
    pub fn from_word(word: Option<&str>) -> Result<Self, String> {
        match word {
            None | Some("json") => Ok(Self::Json),
            Some("csv") => Ok(Self::Csv),
            Some(other) => Err(format!("unknown `format={other}`; expected json or csv")),
        }
    }
}
