//! What the broker keeps from the session: packets above its limit, retained messages, and clients that are gone.

use super::session::MqttSession;
use super::types::LeaseMode;
use crate::north::broker::{OversizedPublication, Publication};

impl MqttSession {
    /// `publication` as this broker accepts it; `None` if it does not. A publication that is too large would end the
    /// connection again and again.
    pub(super) fn admitted(&mut self, mut publication: Publication) -> Option<Publication> {
        let bytes = packet_bytes(&publication);
        let limit = self
            .broker
            .maximum_packet_bytes
            .filter(|most| bytes > *most);
        let is_too_large = limit.is_some();
        match limit {
            Some(limit) => self.oversized.add(OversizedPublication {
                topic: publication.topic.clone(),
                bytes,
                limit,
            }),
            None => self.oversized.published(&publication.topic),
        }
        let is_clearing = publication.retain && publication.payload.is_empty();
        if is_too_large || is_clearing && !self.broker.retains {
            self.counters.too_large += u64::from(is_too_large);
            if let Some(token) = publication.token {
                self.acknowledged(token);
            }
            return None;
        }
        publication.retain &= self.broker.retains;
        Some(publication)
    }

    /// The topic that says that the clients of the broker are gone, while it does and a lease depends on it.
    #[must_use]
    pub fn clients_gone(&self) -> Option<&str> {
        let depends = self.are_commanders_gone && self.settings.lease == LeaseMode::Session;
        if depends {
            self.settings.alive_topic.as_deref()
        } else {
            None
        }
    }

    /// What is not published because it is larger than the broker takes.
    #[must_use]
    pub fn oversized(&self) -> &[OversizedPublication] {
        self.oversized.all()
    }

    /// A publication larger than the broker takes that was not reported yet; each is returned once.
    pub fn next_oversized(&mut self) -> Option<OversizedPublication> {
        self.oversized.next_untold()
    }
}

/// No packet with this publication is larger.
fn packet_bytes(publication: &Publication) -> usize {
    // Fixed header 5, topic length 2, packet identifier 2, properties 4 and in them expiry 5, correlation 3 and more.
    const OTHER_BYTES: usize = 32;
    let correlation = publication.correlation.as_ref().map_or(0, Vec::len);
    publication.topic.len() + publication.payload.len() + correlation + OTHER_BYTES
}
