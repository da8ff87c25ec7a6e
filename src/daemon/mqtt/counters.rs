//! Counters of the connection to the broker.

use std::cell::{Cell, RefCell};

/// Counts since the start.
#[derive(Debug, Default)]
pub struct ClientCounters {
    /// Connections that the broker accepted.
    pub connected: Cell<u64>,
    /// Attempts that failed, and connections that broke.
    pub broken: Cell<u64>,
    /// The reason of the last one.
    pub reason: RefCell<String>,
    /// Messages received.
    pub received: Cell<u64>,
    /// Publications sent.
    pub published: Cell<u64>,
    /// Publications that the broker refused (MQTT 5).
    pub refused: Cell<u64>,
    /// Publications that were too large for the broker or had an invalid topic.
    pub dropped: Cell<u64>,
}

/// Increments `counter`.
pub fn count(counter: &Cell<u64>) {
    counter.set(counter.get() + 1);
}
