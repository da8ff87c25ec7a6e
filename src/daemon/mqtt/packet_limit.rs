//! The largest packet that a broker takes, where it does not say so.
//!
//! A broker of MQTT 3.1.1 cannot name its limit: it closes the connection behind a packet that is larger. An
//! acknowledgement proves that everything sent before it was taken. So a connection that ends behind a packet larger
//! than any that was ever taken is suspicious. From then on such packets are sent one at a time, to be acknowledged
//! each. Where that ends the connection twice, the limit is below this one, and no packet of its size is sent.
//!
//! What was learned is not for ever: another broker behind the same name, or a new limit, shows itself by connections that
//! end soon after they were made, one after the other, behind a packet that was taken before. And a connection that is made an
//! hour after a limit was learned tries larger packets again, because an accident may have taught it. It is not done on a
//! connection that works, because it ends that if the limit is real.

use super::incident::{BrokerTerms, EndCause};
use crate::domain::time::MonoTime;
use std::time::Duration;

/// No limit below this is believed, in bytes: what is smaller must get through.
const LEAST: usize = 512;
/// This many ends of connections behind one packet are no accident.
const REFUSALS: u32 = 2;
/// This many connections in a row that ended [`SOON`] behind a packet that was taken before: the broker takes less now. Fewer
/// than those that make another client with our identifier suspected.
const FORGETS: u32 = 3;
/// A connection that lasts longer has sent all documents, and did not end for the size of one.
const SOON: Duration = Duration::from_secs(5);
/// A limit is tried again on a connection that is made so long after it was learned.
const TRIED_AGAIN: Duration = Duration::from_secs(3600);
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
    /// Connections in a row that ended soon, behind one that was taken before.
    soon_over: u32,
    /// When `most` was learned last.
    learned_at: MonoTime,
    /// The limit that is tried again.
    tried: Option<usize>,
}

impl PacketLimit {
    /// The terms of a broker that accepted a connection at `now`, with what was learned.
    pub fn apply(&mut self, terms: &mut BrokerTerms, now: MonoTime) {
        if self.most.is_some() && now.since(self.learned_at) >= TRIED_AGAIN {
            self.tried = self.most.take();
        }
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
        self.tried.take_if(|most| bytes > *most);
    }

    /// The broker accepted no connection: it was restarted, which explains the end before.
    pub const fn not_reached(&mut self) {
        self.soon_over = 0;
    }

