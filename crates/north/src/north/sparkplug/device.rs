//! A drive as a device: its birth, and its changes since.

use super::content::{MetricContent, MetricContext};
use super::history::{MetricChange, MetricHistory};
use super::metrics::{self, MetricDefinition};
use super::payload::{
    PayloadMetric, PayloadQuality, PayloadType, PayloadValue, PropertyScalar, PropertySet,
};
use crate::domain::command::Report;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::view::DriveView;
use crate::north::clock::LabelClock;
use crate::north::points::{PointContext, PublishedPoints};
use crate::profile::scale::{Decimal, setpoint_step};
use std::sync::Arc;
use std::time::Duration;

/// Measured values of one drive are gathered for this long, so that one message carries what several polls brought.
const GATHERED_FOR: Duration = Duration::from_millis(250);
/// Most changes of the past in one message.
const HISTORY_BATCH: usize = 64;

/// The outcome of the last command that a host gave.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LastResult {
    pub(super) report: Report,
    /// For people.
    pub(super) message: String,
    /// Reports so far, so that two with the same words are distinguished.
    pub(super) count: i64,
}

/// The present, for a device.
#[derive(Clone, Copy)]
pub(super) struct DeviceMoment<'p> {
    pub(super) at: MonoTime,
    pub(super) clock: LabelClock,
    pub(super) drive: &'p DriveDescription,
    pub(super) view: &'p Arc<DriveView>,
}

/// A drive as a device.
#[derive(Debug)]
pub(super) struct SparkplugDevice {
    /// The alias of its first metric; the others follow.
    first_alias: u64,
    definitions: Vec<MetricDefinition>,
    /// The step of its drive's setpoint.
    setpoint_step: Option<Decimal>,
    points: PublishedPoints,
    /// The content of each metric that was last published or kept.
    held: Vec<MetricContent>,
    /// It was born on this connection and has not died.
    pub(super) is_born: bool,
    /// It was born before, so a host knows its content.
    was_born: bool,
    /// Its birth is larger than the broker accepts.
    pub(super) is_too_large: bool,
    pub(super) history: MetricHistory,
    last_result: Option<LastResult>,
    /// The last view seen, and until when it gives nothing new.
    looked: Option<(Arc<DriveView>, MonoTime)>,
    /// Measured values are gathered until then.
    gathers_until: MonoTime,
}

impl SparkplugDevice {
    /// A device whose metrics are numbered from `first_alias`, and that keeps up to `keep` changes of telemetry.
    pub(super) fn new(drive: &DriveDescription, first_alias: u64, keep: usize) -> Self {
        let definitions = metrics::of_drive(drive);
        Self {
            first_alias,
            held: vec![MetricContent::NULL; definitions.len()],
            definitions,
            setpoint_step: setpoint_step(&drive.model),
            points: PublishedPoints::new(drive),
            is_born: false,
            was_born: false,
            is_too_large: false,
            history: MetricHistory::new(keep),
            last_result: None,
            looked: None,
            gathers_until: MonoTime::ZERO,
        }
    }

    /// The step of its drive's setpoint in hertz, where that is known.
    pub(super) const fn setpoint_step(&self) -> Option<Decimal> {
        self.setpoint_step
    }

    /// The alias after those of this device.
    pub(super) fn next_alias(&self) -> u64 {
        self.first_alias + self.definitions.len() as u64
    }

    /// The metric that `metric` of a command addresses: by its name if it has one, else by its alias.
    pub(super) fn definition(&self, metric: &PayloadMetric) -> Option<&MetricDefinition> {
        if let Some(name) = &metric.name {
            return self
                .definitions
                .iter()
                .find(|definition| definition.name == *name);
        }
        let place = usize::try_from(metric.alias?.checked_sub(self.first_alias)?).ok()?;
        self.definitions.get(place)
    }

    /// The names of the metrics that a host may write.
    pub(super) fn inputs(&self) -> impl Iterator<Item = &str> {
        self.definitions
            .iter()
            .filter(|it| it.input().is_some())
            .map(|it| it.name.as_str())
    }

    /// Publishes the outcome of a command.
    pub(super) fn set_result(&mut self, report: Report, message: String) {
        let count = self.last_result.as_ref().map_or(0, |last| last.count) + 1;
        self.last_result = Some(LastResult {
            report,
            message,
            count,
        });
        self.looked = None;
    }

    /// The connection is lost.
    pub(super) fn lost(&mut self) {
        self.is_born = false;
        self.is_too_large = false;
        self.history.lost();
        self.looked = None;
    }

