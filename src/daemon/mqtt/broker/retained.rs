//! Retained messages.

use super::packet::PublishedMessage;
use super::topic;
use crate::domain::time::MonoTime;
use std::collections::BTreeMap;
use std::ops::Bound;
use std::sync::Arc;
use std::time::Duration;

/// A message, and until when it may be delivered.
#[derive(Clone, Debug)]
pub struct ExpiringMessage {
    pub message: Arc<PublishedMessage>,
    pub expires: Option<MonoTime>,
}

impl ExpiringMessage {
    /// `message`, published at `now`.
    pub fn new(message: PublishedMessage, now: MonoTime) -> Self {
        let expires = message.expiry.map(|span| now + span);
        Self {
            message: Arc::new(message),
            expires,
        }
    }

    /// Whether it has expired.
    pub fn is_expired(&self, now: MonoTime) -> bool {
        self.expires.is_some_and(|it| it <= now)
    }

    /// The remaining seconds, rounded up: 0 would mean expired.
    pub fn seconds_left(&self, now: MonoTime) -> Option<u32> {
        let left = self.expires?.since(now) + Duration::from_nanos(999_999_999);
        Some(u32::try_from(left.as_secs()).unwrap_or(u32::MAX))
    }
}

/// The last retained message of each topic.
#[derive(Debug)]
pub struct RetainedMessages {
    kept: BTreeMap<Arc<str>, (ExpiringMessage, u64)>,
    bytes: usize,
    count_max: usize,
    bytes_max: usize,
    /// The number of messages kept so far.
    number: u64,
}

impl RetainedMessages {
    pub const fn new(count_max: usize, bytes_max: usize) -> Self {
        Self {
            kept: BTreeMap::new(),
            bytes: 0,
            count_max,
            bytes_max,
            number: 0,
        }
    }

    /// Keeps `post` in place of the earlier message of its topic; one without a payload only removes that. Returns
    /// whether there was room.
    pub fn set(&mut self, post: &ExpiringMessage) -> bool {
        self.remove(&post.message.topic);
        if post.message.payload.is_empty() {
            return true;
        }
        let weight = post.message.weight();
        if self.kept.len() >= self.count_max || self.bytes + weight > self.bytes_max {
            return false;
        }
        self.bytes += weight;
        self.number += 1;
        self.kept
            .insert(Arc::clone(&post.message.topic), (post.clone(), self.number));
        true
    }

    /// How many were kept so far: all messages kept from now on have a higher number.
    pub const fn number(&self) -> u64 {
        self.number
    }

    /// The next message for `filter` after the topic `after`, of those that existed at `number`.
    pub fn next(
        &self,
        filter: &str,
        after: Option<&Arc<str>>,
        number: u64,
        now: MonoTime,
    ) -> Option<&ExpiringMessage> {
        let literal = topic::literal(filter);
        let from = match after {
            Some(topic) => Bound::Excluded(&**topic),
            None => Bound::Included(literal),
        };
        let from = self.kept.range::<str, _>((from, Bound::Unbounded));
        let mut here = from.take_while(|(topic, _)| topic.starts_with(literal));
        let fits = |topic: &str, post: &ExpiringMessage, kept_as: u64| {
            kept_as <= number && !post.is_expired(now) && topic::matches(filter, topic)
        };
        here.find(|(topic, (post, kept_as))| fits(topic, post, *kept_as))
            .map(|(_, (post, _))| post)
    }

    /// Removes expired messages.
    pub fn sweep(&mut self, now: MonoTime) {
        let over = self.kept.values().filter(|(post, _)| post.is_expired(now));
        let over: Vec<Arc<str>> = over
            .map(|(post, _)| Arc::clone(&post.message.topic))
            .collect();
        for topic in over {
            self.remove(&topic);
        }
    }

    fn remove(&mut self, topic: &str) {
        if let Some((post, _)) = self.kept.remove(topic) {
            self.bytes -= post.message.weight();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::packet::PacketQos;
    use super::*;

    fn post(topic: &str, payload: &str, expiry: Option<u64>) -> ExpiringMessage {
        let message = PublishedMessage {
            topic: topic.into(),
            payload: payload.into(),
            qos: PacketQos::AtLeastOnce,
            retain: true,
            expiry: expiry.map(Duration::from_secs),
            properties: Vec::new(),
        };
        ExpiringMessage::new(message, MonoTime::ZERO)
    }

    fn topics(
        retained: &RetainedMessages,
        filter: &str,
        number: u64,
        now: MonoTime,
    ) -> Vec<String> {
        let mut found = Vec::new();
        let mut after = None;
        while let Some(post) = retained.next(filter, after.as_ref(), number, now) {
            after = Some(Arc::clone(&post.message.topic));
            found.push(post.message.topic.to_string());
        }
        found
    }

    #[test]
    fn what_was_there_is_found_by_its_filter() {
        let mut retained = RetainedMessages::new(100, 1_000_000);
        for topic in ["a", "a/b", "a/b/c", "ab", "b/b", "$SYS/b"] {
            assert!(retained.set(&post(topic, "x", None)));
        }
        let find = |filter: &str| topics(&retained, filter, retained.number(), MonoTime::ZERO);
        assert_eq!(find("a/#"), ["a", "a/b", "a/b/c"]);
        assert_eq!(find("+/b"), ["a/b", "b/b"]);
        assert_eq!(find("a"), ["a"]);
        assert_eq!(find("#").len(), 5);
        assert_eq!(find("$SYS/#"), ["$SYS/b"]);
        let number = retained.number();
        retained.set(&post("a/b", "newer", None));
        retained.set(&post("a", "", None));
        assert_eq!(
            topics(&retained, "a/#", number, MonoTime::ZERO),
            ["a/b/c"],
            "what came later comes live"
        );
    }

    #[test]
    fn there_is_a_bound_and_what_is_over_is_gone() {
        let mut retained = RetainedMessages::new(2, 1_000);
        assert!(retained.set(&post("a", "x", Some(10))) && retained.set(&post("b", "x", None)));
        assert!(!retained.set(&post("c", "x", None)), "no room");
        assert!(retained.set(&post("b", "y", None)), "in its own place");
        assert!(
            !retained.set(&post("b", &"y".repeat(1_000), None)),
            "too many bytes"
        );
        assert!(retained.set(&post("b", "y", None)));
        let later = MonoTime::from_millis(10_000);
        assert_eq!(topics(&retained, "#", u64::MAX, later), ["b"]);
        retained.sweep(later);
        assert!(
            retained.set(&post("c", "x", None)),
            "the place of what is over is free"
        );
        assert_eq!(
            post("a", "x", Some(10)).seconds_left(MonoTime::from_millis(1)),
            Some(10)
        );
        assert_eq!(
            post("a", "x", Some(10)).seconds_left(MonoTime::from_millis(9_999)),
            Some(1)
        );
    }
}
