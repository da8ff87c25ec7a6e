//! The retained topics of one drive: the content of each, and which is to be published next.

use super::history::TopicChange;
use super::kinds::{TopicKind, kinds};
use super::points::PublishedPoints;
use super::slot::{EXPIRY_HEARTBEATS, RenderContext, TopicContent, TopicSlot};
use super::state::{self, StateSlot};
use super::topics::MqttTopics;
use super::types::{Settings, TopicTree};
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::snapshot::ValueReading;
use crate::drive::view::DriveView;
use crate::drive::warnings;
use crate::north::broker::{Publication, Qos};
use crate::north::shown::{answered_run_state, fresh, stale_at, warning};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;
/// The retained topics of one drive.
#[derive(Debug)]
pub(super) struct DriveTopics {
    slots: Vec<(TopicKind, TopicSlot)>,
    state: StateSlot,
    points: PublishedPoints,
    publish: Vec<TopicTree>,
    params: BTreeMap<usize, ValueReading>,
    /// The next slot of this walk; after the last one comes the state.
    cursor: usize,
    /// The last view seen while there was no broker to publish to.
    recorded: Option<Arc<DriveView>>,
    /// The view with which this walk began.
    walking: Option<Arc<DriveView>>,
    /// The view of the last finished walk, and until when another walk over it would publish nothing.
    walked: Option<(Arc<DriveView>, MonoTime)>,
}

impl DriveTopics {
    pub(super) fn new(settings: &Settings, topics: &MqttTopics, drive: &DriveDescription) -> Self {
        let slot = |(kind, rest): (TopicKind, String)| {
            (
                kind,
                TopicSlot::new(topics.drive(drive.name.as_str(), &rest)),
            )
        };
        Self {
            slots: kinds(drive).into_iter().map(slot).collect(),
            state: StateSlot::new(topics.drive(drive.name.as_str(), "state")),
            points: PublishedPoints::new(drive),
            publish: settings.publish.clone(),
            params: BTreeMap::new(),
            cursor: 0,
            recorded: None,
            walking: None,
            walked: None,
        }
    }

    /// All its topics that are published.
    pub(super) fn topics(&self) -> impl Iterator<Item = &str> {
        self.all_topics()
            .filter(|(tree, _)| self.publishes(*tree))
            .map(|(_, topic)| topic)
    }

    /// All topics of the drive that are not published.
    pub(super) fn left_out(&self) -> impl Iterator<Item = &str> {
        self.all_topics()
            .filter(|(tree, _)| !self.publishes(*tree))
            .map(|(_, topic)| topic)
    }

    fn all_topics(&self) -> impl Iterator<Item = (Option<TopicTree>, &str)> {
        let slots = self
            .slots
            .iter()
            .map(|(kind, slot)| (kind.tree(), slot.topic()));
        slots.chain([(Some(TopicTree::State), self.state.topic())])
    }

    fn publishes(&self, tree: Option<TopicTree>) -> bool {
        tree.is_none_or(|tree| self.publish.contains(&tree))
    }

    /// Forgets what was published, so that everything is published again.
    pub(super) fn forget(&mut self) {
        self.slots.iter_mut().for_each(|(_, slot)| slot.forget());
        self.state.forget();
        self.recorded = None;
        self.restart();
    }

    fn restart(&mut self) {
        self.cursor = 0;
        self.walking = None;
        self.walked = None;
    }

    /// Takes a register that was read on demand; it is published even if nothing changed.
    pub(super) fn take_param(&mut self, register: usize, reading: ValueReading, topic: String) {
        if !self.publishes(Some(TopicTree::Param)) {
            return;
        }
        self.params.insert(register, reading);
        let known = self
            .slots
            .iter_mut()
            .find(|(kind, _)| *kind == TopicKind::Param(register));
        match known {
            Some((_, slot)) => slot.forget(),
            None => self
                .slots
                .push((TopicKind::Param(register), TopicSlot::new(topic))),
        }
        self.restart();
    }

    /// The next publication; `None` if all topics show the view.
    pub(super) fn next(
        &mut self,
        now: &RenderContext,
        drive: &DriveDescription,
        view: &Arc<DriveView>,
    ) -> Option<Publication> {
        if self
            .walked
            .as_ref()
            .is_some_and(|(walked, until)| Arc::ptr_eq(walked, view) && now.at < *until)
        {
            return None;
        }
        self.walked = None;
        self.walking.get_or_insert_with(|| view.clone());
        while self.cursor < self.slots.len() {
            self.cursor += 1;
            if let Some(publication) = self.offer(self.cursor - 1, now, drive, view) {
                return Some(publication);
            }
        }
        if self.publishes(Some(TopicTree::State)) {
            let state = self.state.offer(now, drive, view, &self.points);
            if state.is_some() {
                return state;
            }
        }
        let until = self.until(now, drive, view);
        let is_of_this_picture = self
            .walking
            .take()
            .is_some_and(|walking| Arc::ptr_eq(&walking, view));
        self.walked = is_of_this_picture.then(|| (view.clone(), until));
        self.cursor = 0;
        // What was walked before the view changed is walked once more.
        if is_of_this_picture {
            None
        } else {
            self.next(now, drive, view)
        }
    }

