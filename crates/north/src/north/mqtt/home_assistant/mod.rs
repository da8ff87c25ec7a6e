//! Discovery by Home Assistant: the gateway's entities are announced, again when Home Assistant is born, and taken back
//! when they are removed.
//!
//! [`DiscoveryPlant`] makes the announcements, [`DiscoveryWalk`] decides which one is sent next. It keeps no announcement, only its
//! position, and what is to be taken back. It learns what an earlier process of the gateway announced from the broker,
//! which sends what it has retained under the gateway's own node. Without that, only what this process announced is
//! taken back.

mod combined;
mod control;
mod drive;
mod entity;
mod gateway;
mod ids;
mod plant;

#[cfg(test)]
mod documents_tests;
#[cfg(test)]
mod session_tests;

pub(super) use plant::DiscoveryPlant;

use crate::domain::time::MonoTime;
use crate::north::broker::{BrokerMessage, Publication, Qos, SubscriptionFilter};
use plant::AnnouncementKind;
use std::collections::BTreeSet;
use std::ops::Bound;
use std::time::Duration;

/// Most announcements published in [`BURST_EVERY`]: after a birth everything else is sent first.
const BURST: u32 = 10;
const BURST_EVERY: Duration = Duration::from_millis(100);
/// Most announcements in flight, so that a slow broker has room for others.
const IN_FLIGHT_MAX: usize = 8;
/// Most that is remembered to be taken back: the entities of a hundred drives.
const GONE_MAX: usize = 4096;
/// After this time without another one the broker has sent what it has retained.
const QUIET: Duration = Duration::from_secs(1);
/// The wait for that is never longer.
const QUIET_MAX: Duration = Duration::from_secs(10);
/// Not all gateways answer a birth at once.
const JITTER_MAX_MS: u64 = 5_000;
/// Announces that the entity is announced in another way from now on, and keeps what users have made of it.
const MIGRATES: &[u8] = br#"{"migrate_discovery": true}"#;

/// What is announced to Home Assistant, and which step is next.
#[derive(Debug, Default)]
pub(super) struct DiscoveryWalk {
    /// What waits to be taken back before anything is announced.
    gone: BTreeSet<String>,
    /// What is announced in another way from now on: it is migrated before, and taken back afterwards.
    moving: BTreeSet<String>,
    /// What of that was migrated, in order, so far.
    migrated: Option<String>,
    /// The next announcement, device and entity; `None`: all are sent.
    walk: Option<(usize, usize)>,
    /// The path to the broker; `None` while there is none.
    way: Option<OpenPath>,
    /// When a birth is to be answered.
    again_at: Option<MonoTime>,
    /// When this burst began, and how many were sent in it.
    burst: (MonoTime, u32),
    last: u64,
    /// What the broker has not acknowledged.
    in_flight: BTreeSet<u64>,
}

/// An open path to the broker.
#[derive(Clone, Copy, Debug)]
struct OpenPath {
    opened_at: MonoTime,
    /// Until this moment earlier announcements may arrive.
    quiet_at: MonoTime,
}

impl DiscoveryWalk {
    /// The path to the broker is open.
    pub(super) fn opened(&mut self, at: MonoTime) {
        self.way = Some(OpenPath {
            opened_at: at,
            quiet_at: at + QUIET,
        });
        self.walk = Some((0, 0));
        self.again_at = None;
        self.migrated = None;
    }

    /// Whether it is announcing, or waits to.
    pub(super) const fn is_open(&self) -> bool {
        self.way.is_some()
    }

    /// The connection is lost: everything is announced on the next one.
    pub(super) fn lost(&mut self) {
        self.way = None;
        self.in_flight.clear();
    }

    /// The broker has the announcement with this number.
    pub(super) fn acknowledged(&mut self, number: u64) {
        self.in_flight.remove(&number);
    }

    /// Takes a message. False if it is neither from Home Assistant nor an announcement of ours.
    pub(super) fn take(
        &mut self,
        at: MonoTime,
        message: &BrokerMessage<'_>,
        plant: &DiscoveryPlant<'_>,
    ) -> bool {
        if plant.is_birth_topic(message.topic) {
            let is_birth = message.payload.trim_ascii().eq_ignore_ascii_case(b"online");
            if is_birth && plant.is_on() {
                self.birth(at, plant);
            }
            return true;
        }
        let Some((component, object)) = plant.parse(message.topic) else {
            return false;
        };
        if let Some(way) = self.way.as_mut().filter(|way| at < way.quiet_at) {
            way.quiet_at = (at + QUIET).min(way.opened_at + QUIET_MAX);
        }
        if message.payload.is_empty() || message.payload == MIGRATES {
            return true;
        }
        match plant.look(component, object, message.payload) {
            AnnouncementKind::Wanted => {}
            AnnouncementKind::Gone => self.take_back(message.topic),
            AnnouncementKind::OtherWay => self.move_over(message.topic),
        }
        true
    }

