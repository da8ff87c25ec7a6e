//! The Sparkplug B side without a socket or a clock: the gateway is an edge node, each drive a device.
//!
//! [`Session`] is the whole. Inside it, `topics` knows the topics, `payload` the bytes, `host` whether the primary host is
//! there, `metrics` what there is to tell of a drive and by which names, `content` what each holds, `device` and `node`
//! what is news, `telling` says it in messages, `history` what happened while nobody could be told, `order` what a command
//! says, and `commands` makes it commands of [`broker`](super::broker) and tells how they ended.

mod commands;
mod content;
mod device;
mod history;
mod host;
mod metrics;
mod node;
mod order;
pub mod payload;
mod session;
mod telling;
mod topics;
mod types;

#[cfg(test)]
mod command_tests;
#[cfg(test)]
mod harness;
#[cfg(test)]
mod session_tests;

pub use session::Session;
pub use types::{Act, Counters, Settings};