    fn offer(
        &mut self,
        place: usize,
        now: &RenderContext,
        drive: &DriveDescription,
        view: &DriveView,
    ) -> Option<Publication> {
        let kind = self.slots.get(place)?.0;
        let content = self.content(kind, now, drive, view)?;
        if !self.publishes(kind.tree()) {
            self.slots.get_mut(place)?.1.see(content);
            return None;
        }
        let now = now.beating(self.points.heartbeat(kind));
        let points = &self.points;
        let slot = &mut self.slots.get_mut(place)?.1;
        let differ = |old, new| points.differ_on(kind, drive, old, new);
        let content = slot.offer(&now, content, differ)?;
        // Most walks publish nothing, so the text is written only here.
        let payload = points
            .shown(kind, content, drive)
            .unwrap_or_default()
            .into_bytes();
        let qos = if kind == TopicKind::Availability {
            Qos::AtLeastOnce
        } else {
            Qos::AtMostOnce
        };
        Some(slot.publication(&now, payload, qos))
    }

    /// Changes of run state, frequencies and measurements since they were last published or kept, in the order in which
    /// they happened.
    pub(super) fn record(
        &mut self,
        now: &RenderContext,
        place: usize,
        drive: &DriveDescription,
        view: &Arc<DriveView>,
    ) -> Vec<TopicChange> {
        if self
            .recorded
            .as_ref()
            .is_some_and(|recorded| Arc::ptr_eq(recorded, view))
        {
            return Vec::new();
        }
        self.recorded = Some(view.clone());
        let kinds: Vec<_> = self
            .slots
            .iter()
            .map(|(kind, _)| *kind)
            .filter(|kind| kind.is_recorded())
            .collect();
        let contents: Vec<_> = kinds
            .into_iter()
            .map(|kind| (kind, self.content(kind, now, drive, view)))
            .collect();
        let mut changes = Vec::new();
        for (kind, content) in contents {
            let (Some(content), Some((_, slot))) =
                (content, self.slots.iter_mut().find(|(it, _)| *it == kind))
            else {
                continue;
            };
            if !slot.record(&content, |old, new| {
                self.points.differ_on(kind, drive, old, new)
            }) {
                continue;
            }
            let register = kind
                .register()
                .and_then(|register| drive.model.registers.get(register));
            let at = register
                .and_then(|it| view.snapshot.read_at(it))
                .unwrap_or(now.at);
            let topic = below_drive(slot.topic(), drive).to_owned();
            let text = self.points.shown(kind, &content, drive).unwrap_or_default();
            let value = text
                .parse::<f64>()
                .map_or_else(|_| json!(text), |number| json!(number));
            let unit = match (kind, register) {
                (TopicKind::Polled(_), Some(register)) => Some(register.unit.symbol()),
                _ => None,
            };
            changes.push(TopicChange {
                drive: place,
                topic,
                at,
                value,
                unit,
            });
        }
        changes.sort_by_key(|change| change.at);
        changes
    }

    /// The content of a topic; `None` if it is to be left as it is.
    fn content(
        &self,
        kind: TopicKind,
        now: &RenderContext,
        drive: &DriveDescription,
        view: &DriveView,
    ) -> Option<TopicContent> {
        let trip = || Some(&view.trip).filter(|_| trips_are_fresh(drive, view, now.at));
        let word = |reading: Option<ValueReading>| {
            reading.map_or(TopicContent::Cleared, |it| TopicContent::Value(it.value))
        };
        Some(match kind {
            TopicKind::Availability => TopicContent::Text(
                if view.is_online() {
                    "online"
                } else {
                    "offline"
                }
                .into(),
            ),
            TopicKind::RunState => TopicContent::Text(answered_run_state(view).keyword().into()),
            TopicKind::Polled(register) | TopicKind::Rated(register) => word(
                drive
                    .model
                    .registers
                    .get(register)
                    .and_then(|it| fresh(drive, it, view, now.at)),
            ),
            TopicKind::Setpoint => written(view.control.as_ref().and_then(|it| it.setpoint)),
            TopicKind::Owner => written(
                view.control
                    .as_ref()
                    .and_then(|it| it.lease)
                    .map(|(owner, _)| owner),
            ),
            TopicKind::TripActive => written(trip().and_then(|it| it.active)),
            TopicKind::TripCount => written(view.trip_kept.count.filter(|_| trip().is_some())),
            TopicKind::TripCode => written(code(view).filter(|_| trip().is_some())),
            TopicKind::TripText => text(trip().and_then(|_| state::active_trip_text(drive, view))),
            TopicKind::WarningActive => written(warning(drive, view, now.at).map(|word| word != 0)),
            TopicKind::WarningCode => {
                written(warning(drive, view, now.at).map(|word| warnings::code(&drive.model, word)))
            }
            TopicKind::WarningText => text(
                warning(drive, view, now.at).and_then(|word| warnings::text(&drive.model, word)),
            ),
            // Without a record of our own, the earlier content of the topic is still true.
            TopicKind::TripLast => {
                let record = state::record(drive, now.clock, view.trip_kept.last.as_ref()?);
                TopicContent::Text(Value::Object(record).to_string().into())
            }
            TopicKind::Usage(part) => written(view.usage.value(part)),
            TopicKind::Param(register) => {
                let is_fresh = |reading: &&ValueReading| now.at < param_stale_at(now, reading);
                word(self.params.get(&register).filter(is_fresh).copied())
            }
        })
    }

