//! Rows of the journal for whoever asks: read beside the main thread, as many as may be and no more.

use super::query::Query;
use super::routes::wrong;
use crate::daemon::clock;
use crate::daemon::http::state::State as Gateway;
use crate::daemon::journal::listing;
use crate::daemon::journal::reader::connect;
use crate::daemon::journal::search::{self, Found, Since, Wanted};
use axum::extract::{RawQuery, State};
use axum::http::{HeaderName, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::Arc;

/// Most who read the journal at once. Reading is work for a processor that lines need too.
pub const READERS_MAX: usize = 2;
/// Rows that are told unless it is said how many, and most of them.
const LAST_USUAL: usize = 200;
const LAST_MAX: usize = 10_000;
const KEYS: [&str; 5] = ["table", "drive", "since", "last", "format"];

/// The form of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Json,
    Csv,
}

/// What is asked for.
#[derive(Debug)]
struct Asked {
    wanted: Wanted,
    last: usize,
    format: Format,
}

pub async fn rows(State(gateway): State<Arc<Gateway>>, RawQuery(query): RawQuery) -> Response {
    let asked = match asked(query.as_deref()) {
        Ok(asked) => asked,
        Err(what) => return wrong(StatusCode::BAD_REQUEST, what),
    };
    let Some(journal) = &gateway.journal else {
        return wrong(StatusCode::NOT_FOUND, "there is no journal: it needs `data_dir` in [gateway]");
    };
    let Ok(place) = Arc::clone(&gateway.live.readers).try_acquire_owned() else {
        return wrong(StatusCode::SERVICE_UNAVAILABLE, "others read the journal: try again in a moment");
    };
    let (path, format) = (journal.file().to_owned(), asked.format);
    let read = tokio::task::spawn_blocking(move || {
        let _place = place;
        text(path, &asked)
    });
    match read.await {
        Ok(Ok(text)) => (headers(format), text).into_response(),
        Ok(Err(error)) => wrong(StatusCode::SERVICE_UNAVAILABLE, format!("the journal cannot be read: {error}")),
        Err(error) => wrong(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()),
    }
}

fn asked(query: Option<&str>) -> Result<Asked, String> {
    let query = Query::read(query, &KEYS)?;
    let table = query.get("table").unwrap_or("all");
    let tables = search::tables(table)
        .ok_or_else(|| format!("`table={table}` is not known; right are trips, audit, availability and all"))?;
    let since = query.get("since").map(Since::parse).transpose().map_err(|what| format!("`since`: {what}"))?;
    let last = match query.get("last").map(str::parse) {
        None => LAST_USUAL,
        Some(Ok(last)) if (1..=LAST_MAX).contains(&last) => last,
        Some(_) => return Err(format!("`last` is a number from 1 to {LAST_MAX}")),
    };
    let format = match query.get("format") {
        None | Some("json") => Format::Json,
        Some("csv") => Format::Csv,
        Some(other) => return Err(format!("`format={other}` is not known; right are json and csv")),
    };
    let wanted = Wanted {
        tables,
        drive: query.get("drive").map(str::to_owned),
        since: since.map(|since| since.moment(clock::wall())),
    };
    Ok(Asked { wanted, last, format })
}

fn text(path: PathBuf, asked: &Asked) -> Result<String, rusqlite::Error> {
    let Found { rows, is_complete } = search::newest(&connect(&path)?, &asked.wanted, asked.last)?;
    Ok(match asked.format {
        Format::Json => {
            let rows: Vec<Value> = rows.iter().map(|(table, seen)| listing::in_json(*table, seen, true)).collect();
            json!({ "rows": rows, "is_complete": is_complete }).to_string()
        }
        Format::Csv => {
            let rows = rows.iter().map(|(table, seen)| listing::in_csv(*table, seen));
            std::iter::once(listing::COLUMNS.to_owned()).chain(rows).collect()
        }
    })
}

fn headers(format: Format) -> [(HeaderName, &'static str); 3] {
    let (kind, disposition) = match format {
        Format::Json => ("application/json", "inline"),
        Format::Csv => ("text/csv; charset=utf-8", "attachment; filename=\"journal.csv\""),
    };
    [(header::CONTENT_TYPE, kind), (header::CONTENT_DISPOSITION, disposition), (header::CACHE_CONTROL, "no-store")]
}
