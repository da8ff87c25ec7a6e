//! What a drive used on each day, for HTTP clients.

use super::LiveDocuments;
use super::answers::{LiveFormat, error_answer, fresh, no_journal, too_many_readers};
use crate::daemon::http::query::QueryKeys;
use crate::daemon::journal::days::{DayRow, columns, each_day};
use crate::daemon::journal::reader::connect;
use crate::north::api::DaysDocument;
use axum::extract::{RawQuery, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use rusqlite::Error;
use std::path::Path;
use std::sync::Arc;

/// The days of one drive, oldest first. There are so few that they fit into one piece.
pub async fn days(State(live): State<Arc<LiveDocuments>>, RawQuery(query): RawQuery) -> Response {
    let (drive, format) = match parse_query(query.as_deref()) {
        Ok(asked) => asked,
        Err(what) => return error_answer(StatusCode::BAD_REQUEST, what),
    };
    let Some(journal) = &live.state.journal else {
        return no_journal();
    };
    let Ok(_place) = live.readers.try_acquire() else {
        return too_many_readers();
    };
    let path = journal.file().to_owned();
    let read = tokio::task::spawn_blocking(move || rows(&path, &drive)).await;
    match read {
        Ok(Ok(rows)) if format == LiveFormat::Csv => {
            let titles = &live.state.shared.load().titles;
            let lines: String = rows.iter().map(|row| row.in_csv(titles)).collect();
            let kind = [
                (header::CONTENT_TYPE, "text/csv; charset=utf-8"),
                (header::CACHE_CONTROL, "no-store"),
            ];
            (kind, columns(titles) + &lines).into_response()
        }
        Ok(Ok(rows)) => {
            let days = rows.iter().map(DayRow::document).collect();
            fresh(&DaysDocument { days })
        }
        Ok(Err(error)) => error_answer(
            StatusCode::SERVICE_UNAVAILABLE,
            format!("the journal cannot be read: {error}"),
        ),
        Err(error) => error_answer(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()),
    }
}

/// The drive, and the form of the answer.
fn parse_query(query: Option<&str>) -> Result<(String, LiveFormat), String> {
    let query = QueryKeys::read(query, &["drive", "format"])?;
    let drive = query
        .get("drive")
        .ok_or_else(|| "`drive=NAME` is missing".to_owned())?;
    Ok((
        drive.to_owned(),
        LiveFormat::from_word(query.get("format"))?,
    ))
}

fn rows(path: &Path, drive: &str) -> Result<Vec<DayRow>, Error> {
    let mut rows = Vec::new();
    each_day(&connect(path)?, Some(drive), |row| rows.push(row))?;
    Ok(rows)
}
