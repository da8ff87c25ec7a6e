//! The traffic of a line, as server-sent events for the page and for `vfd-gateway capture`.
//!
//! An answer ends by itself before its connection does, and says so: a client that returns with the number of the last
//! record it has seen continues after that one.

use super::answers::refusal;
use super::state::HttpState;
use crate::daemon::exchange::shared::{SharedDrive, SharedLine};
use crate::daemon::exchange::traffic::{LISTENERS_MAX, TrafficListener};
use crate::daemon::host::clock;
use crate::domain::calendar::rfc3339;
use crate::domain::ids::Station;
use crate::domain::time::{MonoTime, WallTime};
use crate::north::api::{LostRecords, TrafficDriveDocument, TrafficLineDocument};
use crate::north::traffic::{KnownDrive, LineFacts, TrafficDecoder};
use crate::toml_file::words::{SHOWN_FRAMINGS, word_for};
use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use hyper::body::{Body as HttpBody, Frame as BodyFrame};
use serde::Serialize;
use serde_json::json;
use std::convert::Infallible;
use std::fmt::Write;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::time::{Interval, MissedTickBehavior, interval};

/// How often new records are sent: a person sees no difference, and the main thread is not woken by each frame.
const EVERY: Duration = Duration::from_millis(50);
/// Most records in one piece of an answer.
const RECORDS_AT_ONCE: usize = 64;
/// After this time without records a heartbeat shows that the line is still watched.
const ALIVE_EVERY: Duration = Duration::from_secs(2);
/// How long an answer lasts: less than its connection may.
const LASTS: Duration = Duration::from_secs(240);

/// The route of the traffic.
pub(super) fn router(state: Arc<HttpState>) -> Router {
    Router::new()
        .route("/api/v1/lines/{name}/traffic", get(watch))
        .with_state(state)
}

async fn watch(
    State(gateway): State<Arc<HttpState>>,
    Path(name): Path<String>,
    headers: HeaderMap,
) -> Response {
    let shared = gateway.shared.get();
    let Some(line) = shared.lines.iter().find(|line| line.name.as_str() == name) else {
        let lines: Vec<_> = shared.lines.iter().map(|line| line.name.as_str()).collect();
        let error = format!("no line is called {name}; there is {}", lines.join(", "));
        return refusal(StatusCode::NOT_FOUND, &error);
    };
    let after = headers
        .get("last-event-id")
        .and_then(|id| number_in(id.to_str().ok()?, line));
    let Some(listener) = TrafficListener::new(Arc::clone(line), after, clock::now) else {
        let error =
            format!("line {name} is already watched by {LISTENERS_MAX} clients, the maximum");
        return refusal(StatusCode::SERVICE_UNAVAILABLE, &error);
    };
    let headers = [
        (header::CONTENT_TYPE, "text/event-stream"),
        (header::CACHE_CONTROL, "no-store"),
    ];
    (headers, Body::new(TrafficEvents::new(gateway, listener))).into_response()
}

/// The events of one answer.
struct TrafficEvents {
    gateway: Arc<HttpState>,
    listener: TrafficListener,
    decoder: TrafficDecoder,
    clock: WallClock,
    ticks: Interval,
    begun: MonoTime,
    last_said: MonoTime,
    /// More records wait than went into the last piece.
    has_more: bool,
    is_begin_sent: bool,
    has_ended: bool,
}

impl TrafficEvents {
    fn new(gateway: Arc<HttpState>, listener: TrafficListener) -> Self {
        let mut ticks = interval(EVERY);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let decoder = TrafficDecoder::new(facts(listener.line()));
        let now = clock::now();
        let clock = WallClock::new();
        let begun = now;
        let last_said = now;
        let has_more = false;
        let is_begin_sent = false;
        let has_ended = false;
        Self {
            gateway,
            listener,
            decoder,
            clock,
            ticks,
            begun,
            last_said,
            has_more,
            is_begin_sent,
            has_ended,
        }
    }

