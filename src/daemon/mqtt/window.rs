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
pub struct Window {
    /// Packets in the connection's queue.
    queued: usize,
    /// Tokens of publications in that queue that will be acknowledged, in order.
    waiting: VecDeque<Option<u64>>,
    /// Tokens of those that were sent.
    sent: HashMap<u16, Option<u64>>,
}

impl Window {
    /// Whether the queue has room for another packet.
    pub const fn has_room(&self) -> bool {
        self.queued < QUEUE_MAX
    }

    /// Whether everything queued was sent.
    pub const fn is_empty(&self) -> bool {
        self.queued == 0
    }

    /// Counts a queued publication.
    pub fn queue_publication(&mut self, qos: Qos, token: Option<u64>) {
        self.queued += 1;
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
        if identifier != 0 {
            let token = self.waiting.pop_front().flatten();
            self.sent.insert(identifier, token);
        }
    }

    /// Another packet was sent.
    pub const fn other_left(&mut self) {
        self.queued = self.queued.saturating_sub(1);
    }

    /// The publication with this identifier is settled. Returns its token.
    pub fn settle(&mut self, identifier: u16) -> Option<u64> {
        self.sent.remove(&identifier).flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn acknowledgements_in_any_order_find_their_token() {
        let mut window = Window::default();
        window.queue_publication(Qos::AtLeastOnce, Some(10));
        window.queue_publication(Qos::AtMostOnce, None);
        window.queue_publication(Qos::AtLeastOnce, None);
        window.queue_publication(Qos::AtLeastOnce, Some(12));
        for identifier in [1, 0, 2, 3] {
            window.publication_left(identifier);
        }
        assert_eq!(window.settle(3), Some(12));
        assert_eq!(window.settle(2), None);
        assert_eq!(window.settle(1), Some(10));
        assert_eq!(window.settle(1), None, "once");
    }

    #[test]
    fn an_identifier_that_is_used_again_stands_for_the_new_token() {
        let mut window = Window::default();
        for token in [1, 2] {
            window.queue_publication(Qos::AtLeastOnce, Some(token));
        }
        window.publication_left(1);
        assert_eq!(window.settle(1), Some(1));
        window.publication_left(1);
        assert_eq!(window.settle(1), Some(2));
    }

    #[test]
    fn it_is_bounded() {
        let mut window = Window::default();
        for _ in 0..QUEUE_MAX {
            assert!(window.has_room());
            window.queue_other();
        }
        assert!(!window.has_room());
        window.other_left();
        assert!(window.has_room());
    }
}
