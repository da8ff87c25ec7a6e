//! The trend of a drive: the last hour from memory, longer spans from what is kept on the disk.

use super::LiveDocuments;
use super::answers::{error_answer, fresh};
use crate::daemon::host::clock;
use crate::daemon::http::query::QueryKeys;
use crate::daemon::trends;
use crate::north::page::history::{DriveHistory, Names};
use crate::north::page::kept::{LEVELS, TrendLevel};
use crate::north::page::trend::{ROWS_MAX, ROWS_RECENT};
use axum::extract::{RawQuery, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use std::sync::Arc;

const KEYS: [&str; 4] = ["drive", "span", "values", "format"];
const HOUR_S: i64 = 3600;

/// The form of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TrendFormat {
    /// The document that the page draws.
    Json,
    /// A list of rows, for dashboards.
    Rows,
    Csv,
}

/// Where a trend comes from.
#[derive(Debug)]
enum TrendSource {
    /// The newest rows in memory.
    Memory {
        rows: usize,
    },
    Disk(KeptTrendQuery),
}

/// What is read from the disk.
#[derive(Debug)]
struct KeptTrendQuery {
    drive: String,
    level: TrendLevel,
    /// The newest rows.
    rows: usize,
    wanted: Names,
    format: TrendFormat,
}

pub async fn trend(State(live): State<Arc<LiveDocuments>>, RawQuery(query): RawQuery) -> Response {
    let query = match QueryKeys::read(query.as_deref(), &KEYS) {
        Ok(query) => query,
        Err(what) => return error_answer(StatusCode::BAD_REQUEST, what),
    };
    let shared = live.state.shared.get();
    let names = || {
        shared
            .drives
            .iter()
            .map(|drive| drive.description.name.as_str())
            .collect::<Vec<_>>()
            .join(", ")
    };
    let Some(name) = query.get("drive") else {
        return error_answer(
            StatusCode::BAD_REQUEST,
            format!("`drive=NAME` is required; there are {}", names()),
        );
    };
    if shared
        .drives
        .iter()
        .all(|drive| drive.description.name.as_str() != name)
    {
        return error_answer(
            StatusCode::NOT_FOUND,
            format!("there is no drive `{name}`; there are {}", names()),
        );
    }
    match parse_query(&query, name) {
        Err(what) => error_answer(StatusCode::BAD_REQUEST, what),
        Ok(TrendSource::Disk(kept)) => read(&live, kept).await,
        Ok(TrendSource::Memory { rows }) => match live.lock().trend(name, rows) {
            Some(document) => fresh(&document),
            None => error_answer(
                StatusCode::SERVICE_UNAVAILABLE,
                "the drive was just added; try again",
            ),
        },
    }
}

fn parse_query(query: &QueryKeys, drive: &str) -> Result<TrendSource, String> {
    let wanted: Names = query
        .get("values")
        .map(|names| names.split(',').map(str::to_owned).collect());
    let format = match query.get("format") {
        None | Some("json") => TrendFormat::Json,
        Some("rows") => TrendFormat::Rows,
        Some("csv") => TrendFormat::Csv,
        Some(other) => {
            return Err(format!(
                "unknown `format={other}`; expected json, rows or csv"
            ));
        }
    };
    let is_plain = wanted.is_none() && format == TrendFormat::Json;
    let [minutes, ..] = LEVELS;
    let (level, rows) = match query.get("span").unwrap_or("1h") {
        "10m" if is_plain => return Ok(TrendSource::Memory { rows: ROWS_RECENT }),
        "10m" => return Err("`span=10m` takes neither `values` nor `format`".to_owned()),
        "1h" if is_plain => return Ok(TrendSource::Memory { rows: ROWS_MAX }),
        "1h" => (
            minutes,
            usize::try_from(HOUR_S / minutes.step_s).unwrap_or(minutes.rows),
        ),
        span => LEVELS
            .into_iter()
            .find(|level| level.span == span)
            .map(|level| (level, level.rows))
            .ok_or_else(|| {
                let spans: Vec<_> = LEVELS.iter().map(|level| level.span).collect();
                format!(
                    "unknown `span={span}`; expected 10m, 1h, {}",
                    spans.join(", ")
                )
            })?,
    };
    Ok(TrendSource::Disk(KeptTrendQuery {
        drive: drive.to_owned(),
        level,
        rows,
        wanted,
        format,
    }))
}

async fn read(live: &LiveDocuments, kept: KeptTrendQuery) -> Response {
    let Some(trends) = &live.state.trends else {
        let what = "only the last hour is known: longer trends, other values and other formats need `data_dir` in [gateway]";
        return error_answer(StatusCode::NOT_FOUND, what);
    };
    let Ok(place) = Arc::clone(&live.readers).try_acquire_owned() else {
        return error_answer(
            StatusCode::SERVICE_UNAVAILABLE,
            "other clients are reading trends or the journal; try again",
        );
    };
    let file = trends.file().to_owned();
    let until_s = clock::wall().unix_ms.div_euclid(1000);
    let read = tokio::task::spawn_blocking(move || {
        let _place = place;
        let KeptTrendQuery {
            drive,
            level,
            rows,
            wanted,
            format,
        } = kept;
        trends::history(&file, &drive, level, rows, until_s, wanted)
            .map(|history| answer(&history, &drive, format))
    });
    match read.await {
        Ok(Ok(response)) => response,
        Ok(Err(error)) => error_answer(
            StatusCode::SERVICE_UNAVAILABLE,
            format!("the trends cannot be read: {error}"),
        ),
        Err(error) => error_answer(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()),
    }
}

fn answer(history: &DriveHistory, drive: &str, format: TrendFormat) -> Response {
    match format {
        TrendFormat::Json => fresh(&history.document(drive)),
        TrendFormat::Rows => fresh(&history.list()),
        TrendFormat::Csv => {
            let disposition = format!("attachment; filename=\"{drive}.csv\"");
            let headers = [
                (header::CONTENT_TYPE, "text/csv; charset=utf-8".to_owned()),
                (header::CONTENT_DISPOSITION, disposition),
                (header::CACHE_CONTROL, "no-store".to_owned()),
            ];
            (headers, history.csv()).into_response()
        }
    }
}