    /// A connection that was accepted `life` ago ended for `cause` at `now`. Nothing larger than `largest` bytes was sent on
    /// it. Returns whether its size explains the end.
    pub fn ended(
        &mut self,
        cause: EndCause,
        largest: usize,
        life: Duration,
        now: MonoTime,
    ) -> bool {
        let may_be_size = matches!(cause, EndCause::Gone | EndCause::TooLarge) && largest > LEAST;
        if !may_be_size || largest <= self.taken {
            let is_soon = may_be_size && life < SOON;
            self.soon_over = if is_soon { self.soon_over + 1 } else { 0 };
            if self.soon_over >= FORGETS {
                (self.taken, self.is_doubted, self.soon_over) = (0, true, 0);
            }
            return false;
        }
        self.soon_over = 0;
        self.learned_at = now;
        if let Some(most) = self.tried.take() {
            self.most = Some(most);
            return true;
        }
        // Others may have been sent with the first.
        let was_alone = std::mem::replace(&mut self.is_doubted, true);
        if !was_alone {
            return cause == EndCause::TooLarge;
        }
        self.refusals += 1;
        let below = largest - 1;
        match self.most {
            None if self.refusals < REFUSALS && cause != EndCause::TooLarge => {}
            None => self.most = Some(below.max(LEAST)),
            Some(_) => self.most = Some((below - below % STEP).max(LEAST).max(self.taken)),
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOMENT: Duration = Duration::from_millis(50);
    const HOUR: u64 = 3_600_000;

    fn gone(known: &mut PacketLimit, largest: usize) -> bool {
        known.ended(EndCause::Gone, largest, MOMENT, MonoTime::ZERO)
    }

    fn published(limit: usize, sizes: &[usize]) -> (u32, Vec<usize>, PacketLimit) {
        let mut known = PacketLimit::default();
        let (connections, sent) = publish(&mut known, limit, sizes, MonoTime::ZERO);
        (connections, sent, known)
    }

    /// A broker that takes packets of up to `limit` bytes, and a client that publishes `sizes` on every connection.
    /// Returns the connections until all is as the broker wants it, and what is sent then.
    fn publish(
        known: &mut PacketLimit,
        limit: usize,
        sizes: &[usize],
        now: MonoTime,
    ) -> (u32, Vec<usize>) {
        for connection in 1..100 {
            let mut terms = BrokerTerms::default();
            known.apply(&mut terms, now);
            let sent: Vec<_> = sizes
                .iter()
                .copied()
                .filter(|bytes| *bytes <= terms.packet_max)
                .collect();
            let refused = sent.iter().position(|bytes| *bytes > limit);
            let Some(refused) = refused else {
                sent.iter().for_each(|bytes| known.taken(*bytes));
                return (connection, sent);
            };
            // What is sent in one piece is not acknowledged before the end, what goes alone is.
            let (acknowledged, last) = match known.alone_above() {
                None => (&[][..], *sent.iter().max().unwrap()),
                Some(_) => (&sent[..refused], sent[refused]),
            };
            acknowledged.iter().for_each(|bytes| known.taken(*bytes));
            known.ended(EndCause::Gone, last, MOMENT, now);
        }
        panic!("it never learns: {known:?}");
    }

    #[test]
    fn the_limit_is_found_in_a_few_connections_and_all_that_fits_is_sent() {
        let sizes = [300, 2_612, 900, 2_600, 2_630, 1_990, 2_590, 700];
        let (connections, sent, known) = published(2_000, &sizes);
        assert_eq!(sent, [300, 900, 1_990, 700]);
        assert!(connections <= 6, "{connections}");
        assert!(
            known.most.unwrap() >= 1_990 && known.most.unwrap() < 2_590,
            "{known:?}"
        );
    }

    #[test]
    fn a_broker_without_a_limit_or_with_one_above_all_is_never_restrained() {
        let (connections, sent, known) = published(100_000, &[300, 2_612, 900]);
        assert_eq!((connections, sent.len(), known.most), (1, 3, None));
        let mut known = known;
        for _ in 0..20 {
            let is_size = known.ended(EndCause::Gone, 2_612, SOON, MonoTime::ZERO);
            assert!(
                !is_size,
                "a broker that restarts now and then, after it took as much"
            );
        }
        assert_eq!((known.most, known.alone_above()), (None, None));
    }

    #[test]
    fn one_end_is_an_accident_and_a_packet_that_is_taken_later_proves_it() {
        let mut known = PacketLimit::default();
        assert!(!gone(&mut known, 3_000), "the first explains nothing");
        assert_eq!(known.alone_above(), Some(LEAST));
        assert!(gone(&mut known, 3_000) && known.most.is_none());
        known.taken(3_000);
        assert!(!gone(&mut known, 3_000));
        assert!(gone(&mut known, 4_000) && known.most.is_none());
        assert!(gone(&mut known, 4_000));
        assert_eq!(known.most, Some(3_999));
    }

    #[test]
    fn small_packets_and_other_ends_are_never_suspected() {
        let mut known = PacketLimit::default();
        for _ in 0..10 {
            assert!(
                !gone(&mut known, LEAST)
                    && !known.ended(EndCause::Other, 9_000, MOMENT, MonoTime::ZERO)
            );
            assert!(!known.ended(EndCause::TakenOver, 9_000, MOMENT, MonoTime::ZERO));
        }
        assert_eq!((known.most, known.alone_above()), (None, None));
        let mut known = PacketLimit {
            is_doubted: true,
            most: Some(600),
            ..PacketLimit::default()
        };
        gone(&mut known, 600);
        assert_eq!(known.most, Some(LEAST));
    }

    #[test]
    fn a_broker_that_says_so_is_believed_at_once() {
        let mut known = PacketLimit::default();
        assert!(
            known.ended(EndCause::TooLarge, 3_000, MOMENT, MonoTime::ZERO),
            "one of those that were sent"
        );
        assert!(known.ended(EndCause::TooLarge, 2_500, MOMENT, MonoTime::ZERO));
        let mut terms = BrokerTerms::default();
        known.apply(&mut terms, MonoTime::ZERO);
        assert_eq!(
            (terms.packet_max, terms.broker.maximum_packet_bytes),
            (2_499, Some(2_499))
        );
    }

    #[test]
    fn another_broker_behind_the_same_name_that_takes_less_is_found() {
        let sizes = [300, 2_612, 900, 1_990];
        let (_, _, mut known) = published(100_000, &sizes);
        let (connections, sent) = publish(&mut known, 2_000, &sizes, MonoTime::ZERO);
        assert_eq!(sent, [300, 900, 1_990]);
        assert!(connections <= 6, "{connections}");
    }

    #[test]
    fn ends_far_apart_forget_nothing() {
        let (_, _, mut known) = published(100_000, &[2_612]);
        for _ in 0..20 {
            assert!(!gone(&mut known, 2_612) && !gone(&mut known, 2_612));
            assert!(!known.ended(EndCause::Gone, 2_612, SOON, MonoTime::ZERO));
            assert!(!gone(&mut known, 2_612) && !gone(&mut known, 2_612));
            known.not_reached();
        }
        assert_eq!((known.most, known.alone_above()), (None, None));
    }

    #[test]
    fn a_limit_is_tried_again_after_an_hour_and_costs_one_connection_if_it_is_real() {
        let sizes = [300, 2_612, 900];
        let (_, _, mut known) = published(2_000, &sizes);
        let (connections, sent) =
            publish(&mut known, 2_000, &sizes, MonoTime::from_millis(HOUR - 1));
        assert_eq!((connections, sent.as_slice()), (1, [300, 900].as_slice()));
        let (connections, sent) = publish(&mut known, 2_000, &sizes, MonoTime::from_millis(HOUR));
        assert_eq!((connections, sent.as_slice()), (2, [300, 900].as_slice()));
        let (connections, sent) =
            publish(&mut known, 100_000, &sizes, MonoTime::from_millis(2 * HOUR));
        assert_eq!(
            (connections, sent.as_slice()),
            (1, sizes.as_slice()),
            "an accident had taught it"
        );
        assert_eq!(known.most, None);
    }
}