    fn look<'l>(&'l self, now: &'l DeviceMoment<'l>) -> MetricContext<'l> {
        MetricContext {
            now: PointContext {
                at: now.at,
                clock: now.clock,
                drive: now.drive,
                view: now.view,
            },
            points: &self.points,
            last_result: self.last_result.as_ref(),
        }
    }

    /// All metrics with names, types and properties. The device counts as born.
    pub(super) fn birth(&mut self, now: &DeviceMoment<'_>) -> Vec<PayloadMetric> {
        let look = self.look(now);
        let held: Vec<_> = self
            .definitions
            .iter()
            .map(|definition| look.content(definition))
            .collect();
        let metrics =
            self.definitions
                .iter()
                .zip(&held)
                .enumerate()
                .map(|(place, (definition, content))| {
                    let value = look.value(definition, content);
                    let quality = if value.is_some() {
                        PayloadQuality::Good
                    } else {
                        PayloadQuality::Stale
                    };
                    PayloadMetric {
                        name: Some(definition.name.clone()),
                        datatype: Some(definition.datatype as u32),
                        properties: with_quality(definition.properties(), quality).or_none(),
                        ..self.metric(
                            place,
                            millis(now.clock, look.since(definition, content)),
                            value,
                        )
                    }
                });
        let mut metrics: Vec<_> = metrics.collect();
        // Values are in the order in which they occurred, in births too.
        metrics.sort_by_key(|metric| metric.timestamp);
        let until = self
            .definitions
            .iter()
            .filter_map(|definition| look.ends_at(definition))
            .min();
        self.held = held;
        self.is_born = true;
        self.was_born = true;
        self.looked = Some((Arc::clone(now.view), until.unwrap_or(MonoTime::NEVER)));
        self.gathers_until = now.at + GATHERED_FOR;
        metrics
    }

    /// The type is always sent, though hosts could know it from the birth: widely used decoders read no value without
    /// it.
    fn metric(&self, place: usize, at_ms: u64, value: Option<PayloadValue>) -> PayloadMetric {
        PayloadMetric {
            alias: Some(self.first_alias + place as u64),
            datatype: self
                .definitions
                .get(place)
                .map(|definition| definition.datatype as u32),
            timestamp: Some(at_ms),
            is_null: value.is_none().then_some(true),
            value,
            ..PayloadMetric::default()
        }
    }

    /// Changes since they were last published or kept, in the order in which they happened.
    fn changes(&mut self, now: &DeviceMoment<'_>) -> Vec<(MetricChange, bool)> {
        let is_known = self.looked.as_ref();
        if is_known.is_some_and(|(view, until)| Arc::ptr_eq(view, now.view) && now.at < *until) {
            return Vec::new();
        }
        let gathers = now.at < self.gathers_until;
        let look = self.look(now);
        let mut until = if gathers {
            self.gathers_until
        } else {
            MonoTime::NEVER
        };
        let mut changes = Vec::new();
        let mut news = Vec::new();
        for (place, (definition, held)) in self.definitions.iter().zip(&self.held).enumerate() {
            until = look
                .ends_at(definition)
                .map_or(until, |ends| ends.min(until));
            if gathers && !definition.is_prompt() {
                continue;
            }
            let content = look.content(definition);
            if !look.is_news(definition, held, &content) {
                continue;
            }
            let at_ms = millis(now.clock, look.since(definition, &content));
            let value = look.value(definition, &content);
            let has_quality_changed =
                (*held == MetricContent::NULL) != (content == MetricContent::NULL);
            let entry = MetricChange {
                metric: place,
                at_ms,
                value,
                is_trip: definition.is_trip(),
            };
            changes.push((entry, has_quality_changed));
            news.push((place, content));
        }
        for (place, content) in news {
            if let Some(held) = self.held.get_mut(place) {
                *held = content;
            }
        }
        let has_measured = changes
            .iter()
            .any(|(entry, _)| !self.is_prompt(entry.metric));
        if has_measured {
            self.gathers_until = now.at + GATHERED_FOR;
        }
        self.looked = Some((Arc::clone(now.view), until));
        changes.sort_by_key(|(entry, _)| entry.at_ms);
        changes
    }

    fn is_prompt(&self, place: usize) -> bool {
        self.definitions
            .get(place)
            .is_some_and(MetricDefinition::is_prompt)
    }

    fn is_recorded(&self, entry: &MetricChange) -> bool {
        self.definitions
            .get(entry.metric)
            .is_some_and(MetricDefinition::is_recorded)
    }

    /// What is to be published now, after this many `probes`; `None` if nothing has changed.
    pub(super) fn data(&mut self, now: &DeviceMoment<'_>, probes: u64) -> Vec<PayloadMetric> {
        let changes = self.changes(now);
        let metrics = changes.iter().map(|(entry, has_quality_changed)| {
            let quality = if entry.value.is_some() {
                PayloadQuality::Good
            } else {
                PayloadQuality::Stale
            };
            let properties =
                has_quality_changed.then(|| with_quality(PropertySet::default(), quality));
            PayloadMetric {
                properties,
                ..self.metric(entry.metric, entry.at_ms, entry.value.clone())
            }
        });
        let metrics = metrics.collect();
        let entries: Vec<_> = changes
            .into_iter()
            .map(|(entry, _)| entry)
            .filter(|it| self.is_recorded(it))
            .collect();
        self.history.sent(probes, entries);
        metrics
    }

    /// Keeps changes while no host can be reached. A value that is read for the first time is no change.
    pub(super) fn record(&mut self, now: &DeviceMoment<'_>) {
        for (entry, has_quality_changed) in self.changes(now) {
            let is_first = has_quality_changed && !self.was_born;
            if entry.value.is_some() && !is_first && self.is_recorded(&entry) {
                self.history.add(entry);
            }
        }
    }

    /// Changes of the past, marked as such; none if none waits.
    pub(super) fn past(&mut self, probes: u64, room_bytes: usize) -> Vec<PayloadMetric> {
        let entries = self.history.take(HISTORY_BATCH, room_bytes);
        let metrics = entries.iter().map(|entry| PayloadMetric {
            is_historical: Some(true),
            ..self.metric(entry.metric, entry.at_ms, entry.value.clone())
        });
        let metrics = metrics.collect();
        self.history.sent(probes, entries);
        metrics
    }

    /// When the view gives something new although it stays the same.
    pub(super) fn wake(&self) -> Option<MonoTime> {
        self.looked
            .as_ref()
            .map(|(_, until)| *until)
            .filter(|until| *until != MonoTime::NEVER)
    }
}

/// Milliseconds since 1970 of `at`.
pub(super) fn millis(clock: LabelClock, at: MonoTime) -> u64 {
    u64::try_from(clock.wall(at).unix_ms).unwrap_or(0)
}

fn with_quality(set: PropertySet, quality: PayloadQuality) -> PropertySet {
    set.with(
        "Quality",
        PayloadType::Int32,
        PropertyScalar::Int(quality as u32),
    )
}
