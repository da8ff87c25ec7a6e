//! What is learned of the largest packet that the broker takes.

use super::{BrokerClient, BrokerConversation};
use crate::daemon::host::clock;
use crate::daemon::mqtt::incident::{BrokenConnection, EndCause};

impl<T: BrokerConversation> BrokerClient<'_, T> {
    /// The broker has taken publications of up to this many bytes.
    pub(super) fn took(&mut self, bytes: usize) {
        self.limit.taken(bytes);
        if let Some(link) = &mut self.link {
            link.alone_above = self.limit.alone_above();
        }
    }

    /// The connection is over. Returns why, as far as the size of what was sent on it explains that.
    pub(super) fn judged(&mut self, broken: BrokenConnection) -> BrokenConnection {
        let Some(link) = self.link.take() else {
            return broken;
        };
        let largest = link.window.largest_bytes();
        let before = self.limit.most();
        if !self
            .limit
            .ended(broken.cause, largest, link.since.elapsed(), clock::now())
        {
            return broken;
        }
        if let Some(most) = self.limit.most().filter(|most| Some(*most) != before) {
            let client_id = self.settings.client_id.as_str();
            tracing::warn!(
                client_id,
                bytes = largest,
                limit = most,
                "broker closes the connection behind a packet of this size; larger ones than the limit are not sent"
            );
        }
        BrokenConnection {
            cause: EndCause::TooLarge,
            ..broken
        }
    }
}
