//! The retained topics of one line, and the document that lists what the gateway has.

use super::slot::{Content, Present, Slot, retained};
use super::state::capabilities;
use super::topics::Topics;
use super::types::{LineState, Publication, Qos, Settings};
use crate::domain::ids::Name;
use crate::domain::report::{self, LineCounters, LineReport};
use crate::domain::suspicion::Suspicion;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use serde_json::{Value, json};
use std::time::Duration;

/// Shortest time between two publications of a line's counters: they change with every exchange.
const STATS_EVERY: Duration = Duration::from_secs(10);

/// The retained topics of one line.
#[derive(Debug)]
pub(super) struct LineTopics {
    status: Slot,
    stats_topic: String,
    stats: Option<(MonoTime, LineReport)>,
    /// The counters changed too soon after the last publication.
    is_held: bool,
}

impl LineTopics {
    pub(super) fn new(topics: &Topics, name: &Name) -> Self {
        let topic = |rest| topics.line(name.as_str(), rest);
        Self { status: Slot::new(topic("status")), stats_topic: topic("stats"), stats: None, is_held: false }
    }

    pub(super) fn forget(&mut self) {
        self.status.forget();
        self.stats = None;
    }

    /// The next publication; nothing if both topics show `line`.
    pub(super) fn next(&mut self, now: &Present, line: &LineState) -> Option<Publication> {
        let status = status(&line.report);
        let payload = status.clone().into_bytes();
        if self.status.offer(now, Content::Text(status.into()), |_, _| true) {
            return Some(self.status.publication(now, payload, Qos::AtLeastOnce));
        }
        self.next_stats(now, &line.report)
    }

    fn next_stats(&mut self, now: &Present, report: &LineReport) -> Option<Publication> {
        let (age, has_changed) = match &self.stats {
            Some((at, last)) => (now.at.since(*at), last != report),
            None => (Duration::MAX, true),
        };
        self.is_held = has_changed && age < STATS_EVERY;
        if self.is_held || !has_changed && age < now.heartbeat {
            return None;
        }
        self.stats = Some((now.at, *report));
        let mut stats = stats(&report.counters);
        if let Some(object) = stats.as_object_mut() {
            let worst_stop_ms = u64::try_from(report.worst_stop.as_millis()).unwrap_or(u64::MAX);
            object.insert("worst_stop_ms".to_owned(), worst_stop_ms.into());
            object.insert("bad_per_cent".to_owned(), report.quality.bad_per_cent.into());
            object.insert("suspended".to_owned(), report.quality.is_suspended.into());
            object.insert("suspicion".to_owned(), report.suspicion.map(Suspicion::word).into());
            object.insert("at".to_owned(), now.clock.text(now.at).into());
        }
        Some(retained(now, self.stats_topic.clone(), stats.to_string().into_bytes(), Qos::AtMostOnce))
    }

    pub(super) fn wake(&self, heartbeat: Duration) -> Option<MonoTime> {
        let wait = if self.is_held { STATS_EVERY } else { heartbeat };
        Some(self.stats.as_ref()?.0 + wait).into_iter().chain([self.status.due(heartbeat)]).min()
    }
}

fn status(report: &LineReport) -> String {
    match (report.state, report.fault) {
        (report::LineState::Up, _) => "up".to_owned(),
        (report::LineState::Down, Some(fault)) => format!("down: {fault}"),
        (report::LineState::Down, None) => "down: not opened yet".to_owned(),
    }
}

fn stats(counters: &LineCounters) -> Value {
    // By its parts, so that a new counter is not forgotten here.
    let LineCounters {
        requests,
        replies,
        exceptions,
        silent,
        garbled,
        strays,
        foreign,
        other_master,
        echoes,
        noise_bytes,
        retries,
        barriers,
        joined,
        queue_full,
        expired,
        port_ups,
        port_downs,
        jams,
        busy_us,
    } = counters;
    json!({
        "requests": requests, "replies": replies, "exceptions": exceptions, "silent": silent, "garbled": garbled,
        "strays": strays, "foreign": foreign, "noise_bytes": noise_bytes, "retries": retries, "barriers": barriers,
        "joined": joined, "queue_full": queue_full, "expired": expired, "port_ups": port_ups,
        "port_downs": port_downs, "busy_us": busy_us, "other_master": other_master, "echoes": echoes, "jams": jams,
    })
}

/// What the gateway has: its lines, its drives and their models.
pub(super) fn info(settings: &Settings, drives: &[DriveDescription], lines: &[Name], started: &str) -> Vec<u8> {
    let names: Vec<_> = lines.iter().map(Name::as_str).collect();
    let document = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "gateway": settings.gateway.as_str(),
        "started": started,
        "lines": names,
        "drives": drives.iter().map(drive).collect::<Vec<_>>(),
    });
    document.to_string().into_bytes()
}

fn drive(drive: &DriveDescription) -> Value {
    let limits = drive.control.as_ref().map(|it| json!({ "min": it.least.as_f64(), "max": it.most.as_f64() }));
    json!({
        "name": drive.name.as_str(),
        "line": drive.line.as_str(),
        "model": drive.model.id,
        "vendor": drive.model.vendor,
        "title": drive.model.title,
        "unit": drive.unit.get(),
        "uniform_unit": drive.uniform_unit.get(),
        "frequency_hz": limits,
        "capabilities": capabilities(drive),
    })
}
