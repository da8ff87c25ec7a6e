//! What the north sides have counted since start, for health and metrics.

use crate::north::broker::OversizedPublication;
use crate::north::modbus::ConnectionCounters;
use crate::north::modbus::serial::SlaveCounters;
use crate::north::mqtt::MqttCounters;
use crate::north::sparkplug::SparkplugCounters;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

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
    exceptions: [AtomicU64; ConnectionCounters::EXCEPTION_CODES],
    attempts_lost: AtomicU64,
    /// The counts of each serial master that is served.
    serial: ShownCounts<SerialTotals>,
    /// The reads of each listener and serial master that is served.
    reads: ShownCounts<ReadTotals>,
}

/// Counts that are shown for as long as their owners keep them.
#[derive(Debug, Default)]
pub struct ShownCounts<T>(Mutex<Vec<Weak<T>>>);

impl<T> ShownCounts<T> {
    /// Shows `counts` too.
    pub fn show(&self, counts: &Arc<T>) {
        let mut all = self.lock();
        all.retain(|counts| counts.strong_count() > 0);
        all.push(Arc::downgrade(counts));
    }

    /// All counts that their owners still keep, in the order in which they came.
    #[must_use]
    pub fn all(&self) -> Vec<Arc<T>> {
        let mut all = self.lock();
        all.retain(|counts| counts.strong_count() > 0);
        all.iter().filter_map(Weak::upgrade).collect()
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Weak<T>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Counts of the native reads of one listener since it is served.
#[derive(Debug, Default)]
pub struct ReadTotals {
    listener: String,
    from_line: AtomicU64,
    from_memory: AtomicU64,
    age_us: AtomicU64,
    oldest_us: AtomicU64,
}

impl ReadTotals {
    /// The counts of the listener called `listener`.
    #[must_use]
    pub fn new(listener: String) -> Self {
        Self {
            listener,
            ..Self::default()
        }
    }

    /// The name of the listener: its address, or that of the serial master.
    #[must_use]
    pub fn listener(&self) -> &str {
        &self.listener
    }

    /// A read was passed to a line.
    pub fn count_from_line(&self) {
        self.from_line.fetch_add(1, Ordering::Relaxed);
    }

    /// A read was answered from memory, with words of this age.
    pub fn count_from_memory(&self, age: Duration) {
        let age_us = u64::try_from(age.as_micros()).unwrap_or(u64::MAX);
        self.from_memory.fetch_add(1, Ordering::Relaxed);
        self.age_us.fetch_add(age_us, Ordering::Relaxed);
        self.oldest_us.fetch_max(age_us, Ordering::Relaxed);
    }

    /// Reads passed to a line.
    #[must_use]
    pub fn from_line(&self) -> u64 {
        self.from_line.load(Ordering::Relaxed)
    }

    /// Reads answered from memory.
    #[must_use]
    pub fn from_memory(&self) -> u64 {
        self.from_memory.load(Ordering::Relaxed)
    }

    /// The ages of the answers from memory, added up.
    #[must_use]
    pub fn age(&self) -> Duration {
        Duration::from_micros(self.age_us.load(Ordering::Relaxed))
    }

    /// The age of the oldest answer from memory.
    #[must_use]
    pub fn oldest(&self) -> Duration {
        Duration::from_micros(self.oldest_us.load(Ordering::Relaxed))
    }
}

/// Counts of the port of one serial master since it is served, over all times that it was opened.
#[derive(Debug, Default)]
pub struct SerialTotals {
    master: String,
    counters: Mutex<SlaveCounters>,
}

impl SerialTotals {
    /// The counts of the port of `master`.
    #[must_use]
    pub fn new(master: String) -> Self {
        Self {
            master,
            ..Self::default()
        }
    }

    /// The master's name.
    #[must_use]
    pub fn master(&self) -> &str {
        &self.master
    }

    /// Adds what the port counted between `before` and `now`.
    pub fn add(&self, before: &SlaveCounters, now: &SlaveCounters) {
        let mut counters = self.counters.lock().unwrap_or_else(PoisonError::into_inner);
        let all = &mut *counters;
        for (all, before, now) in [
            (&mut all.requests, before.requests, now.requests),
            (&mut all.not_in_time, before.not_in_time, now.not_in_time),
            (&mut all.late, before.late, now.late),
            (&mut all.damaged, before.damaged, now.damaged),
            (&mut all.foreign, before.foreign, now.foreign),
            (&mut all.broadcasts, before.broadcasts, now.broadcasts),
            (&mut all.collisions, before.collisions, now.collisions),
        ] {
            *all += now.wrapping_sub(before);
        }
    }

    /// What the port has counted.
    #[must_use]
    pub fn counters(&self) -> SlaveCounters {
        *self.counters.lock().unwrap_or_else(PoisonError::into_inner)
    }
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
    pub fn add(&self, before: &ConnectionCounters, now: &ConnectionCounters) {
        self.requests.fetch_add(
            now.requests.wrapping_sub(before.requests),
            Ordering::Relaxed,
        );
        self.replies
            .fetch_add(now.replies.wrapping_sub(before.replies), Ordering::Relaxed);
        self.attempts_lost.fetch_add(
            now.attempts_lost.wrapping_sub(before.attempts_lost),
            Ordering::Relaxed,
        );
        for (total, (before, now)) in self
            .exceptions
            .iter()
            .zip(before.exceptions.iter().zip(&now.exceptions))
        {
            total.fetch_add(now.wrapping_sub(*before), Ordering::Relaxed);
        }
    }

    /// Counts of native reads, of each listener and serial master.
    #[must_use]
    pub const fn reads(&self) -> &ShownCounts<ReadTotals> {
        &self.reads
    }

    /// Counts of the ports of serial masters.
    #[must_use]
    pub const fn serial(&self) -> &ShownCounts<SerialTotals> {
        &self.serial
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
    pub fn counters(&self) -> ConnectionCounters {
        ConnectionCounters {
            requests: self.requests.load(Ordering::Relaxed),
            replies: self.replies.load(Ordering::Relaxed),
            exceptions: std::array::from_fn(|code| self.exceptions[code].load(Ordering::Relaxed)),
            attempts_lost: self.attempts_lost.load(Ordering::Relaxed),
        }
    }
}

/// State and counts of the MQTT side since start.
pub type MqttTotals = BrokerTotals<MqttCounters>;
/// State and counts of the Sparkplug side since start.
pub type SparkplugTotals = BrokerTotals<SparkplugCounters>;

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
    /// What is not published because it is larger than the broker takes.
    oversized: Mutex<Vec<OversizedPublication>>,
    /// The topic that says that the clients of the broker are gone; `None` if it does not.
    clients_gone: Mutex<Option<String>>,
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

    /// Sets the topic that says that the clients of the broker are gone.
    pub fn set_clients_gone(&self, topic: Option<&str>) {
        let mut known = self
            .clients_gone
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if known.as_deref() != topic {
            *known = topic.map(str::to_owned);
        }
    }

    /// The topic that says that the clients of the broker are gone; `None` if it does not.
    #[must_use]
    pub fn clients_gone(&self) -> Option<String> {
        self.clients_gone
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// Sets what is not published because it is larger than the broker takes.
    pub fn set_oversized(&self, oversized: &[OversizedPublication]) {
        let mut known = self
            .oversized
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if known.as_slice() != oversized {
            *known = oversized.to_vec();
        }
    }

    /// What is not published because it is larger than the broker takes.
    #[must_use]
    pub fn oversized(&self) -> Vec<OversizedPublication> {
        self.oversized
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
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
        self.takeovers
            .fetch_add(u64::from(contested), Ordering::Relaxed);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_counts_of_a_port_add_up_over_all_its_openings_and_go_with_it() {
        let totals = ModbusTotals::default();
        let panel = Arc::new(SerialTotals::new("panel".to_owned()));
        totals.serial().show(&panel);
        let none = SlaveCounters::default();
        let some = SlaveCounters {
            requests: 3,
            foreign: 1,
            ..none
        };
        panel.add(&none, &some);
        panel.add(
            &some,
            &SlaveCounters {
                requests: 5,
                ..some
            },
        );
        // Opened again, it counts from 0.
        panel.add(&none, &some);
        let plc = Arc::new(SerialTotals::new("plc".to_owned()));
        totals.serial().show(&plc);
        let shown = || {
            let all = totals.serial().all();
            all.iter()
                .map(|it| (it.master().to_owned(), it.counters()))
                .collect::<Vec<_>>()
        };
        let of_panel = SlaveCounters {
            requests: 8,
            foreign: 2,
            ..none
        };
        assert_eq!(
            shown(),
            [("panel".to_owned(), of_panel), ("plc".to_owned(), none)]
        );
        drop(panel);
        assert_eq!(shown(), [("plc".to_owned(), none)]);
    }

    #[test]
    fn the_oldest_answer_from_memory_is_remembered() {
        let reads = ReadTotals::new("127.0.0.1:502".to_owned());
        reads.count_from_line();
        for age_ms in [20, 300, 100] {
            reads.count_from_memory(Duration::from_millis(age_ms));
        }
        assert_eq!((reads.from_line(), reads.from_memory()), (1, 3));
        assert_eq!(
            (reads.age(), reads.oldest()),
            (Duration::from_millis(420), Duration::from_millis(300))
        );
    }
}
