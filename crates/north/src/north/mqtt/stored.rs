//! Events that a journal keeps, on their way to the broker. What does not fit here stays in the journal: events are
//! taken from it when there is room, in the order of their numbers, and those that the broker has are reported to it.

use super::in_flight::{IN_FLIGHT_MAX, InFlight};
use super::peer_events::EventMark;
use super::session::MqttSession;
use crate::domain::time::MonoTime;
use crate::journal::StoredEvent;
use crate::north::broker::{PublicationRefusal, SessionAct};
use crate::north::clock::ClockMoment;
use serde_json::{Map, Value};
use std::collections::VecDeque;

/// Most events that are taken from the journal and not acknowledged.
const WAITING_MAX: usize = 4 * IN_FLIGHT_MAX;

/// The events that were taken from the journal.
#[derive(Debug, Default)]
pub(super) struct StoredEvents {
    /// Topic and payload of each, and its mark.
    waiting: InFlight<(String, Vec<u8>, EventMark)>,
    /// The highest number that was taken so far.
    newest: u64,
    /// The journal was asked for those after that.
    is_asked: bool,
    /// The journal is to be asked.
    wants: bool,
    /// What the broker has or refused, and was not reported to the journal yet. Each was waiting or just taken.
    taken: VecDeque<u64>,
    /// What marks the events of our journal.
    session: Option<String>,
}

impl StoredEvents {
    /// The path to the broker is open.
    pub(super) const fn opened(&mut self) {
        self.wants = true;
    }

    /// The connection is lost: what was in flight is sent again, and the journal is asked again on the next one.
    pub(super) fn lost(&mut self) {
        self.waiting.lost();
        self.wants = false;
        self.is_asked = false;
    }

    /// `place`: topic and mark of an event; `None` if another gateway has published it.
    fn take(
        &mut self,
        events: &[StoredEvent],
        more: bool,
        mut place: impl FnMut(&StoredEvent) -> Option<(String, EventMark)>,
    ) {
        if events.is_empty() {
            // A bell. Without `more`, what was requested arrives as soon as it exists.
            self.wants |= more;
            return;
        }
        self.wants = true;
        // What was not requested need not follow what was taken: it is requested.
        if !std::mem::take(&mut self.is_asked) {
            return;
        }
        for event in events {
            if self.waiting.len() >= WAITING_MAX {
                return;
            }
            if event.seq > self.newest {
                self.newest = event.seq;
                match place(event) {
                    Some((topic, mark)) => {
                        self.waiting
                            .push(event.seq, (topic, event.body.clone().into_bytes(), mark));
                    }
                    None => self.taken.push_back(event.seq),
                }
            }
        }
    }

    /// Topic, payload and number of the next event to be sent on this connection, among those that `may` be published.
    pub(super) fn next(
        &mut self,
        at: MonoTime,
        may: impl Fn(&EventMark) -> bool,
    ) -> Option<(String, Vec<u8>, u64)> {
        let (seq, (topic, payload, _)) = self.waiting.next_of(at, |(_, _, mark)| may(mark))?;
        Some((topic.clone(), payload.clone(), seq))
    }

    /// Drops the oldest waiting event that `was_published` by another gateway: it is not to be published any more. True if
    /// there was one.
    pub(super) fn drop_published(
        &mut self,
        mut was_published: impl FnMut(&EventMark) -> bool,
    ) -> bool {
        let dropped = self
            .waiting
            .drop_waiting(|(_, _, mark)| was_published(mark));
        self.taken.extend(dropped);
        dropped.is_some()
    }

    /// Whether `session` marks the events of our journal.
    pub(super) fn is_ours(&self, session: &str) -> bool {
        self.session.as_deref() == Some(session)
    }

    /// The broker acknowledged the event with this number.
    pub(super) fn acknowledged(&mut self, seq: u64) {
        if self.waiting.acknowledged(seq) {
            self.taken.push_back(seq);
        }
    }

    /// The broker refuses the event with this number. True if it is given up: it stays in the journal, marked as not to
    /// be published any more.
    pub(super) fn refused(&mut self, at: MonoTime, seq: u64, refusal: PublicationRefusal) -> bool {
        let is_given_up = self.waiting.refused(at, seq, refusal).is_some();
        if is_given_up {
            self.taken.push_back(seq);
        }
        is_given_up
    }

    /// When one that was refused is sent again.
    pub(super) fn wake(&self, may: impl Fn(&EventMark) -> bool) -> Option<MonoTime> {
        self.waiting.again_at_of(|(_, _, mark)| may(mark))
    }

