//! Rows of the journal for HTTP clients, read on other threads and bounded in number.

use super::LiveDocuments;
use super::answers::{LiveFormat, error_answer, no_journal, too_many_readers};
use crate::daemon::host::clock;
use crate::daemon::http::query::QueryKeys;
use crate::daemon::http::taking::PIECE_BYTES;
use crate::daemon::journal::listing;
use crate::daemon::journal::reader::{connect, row};
use crate::daemon::journal::search::{self, SearchResult, SearchStart, WantedRows};
use crate::journal::JournalTable;
use crate::north::titles::PlantTitles;
use axum::BoxError;
use axum::body::{Body, HttpBody};
use axum::extract::{RawQuery, State};
use axum::http::{HeaderName, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use hyper::body::Frame;
use rusqlite::{Connection, Error};
use std::path::Path;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use tokio::sync::OwnedSemaphorePermit;
use tokio::task::JoinHandle;

/// Rows in an answer by default, and at most.
const LAST_USUAL: usize = 200;
const LAST_MAX: usize = 10_000;
const KEYS: [&str; 5] = ["table", "drive", "since", "last", "format"];

/// A parsed query.
#[derive(Debug)]
struct JournalQuery {
    wanted: WantedRows,
    last: usize,
    format: LiveFormat,
}

pub async fn rows(State(live): State<Arc<LiveDocuments>>, RawQuery(query): RawQuery) -> Response {
    let asked = match parse_query(query.as_deref()) {
        Ok(asked) => asked,
        Err(what) => return error_answer(StatusCode::BAD_REQUEST, what),
    };
    let Some(journal) = &live.state.journal else {
        return no_journal();
    };
    let Ok(place) = Arc::clone(&live.readers).try_acquire_owned() else {
        return too_many_readers();
    };
    let path = journal.file().to_owned();
    let format = asked.format;
    let titles = Arc::clone(&live.state.shared.load().titles);
    let begin = move || JournalReading::begin(&path, &asked, titles, place);
    let read = tokio::task::spawn_blocking(begin).await;
    match read {
        // What fits into one piece is sent with its length, like other documents.
        Ok(Ok((reading, first))) if reading.is_over() => {
            (headers(format), first.unwrap_or_default()).into_response()
        }
        Ok(Ok((reading, first))) => (
            headers(format),
            Body::new(JournalPieces::Ready(Box::new(reading), first)),
        )
            .into_response(),
        Ok(Err(error)) => error_answer(
            StatusCode::SERVICE_UNAVAILABLE,
            format!("the journal cannot be read: {error}"),
        ),
        Err(error) => error_answer(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()),
    }
}

fn parse_query(query: Option<&str>) -> Result<JournalQuery, String> {
    let query = QueryKeys::read(query, &KEYS)?;
    let table = query.get("table").unwrap_or("all");
    let tables = search::tables(table).ok_or_else(|| {
        format!("unknown `table={table}`; expected trips, audit, availability or all")
    })?;
    let since = query
        .get("since")
        .map(SearchStart::parse)
        .transpose()
        .map_err(|what| format!("`since`: {what}"))?;
    let last = match query.get("last").map(str::parse) {
        None => LAST_USUAL,
        Some(Ok(last)) if (1..=LAST_MAX).contains(&last) => last,
        Some(_) => return Err(format!("`last` is a number from 1 to {LAST_MAX}")),
    };
    let format = LiveFormat::from_word(query.get("format"))?;
    let wanted = WantedRows {
        tables,
        drive: query.get("drive").map(str::to_owned),
        since: since.map(|since| since.moment(clock::wall())),
    };
    Ok(JournalQuery {
        wanted,
        last,
        format,
    })
}

/// The rest of an answer. No transaction is open between two pieces.
#[derive(Debug)]
struct JournalReading {
    connection: Connection,
    rows: std::vec::IntoIter<(JournalTable, u64)>,
    format: LiveFormat,
    titles: Arc<PlantTitles>,
    is_first: bool,
    /// The text before the rows; empty once it is sent.
    begin: String,
    /// The text after them.
    end: &'static str,
    /// Free again when the last piece is taken.
    _place: OwnedSemaphorePermit,
}

impl JournalReading {
    /// Finds the rows, and reads the first piece of them.
    fn begin(
        path: &Path,
        asked: &JournalQuery,
        titles: Arc<PlantTitles>,
        place: OwnedSemaphorePermit,
    ) -> Result<(Self, Option<Bytes>), Error> {
        let connection = connect(path)?;
        let SearchResult { rows, is_complete } =
            search::newest(&connection, &asked.wanted, asked.last)?;
        let (begin, end) = match asked.format {
            LiveFormat::Json => (format!("{{\"is_complete\":{is_complete},\"rows\":["), "]}"),
            LiveFormat::Csv => (listing::columns(&titles), ""),
        };
        let rows = rows.into_iter();
        let format = asked.format;
        let mut reading = Self {
            connection,
            rows,
            format,
            titles,
            is_first: true,
            begin,
            end,
            _place: place,
        };
        let first = reading.piece()?;
        Ok((reading, first))
    }

    /// Whether all of it was read.
    fn is_over(&self) -> bool {
        self.rows.as_slice().is_empty() && self.end.is_empty()
    }

    /// The next piece; `None` after the last.
    fn piece(&mut self) -> Result<Option<Bytes>, Error> {
        let mut text = std::mem::take(&mut self.begin);
        while text.len() < PIECE_BYTES / 2 {
            let Some((table, number)) = self.rows.next() else {
                text += std::mem::take(&mut self.end);
                break;
            };
            // The writer may have deleted it meanwhile.
            let Some(seen) = row(&self.connection, table, number)? else {
                continue;
            };
            match self.format {
                LiveFormat::Json => {
                    text += if std::mem::replace(&mut self.is_first, false) {
                        ""
                    } else {
                        ","
                    };
                    text += &listing::in_json(table, &seen, &self.titles, true).to_string();
                }
                LiveFormat::Csv => text += &listing::in_csv(table, &seen, &self.titles),
            }
        }
        Ok(Some(text).filter(|text| !text.is_empty()).map(Bytes::from))
    }
}

/// The rest of an answer, and the next piece of it.
type Read = (Box<JournalReading>, Option<Bytes>);

/// The body of an answer. Each piece is read when the one before it is taken, so that a slow reader holds no thread and little
/// memory.
#[derive(Debug)]
enum JournalPieces {
    /// The next piece has been read.
    Ready(Box<JournalReading>, Option<Bytes>),
    /// The next piece is being read.
    Reading(JoinHandle<Result<Read, Error>>),
    /// All pieces are taken, or reading has failed.
    Ended,
}

impl HttpBody for JournalPieces {
    type Data = Bytes;
    type Error = BoxError;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, BoxError>>> {
        loop {
            *self = match std::mem::replace(&mut *self, Self::Ended) {
                Self::Ready(mut reading, Some(piece)) => {
                    *self = Self::Reading(tokio::task::spawn_blocking(move || {
                        let next = reading.piece()?;
                        Ok((reading, next))
                    }));
                    return Poll::Ready(Some(Ok(Frame::data(piece))));
                }
                Self::Reading(mut read) => match Pin::new(&mut read).poll(context) {
                    Poll::Pending => {
                        *self = Self::Reading(read);
                        return Poll::Pending;
                    }
                    Poll::Ready(Ok(Ok((reading, next)))) => Self::Ready(reading, next),
                    // The answer is broken off, so that it is not taken for complete.
                    Poll::Ready(Ok(Err(error))) => return Poll::Ready(Some(Err(error.into()))),
                    Poll::Ready(Err(error)) => return Poll::Ready(Some(Err(error.into()))),
                },
                Self::Ready(_, None) | Self::Ended => return Poll::Ready(None),
            };
        }
    }
}

fn headers(format: LiveFormat) -> [(HeaderName, &'static str); 3] {
    let (kind, disposition) = match format {
        LiveFormat::Json => ("application/json", "inline"),
        LiveFormat::Csv => (
            "text/csv; charset=utf-8",
            "attachment; filename=\"journal.csv\"",
        ),
    };
    [
        (header::CONTENT_TYPE, kind),
        (header::CONTENT_DISPOSITION, disposition),
        (header::CACHE_CONTROL, "no-store"),
    ]
}
