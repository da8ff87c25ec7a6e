//! The routes of diagnostics: over the socket for the program's own command, and for signed-in users of the page.

use super::ArchiveMaker;
use crate::daemon::http::answers::refusal;
use crate::daemon::http::query::QueryKeys;
use axum::Router;
use axum::extract::{RawQuery, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::time::Duration;

/// How long the traffic may be recorded, in seconds: shorter than a connection may last.
pub const SECONDS: RangeInclusive<u64> = 1..=120;
/// How long it is recorded for the page.
const SECONDS_USUAL: u64 = 10;

/// The route of the program's own command.
pub fn own_router(diagnostics: Arc<ArchiveMaker>) -> Router {
    Router::new()
        .route("/api/v1/diagnostics", get(own))
        .with_state(diagnostics)
}

async fn own(State(diagnostics): State<Arc<ArchiveMaker>>, RawQuery(query): RawQuery) -> Response {
    match QueryKeys::seconds(query.as_deref(), &SECONDS) {
        Ok(seconds) => make_archive(&diagnostics, seconds.unwrap_or(SECONDS_USUAL)).await,
        Err(expected) => refusal(StatusCode::BAD_REQUEST, &expected),
    }
}

/// The archive for a user of the page.
pub async fn answer(diagnostics: &ArchiveMaker) -> Response {
    make_archive(diagnostics, SECONDS_USUAL).await
}

async fn make_archive(diagnostics: &ArchiveMaker, seconds: u64) -> Response {
    let Some(_place) = diagnostics.place() else {
        return refusal(
            StatusCode::SERVICE_UNAVAILABLE,
            "diagnostics are being made already; try again in a moment",
        );
    };
    let name = diagnostics.name();
    match diagnostics
        .archive(name.clone(), Duration::from_secs(seconds))
        .await
    {
        Ok(archive) => {
            let file = format!("attachment; filename=\"{name}.tar.gz\"");
            let headers = [
                (header::CONTENT_TYPE, "application/gzip".to_owned()),
                (header::CONTENT_DISPOSITION, file),
                (header::CACHE_CONTROL, "no-store".to_owned()),
            ];
            (headers, archive).into_response()
        }
        Err(error) => refusal(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}