    /// The next request or report to the journal.
    pub(super) fn next_act(&mut self) -> Option<SessionAct> {
        if let Some(seq) = self.taken.pop_front() {
            return Some(SessionAct::EventTaken(seq));
        }
        let asks = self.wants && !self.is_asked && self.waiting.len() <= IN_FLIGHT_MAX;
        if !asks {
            return None;
        }
        self.wants = false;
        self.is_asked = true;
        Some(SessionAct::WantEvents { after: self.newest })
    }

    /// How many are not acknowledged.
    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }
}

impl MqttSession {
    /// Takes events of the journal.
    pub(super) fn take_stored(&mut self, at: ClockMoment, events: &[StoredEvent], more: bool) {
        let (topics, peer_events) = (&self.topics, &mut self.peer_events);
        let has_pair = self.half.pair().is_some();
        let mut session = None;
        self.stored.take(events, more, |event| {
            let topic = topics.drive(event.drive.as_str(), "trip/event");
            if !has_pair {
                return Some((topic, EventMark::default()));
            }
            let body: Map<String, Value> = serde_json::from_str(&event.body).unwrap_or_default();
            session = body
                .get("session")
                .and_then(Value::as_str)
                .map(str::to_owned);
            let mark = EventMark::of(event.drive.as_str(), &body);
            (!peer_events.take(at.mono, &mark)).then_some((topic, mark))
        });
        self.stored.session = session.or(self.stored.session.take());
        self.count_events();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::ids::Name;

    fn event(seq: u64) -> StoredEvent {
        StoredEvent {
            seq,
            drive: Name::new("pump").unwrap(),
            body: seq.to_string(),
        }
    }

    fn place() -> Option<(String, EventMark)> {
        Some((String::new(), EventMark::default()))
    }

    /// The journal returns this many of its `kept` events after `after`.
    fn answer(stored: &mut StoredEvents, kept: &[u64], after: u64, most: usize) {
        let behind: Vec<_> = kept
            .iter()
            .filter(|seq| **seq > after)
            .map(|seq| event(*seq))
            .collect();
        let given = behind.get(..most.min(behind.len())).unwrap();
        stored.take(given, given.len() < behind.len(), |_| place());
    }

    fn wanted(stored: &mut StoredEvents) -> Option<u64> {
        stored.next_act().map(|act| {
            if let SessionAct::WantEvents { after } = act {
                after
            } else {
                panic!("{act:?}")
            }
        })
    }

    fn sent(stored: &mut StoredEvents) -> Vec<u64> {
        std::iter::from_fn(|| stored.next(MonoTime::ZERO, |_| true).map(|(_, _, seq)| seq))
            .collect()
    }

    #[test]
    fn it_asks_when_there_is_room_and_never_twice_for_one_answer() {
        let mut stored = StoredEvents::default();
        let kept = (1..=100).collect::<Vec<_>>();
        assert_eq!(wanted(&mut stored), None, "no way is open");
        stored.opened();
        assert_eq!((wanted(&mut stored), wanted(&mut stored)), (Some(0), None));
        answer(&mut stored, &kept, 0, 16);
        assert_eq!(
            wanted(&mut stored),
            Some(16),
            "there is room for the next ones"
        );
        answer(&mut stored, &kept, 16, 100);
        assert_eq!(
            (stored.len(), stored.newest),
            (WAITING_MAX, 64),
            "the rest stays where it is"
        );
        assert_eq!(wanted(&mut stored), None, "no room");
        assert_eq!(sent(&mut stored), (1..=16).collect::<Vec<_>>());
        (1..=48).for_each(|seq| {
            stored.acknowledged(seq);
            sent(&mut stored);
        });
        let acts: Vec<_> = std::iter::from_fn(|| stored.next_act()).collect();
        let taken = (1..=48).map(SessionAct::EventTaken);
        assert_eq!(
            acts,
            taken
                .chain([SessionAct::WantEvents { after: 64 }])
                .collect::<Vec<_>>()
        );
    }

    #[test]
    fn what_was_not_asked_for_is_a_bell() {
        let mut stored = StoredEvents::default();
        stored.take(&[event(7)], false, |_| place());
        assert_eq!(stored.len(), 0);
        stored.opened();
        assert_eq!(wanted(&mut stored), Some(0));
        stored.take(&[], false, |_| place());
        assert_eq!(wanted(&mut stored), None, "the want stays open");
        stored.take(&[event(7), event(9)], false, |_| place());
        assert_eq!((stored.len(), wanted(&mut stored)), (2, Some(9)));
        stored.take(&[event(7), event(9)], false, |_| place());
        assert_eq!(
            (stored.len(), wanted(&mut stored)),
            (2, Some(9)),
            "none twice"
        );
        stored.take(&[], true, |_| place());
        stored.lost();
        assert_eq!((wanted(&mut stored), sent(&mut stored)), (None, vec![7, 9]));
        stored.opened();
        assert_eq!(wanted(&mut stored), Some(9));
    }
}
