//! Trip events that another gateway of the same name publishes: what both have seen is published once.
//!
//! Each gateway numbers its events itself, and their clocks need not agree. The same event is known by its drive, its
//! kind, and the drive's own count and code. Repeats of a trip are distinguished by their order: each event that is
//! received stands for one of our own.

use crate::domain::time::MonoTime;
use serde_json::{Map, Value};
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// Most events that are remembered until this gateway has seen them itself, and most drives with a last trip.
const RECEIVED_MAX: usize = 256;
/// How long an event is remembered that has no count of the drive. What was not seen here by then was not seen here at all.
/// One with a count may be: a listener reads no record, and reports the trip when it has the line.
const REMEMBERED_FOR: Duration = Duration::from_secs(60);

/// What distinguishes an event from others of the same drive.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct EventMark {
    drive: String,
    kind: String,
    count: Value,
    code: Value,
    values: Value,
    /// It was found at the drive, and not seen to happen.
    while_away: bool,
}

impl EventMark {
    /// The mark of an event with this body. A body without drive or kind is like no other.
    pub(super) fn of(drive: &str, body: &Map<String, Value>) -> Self {
        let value = |key: &str| body.get(key).cloned().unwrap_or_default();
        let kind = value("kind").as_str().unwrap_or_default().to_owned();
        let values = value("values");
        let while_away = value("while_away") == true;
        Self {
            drive: drive.to_owned(),
            kind,
            count: value("count"),
            code: value("code"),
            values,
            while_away,
        }
    }

    /// The drive.
    pub(super) fn drive(&self) -> &str {
        &self.drive
    }

    /// Whether both gateways mean the same event.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        let is_known = !self.drive.is_empty() && !self.kind.is_empty();
        let agree = |one: &Value, other: &Value| one.is_null() || other.is_null() || one == other;
        is_known
            && (&self.drive, &self.kind) == (&other.drive, &other.kind)
            && agree(&self.count, &other.count)
            && agree(&self.code, &other.code)
    }

    /// Whether both gateways mean the same trip, for one received long ago: only the drive's own count distinguishes
    /// it from a later one.
    fn is_the_same_trip(&self, other: &Self) -> bool {
        let agree = self.has_no_values() || other.has_no_values() || self.values == other.values;
        self.kind == "tripped"
            && self.count.is_number()
            && self.count == other.count
            && agree
            && self.is_same(other)
    }

    fn has_no_values(&self) -> bool {
        self.values.as_object().is_none_or(Map::is_empty)
    }

    /// Whether the retained `last` record of the drive is of this trip. One that was seen to happen and has no record may
    /// be a newer one for the same cause.
    fn is_last(&self, last: &Map<String, Value>) -> bool {
        let is_the_values =
            |values: &Value| self.values == *values || (self.while_away && self.has_no_values());
        let code = last.get("code");
        self.kind == "tripped"
            && code.is_some_and(|code| self.code.is_null() || self.code == *code)
            && last.get("values").is_some_and(is_the_values)
    }
}

/// Events that other gateways have published and that were not seen here yet.
#[derive(Debug, Default)]
pub(super) struct PeerEvents {
    received: VecDeque<(MonoTime, EventMark)>,
    /// The last trip of each drive as the broker had it when this gateway connected.
    last: BTreeMap<String, Map<String, Value>>,
}

impl PeerEvents {
    /// Remembers an event that another gateway has published and that no event of ours is known to be.
    pub(super) fn remember(&mut self, at: MonoTime, mark: EventMark) {
        self.received.retain(|(received_at, mark)| {
            mark.count.is_number() || at.since(*received_at) < REMEMBERED_FOR
        });
        if self.received.len() >= RECEIVED_MAX {
            self.received.pop_front();
        }
        self.received.push_back((at, mark));
    }

    /// Remembers the retained record of the last trip of `drive`.
    pub(super) fn remember_last(&mut self, drive: &str, record: Map<String, Value>) {
        if self.last.len() < RECEIVED_MAX || self.last.contains_key(drive) {
            self.last.insert(drive.to_owned(), record);
        }
    }

    /// Whether an event of ours that comes now was already published by another gateway, which is forgotten then.
    pub(super) fn take(&mut self, at: MonoTime, own: &EventMark) -> bool {
        let is_it = |(received_at, mark): &(MonoTime, EventMark)| {
            if at.since(*received_at) < REMEMBERED_FOR {
                mark.is_same(own)
            } else {
                mark.is_the_same_trip(own)
            }
        };
        if let Some(place) = self.received.iter().position(is_it) {
            self.received.remove(place);
            return true;
        }
        self.take_last(own)
    }

