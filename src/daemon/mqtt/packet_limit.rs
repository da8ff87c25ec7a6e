//! The largest packet that a broker takes, where it does not say so.
//!
//! A broker of MQTT 3.1.1 cannot name its limit: it closes the connection behind a packet that is larger. An
//! acknowledgement proves that everything sent before it was taken. So a connection that ends behind a packet larger
//! than any that was ever taken is suspicious. From then on such packets are sent one at a time, to be acknowledged
//! each. Where that ends the connection twice, the limit is below this one, and no packet of its size is sent again.

use super::incident::{Cause, Terms};

/// No limit below this is believed, in bytes: what is smaller must get through.
const LEAST: usize = 512;
/// This many ends behind one packet are no accident.
const REFUSALS: u32 = 2;
/// Documents change in size by a few bytes. Once a limit is known, it falls in steps of this, so that each of them does
/// not cost a connection.
const STEP: usize = 256;

/// What is known of the limit. It outlives connections.
#[derive(Debug, Default)]
pub struct PacketLimit {
    /// Bytes of the largest packet that was taken.
    taken: usize,
    /// Larger packets are not sent.
    most: Option<usize>,
    /// A connection ended behind a packet larger than `taken`.
    is_doubted: bool,
    /// Connections in a row that ended behind one that was sent alone.
    refusals: u32,
}

impl PacketLimit {
    /// The terms of a broker that accepted a connection, with what was learned.
    pub fn apply(&self, terms: &mut Terms) {
        let Some(most) = self.most else { return };
        terms.packet_max = terms.packet_max.min(most);
        let announced = terms.broker.maximum_packet_bytes.unwrap_or(most);
        terms.broker.maximum_packet_bytes = Some(announced.min(most));
    }

    /// Larger packets are sent one at a time; `None`: any goes.
    pub fn alone_above(&self) -> Option<usize> {
        self.is_doubted.then(|| self.taken.max(LEAST))
    }

    /// Bytes of the largest packet that is sent; `None` while no limit was learned.
    pub const fn most(&self) -> Option<usize> {
        self.most
    }

    /// The broker has taken a packet of this size.
    pub fn taken(&mut self, bytes: usize) {
        if bytes > self.taken {
            self.taken = bytes;
            self.refusals = 0;
        }
    }

    /// A connection ended for `cause`, on which nothing larger than `largest` bytes was sent. Returns whether its size
    /// explains the end.
    pub fn ended(&mut self, cause: Cause, largest: usize) -> bool {
        let is_suspicious = matches!(cause, Cause::Gone | Cause::TooLarge) && largest > self.taken.max(LEAST);
        if !is_suspicious {
            return false;
        }
        // Others may have been sent with the first.
        let was_alone = std::mem::replace(&mut self.is_doubted, true);
        if !was_alone {
            return cause == Cause::TooLarge;
        }
        self.refusals += 1;
        let below = largest - 1;
        match self.most {
            None if self.refusals < REFUSALS && cause != Cause::TooLarge => {}
            None => self.most = Some(below.max(LEAST)),
            Some(_) => self.most = Some((below - below % STEP).max(LEAST).max(self.taken)),
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A broker that takes packets of up to `limit` bytes, and a client that publishes `sizes` on every connection.
    /// Returns the connections until all is as the broker wants it, and what is sent then.
    fn published(limit: usize, sizes: &[usize]) -> (u32, Vec<usize>, PacketLimit) {
        let mut known = PacketLimit::default();
        for connection in 1..100 {
            let mut terms = Terms::default();
            known.apply(&mut terms);
            let sent: Vec<_> = sizes.iter().copied().filter(|bytes| *bytes <= terms.packet_max).collect();
            let refused = sent.iter().position(|bytes| *bytes > limit);
            let Some(refused) = refused else {
                sent.iter().for_each(|bytes| known.taken(*bytes));
                return (connection, sent, known);
            };
            // What is sent in one piece is not acknowledged before the end, what goes alone is.
            let (acknowledged, last) = match known.alone_above() {
                None => (&[][..], *sent.iter().max().unwrap()),
                Some(_) => (&sent[..refused], sent[refused]),
            };
            acknowledged.iter().for_each(|bytes| known.taken(*bytes));
            known.ended(Cause::Gone, last);
        }
        panic!("it never learns: {known:?}");
    }

    #[test]
    fn the_limit_is_found_in_a_few_connections_and_all_that_fits_is_sent() {
        let sizes = [300, 2_612, 900, 2_600, 2_630, 1_990, 2_590, 700];
        let (connections, sent, known) = published(2_000, &sizes);
        assert_eq!(sent, [300, 900, 1_990, 700]);
        assert!(connections <= 6, "{connections}");
        assert!(known.most.unwrap() >= 1_990 && known.most.unwrap() < 2_590, "{known:?}");
    }

    #[test]
    fn a_broker_without_a_limit_or_with_one_above_all_is_never_restrained() {
        let (connections, sent, known) = published(100_000, &[300, 2_612, 900]);
        assert_eq!((connections, sent.len(), known.most), (1, 3, None));
        let mut known = known;
        for _ in 0..20 {
            assert!(!known.ended(Cause::Gone, 2_612), "a broker that restarts, after it took as much");
        }
        assert_eq!((known.most, known.alone_above()), (None, None));
    }

    #[test]
    fn one_end_is_an_accident_and_a_packet_that_is_taken_later_proves_it() {
        let mut known = PacketLimit::default();
        assert!(!known.ended(Cause::Gone, 3_000), "the first explains nothing");
        assert_eq!(known.alone_above(), Some(LEAST));
        assert!(known.ended(Cause::Gone, 3_000) && known.most.is_none());
        known.taken(3_000);
        assert!(!known.ended(Cause::Gone, 3_000));
        assert!(known.ended(Cause::Gone, 4_000) && known.most.is_none());
        assert!(known.ended(Cause::Gone, 4_000));
        assert_eq!(known.most, Some(3_999));
    }

    #[test]
    fn small_packets_and_other_ends_are_never_suspected() {
        let mut known = PacketLimit::default();
        for _ in 0..10 {
            assert!(!known.ended(Cause::Gone, LEAST) && !known.ended(Cause::Other, 9_000));
            assert!(!known.ended(Cause::TakenOver, 9_000));
        }
        assert_eq!((known.most, known.alone_above()), (None, None));
        let mut known = PacketLimit { is_doubted: true, most: Some(600), ..PacketLimit::default() };
        known.ended(Cause::Gone, 600);
        assert_eq!(known.most, Some(LEAST));
    }

    #[test]
    fn a_broker_that_says_so_is_believed_at_once() {
        let mut known = PacketLimit::default();
        assert!(known.ended(Cause::TooLarge, 3_000), "one of those that were sent");
        assert!(known.ended(Cause::TooLarge, 2_500));
        let mut terms = Terms::default();
        known.apply(&mut terms);
        assert_eq!((terms.packet_max, terms.broker.maximum_packet_bytes), (2_499, Some(2_499)));
    }
}
