//! The connections to the broker, each made again after every error, and the embedded broker.
//!
//! [`client`] serves a [`BrokerConversation`]: it keeps a connection, hands over what arrives, and sends what is due. The
//! contents are decided elsewhere: [`speaker`] carries out a session of [`north::broker`](crate::north::broker).
//!
//! The MQTT side and the Sparkplug side have a connection each, with its own identifier and will: the will of a Sparkplug edge
//! node is NDEATH with the number of that very connection, which `bdseq` gives.

mod accepted;
mod backoff;
mod bdseq;
pub mod broker;
pub mod broker_child;
pub mod client;
mod counters;
mod exchange;
mod incident;
mod link;
mod packet_limit;
mod reason;
mod retry;
mod settings;
pub mod speaker;
mod stream;
mod tls;
mod v4;
mod v5;
mod window;
mod wire;

#[cfg(test)]
mod stub;
#[cfg(test)]
mod tests;

pub use bdseq::BdSeq;
pub use client::converse;
pub use counters::ClientCounters;
pub use retry::ClientRival;
pub use settings::{BrokerKeeps, ConnectionSettings, HiddenText};
pub use tls::{TlsError, check as check_tls};

use crate::domain::time::MonoTime;
use crate::north::broker::{BrokerEvent, Publication, SubscriptionFilter};
use crate::north::clock::ClockMoment;

/// A conversation with the broker, without a socket: a session and the state it reads.
///
/// Commands in messages are executed in [`handle`](Self::handle) and [`tick`](Self::tick), never in
/// [`next_packet`](Self::next_packet): that is not called while the queue to the broker is full, and a STOP must not
/// wait for a publication.
pub trait BrokerConversation {
    /// Blocking work before the next connection; `None` for most. Requested before every connection, which waits for
    /// it.
    fn chore(&mut self) -> Option<Chore> {
        None
    }
    /// The last attempt to connect ended before any bytes of ours can have reached the broker.
    fn unsent(&mut self) {}
    /// Whether there is to be a connection at all. One that exists is ended by [`ClientPacket::Leave`].
    fn wants_connection(&self) -> bool {
        true
    }
    /// What the broker is to publish when the connection breaks. Requested before every connection.
    fn will(&self) -> Publication;
    /// Handles an event of the connection. [`BrokerEvent::Lost`] comes only after [`BrokerEvent::Connected`].
    fn handle(&mut self, at: ClockMoment, event: BrokerEvent<'_>);
    /// Lets time pass, and processes what has changed: views, answers of the lines.
    fn tick(&mut self, at: ClockMoment);
    /// When it needs its next tick; `None` if not before another event.
    fn next_wake(&self) -> Option<MonoTime>;
    /// The next packet for the broker. Called only while there is room for it; a packet without a connection is
    /// dropped.
    fn next_packet(&mut self, at: ClockMoment) -> Option<ClientPacket>;
    /// The connection ended because another client has our identifier at the broker; `None` if that has not happened
    /// for a minute.
    fn contested(&mut self, rival: Option<ClientRival>);
    /// There is no connection, for this reason; the broker's address comes first.
    fn lost(&mut self, _reason: &str) {}
    /// The last messages before an orderly end.
    fn farewell(&mut self, at: ClockMoment) -> Vec<Publication>;
    /// Whether the broker is to publish the will after the last messages, too, where the protocol has that: with MQTT
    /// 5.
    fn leaves_will(&self) -> bool {
        false
    }
}

/// Work that may block.
pub type Chore = Box<dyn FnOnce() + Send>;

/// A packet for the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ClientPacket {
    /// Subscribe to these filters; they are answered together. With MQTT 5 retained messages are sent
    /// only for filters that request them, and the retain flag arrives as it was published.
    Subscribe(Vec<SubscriptionFilter>),
    /// Publish. A publication that is too large for the broker or has an invalid topic is dropped, logged and counted.
    Publish(Publication),
    /// Drop the connection and make a new one, for this reason.
    Reconnect(&'static str),
    /// Drop the connection after the last messages and make a new one, for this reason: an orderly end, after which the
    /// broker publishes no will unless [`BrokerConversation::leaves_will`].
    Leave(&'static str),
}
