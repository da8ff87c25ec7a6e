//! Reports of a line, over the last minutes or over a span that the client waits for.

use super::answers::{json, refusal};
use super::health::line_names;
use super::query::QueryKeys;
use super::state::HttpState;
use crate::daemon::exchange::shared::SharedLine;
use crate::daemon::host::clock;
use crate::domain::ids::Station;
use crate::north::api::UnknownLineDocument;
use crate::north::report::{DriveSeen, LineObserved, LineSeen, document};
use crate::north::shown::warning_text;
use axum::Router;
use axum::extract::{Path, State};
use axum::http::{StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use std::collections::{HashMap, VecDeque};
use std::ops::RangeInclusive;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::Semaphore;

/// How often the counts are stored.
const REMEMBER_EVERY: Duration = Duration::from_secs(60);
/// Stored moments: a report reaches back ten minutes.
const MOMENTS: usize = 10;
/// Spans in seconds that a client may wait for: shorter than a connection may last.
pub const SPAN_SECONDS: RangeInclusive<u64> = 1..=240;
/// Most clients that wait for one at once; each holds a connection.
const WAITING_MAX: usize = 16;

/// What was counted some minutes ago.
#[derive(Debug)]
pub struct CountHistory {
    known: Arc<HttpState>,
    moments: Mutex<VecDeque<HashMap<u16, Arc<LineSeen>>>>,
    places: Semaphore,
}

impl CountHistory {
    /// An empty history.
    #[must_use]
    pub fn new(known: Arc<HttpState>) -> Self {
        Self {
            known,
            moments: Mutex::default(),
            places: Semaphore::new(WAITING_MAX),
        }
    }

    /// The line with this number as it was some minutes ago; `None` if it did not exist then.
    fn oldest(&self, number: u16) -> Option<Arc<LineSeen>> {
        self.moments
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .front()?
            .get(&number)
            .cloned()
    }

    /// Stores the present state of all lines.
    fn remember(&self, lines: &[Arc<SharedLine>]) {
        let now = lines
            .iter()
            .map(|line| (line.number, Arc::new(line_seen(line))))
            .collect();
        let mut moments = self.moments.lock().unwrap_or_else(PoisonError::into_inner);
        if moments.len() >= MOMENTS {
            moments.pop_front();
        }
        moments.push_back(now);
    }
}

/// Stores the counts periodically. Never returns.
pub async fn remember(history: Arc<CountHistory>) {
    loop {
        tokio::time::sleep(REMEMBER_EVERY).await;
        history.remember(&history.known.shared.get().lines);
    }
}

/// The route of the reports.
pub(super) fn router(history: Arc<CountHistory>) -> Router {
    Router::new()
        .route("/api/v1/lines/{name}/report", get(report))
        .with_state(history)
}

async fn report(
    State(history): State<Arc<CountHistory>>,
    Path(name): Path<String>,
    uri: Uri,
) -> Response {
    let gateway = &history.known;
    let find = || {
        gateway
            .shared
            .get()
            .lines
            .iter()
            .find(|line| line.name.as_str() == name)
            .cloned()
    };
    let Some(line) = find() else {
        let answer = UnknownLineDocument {
            error: format!("there is no line called {name}").into(),
            lines: line_names(gateway),
        };
        return (StatusCode::NOT_FOUND, json(&answer)).into_response();
    };
    let span = match span(uri.query()) {
        Ok(span) => span,
        Err(error) => return refusal(StatusCode::BAD_REQUEST, &error),
    };
    let (before, line) = match span {
        None => (history.oldest(line.number), line),
        Some(span) => {
            let Ok(_place) = history.places.try_acquire() else {
                let error = format!("{WAITING_MAX} reports are already in progress");
                return refusal(StatusCode::SERVICE_UNAVAILABLE, &error);
            };
            let before = Arc::new(line_seen(&line));
            tokio::time::sleep(span).await;
            let now = find().filter(|now| now.number == line.number);
            (Some(before), now.unwrap_or(line))
        }
    };
    let observed = LineObserved::between(before.as_deref(), line_seen(&line), gateway.started);
    json(&document(&line.name, &line.wiring, &observed)).into_response()
}

/// The span that `query` asks for; `None` for the last minutes.
fn span(query: Option<&str>) -> Result<Option<Duration>, String> {
    let seconds = QueryKeys::seconds(query, &SPAN_SECONDS)
        .map_err(|expected| format!("{expected}, or no query for the last minutes"))?;
    Ok(seconds.map(Duration::from_secs))
}

/// The line as it is now.
fn line_seen(line: &SharedLine) -> LineSeen {
    let stations = line
        .wiring
        .stations
        .iter()
        .copied()
        .chain(std::iter::repeat(Station(0)));
    let now = clock::now();
    let drives = line.drives.iter().zip(stations).map(|(drive, station)| {
        let view = drive.view.load();
        DriveSeen {
            name: drive.description.name.clone(),
            station,
            presence: view.snapshot.presence,
            warning: warning_text(&drive.description, &view, now),
            report: drive.station.load_full(),
        }
    });
    LineSeen {
        at: now,
        report: line.report(),
        drives: drives.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::connections::ConnectionPatience;
    use super::super::routes::RouteDocuments;
    use super::super::tests::{UP, answer, on_a_runtime, online, serve_documents, show, state};
    use super::*;
    use crate::domain::counts::ExchangeCounts;
    use crate::domain::report::StationReport;
    use serde_json::Value;
    use tokio::net::TcpStream;

    #[test]
    fn a_span_is_in_whole_seconds_within_bounds() {
        let seconds = |seconds| Some(Some(Duration::from_secs(seconds)));
        for (query, wanted) in [
            (None, Some(None)),
            (Some(""), Some(None)),
            (Some("seconds=1"), seconds(1)),
            (Some("seconds=240"), seconds(240)),
            (Some("seconds=0"), None),
            (Some("seconds=241"), None),
            (Some("seconds=x"), None),
            (Some("minutes=1"), None),
        ] {
            assert_eq!(span(query).ok(), wanted, "{query:?}");
        }
    }

    fn answered(state: &HttpState, replies: u64) {
        let exchanges = ExchangeCounts {
            replies,
            ..ExchangeCounts::default()
        };
        let station = StationReport {
            exchanges,
            ..StationReport::default()
        };
        state.shared.load().drives[0]
            .station
            .store(Arc::new(station));
    }

    fn get_document(documents: &RouteDocuments, path: &str) -> (u16, Value) {
        on_a_runtime(async {
            let address = serve_documents(documents.clone(), ConnectionPatience::default()).await;
            let (status, body) =
                answer(TcpStream::connect(address).await.unwrap(), "GET", path, "").await;
            (status, serde_json::from_str(&body).unwrap())
        })
    }

    #[test]
    fn a_report_without_a_span_reaches_back_to_the_oldest_moment_that_is_remembered() {
        let documents = RouteDocuments::new(state(false));
        let state = Arc::clone(&documents.state);
        show(&state, UP, online(clock::now()));
        let exchanges = || {
            get_document(&documents, "/api/v1/lines/hall-1/report").1["rates"]["exchanges"].clone()
        };
        answered(&state, 40);
        assert_eq!(exchanges(), 40, "since the start");
        for replies in (100..).step_by(10).take(MOMENTS + 2) {
            answered(&state, replies);
            documents.history.remember(&state.shared.get().lines);
        }
        answered(&state, 1000);
        assert_eq!(exchanges(), 1000 - 120, "the first two are forgotten");
    }

    #[test]
    fn what_cannot_be_reported_is_said() {
        let documents = RouteDocuments::new(state(false));
        let (status, body) = get_document(&documents, "/api/v1/lines/attic/report");
        assert_eq!(
            (status, &body["lines"]),
            (404, &serde_json::json!(["hall-1"]))
        );
        let (status, body) = get_document(&documents, "/api/v1/lines/hall-1/report?seconds=500");
        assert_eq!(status, 400);
        assert!(
            body["error"].as_str().unwrap().contains("seconds=240"),
            "{body}"
        );
        let _all = documents
            .history
            .places
            .try_acquire_many(WAITING_MAX as u32)
            .unwrap();
        assert_eq!(
            get_document(&documents, "/api/v1/lines/hall-1/report?seconds=1").0,
            503
        );
        assert_eq!(
            get_document(&documents, "/api/v1/lines/hall-1/report").0,
            200,
            "this one waits for nothing"
        );
    }
}
