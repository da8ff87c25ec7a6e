//! Another client that connects to the broker with our identifier.

use super::{BrokerClient, BrokerConversation};
use crate::daemon::mqtt::retry::ClientRival;
use std::time::Duration;

impl<T: BrokerConversation> BrokerClient<'_, T> {
    /// The connection ended because another client has our identifier.
    pub(super) fn contested(&self, rival: ClientRival, wait: Duration) {
        let client_id = self.settings.client_id.as_str();
        match rival {
            ClientRival::Reported => tracing::warn!(
                client_id,
                ?wait,
                "another client uses our identifier at the broker; give each client its own `client_id` in [mqtt]"
            ),
            ClientRival::Suspected => tracing::warn!(
                client_id,
                ?wait,
                "broker closes each connection soon after accepting it; probably another client uses the same identifier \
                 (`client_id` in [mqtt]), otherwise see the broker's log"
            ),
        }
        self.conversation.borrow_mut().contested(Some(rival));
    }

    /// Reports when the identifier has been ours alone for long enough.
    pub(super) fn settle(&mut self) {
        if let Some(life) = self.life()
            && self.retry.is_settled(life)
        {
            tracing::info!("no other client uses our identifier any more");
            self.conversation.borrow_mut().contested(None);
        }
    }
}