    /// What is announced before its turn is announced anyway.
    fn birth(&mut self, at: MonoTime, plant: &DiscoveryPlant<'_>) {
        if self.way.is_some_and(|way| at >= way.quiet_at) {
            let wait = Duration::from_millis(digest(&plant.node()) % (JITTER_MAX_MS + 1));
            self.again_at.get_or_insert(at + wait);
        }
    }

    fn take_back(&mut self, topic: &str) {
        if self.gone.len() + self.moving.len() < GONE_MAX && self.gone.insert(topic.to_owned()) {
            // Something else may be announced at the same topic.
            self.walk = Some((0, 0));
        }
    }

    fn move_over(&mut self, topic: &str) {
        if self.gone.len() + self.moving.len() < GONE_MAX && self.moving.insert(topic.to_owned()) {
            self.walk = Some((0, 0));
            self.migrated = None;
        }
    }

    /// The gateway has other drives and lines from now on.
    pub(super) fn replace(&mut self, old: &DiscoveryPlant<'_>, new: &DiscoveryPlant<'_>) {
        let wanted = new.all();
        self.gone.extend(
            old.all()
                .difference(&wanted)
                .map(|(topic, _)| topic.clone()),
        );
        while self.gone.len() > GONE_MAX {
            self.gone.pop_last();
        }
        self.walk = Some((0, 0));
    }

    /// The next publication, if it is time for one, with its number.
    pub(super) fn next(
        &mut self,
        at: MonoTime,
        plant: &DiscoveryPlant<'_>,
    ) -> Option<(Publication, u64)> {
        if self.again_at.is_some_and(|again_at| at >= again_at) {
            self.walk = Some((0, 0));
            self.again_at = None;
        }
        if self.wake()? > at {
            return None;
        }
        let publication = self.announcement(plant)?;
        if at.since(self.burst.0) >= BURST_EVERY {
            self.burst = (at, 0);
        }
        self.burst.1 += 1;
        self.last += 1;
        self.in_flight.insert(self.last);
        Some((publication, self.last))
    }

    fn announcement(&mut self, plant: &DiscoveryPlant<'_>) -> Option<Publication> {
        if let Some(topic) = self.gone.pop_first() {
            return Some(publication(topic, Vec::new(), true));
        }
        if let Some(topic) = self.next_to_migrate().cloned() {
            self.migrated = Some(topic.clone());
            return Some(publication(topic, MIGRATES.to_vec(), false));
        }
        while let Some((device, entity)) = self
            .walk
            .filter(|(device, _)| plant.is_on() && plant.has_device(*device))
        {
            if let Some((topic, payload)) = plant.announcement((device, entity)) {
                self.walk = Some((device, entity + 1));
                return Some(publication(topic, payload, true));
            }
            self.walk = Some((device + 1, 0));
        }
        self.walk = None;
        self.moving
            .pop_first()
            .map(|topic| publication(topic, Vec::new(), true))
    }

    /// The first entity to be migrated for which that was not announced yet.
    fn next_to_migrate(&self) -> Option<&String> {
        match &self.migrated {
            Some(migrated) => self
                .moving
                .range::<String, _>((Bound::Excluded(migrated), Bound::Unbounded))
                .next(),
            None => self.moving.first(),
        }
    }

    /// When something is to be published; `None` while there is nothing to publish, or no room in flight.
    pub(super) fn wake(&self) -> Option<MonoTime> {
        if self.in_flight.len() >= IN_FLIGHT_MAX {
            return None;
        }
        let way = self.way?;
        let has_work = self.walk.is_some() || !self.gone.is_empty() || !self.moving.is_empty();
        let (begun, gone) = self.burst;
        let room_at = if gone < BURST {
            begun
        } else {
            begun + BURST_EVERY
        };
        let work_at = has_work.then(|| room_at.max(way.quiet_at));
        [work_at, self.again_at].into_iter().flatten().min()
    }
}

impl DiscoveryPlant<'_> {
    /// What is subscribed. It is no failure if one of them is not granted.
    pub(super) fn subscriptions(&self) -> Vec<SubscriptionFilter> {
        self.filters()
            .into_iter()
            .map(|path| self.topics.filter(path, true))
            .collect()
    }
}

fn publication(topic: String, payload: Vec<u8>, retain: bool) -> Publication {
    Publication {
        retain,
        qos: Qos::AtLeastOnce,
        ..Publication::new(topic, payload)
    }
}

/// A number derived from a text (FNV-1a).
fn digest(text: &str) -> u64 {
    text.bytes().fold(0xCBF2_9CE4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
    })
}
