//! Telemetry of the time without a broker, published once it is back.

use super::in_flight::InFlight;
use super::topics::MqttTopics;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::north::broker::PublicationRefusal;
use crate::north::clock::LabelClock;
use serde_json::{Value, json};
use std::time::Duration;

/// Most changes published in [`BURST_EVERY`]: after an outage the present is sent first, and a broker that has just
/// come back is not flooded.
const BURST: u32 = 20;
const BURST_EVERY: Duration = Duration::from_millis(100);

/// A topic whose content changed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TopicChange {
    /// Place of the drive in the session's list.
    pub(super) drive: usize,
    /// The topic below the drive's.
    pub(super) topic: String,
    /// When it changed.
    pub(super) at: MonoTime,
    /// Its new content: a number, or a word.
    pub(super) value: Value,
    /// The unit, if the topic's name does not state it.
    pub(super) unit: Option<&'static str>,
}

/// The changes that the broker does not have, oldest first.
#[derive(Debug)]
pub(super) struct ChangeHistory {
    most: usize,
    changes: InFlight<TopicChange>,
    last: u64,
    /// When this burst began, and how many were sent in it.
    burst: (MonoTime, u32),
}

impl ChangeHistory {
    /// Keeps at most this many; 0: none.
    pub(super) fn new(most: usize) -> Self {
        Self {
            most,
            changes: InFlight::default(),
            last: 0,
            burst: (MonoTime::ZERO, 0),
        }
    }

    /// Whether anything is kept at all.
    pub(super) const fn is_on(&self) -> bool {
        self.most > 0
    }

    /// Keeps a change. True if an older one had to give way for it.
    pub(super) fn add(&mut self, change: TopicChange) -> bool {
        self.last += 1;
        self.changes.push(self.last, change);
        self.changes.len() > self.most && self.changes.drop_oldest().is_some()
    }

    /// Topic, payload and number of the next change to be published on this connection, if it is time for one.
    pub(super) fn next(
        &mut self,
        at: MonoTime,
        topics: &MqttTopics,
        clock: LabelClock,
        drives: &[DriveDescription],
    ) -> Option<(String, Vec<u8>, u64)> {
        if at.since(self.burst.0) >= BURST_EVERY {
            self.burst = (at, 0);
        }
        if self.burst.1 >= BURST {
            return None;
        }
        let (number, change) = self.changes.next(at)?;
        self.burst.1 += 1;
        let drive = drives.get(change.drive)?;
        let topic = topics.drive(drive.name.as_str(), "history");
        Some((
            topic,
            document(change, clock).to_string().into_bytes(),
            number,
        ))
    }

    /// When the next one may be sent.
    pub(super) fn wake(&self) -> Option<MonoTime> {
        let (begun, gone) = self.burst;
        let burst = if gone < BURST {
            begun
        } else {
            begun + BURST_EVERY
        };
        self.changes.wake().map(|wake| wake.max(burst))
    }

    /// The broker has the change with this number.
    pub(super) fn acknowledged(&mut self, number: u64) {
        self.changes.acknowledged(number);
    }

    /// The broker refuses the change with this number. True if it is given up.
    pub(super) fn refused(
        &mut self,
        at: MonoTime,
        number: u64,
        refusal: PublicationRefusal,
    ) -> bool {
        self.changes.refused(at, number, refusal).is_some()
    }

    /// The connection is lost: what was in flight is sent again.
    pub(super) fn lost(&mut self) {
        self.changes.lost();
    }

    /// How many are not acknowledged.
    pub(super) fn len(&self) -> usize {
        self.changes.len()
    }
}

fn document(change: &TopicChange, clock: LabelClock) -> Value {
    json!({
        "at": clock.text(change.at),
        "is_historical": true,
        "topic": change.topic,
        "value": change.value,
        "unit": change.unit,
    })
}
