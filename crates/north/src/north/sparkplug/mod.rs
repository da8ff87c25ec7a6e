//! The Sparkplug B side without a socket or a clock: the gateway is an edge node, each drive a device.
//!
//! [`SparkplugSession`] is the whole. Inside it, `topics` knows the topics, `payload` the bytes, `host` whether the primary host
//! is online, `metrics` the metrics of a drive and their names, `content` the content of each, `device` and `node` what
//! has changed, `publishing` puts it into messages, `history` keeps what happened while no host could be reached, `order`
//! parses commands, and `commands` turns them into commands of [`broker`](super::broker) and reports their outcomes.

mod commands;
mod content;
mod device;
mod history;
mod host;
mod metrics;
mod node;
mod order;
pub mod payload;
mod publishing;
mod session;
mod topics;
mod types;

#[cfg(test)]
mod command_tests;
#[cfg(test)]
mod harness;
#[cfg(test)]
mod session_tests;
#[cfg(test)]
mod standby_tests;

pub use session::SparkplugSession;
pub use types::{Settings, SparkplugCounters};
