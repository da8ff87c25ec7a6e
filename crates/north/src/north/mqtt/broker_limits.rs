//! What the broker does not take: packets above its limit, and retained messages where it keeps none.

use super::session::MqttSession;
use crate::north::broker::Publication;

impl MqttSession {
    /// `publication` as this broker accepts it; `None` if it does not. A publication that is too large would end the
    /// connection again and again.
    pub(super) fn admitted(&mut self, mut publication: Publication) -> Option<Publication> {
        let is_too_large = !self.link.oversized.admits(
            &publication.topic,
            packet_bytes(&publication),
            self.link.limits.maximum_packet_bytes,
        );
        let is_clearing = publication.retain && publication.payload.is_empty();
        if is_too_large || is_clearing && !self.link.limits.retains {
            self.counters.too_large += u64::from(is_too_large);
            if let Some(token) = publication.token {
                self.acknowledged(token);
            }
            return None;
        }
        publication.retain &= self.link.limits.retains;
        Some(publication)
    }
}

/// No packet with this publication is larger.
fn packet_bytes(publication: &Publication) -> usize {
    // Fixed header 5, topic length 2, packet identifier 2, properties 4 and in them expiry 5, correlation 3 and more.
    const OTHER_BYTES: usize = 32;
    let correlation = publication.correlation.as_ref().map_or(0, Vec::len);
    publication.topic.len() + publication.payload.len() + correlation + OTHER_BYTES
}
