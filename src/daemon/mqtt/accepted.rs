//! A connection that the broker has accepted, and what is sent on it.

use super::counters::{ClientCounters, count};
use super::incident::{BrokerTerms, NotQueued, UnfitPublication};
use super::link::RequestSender;
use super::window::SendWindow;
use crate::north::broker::{Publication, Qos, SubscriptionFilter};
use tokio::time::Instant;

/// What is known about an accepted connection.
pub struct AcceptedLink {
    pub since: Instant,
    pub sender: RequestSender,
    pub window: SendWindow,
    pub terms: BrokerTerms,
    /// Larger publications go one at a time, and are acknowledged.
    pub alone_above: Option<usize>,
    /// Subscriptions that the broker has not answered, and its answer to those before them.
    unanswered: usize,
    granted: Vec<bool>,
}

/// Bytes of the filters in one subscription, at most, unless one alone has more: a broker that limits packets takes that.
const FILTERS_BYTES_MAX: usize = 400;

impl AcceptedLink {
    /// A connection that was accepted on these terms.
    pub fn new(
        sender: RequestSender,
        since: Instant,
        terms: BrokerTerms,
        alone_above: Option<usize>,
    ) -> Self {
        Self {
            since,
            sender,
            window: SendWindow::default(),
            terms,
            alone_above,
            unanswered: 0,
            granted: Vec::new(),
        }
    }

    /// Whether another packet may be queued.
    pub fn has_room(&self) -> bool {
        let waits = self
            .alone_above
            .is_some_and(|most| self.window.largest_given_bytes() > most);
        self.window.has_room() && !waits
    }

    /// Queues a publication. Returns false if it cannot be sent and was dropped.
    pub fn publish(
        &mut self,
        mut publication: Publication,
        counters: &ClientCounters,
    ) -> Result<bool, NotQueued> {
        if let Err(unfit) = self.sender.check(&publication, &self.terms) {
            count(&counters.dropped);
            let topic = &publication.topic;
            let bytes = publication.payload.len();
            match unfit {
                UnfitPublication::TooLarge => {
                    tracing::warn!(
                        topic,
                        bytes,
                        limit = self.terms.packet_max,
                        "publication is too large for the broker; dropped"
                    );
                }
                UnfitPublication::Topic => {
                    tracing::warn!(topic, "publication has an invalid topic; dropped")
                }
            }
            return Ok(false);
        }
        // A broker without retained messages closes the connection of a client that requests them.
        publication.retain &= self.terms.broker.retains;
        let bytes = self.sender.packet_bytes(&publication);
        if self.alone_above.is_some_and(|most| bytes > most) {
            publication.qos = Qos::AtLeastOnce;
        }
        let qos = publication.qos;
        let token = publication.token;
        self.sender.publish(publication)?;
        self.window.queue_publication(qos, token, bytes);
        Ok(true)
    }

    /// Queues a subscription of all `filters`, in as many packets as a small limit of the broker needs.
    pub fn subscribe(&mut self, filters: Vec<SubscriptionFilter>) {
        (self.unanswered, self.granted) = (0, Vec::new());
        let mut rest = filters.into_iter().peekable();
        while rest.peek().is_some() {
            let mut bytes = 0;
            let mut part = Vec::new();
            while let Some(filter) =
                rest.next_if(|it| part.is_empty() || bytes + it.path.len() <= FILTERS_BYTES_MAX)
            {
                bytes += filter.path.len();
                part.push(filter);
            }
            if self.sender.subscribe(part).is_err() {
                tracing::error!("subscription has an invalid filter; dropped");
                return;
            }
            self.unanswered += 1;
            self.window.queue_other();
        }
    }

    /// The broker has answered a part of the subscription. Returns the answer to all of it, once that is complete.
    pub fn subscribed(&mut self, granted: Vec<bool>) -> Option<Vec<bool>> {
        self.granted.extend(granted);
        self.unanswered = self.unanswered.saturating_sub(1);
        (self.unanswered == 0).then(|| std::mem::take(&mut self.granted))
    }

    pub fn disconnect(&mut self) {
        self.window.queue_other();
        if self.sender.disconnect().is_err() {
            tracing::debug!("no room to queue DISCONNECT");
        }
    }
}
