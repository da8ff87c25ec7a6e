//! What the HTTP side knows: what the lines show, and counts that the other north sides keep for it.

use crate::daemon::shared::Shared;
use crate::domain::report::LineState;
use crate::domain::time::{MonoTime, WallTime};
use crate::north::modbus::Counters;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// What the HTTP side knows. It is made once, when the gateway starts.
#[derive(Debug)]
pub struct State {
    /// The gateway's name.
    pub gateway: String,
    /// Lines and drives.
    pub shared: Arc<Shared>,
    /// Counts of the Modbus TCP side.
    pub modbus: Arc<ModbusTotals>,
    /// State and counts of the MQTT side; nothing if no broker is configured.
    pub mqtt: Option<Arc<MqttTotals>>,
    /// When the gateway started.
    pub started: MonoTime,
    /// The same moment for people.
    pub started_at: WallTime,
}

impl State {
    /// Whether the gateway does what it is configured for: all lines are open, and the broker is reached if there is
    /// one.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        let lines_are_up = self.shared.lines.iter().all(|line| line.report().state == LineState::Up);
        lines_are_up && self.mqtt.as_ref().is_none_or(|mqtt| mqtt.is_connected())
    }
}

/// Counts of the Modbus TCP side over all connections since start.
#[derive(Debug, Default)]
pub struct ModbusTotals {
    connections: AtomicU64,
    accepted: AtomicU64,
    refused: AtomicU64,
    requests: AtomicU64,
    replies: AtomicU64,
    exceptions: [AtomicU64; Counters::EXCEPTION_CODES],
}

impl ModbusTotals {
    /// A connection was accepted.
    pub fn opened(&self) {
        self.connections.fetch_add(1, Ordering::Relaxed);
        self.accepted.fetch_add(1, Ordering::Relaxed);
    }

    /// A connection was turned away: not allowed, or one too many.
    pub fn refused(&self) {
        self.refused.fetch_add(1, Ordering::Relaxed);
    }

    /// A connection that had been [`Self::opened`] ended. What it counted must have been added before.
    pub fn closed(&self) {
        self.connections.fetch_sub(1, Ordering::Relaxed);
    }

    /// Adds what one connection counted between `before` and `now`.
    pub fn add(&self, before: &Counters, now: &Counters) {
        self.requests.fetch_add(now.requests.wrapping_sub(before.requests), Ordering::Relaxed);
        self.replies.fetch_add(now.replies.wrapping_sub(before.replies), Ordering::Relaxed);
        for (total, (before, now)) in self.exceptions.iter().zip(before.exceptions.iter().zip(&now.exceptions)) {
            total.fetch_add(now.wrapping_sub(*before), Ordering::Relaxed);
        }
    }

    /// Connections that are open now.
    #[must_use]
    pub fn connections(&self) -> u64 {
        self.connections.load(Ordering::Relaxed)
    }

    /// Connections accepted so far.
    #[must_use]
    pub fn accepted(&self) -> u64 {
        self.accepted.load(Ordering::Relaxed)
    }

    /// Connections turned away so far.
    #[must_use]
    pub fn turned_away(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }

    /// Requests, answers that are no exceptions, and exceptions by code, as in [`Counters`].
    #[must_use]
    pub fn counters(&self) -> Counters {
        Counters {
            requests: self.requests.load(Ordering::Relaxed),
            replies: self.replies.load(Ordering::Relaxed),
            exceptions: std::array::from_fn(|code| self.exceptions[code].load(Ordering::Relaxed)),
        }
    }
}

/// State and counts of the MQTT side since start.
#[derive(Debug, Default)]
pub struct MqttTotals {
    connected: AtomicBool,
    connects: AtomicU64,
    received: AtomicU64,
    published: AtomicU64,
    refused_retained: AtomicU64,
}

impl MqttTotals {
    /// The broker was reached, or lost.
    pub fn set_connected(&self, connected: bool) {
        if connected && !self.connected.swap(true, Ordering::Relaxed) {
            self.connects.fetch_add(1, Ordering::Relaxed);
        } else {
            self.connected.store(connected, Ordering::Relaxed);
        }
    }

    /// A message came from the broker.
    pub fn received(&self) {
        self.received.fetch_add(1, Ordering::Relaxed);
    }

    /// A message went to the broker.
    pub fn published(&self) {
        self.published.fetch_add(1, Ordering::Relaxed);
    }

    /// A command was refused because it was retained.
    pub fn refused_retained(&self) {
        self.refused_retained.fetch_add(1, Ordering::Relaxed);
    }

    /// Whether the broker is reached.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        self.connected.load(Ordering::Relaxed)
    }

    /// Times the broker was reached, messages in, messages out, retained commands refused.
    #[must_use]
    pub fn counts(&self) -> [u64; 4] {
        [&self.connects, &self.received, &self.published, &self.refused_retained].map(|it| it.load(Ordering::Relaxed))
    }
}
