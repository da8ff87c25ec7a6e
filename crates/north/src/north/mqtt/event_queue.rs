//! Trip events on their way to the broker if no journal keeps them: in order, each until the broker has acknowledged
//! it.

use super::in_flight::InFlight;
use super::peer_events::EventMark;
use crate::domain::time::MonoTime;
use crate::north::broker::PublicationRefusal;
use serde_json::{Map, Value};

/// Most events that are kept.
const KEPT_MAX: usize = 1_024;

/// One event.
#[derive(Debug)]
struct QueuedEvent {
    topic: String,
    body: Map<String, Value>,
    mark: EventMark,
    /// How many events before it were dropped.
    lost: u64,
}

/// The events that are not acknowledged, numbered from 1.
#[derive(Debug, Default)]
pub(super) struct EventQueue {
    entries: InFlight<QueuedEvent>,
    last_seq: u64,
}

impl EventQueue {
    /// Adds an event, which gets the next sequence number. True if an older one had to be dropped for it.
    pub(super) fn add(&mut self, topic: String, body: Map<String, Value>, mark: EventMark) -> bool {
        self.last_seq += 1;
        self.entries.push(
            self.last_seq,
            QueuedEvent {
                topic,
                body,
                mark,
                lost: 0,
            },
        );
        self.entries.len() > KEPT_MAX && self.drop_oldest()
    }

    /// Drops the oldest that is not in flight. The one after it carries the count.
    fn drop_oldest(&mut self) -> bool {
        let Some((dropped, next)) = self.entries.drop_oldest() else {
            return false;
        };
        if let Some(next) = next {
            next.lost += dropped.lost + 1;
        }
        true
    }

    /// Topic, payload and number of the next event to be sent on this connection, among those that `may` be published.
    pub(super) fn next(
        &mut self,
        at: MonoTime,
        may: impl Fn(&EventMark) -> bool,
    ) -> Option<(String, Vec<u8>, u64)> {
        let (seq, entry) = self.entries.next_of(at, |entry| may(&entry.mark))?;
        let mut body = entry.body.clone();
        body.insert("seq".to_owned(), seq.into());
        if entry.lost > 0 {
            body.insert("lost".to_owned(), entry.lost.into());
        }
        Some((
            entry.topic.clone(),
            Value::Object(body).to_string().into_bytes(),
            seq,
        ))
    }

    /// Drops the oldest waiting event that `was_published` by another gateway. True if there was one.
    pub(super) fn drop_published(
        &mut self,
        mut was_published: impl FnMut(&EventMark) -> bool,
    ) -> bool {
        self.entries
            .drop_waiting(|entry| was_published(&entry.mark))
            .is_some()
    }

    /// The broker acknowledged the event with this number.
    pub(super) fn acknowledged(&mut self, seq: u64) {
        self.entries.acknowledged(seq);
    }

    /// The broker refuses the event with this number. True if it is given up.
    pub(super) fn refused(&mut self, at: MonoTime, seq: u64, refusal: PublicationRefusal) -> bool {
        self.entries.refused(at, seq, refusal).is_some()
    }

    /// When one that was refused is sent again.
    pub(super) fn wake(&self, may: impl Fn(&EventMark) -> bool) -> Option<MonoTime> {
        self.entries.again_at_of(|entry| may(&entry.mark))
    }

    /// The connection is lost: what was in flight is sent again.
    pub(super) fn lost(&mut self) {
        self.entries.lost();
    }

    /// How many are not acknowledged.
    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }
}

#[cfg(test)]
mod tests {
    use super::super::in_flight::IN_FLIGHT_MAX;
    use super::*;

    fn add(events: &mut EventQueue) -> bool {
        events.add("t".into(), Map::new(), EventMark::default())
    }

    #[test]
    fn the_oldest_gives_way_and_the_next_one_says_so() {
        let mut events = EventQueue::default();
        (0..KEPT_MAX).for_each(|_| assert!(!add(&mut events)));
        assert_eq!(
            std::iter::from_fn(|| events.next(MonoTime::ZERO, |_| true)).count(),
            IN_FLIGHT_MAX
        );
        assert!(add(&mut events) && add(&mut events));
        assert_eq!(events.len(), KEPT_MAX);
        events.acknowledged(1);
        let (_, payload, seq) = events.next(MonoTime::ZERO, |_| true).unwrap();
        assert_eq!((seq, &payload[..]), (19, &br#"{"lost":2,"seq":19}"#[..]));
    }
}