    /// Until when nothing is due while the view stays the same.
    fn until(&self, now: &RenderContext, drive: &DriveDescription, view: &DriveView) -> MonoTime {
        let heartbeat = |kind| now.beating(self.points.heartbeat(kind)).heartbeat;
        let heartbeats = self
            .slots
            .iter()
            .map(|(kind, slot)| slot.due(heartbeat(*kind)));
        let ends = self
            .slots
            .iter()
            .filter_map(|(kind, slot)| self.ends_at(*kind, slot, now, drive, view));
        // The state shows staleness of every polled register, including those without a topic of their own.
        let polled = drive.model.registers.iter().filter(|it| it.poll.is_some());
        let stale = polled
            .filter_map(|it| stale_at(drive, it, view))
            .filter(|stale_at| *stale_at > now.at);
        let all = heartbeats
            .chain(ends)
            .chain(stale)
            .chain([self.state.due(now.heartbeat)]);
        all.min().unwrap_or(MonoTime::NEVER)
    }

    /// When the content of a topic is to be cleared.
    fn ends_at(
        &self,
        kind: TopicKind,
        slot: &TopicSlot,
        now: &RenderContext,
        drive: &DriveDescription,
        view: &DriveView,
    ) -> Option<MonoTime> {
        if !slot.is_filled() {
            return None;
        }
        let trips = drive.model.trip_register();
        let register = match kind {
            TopicKind::Polled(register) | TopicKind::Rated(register) => {
                drive.model.registers.get(register)
            }
            TopicKind::TripActive
            | TopicKind::TripCode
            | TopicKind::TripText
            | TopicKind::TripCount => trips,
            TopicKind::WarningActive | TopicKind::WarningCode | TopicKind::WarningText => {
                drive.model.warning_register()
            }
            TopicKind::Param(register) => {
                return self.params.get(&register).map(|it| param_stale_at(now, it));
            }
            _ => None,
        };
        stale_at(drive, register?, view)
    }

    /// When the finished walk is to be repeated; `None` while one is under way.
    pub(super) fn wake(&self) -> Option<MonoTime> {
        self.walked.as_ref().map(|(_, until)| *until)
    }
}

/// This text; without it the topic is empty.
fn text(text: Option<String>) -> TopicContent {
    text.map_or(TopicContent::Cleared, |text| {
        TopicContent::Text(text.into())
    })
}

fn written(value: Option<impl ToString>) -> TopicContent {
    text(value.map(|value| value.to_string()))
}

/// A value that was read once on demand is shown for as long as a broker may keep it.
fn param_stale_at(now: &RenderContext, reading: &ValueReading) -> MonoTime {
    reading.at + now.heartbeat * EXPIRY_HEARTBEATS
}

/// Whether what is known of trips is as recent as the register that shows them has to be. One that is not polled is
/// read in another way.
pub(in crate::north) fn trips_are_fresh(
    drive: &DriveDescription,
    view: &DriveView,
    at: MonoTime,
) -> bool {
    let polled = drive.model.trip_register().filter(|it| it.poll.is_some());
    polled.is_none_or(|register| fresh(drive, register, view, at).is_some())
}

/// The number of the cause of the active trip, 0 if none is active; `None` if that is not known.
pub(in crate::north) fn code(view: &DriveView) -> Option<u16> {
    if view.trip.active? {
        view.trip.last.as_ref()?.code
    } else {
        Some(0)
    }
}

/// The levels of `topic` below those of `drive`.
fn below_drive<'t>(topic: &'t str, drive: &DriveDescription) -> &'t str {
    let place = topic
        .find(&format!("/drive/{}/", drive.name))
        .map(|start| start + "/drive/".len());
    place
        .and_then(|start| topic.get(start + drive.name.as_str().len() + 1..))
        .unwrap_or(topic)
}
