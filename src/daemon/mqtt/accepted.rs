//! A connection that the broker has accepted, and what is sent on it.

use super::counters::{Counters, count};
use super::incident::{NotQueued, Terms, Unfit};
use super::link::Sender;
use super::window::Window;
use crate::north::broker::{Filter, Publication, Qos};
use tokio::time::Instant;

/// What is known about an accepted connection.
pub struct Link {
    pub since: Instant,
    pub sender: Sender,
    pub window: Window,
    pub terms: Terms,
    /// Larger publications go one at a time, and are acknowledged.
    pub alone_above: Option<usize>,
}

impl Link {
    /// Whether another packet may be queued.
    pub fn has_room(&self) -> bool {
        let waits = self.alone_above.is_some_and(|most| self.window.largest_given_bytes() > most);
        self.window.has_room() && !waits
    }

    /// Queues a publication. Returns false if it cannot be sent and was dropped.
    pub fn publish(&mut self, mut publication: Publication, counters: &Counters) -> Result<bool, NotQueued> {
        if let Err(unfit) = self.sender.check(&publication, &self.terms) {
            count(&counters.dropped);
            let topic = &publication.topic;
            let bytes = publication.payload.len();
            match unfit {
                Unfit::TooLarge => {
                    tracing::warn!(
                        topic,
                        bytes,
                        limit = self.terms.packet_max,
                        "publication is too large for the broker; dropped"
                    );
                }
                Unfit::Topic => tracing::warn!(topic, "publication has an invalid topic; dropped"),
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

    pub fn subscribe(&mut self, filters: Vec<Filter>) {
        if self.sender.subscribe(filters).is_ok() {
            self.window.queue_other();
        } else {
            tracing::error!("subscription has an invalid filter; dropped");
        }
    }

    pub fn disconnect(&mut self) {
        self.window.queue_other();
        if self.sender.disconnect().is_err() {
            tracing::debug!("no room to queue DISCONNECT");
        }
    }
}
