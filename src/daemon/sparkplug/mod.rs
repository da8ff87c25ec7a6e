//! The Sparkplug side of the daemon: a second client at the broker, with an identifier, a will and a lifetime of its
//! own.
//!
//! It cannot share the connection of the MQTT side: a connection has one will, and that of a Sparkplug edge node must
//! be NDEATH with the number of that very connection. `speaker` decides what it sends,
//! [`mqtt::converse`](crate::daemon::mqtt::converse) carries it, and `bdseq` numbers the connections.

mod bdseq;
pub mod speaker;

pub use bdseq::BdSeq;
