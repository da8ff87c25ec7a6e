//! One connection of either protocol version, behind one interface.
//!
//! For one connection only: after an error it is dropped with everything that is still in it.

use super::exchange::BrokerExchange;
use super::incident::{
    BrokenConnection, BrokerTerms, ConnectionIncident, NotQueued, UnfitPublication,
};
use super::settings::ConnectionSettings;
use super::stream::BrokerTarget;
use super::v4::{self, V4};
use super::v5::{self, V5};
use super::window::QUEUE_MAX;
use crate::north::broker::{MqttVersion, Publication, SubscriptionFilter};
use rustls::ClientConfig;
use std::future::poll_fn;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::pin;
use std::sync::Arc;
use std::task::Poll;
use tokio::sync::mpsc;

/// Longest topic, and longest correlation data: their length is sent in two bytes.
const FIELD_MAX: usize = 65_535;

/// The sending half: a queue that the other half sends from. It never blocks.
#[derive(Debug)]
pub enum RequestSender {
    V4(mpsc::Sender<rumqttc::Request>),
    V5(mpsc::Sender<rumqttc::v5::Request>),
}

/// The half that does the work while it is polled.
pub enum ConnectionEvents {
    V4(Box<BrokerExchange<V4>>),
    V5(Box<BrokerExchange<V5>>),
}

/// Prepares a connection. It begins with the first [`ConnectionEvents::next`].
pub fn open(
    settings: &ConnectionSettings,
    will: Publication,
    tls: Option<Arc<ClientConfig>>,
) -> (RequestSender, ConnectionEvents) {
    let target = BrokerTarget {
        host: settings.host.clone(),
        port: settings.port,
        tls,
    };
    let keep_alive = settings.keep_alive();
    match settings.version {
        MqttVersion::V4 => {
            let (sender, queue) = mpsc::channel(QUEUE_MAX);
            let exchange = BrokerExchange::new(V4::new(settings, will), target, queue, keep_alive);
            (
                RequestSender::V4(sender),
                ConnectionEvents::V4(Box::new(exchange)),
            )
        }
        MqttVersion::V5 => {
            let (sender, queue) = mpsc::channel(QUEUE_MAX);
            let exchange = BrokerExchange::new(V5::new(settings, will), target, queue, keep_alive);
            (
                RequestSender::V5(sender),
                ConnectionEvents::V5(Box::new(exchange)),
            )
        }
    }
}

impl RequestSender {
    /// Whether the publication may be sent under these terms.
    pub fn check(
        &self,
        publication: &Publication,
        terms: &BrokerTerms,
    ) -> Result<(), UnfitPublication> {
        let correlation = publication.correlation.as_ref().map_or(0, Vec::len);
        if publication.topic.len() > FIELD_MAX || correlation > FIELD_MAX {
            return Err(UnfitPublication::TooLarge);
        }
        if publication.topic.is_empty() || !rumqttc::valid_topic(&publication.topic) {
            return Err(UnfitPublication::Topic);
        }
        if self.packet_bytes(publication) > terms.packet_max {
            Err(UnfitPublication::TooLarge)
        } else {
            Ok(())
        }
    }

    /// Bytes of a publication on the wire.
    pub fn packet_bytes(&self, publication: &Publication) -> usize {
        match self {
            Self::V4(_) => v4::packet_bytes(publication),
            Self::V5(_) => v5::packet_bytes(publication),
        }
    }

    /// Queues a publication.
    pub fn publish(&self, publication: Publication) -> Result<(), NotQueued> {
        match self {
            Self::V4(sender) => v4::publish(sender, publication),
            Self::V5(sender) => v5::publish(sender, publication),
        }
    }

    /// Queues a subscription.
    pub fn subscribe(&self, filters: Vec<SubscriptionFilter>) -> Result<(), NotQueued> {
        match self {
            Self::V4(sender) => v4::subscribe(sender, filters),
            Self::V5(sender) => v5::subscribe(sender, filters),
        }
    }

    /// Queues the orderly end.
    pub fn disconnect(&self) -> Result<(), NotQueued> {
        match self {
            Self::V4(sender) => v4::disconnect(sender),
            Self::V5(sender) => v5::disconnect(sender),
        }
    }
}

impl ConnectionEvents {
    /// Waits for the next incident. Cancel safe. After an error the connection is over.
    pub async fn next(&mut self) -> Result<ConnectionIncident, BrokenConnection> {
        match self {
            Self::V4(exchange) => guarded(exchange.next()).await?,
            Self::V5(exchange) => guarded(exchange.next()).await?,
        }
    }

    /// What was received but not yet returned when the connection ended.
    pub fn rest(&mut self) -> Vec<ConnectionIncident> {
        match self {
            Self::V4(exchange) => exchange.rest(),
            Self::V5(exchange) => exchange.rest(),
        }
    }
}

/// Catches a panic of the library: bytes from a broker must end no more than their connection.
async fn guarded<F: Future>(future: F) -> Result<F::Output, BrokenConnection> {
    let mut future = pin!(future);
    poll_fn(
        |cx| match catch_unwind(AssertUnwindSafe(|| future.as_mut().poll(cx))) {
            Ok(Poll::Pending) => Poll::Pending,
            Ok(Poll::Ready(output)) => Poll::Ready(Ok(output)),
            Err(_) => Poll::Ready(Err(BrokenConnection::because(
                "the client library panicked",
            ))),
        },
    )
    .await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_panic_of_the_library_ends_only_the_connection() {
        let panics = async {
            assert!(std::hint::black_box(false), "for this test");
        };
        assert!(guarded(panics).await.is_err());
        assert_eq!(guarded(std::future::ready(7)).await.unwrap(), 7);
    }
}
