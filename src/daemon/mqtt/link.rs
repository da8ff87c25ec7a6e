//! One connection of either protocol version, behind one interface.
//!
//! For one connection only: after an error it is dropped with everything that is still in it.

use super::exchange::Exchange;
use super::incident::{Broken, Incident, NotQueued, Terms, Unfit};
use super::settings::ConnectionSettings;
use super::stream::Target;
use super::v4::{self, V4};
use super::v5::{self, V5};
use super::window::QUEUE_MAX;
use crate::north::broker::{Filter, Publication, Version};
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
pub enum Sender {
    V4(mpsc::Sender<rumqttc::Request>),
    V5(mpsc::Sender<rumqttc::v5::Request>),
}

/// The half that does the work while it is polled.
pub enum Events {
    V4(Box<Exchange<V4>>),
    V5(Box<Exchange<V5>>),
}

/// Prepares a connection. It begins with the first [`Events::next`].
pub fn open(
    settings: &ConnectionSettings,
    will: Publication,
    tls: Option<Arc<ClientConfig>>,
) -> (Sender, Events) {
    let target = Target {
        host: settings.host.clone(),
        port: settings.port,
        tls,
    };
    let keep_alive = settings.keep_alive();
    match settings.version {
        Version::V4 => {
            let (sender, queue) = mpsc::channel(QUEUE_MAX);
            let exchange = Exchange::new(V4::new(settings, will), target, queue, keep_alive);
            (Sender::V4(sender), Events::V4(Box::new(exchange)))
        }
        Version::V5 => {
            let (sender, queue) = mpsc::channel(QUEUE_MAX);
            let exchange = Exchange::new(V5::new(settings, will), target, queue, keep_alive);
            (Sender::V5(sender), Events::V5(Box::new(exchange)))
        }
    }
}

impl Sender {
    /// Whether the publication may be sent under these terms.
    pub fn check(&self, publication: &Publication, terms: &Terms) -> Result<(), Unfit> {
        let correlation = publication.correlation.as_ref().map_or(0, Vec::len);
        if publication.topic.len() > FIELD_MAX || correlation > FIELD_MAX {
            return Err(Unfit::TooLarge);
        }
        if publication.topic.is_empty() || !rumqttc::valid_topic(&publication.topic) {
            return Err(Unfit::Topic);
        }
        if self.packet_bytes(publication) > terms.packet_max {
            Err(Unfit::TooLarge)
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
    pub fn subscribe(&self, filters: Vec<Filter>) -> Result<(), NotQueued> {
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

impl Events {
    /// Waits for the next incident. Cancel safe. After an error the connection is over.
    pub async fn next(&mut self) -> Result<Incident, Broken> {
        match self {
            Self::V4(exchange) => guarded(exchange.next()).await?,
            Self::V5(exchange) => guarded(exchange.next()).await?,
        }
    }

    /// What was received but not yet returned when the connection ended.
    pub fn rest(&mut self) -> Vec<Incident> {
        match self {
            Self::V4(exchange) => exchange.rest(),
            Self::V5(exchange) => exchange.rest(),
        }
    }
}

/// Catches a panic of the library: bytes from a broker must end no more than their connection.
async fn guarded<F: Future>(future: F) -> Result<F::Output, Broken> {
    let mut future = pin!(future);
    poll_fn(
        |cx| match catch_unwind(AssertUnwindSafe(|| future.as_mut().poll(cx))) {
            Ok(Poll::Pending) => Poll::Pending,
            Ok(Poll::Ready(output)) => Poll::Ready(Ok(output)),
            Err(_) => Poll::Ready(Err(Broken::because("the client library panicked"))),
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
