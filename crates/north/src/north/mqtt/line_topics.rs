//! The retained topics of one line, and the documents that describe the gateway and its drives.

use super::slot::{RenderContext, TopicSlot, retained};
use super::topics::MqttTopics;
use crate::domain::ids::Name;
use crate::domain::report::{LineCounters, LineReport, REPLY_CLASSES, ReplyReport, StationReport};
use crate::domain::suspicion::LineSuspicion;
use crate::domain::time::MonoTime;
use crate::domain::version::PROGRAM_VERSION;
use crate::drive::description::DriveDescription;
use crate::north::broker::{Publication, Qos, SessionLine};
use crate::north::points::PointContent;
use crate::north::shown::{capabilities, millis, site};
use serde_json::{Value, json};
use std::time::Duration;

/// Shortest time between two publications of a line's counters: they change with every exchange.
const STATS_EVERY: Duration = Duration::from_secs(10);

/// The retained topics of one line.
#[derive(Debug)]
pub(super) struct LineTopics {
    status: TopicSlot,
    /// Which of several gateways is active on the line, and its name.
    active: Option<(TopicSlot, String)>,
    stats_topic: String,
    /// The names of its drives, in order, each with the topic of its counts. They have topics of their own, so that no
    /// document grows with the drives: brokers limit the size of packets.
    drives: Vec<(Name, String)>,
    stats: Option<(MonoTime, LineReport)>,
    /// The drives whose counts were published since the line's.
    published_drives: usize,
    /// The counters changed too soon after the last publication.
    is_held: bool,
}

impl LineTopics {
    pub(super) fn new(topics: &MqttTopics, name: &Name, drives: &[DriveDescription]) -> Self {
        let topic = |rest| topics.line(name.as_str(), rest);
        let stats_of = |drive: &DriveDescription| topics.drive(drive.name.as_str(), "stats");
        let drives = drives
            .iter()
            .filter(|drive| drive.line == *name)
            .map(|drive| (drive.name.clone(), stats_of(drive)));
        let active = topics
            .half()
            .map(|half| (TopicSlot::new(topic("active")), half.to_string()));
        let status = TopicSlot::new(topic("status"));
        let drives = drives.collect();
        Self {
            status,
            active,
            stats_topic: topic("stats"),
            drives,
            stats: None,
            published_drives: 0,
            is_held: false,
        }
    }

    /// All its topics.
    pub(super) fn topics(&self) -> impl Iterator<Item = &str> {
        let active = self.active.as_ref().map(|(slot, _)| slot.topic());
        let of_drives = self.drives.iter().map(|(_, topic)| topic.as_str());
        [self.status.topic(), self.stats_topic.as_str()]
            .into_iter()
            .chain(active)
            .chain(of_drives)
    }

    /// Whether both show the same line with the same drives.
    pub(super) fn is_of_the_same(&self, other: &Self) -> bool {
        self.stats_topic == other.stats_topic && self.drives == other.drives
    }

    pub(super) fn forget(&mut self) {
        self.status.forget();
        if let Some((active, _)) = &mut self.active {
            active.forget();
        }
        self.stats = None;
    }

    /// The next publication; `None` if all topics show `line`.
    pub(super) fn next(&mut self, now: &RenderContext, line: &SessionLine) -> Option<Publication> {
        let status = status(&line.report);
        let payload = status.clone().into_bytes();
        if self
            .status
            .offer(now, PointContent::Text(status.into()), |_, _| true)
            .is_some()
        {
            return Some(self.status.publication(now, payload, Qos::AtLeastOnce));
        }
        if let Some((active, half)) = &mut self.active
            && active
                .offer(now, PointContent::Text(half.clone().into()), |_, _| true)
                .is_some()
        {
            return Some(active.publication(now, half.clone().into_bytes(), Qos::AtLeastOnce));
        }
        self.next_stats(now, line)
    }

    fn next_stats(&mut self, now: &RenderContext, line: &SessionLine) -> Option<Publication> {
        let report = &line.report;
        if self.stats.is_some()
            && let Some(((name, topic), station)) = self
                .drives
                .iter()
                .zip(&line.stations)
                .nth(self.published_drives)
        {
            self.published_drives += 1;
            let mut stats = station_stats(name, station);
            stats["at"] = now.clock.text(now.at).into();
            return Some(retained(
                now,
                topic.clone(),
                stats.to_string().into_bytes(),
                Qos::AtMostOnce,
            ));
        }
        let (age, has_changed) = match &self.stats {
            Some((at, last)) => (now.at.since(*at), last != report),
            None => (Duration::MAX, true),
        };
        self.is_held = has_changed && age < STATS_EVERY;
        if self.is_held || !has_changed && age < now.heartbeat {
            return None;
        }
        self.stats = Some((now.at, report.clone()));
        self.published_drives = 0;
        let mut stats = line_stats(&report.counters);
        if let Some(object) = stats.as_object_mut() {
            object.insert("budget".to_owned(), budget(report));
            object.insert(
                "bad_per_cent".to_owned(),
                report.quality.bad_per_cent.into(),
            );
            object.insert("suspended".to_owned(), report.quality.is_suspended.into());
            object.insert(
                "suspicion".to_owned(),
                report.suspicion.map(LineSuspicion::keyword).into(),
            );
            object.insert("at".to_owned(), now.clock.text(now.at).into());
        }
        Some(retained(
            now,
            self.stats_topic.clone(),
            stats.to_string().into_bytes(),
            Qos::AtMostOnce,
        ))
    }

