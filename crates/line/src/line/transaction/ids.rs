//! The numbers of transactions, where frames have one.

use std::collections::VecDeque;

/// Most numbers without a reply that are remembered; beyond that the oldest may be used again.
const UNANSWERED_MAX: usize = 1024;

/// Numbers the requests on one connection. A number whose reply is missing is not used again while the connection
/// stands, so that however late the reply comes, it belongs to no other request.
#[derive(Debug, Default)]
pub(super) struct TransactionIds {
    next: u16,
    /// Numbers whose reply has not arrived, oldest first.
    unanswered: VecDeque<u16>,
}

impl TransactionIds {
    /// The next number is `first`.
    pub const fn begin_with(&mut self, first: u16) {
        self.next = first;
    }

    /// A number for a new request.
    pub fn take(&mut self) -> u16 {
        while self.unanswered.contains(&self.next) {
            self.next = self.next.wrapping_add(1);
        }
        let id = self.next;
        self.next = id.wrapping_add(1);
        if self.unanswered.len() >= UNANSWERED_MAX {
            self.unanswered.pop_front();
        }
        self.unanswered.push_back(id);
        id
    }

    /// The reply with the number `id` has arrived.
    pub fn answered(&mut self, id: u16) {
        self.unanswered.retain(|known| *known != id);
    }

    /// The connection is over, and with it all replies. The numbers go on, for a converter whose replies come through
    /// the next connection.
    pub fn connection_is_over(&mut self) {
        self.unanswered.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_without_a_reply_is_not_used_again_on_its_connection() {
        let mut ids = TransactionIds::default();
        ids.begin_with(65_534);
        let taken: Vec<_> = (0..4).map(|_| ids.take()).collect();
        assert_eq!(taken, [65_534, 65_535, 0, 1]);
        [65_534, 0, 1].into_iter().for_each(|id| ids.answered(id));
        for _ in 0..65_533 {
            let id = ids.take();
            assert_ne!(id, 65_535);
            ids.answered(id);
        }
        assert_eq!(ids.take(), 0, "65,535 is left out");
        ids.connection_is_over();
        let seen: Vec<_> = (0..=u16::MAX).map(|_| ids.take()).collect();
        assert!(seen.contains(&65_535));
    }

    #[test]
    fn the_numbers_that_are_remembered_are_bounded() {
        let mut ids = TransactionIds::default();
        for _ in 0..100_000 {
            ids.take();
        }
        assert_eq!(ids.unanswered.len(), UNANSWERED_MAX);
    }
}
