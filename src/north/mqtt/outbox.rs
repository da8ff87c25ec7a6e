//! Trip events on their way to the broker: in order, each until the broker acknowledged it.

use serde_json::{Map, Value};
use std::collections::VecDeque;

/// Most events that are kept.
const KEPT_MAX: usize = 1_024;
/// Most events that the broker has not acknowledged on this connection.
const IN_FLIGHT_MAX: usize = 16;

/// One event.
#[derive(Debug)]
struct Entry {
    seq: u64,
    topic: String,
    body: Map<String, Value>,
    /// How many events before it were dropped.
    lost: u64,
}

/// The events that are not acknowledged, oldest first. Those at the front are in flight.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    entries: VecDeque<Entry>,
    in_flight: usize,
    last_seq: u64,
}

impl Outbox {
    /// Adds an event, which gets the next sequence number. True if one had to give way for it.
    pub(super) fn add(&mut self, topic: String, body: Map<String, Value>) -> bool {
        self.last_seq += 1;
        self.entries.push_back(Entry { seq: self.last_seq, topic, body, lost: 0 });
        self.entries.len() > KEPT_MAX && self.drop_oldest()
    }

    /// Drops the oldest that is not in flight. The one behind it says so.
    fn drop_oldest(&mut self) -> bool {
        let Some(dropped) = self.entries.remove(self.in_flight) else { return false };
        if let Some(next) = self.entries.get_mut(self.in_flight) {
            next.lost += dropped.lost + 1;
        }
        true
    }

    /// Topic, payload and token of the next event to be sent on this connection.
    pub(super) fn next(&mut self) -> Option<(String, Vec<u8>, u64)> {
        if self.in_flight >= IN_FLIGHT_MAX {
            return None;
        }
        let entry = self.entries.get(self.in_flight)?;
        self.in_flight += 1;
        let mut body = entry.body.clone();
        body.insert("seq".to_owned(), entry.seq.into());
        if entry.lost > 0 {
            body.insert("lost".to_owned(), entry.lost.into());
        }
        Some((entry.topic.clone(), Value::Object(body).to_string().into_bytes(), entry.seq))
    }

    /// The broker has the event with this token.
    pub(super) fn acknowledged(&mut self, token: u64) {
        let place = self.entries.iter().take(self.in_flight).position(|entry| entry.seq == token);
        if let Some(place) = place {
            self.entries.remove(place);
            self.in_flight -= 1;
        }
    }

    /// The connection is gone: what was in flight goes again.
    pub(super) const fn lost(&mut self) {
        self.in_flight = 0;
    }

    /// How many are not acknowledged.
    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(outbox: &mut Outbox) -> Vec<u64> {
        std::iter::from_fn(|| outbox.next().map(|(_, _, token)| token)).collect()
    }

    fn filled(count: usize) -> Outbox {
        let mut outbox = Outbox::default();
        (0..count).for_each(|_| assert!(!outbox.add("t".into(), Map::new())));
        outbox
    }

    #[test]
    fn events_go_in_order_again_until_each_is_acknowledged() {
        let mut outbox = filled(20);
        assert_eq!(sent(&mut outbox), (1..=16).collect::<Vec<_>>());
        [1, 3, 99].into_iter().for_each(|token| outbox.acknowledged(token));
        assert_eq!(sent(&mut outbox), [17, 18]);
        outbox.lost();
        outbox.acknowledged(2);
        let again: Vec<_> = [2].into_iter().chain(4..=18).collect();
        assert_eq!(sent(&mut outbox), again, "an acknowledgement of the connection before counts for nothing");
    }

    #[test]
    fn the_oldest_gives_way_and_the_next_one_says_so() {
        let mut outbox = filled(KEPT_MAX);
        assert_eq!(sent(&mut outbox).len(), IN_FLIGHT_MAX);
        assert!(outbox.add("t".into(), Map::new()) && outbox.add("t".into(), Map::new()));
        assert_eq!(outbox.len(), KEPT_MAX);
        outbox.acknowledged(1);
        let (_, payload, token) = outbox.next().unwrap();
        assert_eq!((token, &payload[..]), (19, &br#"{"lost":2,"seq":19}"#[..]));
    }
}
