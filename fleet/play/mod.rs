//! A fleet of gateways on a real broker, for sizing: many connections that publish as gateways do, and consumers that
//! check what arrives. It ends by itself.
//!
//! [`run`] is the sequence. Each gateway and each consumer is a [`BrokerConversation`](vfd_gateway::daemon::mqtt::BrokerConversation) on the
//! gateway's own client, so that its waits, limits and repeats are the real ones.

mod board;
mod consumer;
mod cost;
mod gateway;
mod player;
mod run;

pub use run::{Outcome, Progress, Stage, run};

use crate::books::Shape;
use std::time::Duration;
use vfd_gateway::daemon::mqtt::ConnectionSettings;
use vfd_gateway::north::broker::Qos;

/// What is to be simulated.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The numbers of gateways, drives and updates.
    pub shape: Shape,
    /// Quality of service of the updates.
    pub qos: Qos,
    /// Whether the broker keeps the newest update of each drive.
    pub retain: bool,
    /// How long it may keep it (MQTT 5).
    pub expiry: Option<Duration>,
    /// The document of a drive, which each update of its state contains.
    pub state: Vec<u8>,
    /// How each gateway reaches the broker.
    pub gateways: Vec<ConnectionSettings>,
    /// How each consumer reaches the broker.
    pub consumers: Vec<ConnectionSettings>,
    /// How updates are distributed to consumers.
    pub reading: Reading,
    /// Gateways that connect in a second.
    pub connects_per_second: u32,
    /// Threads for the gateways.
    pub threads: usize,
    /// Longest wait for messages under way after the last update was due.
    pub drain: Duration,
    /// Ids of other processes whose cost is measured, such as the broker.
    pub watched: Vec<u32>,
}

/// How updates are distributed to several consumers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// Each gets everything.
    All,
    /// The broker distributes them: a shared subscription.
    Shared,
    /// Each has its own gateways.
    Split,
}
