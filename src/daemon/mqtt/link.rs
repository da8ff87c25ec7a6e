//! One connection of either protocol version, in words that both have.
//!
//! It is for one connection only: after an error it is dropped with all that is still in it.

use super::exchange::Exchange;
use super::settings::ConnectionSettings;
use super::stream::Target;
use super::v4::{self, V4};
use super::v5::{self, V5};
use super::window::QUEUE_MAX;
use crate::north::mqtt::{Broker, Filter, Message, Publication, Refusal, Version};
use bytes::Bytes;
use rustls::ClientConfig;
use std::future::poll_fn;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::pin;
use std::sync::Arc;
use std::task::Poll;
use std::time::Duration;
use tokio::sync::mpsc;

/// Longest packet that is taken, and sent where the broker names no smaller limit. Nothing of ours comes near it.
pub const PACKET_MAX: usize = 256 * 1024;
/// Publications that wait for their acknowledgement at once.
pub const INFLIGHT_MAX: u16 = 64;
/// Time for name, TCP, TLS and CONNACK together.
pub const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// Longest topic, and longest correlation data: their length is sent in two bytes.
const FIELD_MAX: usize = 65_535;

/// Something that happened on the connection.
#[derive(Debug)]
pub enum Incident {
    /// The broker accepted it.
    Connected(Terms),
    /// The broker answered the subscription.
    Subscribed(Vec<bool>),
    /// A message came.
    Message(Received),
    /// The broker took the publication with this identifier.
    Acknowledged(u16),
    /// The broker answered that it does not take the publication with this identifier, what that means, and why.
    Refused(u16, Refusal, String),
    /// A publication was written to the socket with this identifier; 0: it is not acknowledged.
    PublicationLeft(u16),
    /// A subscription or DISCONNECT was written to the socket.
    OtherLeft,
    /// The broker sent what the protocol forbids: the connection ends, and what came with it is not believed.
    Offence(&'static str),
    /// The broker said something else.
    Heard,
    /// Nothing that matters.
    Nothing,
}

impl Incident {
    /// Whether it proves that the broker is alive.
    pub const fn is_heard(&self) -> bool {
        !matches!(self, Self::PublicationLeft(_) | Self::OtherLeft | Self::Nothing)
    }
}

/// What the broker allows.
#[derive(Clone, Copy, Debug)]
pub struct Terms {
    /// What the session is told.
    pub broker: Broker,
    /// Longest packet that may be sent, in bytes.
    pub packet_max: usize,
    /// The keep-alive that it prescribes; nothing: ours.
    pub keep_alive: Option<Duration>,
}

impl Default for Terms {
    fn default() -> Self {
        let broker = Broker { maximum_packet_bytes: None, retains: true };
        Self { broker, packet_max: PACKET_MAX, keep_alive: None }
    }
}

/// A message, owned.
#[derive(Debug)]
pub struct Received {
    pub topic: String,
    pub payload: Bytes,
    pub retain: bool,
    pub duplicate: bool,
    pub expiry: Option<Duration>,
    pub response_topic: Option<String>,
    pub correlation: Option<Bytes>,
}

impl Received {
    pub fn as_message(&self) -> Message<'_> {
        Message {
            topic: &self.topic,
            payload: &self.payload,
            retain: self.retain,
            duplicate: self.duplicate,
            expiry: self.expiry,
            response_topic: self.response_topic.as_deref(),
            correlation: self.correlation.as_deref(),
        }
    }
}

/// Why a connection is over.
#[derive(Debug)]
pub struct Broken {
    /// For people.
    pub reason: String,
    /// Whether what was read just before is as young as that. It is not if writing had stalled for an unknown time.
    pub is_fresh: bool,
    /// What it tells of the broker.
    pub cause: Cause,
    /// Whether it is certain that the broker has seen no CONNECT of ours.
    pub is_unsent: bool,
}

/// What the end of a connection tells of the broker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// It is not there, or has closed the connection without a word.
    Gone,
    /// It says that another client has our identifier.
    TakenOver,
    /// Nothing.
    Other,
}

impl Broken {
    /// Given up by this side.
    pub fn because(reason: impl Into<String>) -> Self {
        Self { reason: reason.into(), is_fresh: false, cause: Cause::Other, is_unsent: false }
    }

    /// The same before anything was sent.
    pub fn unsent(reason: impl Into<String>) -> Self {
        Self { is_unsent: true, ..Self::because(reason) }
    }
}

/// Why a publication is not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unfit {
    /// It is too large for the broker, or for the protocol.
    TooLarge,
    /// Its topic has wildcards or is empty.
    Topic,
}

/// The way in: a queue that the other half sends from. It never waits.
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

/// The queue was full although it was counted, or the topic is impossible although it was checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotQueued;

/// Prepares a connection. It begins with the first [`Events::next`].
pub fn open(settings: &ConnectionSettings, will: Publication, tls: Option<Arc<ClientConfig>>) -> (Sender, Events) {
    let target = Target { host: settings.host.clone(), port: settings.port, tls };
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

/// The keep-alive as CONNECT has it.
pub fn keep_alive_seconds(settings: &ConnectionSettings) -> u16 {
    u16::try_from(settings.keep_alive().as_secs()).unwrap_or(u16::MAX)
}

/// Whether a broker would take these filters.
pub fn check_filters(filters: &[Filter]) -> Result<(), NotQueued> {
    let are_valid = !filters.is_empty() && filters.iter().all(|filter| rumqttc::valid_filter(&filter.path));
    if are_valid { Ok(()) } else { Err(NotQueued) }
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
        let bytes = match self {
            Self::V4(_) => v4::packet_bytes(publication),
            Self::V5(_) => v5::packet_bytes(publication),
        };
        if bytes > terms.packet_max { Err(Unfit::TooLarge) } else { Ok(()) }
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
    /// What happens next. If it is dropped, the next call continues. After an error the connection is over.
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

/// Catches a panic of the library: bytes of a broker must end no more than the connection they came by.
async fn guarded<F: Future>(future: F) -> Result<F::Output, Broken> {
    let mut future = pin!(future);
    poll_fn(|cx| match catch_unwind(AssertUnwindSafe(|| future.as_mut().poll(cx))) {
        Ok(Poll::Pending) => Poll::Pending,
        Ok(Poll::Ready(output)) => Poll::Ready(Ok(output)),
        Err(_) => Poll::Ready(Err(Broken::because("the client library panicked"))),
    })
    .await
}

/// Bytes of a packet whose part behind the fixed header has `rest` bytes.
pub const fn with_header(rest: usize) -> usize {
    1 + length_bytes(rest) + rest
}

/// Bytes that the protocol's variable-length number takes.
pub const fn length_bytes(length: usize) -> usize {
    match length {
        0..128 => 1,
        128..16_384 => 2,
        16_384..2_097_152 => 3,
        _ => 4,
    }
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
