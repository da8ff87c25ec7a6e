//! Maps packet identifiers to tokens.
//!
//! The connection chooses identifiers when it takes a publication out of its queue, and reports them in that order.
//! Identifiers are reused, and acknowledgements arrive in any order.

use crate::north::broker::Qos;
use std::collections::{HashMap, VecDeque};

/// Most packets in the connection's queue.
pub const QUEUE_MAX: usize = 64;

/// What this connection has sent and what is acknowledged. A new connection starts with a new one.
#[derive(Debug, Default)]
pub struct SendWindow {
    /// Packets in the connection's queue.
    queued: usize,
    /// The bytes of publications in that queue, in order.
    sizes: VecDeque<usize>,
    /// Tokens of publications in that queue that will be acknowledged, in order.
    waiting: VecDeque<Option<u64>>,
    /// Tokens of those that were sent, each with the bytes of the largest publication up to it.
    sent: HashMap<u16, (Option<u64>, usize)>,
    /// Bytes of the largest publication that was sent.
    largest: usize,
}

/// A publication that is settled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SettledPublication {
    /// Its token.
    pub token: Option<u64>,
    /// The broker has taken publications of up to this many bytes: this one and all before it.
    pub taken_bytes: usize,
}

impl SendWindow {
    /// Whether the queue has room for another packet.
    pub const fn has_room(&self) -> bool {
        self.queued < QUEUE_MAX
    }

    /// Whether everything queued was sent.
    pub const fn is_empty(&self) -> bool {
        self.queued == 0
    }

    /// Bytes of the largest publication that was sent.
    pub const fn largest_bytes(&self) -> usize {
        self.largest
    }

    /// Bytes of the largest publication that was queued or sent.
    pub fn largest_given_bytes(&self) -> usize {
        self.sizes.iter().copied().fold(self.largest, usize::max)
    }

    /// Counts a queued publication of this many bytes.
    pub fn queue_publication(&mut self, qos: Qos, token: Option<u64>, bytes: usize) {
        self.queued += 1;
        self.sizes.push_back(bytes);
        if qos == Qos::AtLeastOnce {
            self.waiting.push_back(token);
        }
    }

    /// Counts another queued packet.
    pub const fn queue_other(&mut self) {
        self.queued += 1;
    }

    /// A publication was sent with this identifier; 0 if it will not be acknowledged.
    pub fn publication_left(&mut self, identifier: u16) {
        self.queued = self.queued.saturating_sub(1);
        self.largest = self.largest.max(self.sizes.pop_front().unwrap_or(0));
        if identifier != 0 {
            let token = self.waiting.pop_front().flatten();
            self.sent.insert(identifier, (token, self.largest));
        }
    }

    /// Another packet was sent.
    pub const fn other_left(&mut self) {
        self.queued = self.queued.saturating_sub(1);
    }

    /// The publication with this identifier is settled.
    pub fn settle(&mut self, identifier: u16) -> SettledPublication {
        let (token, taken_bytes) = self.sent.remove(&identifier).unwrap_or_default();
        SettledPublication { token, taken_bytes }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn acknowledgements_in_any_order_find_their_token() {
        let mut window = SendWindow::default();
        window.queue_publication(Qos::AtLeastOnce, Some(10), 100);
        window.queue_publication(Qos::AtMostOnce, None, 100);
        window.queue_publication(Qos::AtLeastOnce, None, 100);
        window.queue_publication(Qos::AtLeastOnce, Some(12), 100);
        for identifier in [1, 0, 2, 3] {
            window.publication_left(identifier);
        }
        assert_eq!(window.settle(3).token, Some(12));
        assert_eq!(window.settle(2).token, None);
        assert_eq!(window.settle(1).token, Some(10));
        assert_eq!(window.settle(1).token, None, "once");
    }

    #[test]
    fn an_identifier_that_is_used_again_stands_for_the_new_token() {
        let mut window = SendWindow::default();
        for token in [1, 2] {
            window.queue_publication(Qos::AtLeastOnce, Some(token), 100);
        }
        window.publication_left(1);
        assert_eq!(window.settle(1).token, Some(1));
        window.publication_left(1);
        assert_eq!(window.settle(1).token, Some(2));
    }

    #[test]
    fn an_acknowledgement_proves_what_was_sent_before_it() {
        let mut window = SendWindow::default();
        for (qos, bytes) in [
            (Qos::AtMostOnce, 3_000),
            (Qos::AtLeastOnce, 50),
            (Qos::AtMostOnce, 4_000),
        ] {
            window.queue_publication(qos, None, bytes);
        }
        assert_eq!(
            (window.largest_bytes(), window.largest_given_bytes()),
            (0, 4_000)
        );
        for identifier in [0, 1, 0] {
            window.publication_left(identifier);
        }
        assert_eq!(window.settle(1).taken_bytes, 3_000);
        assert_eq!(
            (window.largest_bytes(), window.settle(1)),
            (4_000, SettledPublication::default())
        );
    }

    #[test]
    fn it_is_bounded() {
        let mut window = SendWindow::default();
        for _ in 0..QUEUE_MAX {
            assert!(window.has_room());
            window.queue_other();
        }
        assert!(!window.has_room());
        window.other_left();
        assert!(window.has_room());
    }
}
