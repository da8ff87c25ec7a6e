//! One retained topic with what was last published on it.

use super::clock::Clock;
use super::types::{Publication, Qos};
use crate::domain::time::MonoTime;
use std::borrow::Cow;
use std::time::Duration;

/// How many heartbeats a broker may keep telemetry that is not renewed (MQTT 5).
pub(super) const EXPIRY_HEARTBEATS: u32 = 3;

/// What publishing depends on besides the pictures.
#[derive(Clone, Copy, Debug)]
pub(super) struct Present {
    pub(super) at: MonoTime,
    pub(super) clock: Clock,
    pub(super) heartbeat: Duration,
    /// How long the broker may keep telemetry (MQTT 5).
    pub(super) expiry: Option<Duration>,
}

/// What stands on a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Content {
    /// Nothing.
    Cleared,
    /// This text.
    Text(Cow<'static, str>),
    /// The value of a register that holds this word.
    Word(u16),
}

/// One retained topic.
#[derive(Debug)]
pub(super) struct Slot {
    topic: String,
    published: Option<(MonoTime, Content)>,
}

impl Slot {
    pub(super) const fn new(topic: String) -> Self {
        Self { topic, published: None }
    }

    /// Whether `content` is to be published now; from then on it counts as published. Words that `differ` does not
    /// tell apart are the same content.
    pub(super) fn offer(&mut self, now: &Present, content: Content, differ: impl Fn(u16, u16) -> bool) -> bool {
        let is_due = match (&self.published, &content) {
            (None, _) => true,
            (Some((_, Content::Cleared)), Content::Cleared) => false,
            (Some((at, Content::Word(old))), Content::Word(new)) => {
                differ(*old, *new) || now.at.since(*at) >= now.heartbeat
            }
            (Some((at, old)), new) => old != new || now.at.since(*at) >= now.heartbeat,
        };
        if is_due {
            self.published = Some((now.at, content));
        }
        is_due
    }

    /// The topic.
    pub(super) fn topic(&self) -> &str {
        &self.topic
    }

    /// Whether something stands on the topic.
    pub(super) const fn is_filled(&self) -> bool {
        matches!(self.published, Some((_, Content::Text(_) | Content::Word(_))))
    }

    /// When it is published again though nothing changed.
    pub(super) fn due(&self, heartbeat: Duration) -> MonoTime {
        match &self.published {
            Some((at, Content::Text(_) | Content::Word(_))) => *at + heartbeat,
            _ => MonoTime::NEVER,
        }
    }

    /// Forgets what was published, so that it is published again.
    pub(super) fn forget(&mut self) {
        self.published = None;
    }

    /// Its publication with `payload`; an empty one clears the topic.
    pub(super) fn publication(&self, now: &Present, payload: Vec<u8>, qos: Qos) -> Publication {
        retained(now, self.topic.clone(), payload, qos)
    }
}

/// A retained publication of telemetry.
pub(super) fn retained(now: &Present, topic: String, payload: Vec<u8>, qos: Qos) -> Publication {
    let expiry = now.expiry.filter(|_| !payload.is_empty());
    Publication { topic, payload, retain: true, qos, expiry, correlation: None, token: None }
}
