//! What the north sides have counted since start, for health and metrics.

use crate::north::modbus::Counters;
use crate::north::modbus::serial::SlaveCounters;
use crate::north::mqtt::Counters as Counts;
use crate::north::sparkplug::Counters as SparkplugCounts;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Counts of the Modbus TCP side over all connections since start.
#[derive(Debug, Default)]
pub struct ModbusTotals {
    connections: AtomicU64,
    accepted: AtomicU64,
    refused: AtomicU64,
    handshakes_failed: AtomicU64,
    closed_early: AtomicU64,
    requests: AtomicU64,
    replies: AtomicU64,
    exceptions: [AtomicU64; Counters::EXCEPTION_CODES],
    attempts_lost: AtomicU64,
    serial: SerialTotals,
}

/// Counts of all serial masters' ports since start.
#[derive(Debug, Default)]
struct SerialTotals {
    requests: AtomicU64,
    not_in_time: AtomicU64,
    late: AtomicU64,
    damaged: AtomicU64,
    foreign: AtomicU64,
    broadcasts: AtomicU64,
    collisions: AtomicU64,
}

impl ModbusTotals {
    /// A connection was accepted.
    pub fn opened(&self) {
        self.connections.fetch_add(1, Ordering::Relaxed);
        self.accepted.fetch_add(1, Ordering::Relaxed);
    }

    /// A connection was refused: not allowed, or one too many.
    pub fn refused(&self) {
        self.refused.fetch_add(1, Ordering::Relaxed);
    }

    /// A TLS handshake failed.
    pub fn handshake_failed(&self) {
        self.handshakes_failed.fetch_add(1, Ordering::Relaxed);
    }

    /// A connection was closed to make room, or because it left too much unread.
    pub fn closed_early(&self) {
        self.closed_early.fetch_add(1, Ordering::Relaxed);
    }

    /// A connection that had been [`Self::opened`] ended. What it counted must have been added before.
    pub fn closed(&self) {
        self.connections.fetch_sub(1, Ordering::Relaxed);
    }

    /// Adds what one connection counted between `before` and `now`.
    pub fn add(&self, before: &Counters, now: &Counters) {
        self.requests.fetch_add(now.requests.wrapping_sub(before.requests), Ordering::Relaxed);
        self.replies.fetch_add(now.replies.wrapping_sub(before.replies), Ordering::Relaxed);
        self.attempts_lost.fetch_add(now.attempts_lost.wrapping_sub(before.attempts_lost), Ordering::Relaxed);
        for (total, (before, now)) in self.exceptions.iter().zip(before.exceptions.iter().zip(&now.exceptions)) {
            total.fetch_add(now.wrapping_sub(*before), Ordering::Relaxed);
        }
    }

    /// Adds what one serial port counted between `before` and `now`.
    pub fn add_serial(&self, before: &SlaveCounters, now: &SlaveCounters) {
        let serial = &self.serial;
        for (total, before, now) in [
            (&serial.requests, before.requests, now.requests),
            (&serial.not_in_time, before.not_in_time, now.not_in_time),
            (&serial.late, before.late, now.late),
            (&serial.damaged, before.damaged, now.damaged),
            (&serial.foreign, before.foreign, now.foreign),
            (&serial.broadcasts, before.broadcasts, now.broadcasts),
            (&serial.collisions, before.collisions, now.collisions),
        ] {
            total.fetch_add(now.wrapping_sub(before), Ordering::Relaxed);
        }
    }

    /// What all serial ports have counted.
    #[must_use]
    pub fn serial(&self) -> SlaveCounters {
        let serial = &self.serial;
        SlaveCounters {
            requests: serial.requests.load(Ordering::Relaxed),
            not_in_time: serial.not_in_time.load(Ordering::Relaxed),
            late: serial.late.load(Ordering::Relaxed),
            damaged: serial.damaged.load(Ordering::Relaxed),
            foreign: serial.foreign.load(Ordering::Relaxed),
            broadcasts: serial.broadcasts.load(Ordering::Relaxed),
            collisions: serial.collisions.load(Ordering::Relaxed),
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

    /// Connections refused so far.
    #[must_use]
    pub fn turned_away(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }

    /// Failed TLS handshakes so far.
    #[must_use]
    pub fn handshakes_failed(&self) -> u64 {
        self.handshakes_failed.load(Ordering::Relaxed)
    }

    /// Connections closed so far to make room, or because they left too much unread.
    #[must_use]
    pub fn dismissed(&self) -> u64 {
        self.closed_early.load(Ordering::Relaxed)
    }

    /// What all connections have counted.
    #[must_use]
    pub fn counters(&self) -> Counters {
        Counters {
            requests: self.requests.load(Ordering::Relaxed),
            replies: self.replies.load(Ordering::Relaxed),
            exceptions: std::array::from_fn(|code| self.exceptions[code].load(Ordering::Relaxed)),
            attempts_lost: self.attempts_lost.load(Ordering::Relaxed),
        }
    }
}

/// State and counts of the MQTT side since start.
pub type MqttTotals = BrokerTotals<Counts>;
/// State and counts of the Sparkplug side since start.
pub type SparkplugTotals = BrokerTotals<SparkplugCounts>;

/// State and counts of a side that talks to the broker.
#[derive(Debug, Default)]
pub struct BrokerTotals<C> {
    path_alive: AtomicBool,
    connects: AtomicU64,
    counters: Mutex<C>,
    takeovers: AtomicU64,
    contested: AtomicBool,
    /// Why there is no connection; `None` once the path was open.
    lost: Mutex<Option<String>>,
}

impl<C: Copy> BrokerTotals<C> {
    /// Sets whether the path through the broker is open, and what the session has counted.
    pub fn set(&self, path_alive: bool, counters: &C) {
        if path_alive && !self.path_alive.swap(true, Ordering::Relaxed) {
            self.connects.fetch_add(1, Ordering::Relaxed);
        } else {
            self.path_alive.store(path_alive, Ordering::Relaxed);
        }
        if path_alive {
            self.lost().take();
        }
        *self.counters.lock().unwrap_or_else(PoisonError::into_inner) = *counters;
    }

    /// Sets why there is no connection, with the broker's address.
    pub fn set_lost(&self, reason: &str) {
        self.lost().replace(reason.to_owned());
    }

    /// Why there is no connection, with the broker's address; `None` if there is one, or if the first is being made.
    #[must_use]
    pub fn lost_reason(&self) -> Option<String> {
        self.lost().clone()
    }

    fn lost(&self) -> MutexGuard<'_, Option<String>> {
        self.lost.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets whether another client contests our identifier.
    pub fn contested(&self, contested: bool) {
        self.takeovers.fetch_add(u64::from(contested), Ordering::Relaxed);
        self.contested.store(contested, Ordering::Relaxed);
    }

    /// Whether another client contests our identifier.
    #[must_use]
    pub fn is_contested(&self) -> bool {
        self.contested.load(Ordering::Relaxed)
    }

    /// Connections that ended because another client has our identifier.
    #[must_use]
    pub fn takeovers(&self) -> u64 {
        self.takeovers.load(Ordering::Relaxed)
    }

    /// Whether the path through the broker is open.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        self.path_alive.load(Ordering::Relaxed)
    }

    /// How often the path was opened.
    #[must_use]
    pub fn connects(&self) -> u64 {
        self.connects.load(Ordering::Relaxed)
    }

    /// What the session has counted.
    #[must_use]
    pub fn counters(&self) -> C {
        *self.counters.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
