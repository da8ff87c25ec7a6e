//! The MQTT side of the daemon: a connection to the broker that is built anew after every error, and a broker for
//! trying out.
//!
//! [`client`] carries out what a [`Talk`] wants: it keeps a connection, hands over what comes, sends what is due.
//! What is said and what it means is decided elsewhere.

mod accepted;
mod backoff;
pub mod broker;
pub mod broker_child;
pub mod client;
mod counters;
mod exchange;
mod incident;
mod link;
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

pub use client::converse;
pub use counters::Counters;
pub use retry::Rival;
pub use settings::{ConnectionSettings, Keeps, Secret, TlsSettings};
pub use tls::{TlsError, check as check_tls};

use crate::domain::time::MonoTime;
use crate::north::broker::{Event, Filter, Publication};
use crate::north::clock::Moment;

/// The one who talks with the broker, without a socket: the MQTT session and what it looks at.
///
/// Commands that a message carries are carried out within [`handle`](Self::handle) and [`tick`](Self::tick), never
/// within [`next_packet`](Self::next_packet): that is not called while the way to the broker is full, and a STOP
/// waits for no publication.
pub trait Talk {
    /// What is to be done before the next connection, beside the runtime; nothing for most. It is asked before every
    /// connection, and waited for.
    fn chore(&mut self) -> Option<Chore> {
        None
    }
    /// The last attempt to connect ended before anything of ours can have reached the broker.
    fn unsent(&mut self) {}
    /// What the broker shall publish when the connection breaks. Asked before every connection.
    fn will(&self) -> Publication;
    /// Takes what happened on the connection. [`Event::Lost`] comes only after [`Event::Connected`].
    fn handle(&mut self, at: Moment, event: Event<'_>);
    /// Lets time pass, and looks at what has changed since: pictures, answers of the lines.
    fn tick(&mut self, at: Moment);
    /// When it wants its next tick; nothing: not before something happens.
    fn next_wake(&self) -> Option<MonoTime>;
    /// The next thing for the broker. It is asked only while there is room for it; what it gives while there is no
    /// connection is dropped.
    fn next_packet(&mut self, at: Moment) -> Option<Packet>;
    /// Another client has our identifier at the broker, and the connection ended for that; nothing: it has not been so
    /// for a minute.
    fn contested(&mut self, rival: Option<Rival>);
    /// The last words before an orderly end.
    fn farewell(&mut self, at: Moment) -> Vec<Publication>;
    /// Whether the broker is to publish the will behind the last words too, where the protocol has that: with MQTT 5.
    fn leaves_will(&self) -> bool {
        false
    }
}

/// Something that may take its time.
pub type Chore = Box<dyn FnOnce() + Send>;

/// Something for the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Packet {
    /// Subscribe to these filters at quality of service 1, all in one packet. With MQTT 5 no retained messages are
    /// sent at that but for filters that want them, and the retain flag arrives as it was published.
    Subscribe(Vec<Filter>),
    /// Publish. One that is too large for the broker or has an impossible topic is dropped, logged and counted.
    Publish(Publication),
    /// Drop the connection and make a new one, for this reason.
    Reconnect(&'static str),
    /// The same after the last words: an orderly end, which the broker publishes no will for unless
    /// [`Talk::leaves_will`].
    Leave(&'static str),
}