    /// The events at `now`; empty if there are none.
    fn piece(&mut self, now: MonoTime) -> String {
        let mut text = String::new();
        if !std::mem::replace(&mut self.is_begin_sent, true) {
            text += "retry: 500\n";
            event(&mut text, "begin", &about(self.listener.line()));
        }
        let news = self.listener.look(RECORDS_AT_ONCE);
        self.has_more = news.records.len() == RECORDS_AT_ONCE;
        if news.lost > 0 {
            self.decoder.skip();
            let records = news.lost;
            event(&mut text, "lost", &LostRecords { records });
        }
        for (number, record) in news.records {
            let at = self.clock.rfc3339(record.at());
            let frame = self.decoder.decode(&record).document(at, &record.bytes);
            let _ = writeln!(text, "id: {}.{number}", self.listener.line().number);
            event(&mut text, "frame", &frame);
        }
        let is_gone = || {
            !self
                .gateway
                .shared
                .load()
                .lines
                .iter()
                .any(|line| Arc::ptr_eq(line, self.listener.line()))
        };
        if !self.has_more && (now.since(self.begun) >= LASTS || is_gone()) {
            event(&mut text, "again", &json!({}));
            self.has_ended = true;
        }
        if text.is_empty() && now.since(self.last_said) >= ALIVE_EVERY {
            event(&mut text, "alive", &json!({}));
        }
        if !text.is_empty() {
            self.last_said = now;
        }
        text
    }
}

impl HttpBody for TrafficEvents {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<BodyFrame<Bytes>, Infallible>>> {
        while !self.has_ended {
            if !self.has_more {
                ready!(self.ticks.poll_tick(cx));
            }
            let text = self.piece(clock::now());
            if !text.is_empty() {
                return Poll::Ready(Some(Ok(BodyFrame::data(text.into()))));
            }
        }
        Poll::Ready(None)
    }
}

/// The record of `line` that `id` names; 0 if `id` is from an earlier line of the same name.
fn number_in(id: &str, line: &SharedLine) -> Option<u64> {
    let (of, number) = id.split_once('.')?;
    let (of, number): (u16, u64) = (of.parse().ok()?, number.parse().ok()?);
    Some(if of == line.number { number } else { 0 })
}

fn event<T: Serialize>(text: &mut String, name: &str, data: &T) {
    let data = json!(data);
    let _ = write!(text, "event: {name}\ndata: {data}\n\n");
}

pub(super) fn facts(line: &SharedLine) -> LineFacts {
    let drives = line
        .drives
        .iter()
        .zip(&line.wiring.stations)
        .map(|(drive, station)| {
            let description = &drive.description;
            KnownDrive {
                station: *station,
                name: description.name.clone(),
                model: Arc::clone(&description.model),
                ratings: description.ratings,
            }
        });
    LineFacts {
        framing: line.wiring.framing,
        drives: drives.collect(),
    }
}

/// The description of the line with which an answer begins.
pub(super) fn about(line: &SharedLine) -> TrafficLineDocument {
    let characters = line.wiring.characters();
    let drives = line.drives.iter().zip(&line.wiring.stations);
    let drive = |(drive, station): (&Arc<SharedDrive>, &Station)| TrafficDriveDocument {
        name: drive.description.name.to_string().into(),
        station: station.0,
        model: drive.description.model.id.clone().into(),
    };
    TrafficLineDocument {
        line: line.name.to_string().into(),
        framing: word_for(&SHOWN_FRAMINGS, &line.wiring.framing).into(),
        port: line.wiring.port.clone().into(),
        link: characters.map(|link| link.to_string()),
        baud: characters.map(|link| link.baud),
        drives: drives.map(drive).collect(),
    }
}

/// The wall clock as of the beginning of the answer: intervals stay right although the clock may be set meanwhile.
pub(super) struct WallClock {
    /// Microseconds that it was ahead of the monotonic clock.
    ahead_us: i64,
}

impl WallClock {
    pub(super) fn new() -> Self {
        Self {
            ahead_us: clock::wall_micros() - micros(clock::now()),
        }
    }

    /// `at` as RFC 3339 in UTC with microseconds.
    pub(super) fn rfc3339(&self, at: MonoTime) -> String {
        let unix_us = micros(at) + self.ahead_us;
        let text = rfc3339(WallTime {
            unix_ms: unix_us.div_euclid(1000),
        });
        format!(
            "{}{:03}Z",
            text.trim_end_matches('Z'),
            unix_us.rem_euclid(1000)
        )
    }
}

fn micros(at: MonoTime) -> i64 {
    i64::try_from(at.as_nanos() / 1000).unwrap_or(i64::MAX)
}