    /// Whether an event of ours is the last trip of its drive, as the broker had it. That trip is forgotten then.
    pub(super) fn take_last(&mut self, own: &EventMark) -> bool {
        let is_last = self
            .last
            .get(own.drive())
            .is_some_and(|last| own.is_last(last));
        is_last && self.last.remove(own.drive()).is_some()
    }

    /// The connection is lost: the next one brings what the broker has then.
    pub(super) fn lost(&mut self) {
        self.last.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn mark(body: &Value) -> EventMark {
        EventMark::of("pump", body.as_object().unwrap())
    }

    #[test]
    fn the_same_event_is_known_by_kind_count_and_code() {
        let trip =
            mark(&json!({ "kind": "tripped", "count": 3, "code": 9, "at": "one", "seq": 1 }));
        for (other, is_same) in [
            (
                json!({ "kind": "tripped", "count": 3, "code": 9, "at": "two", "seq": 7 }),
                true,
            ),
            (json!({ "kind": "tripped", "count": null, "code": 9 }), true),
            (json!({ "kind": "tripped", "count": 3, "code": null }), true),
            (json!({ "kind": "tripped", "count": 4, "code": 9 }), false),
            (json!({ "kind": "tripped", "count": 3, "code": 8 }), false),
            (json!({ "kind": "cleared", "count": 3 }), false),
            (json!({}), false),
        ] {
            assert_eq!(trip.is_same(&mark(&other)), is_same, "{other}");
        }
        let of_another = EventMark::of(
            "fan",
            json!({ "kind": "tripped", "count": 3, "code": 9 })
                .as_object()
                .unwrap(),
        );
        assert!(!trip.is_same(&of_another));
        assert!(
            !mark(&json!({})).is_same(&mark(&json!({}))),
            "what is not understood is like no other"
        );
    }

    /// A listener that was restarted, or off the line, finds a trip minutes after the other one has published it.
    #[test]
    fn a_counted_trip_is_known_again_however_late_it_is_found() {
        let at = MonoTime::from_millis;
        let trip = |values: Value| {
            mark(&json!({ "kind": "tripped", "count": 3, "code": 9, "values": values }))
        };
        for (own, is_published) in [
            (json!({ "a": 1 }), true),
            (json!({}), true),
            (json!({ "a": 2 }), false),
        ] {
            let mut peer_events = PeerEvents::default();
            peer_events.remember(at(0), trip(json!({ "a": 1 })));
            peer_events.remember(at(300_000), mark(&json!({ "kind": "cleared" })));
            assert_eq!(
                peer_events.take(at(600_000), &trip(own.clone())),
                is_published,
                "{own}"
            );
        }
    }

    #[test]
    fn each_received_event_stands_for_one_of_ours_for_a_minute() {
        let mut peer_events = PeerEvents::default();
        let cleared = mark(&json!({ "kind": "cleared" }));
        let at = MonoTime::from_millis;
        peer_events.remember(at(0), cleared.clone());
        peer_events.remember(at(10_000), cleared.clone());
        assert_eq!(
            [1, 2, 3].map(|ms| peer_events.take(at(ms), &cleared)),
            [true, true, false]
        );
        peer_events.remember(at(0), cleared.clone());
        assert!(!peer_events.take(at(60_000), &cleared));
        (0..1_000).for_each(|_| peer_events.remember(at(60_000), cleared.clone()));
        assert_eq!(peer_events.received.len(), RECEIVED_MAX);
    }

    #[test]
    fn the_retained_record_stands_for_the_trip_with_its_values() {
        let record = json!({ "at": "then", "code": 9, "values": { "hours": 7 } });
        for (own, is_it) in [
            (
                json!({ "kind": "tripped", "count": 1, "code": 9, "values": { "hours": 7 } }),
                true,
            ),
            (
                json!({ "kind": "tripped", "count": 1, "code": null, "values": {}, "while_away": true }),
                true,
            ),
            (
                json!({ "kind": "tripped", "count": 1, "code": null, "values": {} }),
                false,
            ),
            (
                json!({ "kind": "tripped", "count": 1, "code": 9, "values": { "hours": 8 } }),
                false,
            ),
            (
                json!({ "kind": "tripped", "count": 1, "code": 8, "values": { "hours": 7 } }),
                false,
            ),
            (json!({ "kind": "cleared", "count": 1 }), false),
        ] {
            let mut peer_events = PeerEvents::default();
            peer_events.remember_last("pump", record.as_object().unwrap().clone());
            assert_eq!(
                peer_events.take(MonoTime::ZERO, &mark(&own)),
                is_it,
                "{own}"
            );
            assert!(!peer_events.take(MonoTime::ZERO, &mark(&own)), "once");
        }
    }
}
