//! A fleet of gateways on a real broker, for sizing: many connections that publish as gateways do, consumers that check what
//! arrives, and an end that comes by itself.
//!
//! [`run`] is the order of it. Each gateway and each consumer is a [`Talk`](vfd_gateway::daemon::mqtt::Talk) on the same client that the
//! gateway itself has, so that its waits, limits and repeats are the real ones.

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
    /// How many publish what, and when.
    pub shape: Shape,
    /// Quality of service of the updates.
    pub qos: Qos,
    /// Whether the broker keeps the newest update of each drive.
    pub retain: bool,
    /// How long it may keep it (MQTT 5).
    pub expiry: Option<Duration>,
    /// The document of a drive, which each update of its state repeats.
    pub state: Vec<u8>,
    /// How each gateway reaches the broker.
    pub gateways: Vec<ConnectionSettings>,
    /// How each consumer does.
    pub consumers: Vec<ConnectionSettings>,
    /// Who of the consumers gets what.
    pub reading: Reading,
    /// So many gateways connect in a second.
    pub connects_per_second: u32,
    /// Threads for the gateways.
    pub threads: usize,
    /// Longest time for what is still on its way when the last update was due.
    pub drain: Duration,
    /// Other processes whose cost is measured, by their numbers: the broker's.
    pub watched: Vec<u32>,
}

/// Who of several consumers gets what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// Each gets everything.
    All,
    /// The broker deals it out: a shared subscription.
    Shared,
    /// Each has its own gateways.
    Split,
}