    pub(super) fn wake(&self, heartbeat: Duration) -> Option<MonoTime> {
        let wait = if self.is_held { STATS_EVERY } else { heartbeat };
        let active = self.active.as_ref().map(|(slot, _)| slot.due(heartbeat));
        let all = Some(self.stats.as_ref()?.0 + wait)
            .into_iter()
            .chain([self.status.due(heartbeat)])
            .chain(active);
        all.min()
    }
}

fn status(report: &LineReport) -> String {
    report
        .down_reason()
        .map_or_else(|| "up".to_owned(), |reason| format!("down: {reason}"))
}

/// Planned and measured times.
fn budget(report: &LineReport) -> Value {
    let LineReport {
        stop,
        measured,
        planned_use_per_mille,
        ..
    } = report;
    json!({
        "planned_use_percent": f64::from(*planned_use_per_mille) / 10.0,
        "worst_stop_healthy_ms": millis(stop.all_healthy),
        "worst_stop_ms": millis(stop.one_silent),
        "each_further_stop_ms": millis(stop.each_further),
        "longest_stop_ms": millis(measured.longest_stop),
        "shortest_gap_us": measured.shortest_gap.map(micros),
        "median_gap_us": micros(measured.median_gap),
    })
}

fn station_stats(name: &Name, station: &StationReport) -> Value {
    let mut stats = json!({
        "name": name.as_str(),
        "oldest_age_ms": millis(station.oldest_age),
        "planned_age_ms": station.planned_age.map(millis),
        "retries": station.exchanges.retries,
        "silent": station.exchanges.silent,
    });
    for (class, reply) in REPLY_CLASSES.into_iter().zip(&station.replies) {
        let ReplyReport {
            count,
            p50,
            p90,
            p99,
            p999,
            max,
            timeout,
            ..
        } = reply;
        let mut times = json!({ "count": count, "timeout_ms": millis(*timeout) });
        for (name, time) in [
            ("p50", p50),
            ("p90", p90),
            ("p99", p99),
            ("p999", p999),
            ("max", max),
        ] {
            times[format!("{name}_us")] = if *count > 0 {
                micros(*time).into()
            } else {
                Value::Null
            };
        }
        stats[class] = times;
    }
    stats
}

fn micros(time: Duration) -> u64 {
    u64::try_from(time.as_micros()).unwrap_or(u64::MAX)
}

fn line_stats(counters: &LineCounters) -> Value {
    // Destructured, so that a new counter is not forgotten here.
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
        noise_between,
        retries,
        barriers,
        broadcasts,
        joined,
        queue_full,
        expired,
        withdrawn,
        port_ups,
        port_downs,
        jams,
        busy_us,
    } = counters;
    json!({
        "requests": requests, "replies": replies, "exceptions": exceptions, "silent": silent, "garbled": garbled,
        "strays": strays, "foreign": foreign, "noise_bytes": noise_bytes, "noise_between": noise_between, "retries": retries, "barriers": barriers,
        "broadcasts": broadcasts, "joined": joined, "queue_full": queue_full, "expired": expired,
        "withdrawn": withdrawn, "port_ups": port_ups, "port_downs": port_downs, "busy_us": busy_us,
        "other_master": other_master, "echoes": echoes, "jams": jams,
    })
}

/// A topic that says what the gateway or a drive is. It changes only with the configuration.
#[derive(Debug)]
pub(super) struct InfoTopic {
    pub(super) topic: String,
    pub(super) payload: Vec<u8>,
    /// It is published on this connection.
    pub(super) is_published: bool,
}

impl InfoTopic {
    /// Whether both have the same content.
    pub(super) fn is_of_the_same(&self, other: &Self) -> bool {
        self.topic == other.topic && self.payload == other.payload
    }
}

/// What the gateway and its drives are: the gateway first, with the names of lines and drives.
pub(super) fn infos(
    topics: &MqttTopics,
    drives: &[DriveDescription],
    lines: &[Name],
    started: &str,
) -> Vec<InfoTopic> {
    let info = |topic: String, document: &Value| InfoTopic {
        topic,
        payload: document.to_string().into_bytes(),
        is_published: false,
    };
    let document = json!({
        "version": PROGRAM_VERSION,
        "gateway": topics.name.as_str(),
        "started": started,
        "lines": lines.iter().map(Name::as_str).collect::<Vec<_>>(),
        "drives": drives.iter().map(|drive| drive.name.as_str()).collect::<Vec<_>>(),
    });
    let of_drives = drives
        .iter()
        .map(|it| info(topics.drive(it.name.as_str(), "info"), &drive(it)));
    std::iter::once(info(topics.gateway("info"), &document))
        .chain(of_drives)
        .collect()
}

fn drive(drive: &DriveDescription) -> Value {
    let limits = drive
        .control
        .as_ref()
        .map(|it| json!({ "min": it.least.as_f64(), "max": it.most.as_f64() }));
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
        "site": drive.control.as_ref().map(|it| site(it)),
    })
}
