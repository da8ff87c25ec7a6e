//! What the connection to the broker has gone through.

use std::cell::{Cell, RefCell};

/// Counts since the start.
#[derive(Debug, Default)]
pub struct Counters {
    /// Connections that the broker accepted.
    pub connected: Cell<u64>,
    /// Attempts that failed, and connections that broke.
    pub broken: Cell<u64>,
    /// Why the last of these did.
    pub reason: RefCell<String>,
    /// Messages that came.
    pub received: Cell<u64>,
    /// Publications that went out.
    pub published: Cell<u64>,
    /// Publications that the broker refused (MQTT 5).
    pub refused: Cell<u64>,
    /// Publications that were too large for the broker or had an impossible topic.
    pub dropped: Cell<u64>,
}

/// One more.
pub fn count(counter: &Cell<u64>) {
    counter.set(counter.get() + 1);
}
