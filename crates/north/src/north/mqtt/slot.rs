//! One retained topic with what was last published on it.

use crate::domain::time::MonoTime;
use crate::north::broker::{Publication, Qos};
use crate::north::clock::LabelClock;
use crate::north::points::PointContent;
use crate::profile::scale::ScaledValue;
use std::time::Duration;

/// How many heartbeats a broker may keep telemetry that is not renewed (MQTT 5).
pub(super) const EXPIRY_HEARTBEATS: u32 = 3;

/// What publishing depends on besides the views.
#[derive(Clone, Copy, Debug)]
pub(super) struct RenderContext {
    pub(super) at: MonoTime,
    pub(super) clock: LabelClock,
    pub(super) heartbeat: Duration,
    /// Whether the broker may be given an expiry for telemetry (MQTT 5).
    pub(super) expires: bool,
}

impl RenderContext {
    /// This context with `heartbeat` in place of its own, if there is one.
    pub(super) fn beating(self, heartbeat: Option<Duration>) -> Self {
        Self {
            heartbeat: heartbeat.unwrap_or(self.heartbeat),
            ..self
        }
    }
}

/// One retained topic.
#[derive(Debug)]
pub(super) struct TopicSlot {
    topic: String,
    published: Option<(MonoTime, PointContent)>,
    /// The last content that was published or kept for later: it outlives the connection.
    latest: Option<PointContent>,
}

impl TopicSlot {
    pub(super) const fn new(topic: String) -> Self {
        Self {
            topic,
            published: None,
            latest: None,
        }
    }

    /// `content` if it is to be published now; from then on it counts as published. Words that `differ` does not
    /// distinguish are the same content.
    pub(super) fn offer(
        &mut self,
        now: &RenderContext,
        content: PointContent,
        differ: impl Fn(ScaledValue, ScaledValue) -> bool,
    ) -> Option<&PointContent> {
        let is_due = match (&self.published, &content) {
            (None, _) => true,
            (Some((_, PointContent::Unknown)), PointContent::Unknown) => false,
            (Some((at, PointContent::Value(old))), PointContent::Value(new)) => {
                differ(*old, *new) || now.at.since(*at) >= now.heartbeat
            }
            (Some((at, old)), new) => old != new || now.at.since(*at) >= now.heartbeat,
        };
        if !is_due {
            return None;
        }
        self.latest = Some(content.clone());
        Some(&self.published.insert((now.at, content)).1)
    }

    /// Whether `content` differs from what was last published or kept; from then on it counts as such. The first
    /// content of all is no change, nor is a value becoming unknown.
    pub(super) fn record(
        &mut self,
        content: &PointContent,
        differ: impl Fn(ScaledValue, ScaledValue) -> bool,
    ) -> bool {
        let is_new = match (&self.latest, content) {
            (_, PointContent::Unknown) => return false,
            (Some(PointContent::Value(old)), PointContent::Value(new)) => differ(*old, *new),
            (old, new) => old.as_ref() != Some(new),
        };
        let is_first = self.latest.is_none();
        if is_new {
            self.latest = Some(content.clone());
        }
        is_new && !is_first
    }

    /// The topic.
    pub(super) fn topic(&self) -> &str {
        &self.topic
    }

    /// Whether the topic is not empty.
    pub(super) const fn is_filled(&self) -> bool {
        !matches!(self.published, None | Some((_, PointContent::Unknown)))
    }

    /// When it is published again although unchanged.
    pub(super) fn due(&self, heartbeat: Duration) -> MonoTime {
        match &self.published {
            None | Some((_, PointContent::Unknown)) => MonoTime::NEVER,
            Some((at, _)) => *at + heartbeat,
        }
    }

    /// Records what would be published if the topic were published.
    pub(super) fn see(&mut self, content: PointContent) {
        self.latest = Some(content);
    }

    /// Forgets what was published, so that it is published again.
    pub(super) fn forget(&mut self) {
        self.published = None;
    }

    /// Its publication with `payload`; an empty one clears the topic.
    pub(super) fn publication(
        &self,
        now: &RenderContext,
        payload: Vec<u8>,
        qos: Qos,
    ) -> Publication {
        retained(now, self.topic.clone(), payload, qos)
    }
}

/// A retained publication of telemetry.
pub(super) fn retained(
    now: &RenderContext,
    topic: String,
    payload: Vec<u8>,
    qos: Qos,
) -> Publication {
    let expiry = (now.expires && !payload.is_empty()).then(|| now.heartbeat * EXPIRY_HEARTBEATS);
    Publication {
        retain: true,
        qos,
        expiry,
        ..Publication::new(topic, payload)
    }
}
