//! The retained topics of one drive: the content of each, and which is to be published next.

use super::history::TopicChange;
use super::slot::{EXPIRY_HEARTBEATS, RenderContext, TopicSlot};
use super::state::StateSlot;
use super::topics::MqttTopics;
use super::types::{Settings, TopicTree};
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::snapshot::ValueReading;
use crate::drive::view::DriveView;
use crate::north::broker::{Publication, Qos};
use crate::north::points::{
    DrivePoint, PointContent, PointContext, PointGroup, PublishedPoints, points_of,
};
use crate::north::shown::stale_at;
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The retained topics of one drive.
#[derive(Debug)]
pub(super) struct DriveTopics {
    slots: Vec<(DrivePoint, TopicSlot)>,
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
        let slot = |(point, rest): (DrivePoint, String)| {
            (
                point,
                TopicSlot::new(topics.drive(drive.name.as_str(), &rest)),
            )
        };
        Self {
            slots: points_of(drive).into_iter().map(slot).collect(),
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
            .map(|(point, slot)| (tree_of(*point), slot.topic()));
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
            .find(|(point, _)| *point == DrivePoint::Param(register));
        match known {
            Some((_, slot)) => slot.forget(),
            None => self
                .slots
                .push((DrivePoint::Param(register), TopicSlot::new(topic))),
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
        let point = self.slots.get(place)?.0;
        let content = self.content(point, now, drive, view)?;
        if !self.publishes(tree_of(point)) {
            self.slots.get_mut(place)?.1.see(content);
            return None;
        }
        let now = now.beating(self.points.heartbeat(point));
        let points = &self.points;
        let slot = &mut self.slots.get_mut(place)?.1;
        let differ = |old, new| points.differ_on(point, drive, old, new);
        let content = slot.offer(&now, content, differ)?;
        // Most walks publish nothing, so the text is written only here.
        let payload = points
            .shown(point, content, drive)
            .unwrap_or_default()
            .into_bytes();
        let qos = if point == DrivePoint::Availability {
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
        let points: Vec<_> = self
            .slots
            .iter()
            .map(|(point, _)| *point)
            .filter(|point| point.is_recorded())
            .collect();
        let contents: Vec<_> = points
            .into_iter()
            .map(|point| (point, self.content(point, now, drive, view)))
            .collect();
        let mut changes = Vec::new();
        for (point, content) in contents {
            let (Some(content), Some((_, slot))) =
                (content, self.slots.iter_mut().find(|(it, _)| *it == point))
            else {
                continue;
            };
            if !slot.record(&content, |old, new| {
                self.points.differ_on(point, drive, old, new)
            }) {
                continue;
            }
            let register = point
                .register()
                .and_then(|register| drive.model.registers.get(register));
            let at = register
                .and_then(|it| view.snapshot.read_at(it))
                .unwrap_or(now.at);
            let topic = below_drive(slot.topic(), drive).to_owned();
            let text = self
                .points
                .shown(point, &content, drive)
                .unwrap_or_default();
            let value = text
                .parse::<f64>()
                .map_or_else(|_| json!(text), |number| json!(number));
            let unit = match (point, register) {
                (DrivePoint::Polled(_), Some(register)) => Some(register.unit.symbol()),
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
        point: DrivePoint,
        now: &RenderContext,
        drive: &DriveDescription,
        view: &DriveView,
    ) -> Option<PointContent> {
        if let DrivePoint::Param(register) = point {
            let is_fresh = |reading: &&ValueReading| now.at < param_stale_at(now, reading);
            let reading = self.params.get(&register).filter(is_fresh);
            return Some(reading.map_or(PointContent::Unknown, |it| PointContent::Value(it.value)));
        }
        let content = point.content(&PointContext {
            at: now.at,
            clock: now.clock,
            drive,
            view,
        });
        let is_left = content == PointContent::Unknown
            && matches!(point, DrivePoint::Plain(point) if point.group == PointGroup::TripRecord);
        (!is_left).then_some(content)
    }

    /// Until when nothing is due while the view stays the same.
    fn until(&self, now: &RenderContext, drive: &DriveDescription, view: &DriveView) -> MonoTime {
        let heartbeat = |point| now.beating(self.points.heartbeat(point)).heartbeat;
        let heartbeats = self
            .slots
            .iter()
            .map(|(point, slot)| slot.due(heartbeat(*point)));
        let ends = self
            .slots
            .iter()
            .filter_map(|(point, slot)| self.ends_at(*point, slot, now, drive, view));
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
        point: DrivePoint,
        slot: &TopicSlot,
        now: &RenderContext,
        drive: &DriveDescription,
        view: &DriveView,
    ) -> Option<MonoTime> {
        if !slot.is_filled() {
            return None;
        }
        if let DrivePoint::Param(register) = point {
            return self.params.get(&register).map(|it| param_stale_at(now, it));
        }
        stale_at(drive, point.rests_on(drive)?, view)
    }

    /// When the finished walk is to be repeated; `None` while one is under way.
    pub(super) fn wake(&self) -> Option<MonoTime> {
        self.walked.as_ref().map(|(_, until)| *until)
    }
}

/// The tree that `point` is part of; `None`: it is always published.
const fn tree_of(point: DrivePoint) -> Option<TopicTree> {
    match point {
        DrivePoint::Availability => None,
        DrivePoint::Param(_) => Some(TopicTree::Param),
        _ => Some(TopicTree::Values),
    }
}

/// A value that was read once on demand is shown for as long as a broker may keep it.
fn param_stale_at(now: &RenderContext, reading: &ValueReading) -> MonoTime {
    reading.at + now.heartbeat * EXPIRY_HEARTBEATS
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
